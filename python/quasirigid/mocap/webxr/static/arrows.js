// Arrows whose number changes: shafts and heads, as solid things, since lines are one pixel wide in a headset.
import * as THREE from './three.js';

const UP = new THREE.Vector3(0, 1, 0);
const SIDES = 8;

export class Arrows {
  /** Of a radius of the shaft and a length of the head, m. */
  constructor(parent, radius, head) {
    this.parent = parent;
    this.radius = radius;
    this.head = head;
    this.shaft = new THREE.CylinderGeometry(1, 1, 1, SIDES, 1, true).translate(0, 0.5, 0);
    this.tip = new THREE.ConeGeometry(1, 1, SIDES).translate(0, 0.5, 0);
    this.material = new THREE.MeshLambertMaterial();
    this.from = new THREE.Vector3();
    this.along = new THREE.Vector3();
    this.turn = new THREE.Quaternion();
    this.size = new THREE.Vector3();
    this.matrix = new THREE.Matrix4();
    this.make(64);
  }

  make(room) {
    for (const mesh of this.meshes ?? []) {
      this.parent.remove(mesh);
      mesh.dispose();
    }
    this.room = room;
    this.meshes = [this.shaft, this.tip].map((geometry) => {
      const mesh = new THREE.InstancedMesh(geometry, this.material, room);
      mesh.setColorAt(0, new THREE.Color()); // makes the colours
      mesh.frustumCulled = false;
      mesh.count = 0;
      this.parent.add(mesh);
      return mesh;
    });
  }

  begin() {
    this.wanted = 0;
    this.count = 0;
  }

  /** The arrow of a point and a vector that stand in `array` from `at`, `scale` times as long as the vector. */
  add(array, at, scale, colour) {
    this.from.fromArray(array, at);
    this.along.fromArray(array, at + 3).multiplyScalar(scale);
    const length = this.along.length();
    if (length < 0.2 * this.radius) return;
    this.wanted += 1;
    if (this.count === this.room) return; // there is room from the next state on
    this.turn.setFromUnitVectors(UP, this.along.multiplyScalar(1 / length));
    const head = Math.min(this.head, 0.6 * length);
    const wide = (head / this.head) * this.radius; // a short arrow is a small one
    const [shafts, heads] = this.meshes;
    shafts.setMatrixAt(this.count, this.matrix.compose(this.from, this.turn, this.size.set(wide, length - head, wide)));
    this.from.addScaledVector(this.along, length - head);
    heads.setMatrixAt(this.count, this.matrix.compose(this.from, this.turn, this.size.set(2.6 * wide, head, 2.6 * wide)));
    for (const mesh of this.meshes) mesh.setColorAt(this.count, colour);
    this.count += 1;
  }

  end() {
    for (const mesh of this.meshes) {
      mesh.count = this.count;
      mesh.instanceMatrix.needsUpdate = mesh.instanceColor.needsUpdate = true;
    }
    if (this.wanted > this.room) this.make(2 * this.wanted);
  }
}
