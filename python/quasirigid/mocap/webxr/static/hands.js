// The joints of both hands, frame by frame, and the gesture of the hand that does not grasp.
import { JOINTS, SIDES, handsMessage } from './protocol.js';

const PINCH = 0.02; // m between the tips of thumb and index finger
const HELD = 2000; // ms that the pinch must last

export class HandReader {
  constructor() {
    this.out = handsMessage();
    this.pinchSince = null;
  }

  /** Reads an XRFrame in a reference space. Returns the message to send; `joints` has what it holds. */
  read(frame, space, milliseconds) {
    const { joints } = this.out;
    joints.fill(NaN);
    let there = 0;
    for (const source of frame.session.inputSources) {
      const side = SIDES.indexOf(source.handedness);
      if (!source.hand || side < 0) continue;
      there |= 1 << side;
      JOINTS.forEach((name, i) => {
        const joint = source.hand.get(name);
        const pose = joint && frame.getJointPose(joint, space);
        if (!pose) return;
        const { position: p, orientation: q } = pose.transform;
        joints.set([p.x, p.y, p.z, q.x, q.y, q.z, q.w, pose.radius || 0], 8 * (JOINTS.length * side + i));
      });
    }
    this.out.stamp(there, milliseconds);
    return this.out.message;
  }

  /** Whether the hand of `side` has just pinched for long enough: once per pinch. */
  gesture(side, milliseconds) {
    const at = (name) => 8 * (JOINTS.length * SIDES.indexOf(side) + JOINTS.indexOf(name));
    const [a, b] = [at('thumb-tip'), at('index-finger-tip')];
    const { joints } = this.out;
    const apart = Math.hypot(joints[a] - joints[b], joints[a + 1] - joints[b + 1], joints[a + 2] - joints[b + 2]);
    if (!(apart < PINCH)) {
      this.pinchSince = null; // also where a tip is not seen: NaN
      return false;
    }
    this.pinchSince ??= milliseconds;
    if (milliseconds - this.pinchSince < HELD) return false;
    this.pinchSince = Infinity;
    return true;
  }
}
