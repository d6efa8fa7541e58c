// Draws the scene in the world's own axes (z up); where the world stands in the room is the pose of `world`.
import * as THREE from './three.js';

const NEWTON = 0.012; // length of the arrow of 1 N, m, as in the viewer
const STATUS = [new THREE.Color('#888888'), new THREE.Color('#0072b2'), new THREE.Color('#d55e00')]; // open, stick, slip
const SUM = new THREE.Color('#28303a');
// The world's axes in the room: x away from the user (-z), y to the left (-x), z up (y).
const AXES = new THREE.Quaternion(-0.5, 0.5, 0.5, 0.5);

export class WorldDrawing {
  constructor(scene) {
    this.world = new THREE.Group();
    scene.add(this.world);
    this.bodies = [];
    this.lines = new Lines(this.world);
    this.states = 0;
    this.phase = '';
    this.place([0, 0.75, -0.4], 0);
  }

  place(position, heading) {
    this.world.position.fromArray(position);
    this.world.quaternion.setFromAxisAngle(new THREE.Vector3(0, 1, 0), heading).multiply(AXES);
  }

  show(model) {
    for (const body of this.bodies) {
      this.world.remove(body);
      body.geometry.dispose();
      body.material.dispose();
    }
    this.bodies = model.bodies.map((body, i) => {
      const geometry = new THREE.BufferGeometry();
      const points = new THREE.BufferAttribute(model.arrays[`points${i}`], 3);
      points.setUsage(THREE.DynamicDrawUsage);
      geometry.setAttribute('position', points);
      geometry.setAttribute('normal', new THREE.BufferAttribute(model.arrays[`normals${i}`], 3));
      geometry.setIndex(new THREE.BufferAttribute(model.arrays[`faces${i}`], 1));
      const clear = body.kind === 'object';
      const colour = new THREE.Color().setRGB(...body.colour, 'srgb');
      const material = new THREE.MeshStandardMaterial({ color: colour, roughness: 0.7, transparent: clear, opacity: clear ? 0.6 : 1 });
      const mesh = new THREE.Mesh(geometry, material);
      mesh.name = body.name;
      mesh.rest = points.array.slice();
      mesh.moved = null;
      this.world.add(mesh);
      return mesh;
    });
    this.states = 0;
  }

  update(state) {
    const { poses, contacts, sums, status } = state.arrays;
    if (poses.length !== 7 * this.bodies.length) return; // of another model
    this.bodies.forEach((body, i) => {
      const [x, y, z, w, a, b, c] = poses.subarray(7 * i, 7 * i + 7);
      body.position.set(x, y, z);
      body.quaternion.set(a, b, c, w);
      deform(body, state.arrays[`moved${i}`], state.arrays[`to${i}`]);
    });
    this.lines.begin();
    for (let i = 0; i < status.length; i++) this.lines.force(contacts, 6 * i, STATUS[status[i]]);
    for (let i = 0; i < sums.length; i += 6) this.lines.force(sums, i, SUM);
    this.lines.end();
    this.states += 1;
    this.phase = state.phase;
  }
}

/** Moves the points that yield, and those back that did. */
function deform(body, indices, points) {
  if (!indices && !body.moved) return;
  const attribute = body.geometry.attributes.position;
  for (const i of body.moved ?? []) attribute.array.set(body.rest.subarray(3 * i, 3 * i + 3), 3 * i);
  indices?.forEach((i, row) => attribute.array.set(points.subarray(3 * row, 3 * row + 3), 3 * i));
  body.moved = indices ?? null;
  attribute.needsUpdate = true;
}

/** Line segments whose number changes. */
class Lines {
  constructor(parent) {
    this.parent = parent;
    this.room = 0;
    this.grow(256);
  }

  grow(room) {
    const old = this.mesh;
    const geometry = new THREE.BufferGeometry();
    for (const name of ['position', 'color']) {
      const attribute = new THREE.BufferAttribute(new Float32Array(6 * room), 3);
      if (old) attribute.array.set(old.geometry.attributes[name].array);
      geometry.setAttribute(name, attribute.setUsage(THREE.DynamicDrawUsage));
    }
    this.mesh = new THREE.LineSegments(geometry, old?.material ?? new THREE.LineBasicMaterial({ vertexColors: true }));
    this.mesh.frustumCulled = false;
    if (old) {
      this.parent.remove(old);
      old.geometry.dispose();
    }
    this.parent.add(this.mesh);
    this.room = room;
  }

  begin() {
    this.count = 0;
  }

  force(array, at, colour) {
    if (this.count === this.room) this.grow(2 * this.room);
    const { position, color } = this.mesh.geometry.attributes;
    for (let k = 0; k < 3; k++) {
      position.array[6 * this.count + k] = array[at + k];
      position.array[6 * this.count + 3 + k] = array[at + k] + NEWTON * array[at + 3 + k];
    }
    colour.toArray(color.array, 6 * this.count);
    colour.toArray(color.array, 6 * this.count + 3);
    this.count += 1;
  }

  end() {
    const { position, color } = this.mesh.geometry.attributes;
    position.needsUpdate = color.needsUpdate = true;
    this.mesh.geometry.setDrawRange(0, 2 * this.count);
  }
}

/** The user's own joints as small balls, in the room. */
export class JointBalls {
  constructor(scene, count) {
    const material = new THREE.MeshStandardMaterial({ color: '#e69f00', transparent: true, opacity: 0.5 });
    this.mesh = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 10, 8), material, count);
    this.mesh.frustumCulled = false;
    this.matrix = new THREE.Matrix4();
    scene.add(this.mesh);
    this.show(null);
  }

  show(joints) {
    for (let i = 0; i < this.mesh.count; i++) {
      const seen = joints && Number.isFinite(joints[8 * i]);
      const size = seen ? 0.6 * (joints[8 * i + 7] || 0.008) : 0;
      this.matrix.makeScale(size, size, size);
      if (seen) this.matrix.setPosition(joints[8 * i], joints[8 * i + 1], joints[8 * i + 2]);
      this.mesh.setMatrixAt(i, this.matrix);
    }
    this.mesh.instanceMatrix.needsUpdate = true;
  }
}
