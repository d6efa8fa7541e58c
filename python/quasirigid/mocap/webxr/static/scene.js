// Draws the scene in the world's own axes (z up); where the world stands in the room is the pose of `world`.
import * as THREE from './three.js';
import { Arrows } from './arrows.js';
import { Table } from './room.js';

const NEWTON = 0.012; // length of a finger's arrow, m per N, as in the live view
const LONGEST = 0.005; // of the arrows of contacts, m
const LOADED = 3; // of 255: points under less keep the colour of the pad
const GLASS = 0.42; // opacity of what is taken
const SHEER = 0.6; // and of what it stands on, in one's own room
const STATUS = [new THREE.Color('#888888'), new THREE.Color('#0072b2'), new THREE.Color('#e69f00')]; // open, stick, slip
// The world's axes in the room: x away from the user (-z), y to the left (-x), z up (y).
const AXES = new THREE.Quaternion(-0.5, 0.5, 0.5, 0.5);
const NOTHING = [];

export class WorldDrawing {
  constructor(scene) {
    this.world = new THREE.Group();
    scene.add(this.world);
    this.bodies = [];
    this.fingers = [];
    this.table = new Table(this.world);
    this.contacts = new Arrows(this.world, 0.00035, 0.0016);
    this.sums = new Arrows(this.world, 0.0014, 0.009);
    this.states = 0;
    this.through = false;
    this.place([0, 0.75, -0.4], 0);
  }

  place(position, heading) {
    this.world.position.fromArray(position);
    this.world.quaternion.setFromAxisAngle(new THREE.Vector3(0, 1, 0), heading).multiply(AXES);
    this.table.stand(position[1]);
  }

  show(model) {
    for (const body of this.bodies) {
      this.world.remove(body);
      body.geometry.dispose();
      body.material.dispose();
    }
    this.colours = linear(model.arrays.colours);
    this.fingers = model.fingers.map(({ name, colour }) => ({ name, css: colour, colour: new THREE.Color(colour) }));
    this.bodies = model.bodies.map((body, i) => {
      const mesh = solid(body, model.arrays[`points${i}`], model.arrays[`normals${i}`], model.arrays[`faces${i}`]);
      if (body.kind === 'support') sheer(mesh, this.through);
      this.world.add(mesh);
      return mesh;
    });
    this.table.lay(model.floor);
    this.states = 0;
  }

  update(state) {
    const { poses, contacts, sums, status } = state.arrays;
    if (poses.length !== 7 * this.bodies.length) return; // of another model
    this.bodies.forEach((body, i) => {
      const [x, y, z, w, a, b, c] = poses.subarray(7 * i, 7 * i + 7);
      body.position.set(x, y, z);
      body.quaternion.set(a, b, c, w);
      this.deform(body, state.arrays[`at${i}`] ?? NOTHING, state.arrays[`by${i}`], state.quanta_m[i], state.arrays[`press${i}`]);
    });
    let largest = 1e-9;
    for (let i = 0; i < contacts.length; i += 6) largest = Math.max(largest, Math.hypot(...contacts.subarray(i + 3, i + 6)));
    this.contacts.begin();
    for (let i = 0; i < status.length; i++) this.contacts.add(contacts, 6 * i, LONGEST / largest, STATUS[status[i]]);
    this.contacts.end();
    this.sums.begin();
    this.fingers.forEach((finger, i) => this.sums.add(sums, 6 * i, NEWTON, finger.colour));
    this.sums.end();
    this.states += 1;
  }

  /** Moves the points that yield, in steps of `quantum` (m), and those back that did; colours them by the pressure on them. */
  deform(body, indices, by, quantum, press) {
    if (!indices.length && !body.moved.length) return;
    const { position, color } = body.geometry.attributes;
    for (const i of body.moved) {
      position.array.set(body.rest.subarray(3 * i, 3 * i + 3), 3 * i);
      if (color) body.plain.toArray(color.array, 3 * i);
    }
    indices.forEach((i, row) => {
      for (let k = 3 * i, j = 3 * row; j < 3 * row + 3; k++, j++) position.array[k] += quantum * by[j];
      if (press && press[row] >= LOADED) color.array.set(this.colours.subarray(3 * press[row], 3 * press[row] + 3), 3 * i);
    });
    body.moved = indices;
    position.needsUpdate = true;
    if (color) color.needsUpdate = true;
  }

  /** Whether the things of the person's own room can be seen behind the scene. */
  passthrough(on) {
    this.through = on;
    this.table.passthrough(on);
    for (const body of this.bodies.filter(({ kind }) => kind === 'support')) sheer(body, on);
  }
}

/** A body's mesh. Those that press have a colour at each point;
 * those that are taken are see-through, so that one sees what presses on them. */
function solid(body, points, normals, faces) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(points, 3).setUsage(THREE.DynamicDrawUsage));
  geometry.setAttribute('normal', new THREE.BufferAttribute(normals, 3));
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  const plain = new THREE.Color().setRGB(...body.colour, 'srgb');
  const clear = body.kind === 'object';
  const felt = body.kind === 'fingertip';
  const material = new THREE.MeshLambertMaterial({ transparent: clear, opacity: clear ? GLASS : 1, depthWrite: !clear });
  if (felt) {
    const colours = new Float32Array(points.length);
    for (let i = 0; i < points.length; i += 3) plain.toArray(colours, i);
    geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3).setUsage(THREE.DynamicDrawUsage));
    material.vertexColors = true;
  } else material.color = plain;
  const mesh = new THREE.Mesh(geometry, material);
  mesh.castShadow = body.kind !== 'support';
  mesh.receiveShadow = body.kind === 'support';
  return Object.assign(mesh, { name: body.name, kind: body.kind, plain, rest: points.slice(), moved: NOTHING });
}

/** Lets the person's own table be seen through what the scene stands on. */
function sheer(body, on) {
  Object.assign(body.material, { transparent: on, opacity: on ? SHEER : 1, needsUpdate: true });
}

/** Bytes of sRGB as what three.js computes with. */
function linear(bytes) {
  const colours = new Float32Array(bytes.length);
  const colour = new THREE.Color();
  for (let i = 0; i < bytes.length; i += 3) {
    colour.setRGB(bytes[i] / 255, bytes[i + 1] / 255, bytes[i + 2] / 255, 'srgb').toArray(colours, i);
  }
  return colours;
}
