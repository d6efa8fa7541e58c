// What goes on, in words and figures with their units: on a board behind the table, and in the panel of the flat page.
import * as THREE from './three.js';

const WORDS = {
  'waiting for the hand': 'Show your hand',
  reach: 'Reach for it',
  touch: 'Touching',
  'put down': 'Put down: let go',
  rest: 'Put down',
  'fallen over': 'Fallen over',
  fall: 'Dropped',
};
const FAILED = ['fallen over', 'fall'];
const [WIDE, HIGH] = [1024, 704]; // in which it is drawn ...
const SHARE = 0.625; // ... at this share of so many pixels
const METRES = 0.24; // width of the board
const EVERY = 300; // ms, at most
const INK = '#1d2430';
const DIM = '#5b6472';
const GOOD = '#00694b';
const BAD = '#b23c00';
const MOST = 10; // N, end of the bars

/** Headline, and a line per finger. */
export function readout(state, fingers) {
  const up = `${Math.round(1000 * state.lifted_m)} mm`;
  return {
    headline: state.phase === 'carry' ? `Held, ${up} up` : (WORDS[state.phase] ?? state.phase),
    mood: state.phase === 'carry' ? GOOD : FAILED.includes(state.phase) ? BAD : INK,
    rows: fingers.map(({ name, css }, i) => {
      const [force, slip] = state.fingers[i] ?? [0, 0];
      const felt = force <= 0.005 ? 'free' : slip > 0.5 ? 'slips' : slip > 0 ? 'sticks, rim slips' : 'sticks';
      return { name, css, force, felt, text: `${force.toFixed(1)} N` };
    }),
    scale: state.scale_pa / 1000,
    time: `${Math.floor(state.time)} s`,
    notice: state.notice,
  };
}

/** A board in the world: stands behind the table and faces who sits before it. */
export class Board {
  constructor(world) {
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [SHARE * WIDE, SHARE * HIGH];
    this.pen = canvas.getContext('2d');
    this.pen.scale(SHARE, SHARE);
    this.texture = new THREE.CanvasTexture(canvas);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    this.texture.generateMipmaps = false;
    this.texture.minFilter = THREE.LinearFilter;
    const plane = new THREE.PlaneGeometry(METRES, (METRES * HIGH) / WIDE);
    this.mesh = new THREE.Mesh(plane, new THREE.MeshBasicMaterial({ map: this.texture, fog: false, toneMapped: false }));
    world.add(this.mesh);
    this.drawn = -Infinity;
    this.said = '';
    this.aside('right');
  }

  /** On the side where the grasping hand is not. */
  aside(hand) {
    const left = hand === 'right' ? 1 : -1;
    this.mesh.position.set(0.22, 0.21 * left, 0.16);
    // Upright, its face to the user (-x), turned and tilted towards the eyes.
    const face = new THREE.Vector3(-1, -0.5 * left, 0.4).normalize();
    const right = new THREE.Vector3(0, 0, 1).cross(face).normalize();
    this.mesh.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(right, face.clone().cross(right), face));
  }

  show(said, colours, now) {
    const key = JSON.stringify(said);
    if (key === this.said || now - this.drawn < EVERY) return;
    this.said = key;
    this.drawn = now;
    this.paint(said, colours);
    this.texture.needsUpdate = true;
  }

  paint(said, colours) {
    const { pen } = this;
    const text = (what, x, y, size, colour, align = 'left', weight = 400) => {
      pen.font = `${weight} ${size}px system-ui, sans-serif`;
      pen.textAlign = align;
      pen.fillStyle = colour;
      pen.fillText(what, x, y);
    };
    pen.fillStyle = '#fbfcfd';
    pen.fillRect(0, 0, WIDE, HIGH);
    text(said.headline, 48, 104, 76, said.mood, 'left', 650);
    text(said.time, WIDE - 48, 104, 44, DIM, 'right');
    // In place of the figures: whose hand is not seen reads these first.
    if (said.notice) return broken(said.notice, 42).forEach((line, i) => text(line, 48, 200 + 58 * i, 44, BAD));
    said.rows.forEach((row, i) => {
      const y = 190 + 66 * i;
      text(row.name, 48, y, 44, INK);
      pen.fillStyle = '#e3e7ed';
      pen.fillRect(240, y - 30, 320, 28);
      pen.fillStyle = row.css;
      pen.fillRect(240, y - 30, 320 * Math.min(1, row.force / MOST), 28);
      text(row.text, 728, y, 44, INK, 'right', 600);
      text(row.felt, 752, y, 36, row.felt === 'slips' ? BAD : DIM);
    });
    const y = HIGH - 118;
    text('pressure', 48, y + 26, 40, INK);
    for (let i = 0; i < 256; i++) {
      pen.fillStyle = `rgb(${colours[3 * i]} ${colours[3 * i + 1]} ${colours[3 * i + 2]})`;
      pen.fillRect(240 + (i * 736) / 256, y - 6, 736 / 256 + 1, 36);
    }
    [0, 0.5, 1].forEach((share, i) => {
      const value = said.scale * share;
      text(`${Number(value.toPrecision(3))}${i ? ' kPa' : ''}`, 240 + 736 * share, y + 72, 36, DIM, ['left', 'center', 'right'][i]);
    });
  }
}

/** Lines of at most so many characters, broken between words. */
function broken(sentence, most) {
  const lines = [''];
  for (const word of sentence.split(' ')) {
    const line = `${lines.at(-1)} ${word}`.trim();
    if (line.length > most) lines.push(word);
    else lines[lines.length - 1] = line;
  }
  return lines;
}
