// The person's own hands, as thin bones between the joints that the headset sees.
import * as THREE from './three.js';
import { JOINTS } from './protocol.js';

const UP = new THREE.Vector3(0, 1, 0);
const SLIM = 0.36; // of the radius of the skin
const BONES = [];
JOINTS.forEach((name, i) => {
  if (i) BONES.push([/metacarpal$/.test(name) ? 0 : i - 1, i]);
});

export class Skeleton {
  constructor(scene) {
    const material = new THREE.MeshLambertMaterial({ color: '#66707f' });
    const count = 2 * BONES.length;
    this.bones = new THREE.InstancedMesh(new THREE.CylinderGeometry(1, 1, 1, 8, 1, true).translate(0, 0.5, 0), material, count);
    this.knobs = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 10, 8), material, 2 * JOINTS.length);
    for (const mesh of [this.bones, this.knobs]) {
      mesh.frustumCulled = false;
      mesh.castShadow = true;
      scene.add(mesh);
    }
    this.matrix = new THREE.Matrix4();
    this.from = new THREE.Vector3();
    this.along = new THREE.Vector3();
    this.turn = new THREE.Quaternion();
    this.size = new THREE.Vector3();
    this.show(null);
  }

  /** `joints` (2, 25, 8) in the room, NaN for what is not seen; null for no hands. */
  show(joints) {
    let bones = 0;
    let knobs = 0;
    for (let side = 0; joints && side < 2; side++) {
      const base = side * JOINTS.length;
      for (let i = 0; i < JOINTS.length; i++) {
        const at = 8 * (base + i);
        if (!Number.isFinite(joints[at])) continue;
        const size = SLIM * (joints[at + 7] || 0.008);
        this.from.fromArray(joints, at);
        this.matrix.makeScale(size, size, size).setPosition(this.from);
        this.knobs.setMatrixAt(knobs++, this.matrix);
      }
      for (const [a, b] of BONES) {
        const at = 8 * (base + b);
        this.from.fromArray(joints, 8 * (base + a));
        this.along.fromArray(joints, at).sub(this.from);
        const length = this.along.length();
        if (!(length > 1e-4)) continue; // also where one of them is not seen: NaN
        const size = SLIM * (joints[at + 7] || 0.008);
        this.turn.setFromUnitVectors(UP, this.along.multiplyScalar(1 / length));
        this.bones.setMatrixAt(bones++, this.matrix.compose(this.from, this.turn, this.size.set(size, length, size)));
      }
    }
    this.bones.count = bones;
    this.knobs.count = knobs;
    this.bones.instanceMatrix.needsUpdate = this.knobs.instanceMatrix.needsUpdate = true;
  }
}
