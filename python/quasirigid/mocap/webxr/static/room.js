// What one stands in: light, a floor with a grid of half metres, and the table on which the scene stands, with a grid of centimetres.
import * as THREE from './three.js';

export const SKY = '#e6e9ee';
const FLOOR = '#cfd4dc';
const WIDTH = 0.64; // of the table, m
const THICK = 0.022;

export function addLight(scene, world) {
  scene.add(new THREE.HemisphereLight('#ffffff', '#b0a89e', 1.7));
  const sun = new THREE.DirectionalLight('#ffffff', 1.9);
  sun.position.set(-0.25, 0.35, 0.9); // from above, over the shoulder
  sun.castShadow = true;
  sun.shadow.mapSize.set(512, 512);
  Object.assign(sun.shadow.camera, { left: -0.4, right: 0.4, top: 0.4, bottom: -0.4, near: 0.2, far: 1.8 });
  sun.shadow.normalBias = 0.0015;
  sun.shadow.intensity = 0.55;
  world.add(sun, sun.target);
}

/** Lines `apart` within a square of `width`, every tenth (or `major`-th) one darker; z is up. */
function grid(width, apart, major, light, dark) {
  const half = width / 2;
  const count = Math.floor(half / apart + 1e-6);
  const points = [];
  const colours = [];
  for (let i = -count; i <= count; i++) {
    const at = i * apart;
    points.push(at, -half, 0, at, half, 0, -half, at, 0, half, at, 0);
    const colour = new THREE.Color(i % major ? light : dark);
    for (let k = 0; k < 4; k++) colours.push(colour.r, colour.g, colour.b);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(points), 3));
  geometry.setAttribute('color', new THREE.BufferAttribute(new Float32Array(colours), 3));
  return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ vertexColors: true }));
}

/** The floor of a room that is not there: fades into the distance. */
export class Floor {
  constructor(scene) {
    this.scene = scene;
    this.fog = new THREE.Fog(SKY, 1.5, 6);
    this.sky = new THREE.Color(SKY);
    this.group = new THREE.Group();
    this.group.rotation.x = -Math.PI / 2;
    const ground = new THREE.Mesh(new THREE.PlaneGeometry(14, 14), new THREE.MeshBasicMaterial({ color: FLOOR }));
    ground.position.z = -0.002;
    this.group.add(ground, grid(12, 0.5, 2, '#bcc2cc', '#a3abb8'));
    scene.add(this.group);
    this.show(true);
  }

  show(on) {
    this.group.visible = on;
    this.scene.fog = on ? this.fog : null;
    this.scene.background = on ? this.sky : null;
  }
}

/** In the world's axes. */
export class Table {
  constructor(world) {
    this.group = new THREE.Group();
    const wood = new THREE.MeshLambertMaterial({ color: '#c9b79c' });
    const top = new THREE.Mesh(new THREE.BoxGeometry(WIDTH, WIDTH, THICK), wood);
    top.position.z = -THICK / 2 - 0.001;
    top.receiveShadow = true;
    this.leg = new THREE.Mesh(new THREE.CylinderGeometry(0.035, 0.035, 1, 24), wood);
    this.leg.rotation.x = Math.PI / 2;
    this.foot = new THREE.Mesh(new THREE.CylinderGeometry(0.2, 0.22, 0.02, 40), wood);
    this.foot.rotation.x = Math.PI / 2;
    this.lines = grid(0.56, 0.02, 5, '#d5d9e0', '#aeb5c1');
    this.lines.position.z = 0.0016; // over the plate of the scene, which lies 1 mm higher
    this.solid = [top, this.leg, this.foot];
    this.group.add(...this.solid, this.lines);
    world.add(this.group);
    this.floor = 0;
    this.height = 0.75;
  }

  /** On the floor of the room, `height` (m) under the world's origin. */
  stand(height) {
    this.height = height;
    this.lay(this.floor);
  }

  /** The top at `floor`, m, world. */
  lay(floor) {
    this.floor = floor;
    this.group.position.z = floor;
    const long = this.height + floor - THICK - 0.001;
    this.leg.visible = this.foot.visible = long > 0.05 && this.group.parent !== null && !this.through;
    this.leg.scale.y = Math.max(long, 1e-3);
    this.leg.position.z = -THICK - 0.001 - long / 2;
    this.foot.position.z = -THICK - 0.001 - long + 0.01;
  }

  passthrough(on) {
    this.through = on;
    for (const part of this.solid) part.visible = !on;
    this.lay(this.floor);
  }
}
