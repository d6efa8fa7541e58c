// A headset with hands, for tests: `xrDevice(open, closed, side)` installs it, `xrMove(keys)` moves the hand of that side.
// The emulator's poses are those of a left hand, and it mirrors them for the right one: so a hand that is given as a right one becomes
// one of either side, about the middle plane of the room.
const MIRROR = [1, -1, -1, 0, -1, 1, 1, 0, -1, 1, 1, 0, -1, 1, 1, 1];
const RADIUS = 0.008;

window.xrDevice = (open, closed, side = 'right') => {
  const device = new IWER.XRDevice(IWER.metaQuest3);
  device.installRuntime({ forceInstall: true });
  device.primaryInputMode = 'hand';
  const other = side === 'right' ? 'left' : 'right';
  device.hands[other].connected = false;
  const pose = (matrices) => ({
    jointTransforms: Object.fromEntries(
      Object.entries(matrices).map(([name, m]) => [name, { offsetMatrix: m.map((x, i) => x * MIRROR[i]), radius: RADIUS }]),
    ),
  });
  device.hands[side][IWER.P_HAND_INPUT].poses = { default: pose(open), pinch: pose(closed) };
  device.position.set(0, 1.2, 0);
  window.device = device;
  window.grasping = device.hands[side];
  window.resting = device.hands[other];
};

// keys: [seconds, x, y, z, pinch], room; between them the hand moves with minimum jerk, in the time
// of the simulation that the page shows. A busy
// machine draws few frames and simulates slowly: there the motion is slower, not coarser.
const LONGEST = 0.02; // s between two frames

window.xrGap = 0; // the longest time between two places of the hand, s
window.xrMove = (keys) => {
  let t = 0;
  let before = quasirigid.status.time;
  let sent = -1;
  window.xrDone = false;
  const step = () => {
    const now = quasirigid.status.time;
    if (quasirigid.status.sent !== sent && now > before) {
      sent = quasirigid.status.sent;
      t = Math.min(t + Math.min(now - before, LONGEST), keys.at(-1)[0]);
      window.xrGap = Math.max(window.xrGap, now - before);
      before = now;
      const next = Math.max(1, keys.findIndex((key) => key[0] >= t));
      const [a, b] = [keys[next - 1], keys[next]];
      const s = (t - a[0]) / (b[0] - a[0]);
      const share = s * s * s * (10 - 15 * s + 6 * s * s);
      const [x, y, z, pinch] = a.slice(1).map((v, i) => v + share * (b[i + 1] - v));
      grasping.position.set(x, y, z);
      grasping.updatePinchValue(Math.min(1, Math.max(0, pinch)));
    }
    if (t < keys.at(-1)[0]) setTimeout(step, 4);
    else window.xrDone = true;
  };
  step();
};
