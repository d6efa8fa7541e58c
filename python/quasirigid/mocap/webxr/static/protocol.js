// The messages; quasirigid/webxr/messages.py has the other half and describes them.
export const JOINTS = ['wrist', ...['metacarpal', 'phalanx-proximal', 'phalanx-distal', 'tip'].map((part) => `thumb-${part}`)];
for (const finger of ['index', 'middle', 'ring', 'pinky']) {
  for (const part of ['metacarpal', 'phalanx-proximal', 'phalanx-intermediate', 'phalanx-distal', 'tip']) {
    JOINTS.push(`${finger}-finger-${part}`);
  }
}
export const SIDES = ['left', 'right'];
const NUMBERS = 8; // per joint: position, quaternion, radius
const HEAD = 16;

/** Room for the joints of both hands, and the message around it: `joints` is (2, 25, 8), a view into `message`. */
export function handsMessage() {
  const message = new ArrayBuffer(HEAD + 4 * SIDES.length * JOINTS.length * NUMBERS);
  new Uint8Array(message).set([0x51, 0x58, 0x48, 0x31]); // QXH1
  const view = new DataView(message);
  return {
    message,
    joints: new Float32Array(message, HEAD),
    stamp(there, milliseconds) {
      view.setUint32(4, there, true);
      view.setFloat64(8, milliseconds / 1000, true);
    },
  };
}

const TYPES = { float32: Float32Array, uint32: Uint32Array, uint16: Uint16Array, uint8: Uint8Array, int8: Int8Array };

/** Header of a packed message, with its arrays in place of where they lie. */
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  for (const [name, [type, offset, items]] of Object.entries(header.arrays)) {
    header.arrays[name] = new TYPES[type](buffer, 4 + length + offset, items);
  }
  return header;
}
