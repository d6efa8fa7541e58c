// A headset with hands, for tests: `xrDevice(open, closed)` installs it, `xrMove(keys)` moves its right hand.
// The emulator's poses are those of a left hand; it mirrors them for the right one.
const MIRROR = [1, -1, -1, 0, -1, 1, 1, 0, -1, 1, 1, 0, -1, 1, 1, 1];
const RADIUS = 0.008;

window.xrDevice = (open, closed) => {
  const device = new IWER.XRDevice(IWER.metaQuest3);
  device.installRuntime({ forceInstall: true });
  device.primaryInputMode = 'hand';
  device.hands.left.connected = false;
  const pose = (matrices) => ({
    jointTransforms: Object.fromEntries(
      Object.entries(matrices).map(([name, m]) => [name, { offsetMatrix: m.map((x, i) => x * MIRROR[i]), radius: RADIUS }]),
    ),
  });
  device.hands.right[IWER.P_HAND_INPUT].poses = { default: pose(open), pinch: pose(closed) };
  device.position.set(0, 1.2, 0);
  window.device = device;
};

// keys: [seconds, x, y, z, pinch], room; between them the hand moves with minimum jerk.
window.xrMove = (keys) => {
  const begin = performance.now();
  window.xrDone = false;
  const step = () => {
    const t = Math.min((performance.now() - begin) / 1000, keys.at(-1)[0]);
    const next = Math.max(1, keys.findIndex((key) => key[0] >= t));
    const [a, b] = [keys[next - 1], keys[next]];
    const s = (t - a[0]) / (b[0] - a[0]);
    const share = s * s * s * (10 - 15 * s + 6 * s * s);
    const [x, y, z, pinch] = a.slice(1).map((v, i) => v + share * (b[i + 1] - v));
    device.hands.right.position.set(x, y, z);
    device.hands.right.updatePinchValue(Math.min(1, Math.max(0, pinch)));
    if (t < keys.at(-1)[0]) setTimeout(step, 4);
    else window.xrDone = true;
  };
  step();
};
