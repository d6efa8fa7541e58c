// The page: a connection, a drawing, and a session of the headset.
import * as THREE from './three.js';
import { HandReader } from './hands.js';
import { unpack } from './protocol.js';
import { JointBalls, WorldDrawing } from './scene.js';

const AGAIN = 1000; // ms until a lost connection is tried again
const BACKLOG = 16384; // bytes that may wait to be sent; newer hands are not queued behind them
const $ = (id) => document.getElementById(id);

const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
renderer.xr.enabled = true;
renderer.xr.setReferenceSpaceType('local-floor');
document.body.append(renderer.domElement);
const scene = new THREE.Scene();
scene.add(new THREE.HemisphereLight('#ffffff', '#8890a0', 2.2));
const sun = new THREE.DirectionalLight('#ffffff', 1.6);
sun.position.set(1, 3, 2);
scene.add(sun);
const camera = new THREE.PerspectiveCamera(50, 1, 0.01, 20);
const orbit = new THREE.OrbitControls(camera, renderer.domElement);
const drawing = new WorldDrawing(scene);
const hands = new HandReader();
const balls = new JointBalls(scene, 50);
const status = { connected: false, states: 0, sent: 0, skipped: 0, session: null, hand: 'right', writer: null };
window.quasirigid = { drawing, status, camera };

// The connection.

let socket = null;
function connect() {
  socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/socket`);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    status.connected = true;
    $('link').textContent = 'Connected; waiting for the scene…';
  };
  socket.onmessage = ({ data }) => (typeof data === 'string' ? told(JSON.parse(data)) : shown(unpack(data)));
  socket.onclose = () => {
    status.connected = false;
    status.writer = null;
    $('link').textContent = 'The program has ended, or is full; trying again…';
    setTimeout(connect, AGAIN);
  };
}

function told(message) {
  if (message.type === 'hello') status.hand = message.hand;
  if (message.type === 'writer') status.writer = message.yours;
  if (message.type === 'placement') {
    drawing.place(message.position, message.heading);
    if (!renderer.xr.isPresenting) lookAtWorld();
  }
}

function shown(message) {
  if (message.type === 'model') drawing.show(message);
  else {
    drawing.update(message);
    status.states += 1;
    $('link').textContent = `${message.time.toFixed(2)} s  ${message.phase}`;
  }
}

// Without a headset: a camera to turn with the mouse.

function lookAtWorld() {
  const at = drawing.world.position;
  orbit.target.copy(at).y += 0.05;
  camera.position.set(0.22, 0.18, 0.35).applyAxisAngle(new THREE.Vector3(0, 1, 0), Math.PI / 8).add(at);
  orbit.update();
}

function resize() {
  if (renderer.xr.isPresenting) return;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.setSize(innerWidth, innerHeight);
  camera.aspect = innerWidth / innerHeight;
  camera.updateProjectionMatrix();
}
addEventListener('resize', resize);

// With one.

function recentre() {
  const eyes = new THREE.Vector3();
  const forward = new THREE.Vector3();
  const head = renderer.xr.getCamera();
  head.getWorldPosition(eyes);
  head.getWorldDirection(forward); // cameras look along -z, and three.js says so here
  if (socket?.readyState === WebSocket.OPEN) {
    socket.send(JSON.stringify({ type: 'recentre', position: eyes.toArray(), forward: forward.toArray() }));
  }
}

async function enter(mode) {
  try {
    const session = await navigator.xr.requestSession(mode, {
      requiredFeatures: ['local-floor', 'hand-tracking'],
      optionalFeatures: ['bounded-floor'],
    });
    scene.background = mode === 'immersive-vr' ? new THREE.Color('#dfe3e8') : null;
    status.session = mode;
    $('recentre').hidden = $('help').hidden = false;
    session.addEventListener('end', () => {
      status.session = null;
      scene.background = null;
      $('recentre').hidden = $('help').hidden = true;
      balls.show(null);
      resize();
      lookAtWorld();
    });
    await renderer.xr.setSession(session);
  } catch (error) {
    $('device').textContent = `The headset did not start a session with hand tracking: ${error.message}`;
  }
}

async function offer() {
  const modes = { vr: 'immersive-vr', ar: 'immersive-ar' };
  let any = false;
  for (const [id, mode] of Object.entries(modes)) {
    const there = await (navigator.xr?.isSessionSupported(mode) ?? false);
    $(id).hidden = !there;
    any ||= there;
    if (there) $(id).onclick = () => enter(mode);
  }
  if (any) $('device').textContent = 'Headset found. Put the controllers down and show your hands.';
  else if (!isSecureContext) $('device').textContent = 'WebXR needs https, or localhost through a USB port forward. See docs/webxr.md.';
  else $('device').textContent = 'No WebXR device here: this page only shows the scene. Drag to turn, scroll to come nearer.';
}
$('recentre').onclick = recentre;

renderer.setAnimationLoop((milliseconds, frame) => {
  if (frame) {
    const message = hands.read(frame, renderer.xr.getReferenceSpace(), milliseconds);
    balls.show(hands.out.joints);
    if (socket?.readyState === WebSocket.OPEN) {
      if (socket.bufferedAmount < BACKLOG) {
        socket.send(message);
        status.sent += 1;
      } else status.skipped += 1;
    }
    if (hands.gesture(status.hand === 'right' ? 'left' : 'right', milliseconds)) recentre();
  } else {
    orbit.update();
  }
  renderer.render(scene, camera);
});

resize();
lookAtWorld();
connect();
navigator.xr?.addEventListener?.('devicechange', offer);
offer();
