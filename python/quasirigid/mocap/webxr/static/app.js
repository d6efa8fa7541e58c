// The page: a connection, a drawing, and a session of the headset.
import * as THREE from './three.js';
import { HandReader } from './hands.js';
import { unpack } from './protocol.js';
import { Board, readout } from './readout.js';
import { Floor, addLight } from './room.js';
import { WorldDrawing } from './scene.js';
import { Skeleton } from './skeleton.js';
import { listenFor, localRecogniser } from './voice.js';

const AGAIN = 1000; // ms until a lost connection is tried again
const BACKLOG = 16384; // bytes that may wait to be sent; newer hands are not queued behind them
const TIMED = 512; // frames and updates of which the time in this page is kept
const MODES = { vr: 'immersive-vr', ar: 'immersive-ar' };
const $ = (id) => document.getElementById(id);

const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
renderer.xr.enabled = true;
renderer.xr.setReferenceSpaceType('local-floor');
renderer.shadowMap.enabled = true;
document.body.append(renderer.domElement);
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(40, 1, 0.01, 20);
const orbit = new THREE.OrbitControls(camera, renderer.domElement);
const floor = new Floor(scene);
const drawing = new WorldDrawing(scene);
const board = new Board(drawing.world);
addLight(scene, drawing.world);
const hands = new HandReader();
const skeleton = new Skeleton(scene);
const status = {
  connected: false,
  states: 0,
  bytes: 0, // of the last state
  time: 0, // simulated, s
  sent: 0,
  skipped: 0,
  recentred: 0,
  resets: 0,
  session: null,
  visibility: null,
  hand: 'right',
  writer: null,
  frames: 0,
  updates: 0,
  frameTimes: new Float32Array(TIMED), // ms of script, the newest at `frames - 1` modulo TIMED
  updateTimes: new Float32Array(TIMED),
};
window.quasirigid = {
  drawing,
  board,
  floor,
  status,
  camera,
  scene,
  renderer,
  get socket() {
    return socket;
  },
};

function timed(times, count, began) {
  times[count % TIMED] = performance.now() - began;
  return count + 1;
}

// The connection.

let socket = null;
let colours = null;
function connect() {
  socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/socket`);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    status.connected = true;
    $('link').textContent = 'Connected; waiting for the scene…';
  };
  socket.onmessage = ({ data }) => {
    if (typeof data === 'string') return told(JSON.parse(data));
    const began = performance.now();
    shown(unpack(data), data.byteLength);
    status.updates = timed(status.updateTimes, status.updates, began);
  };
  socket.onclose = () => {
    status.connected = false;
    status.writer = null;
    $('link').textContent = 'The program has ended, or is full; trying again…';
    for (const id of ['readout', 'notice', 'reset']) $(id).hidden = true;
    setTimeout(connect, AGAIN);
  };
}

function told(message) {
  if (message.type === 'hello') {
    status.hand = message.hand;
    board.aside(message.hand);
    for (const place of document.querySelectorAll('.grasping')) place.textContent = message.hand;
    for (const place of document.querySelectorAll('.other')) place.textContent = message.hand === 'right' ? 'left' : 'right';
  }
  if (message.type === 'writer') {
    status.writer = message.yours;
    $('standing').hidden = message.yours;
    $('reset').hidden = !message.yours;
  }
  if (message.type === 'placement') {
    drawing.place(message.position, message.heading);
    if (!renderer.xr.isPresenting) lookAtWorld();
  }
}

function shown(message, bytes) {
  if (message.type === 'model') {
    colours = message.arrays.colours;
    drawing.show(message);
    $('reset').hidden = status.writer === false;
    return;
  }
  drawing.update(message);
  status.states += 1;
  status.bytes = bytes;
  status.time = message.time;
  const said = readout(message, drawing.fingers);
  if (renderer.xr.isPresenting) board.show(said, colours, performance.now());
  else print(said);
}

/** The figures in the panel of the flat page. */
function print(said) {
  $('link').textContent = `${said.headline}, ${said.time}`;
  $('notice').hidden = !said.notice;
  $('notice').textContent = said.notice;
  $('readout').hidden = !said.rows.length;
  const rows = said.rows.map(({ name, css, text, felt }) => {
    const row = document.createElement('tr');
    for (const [what, kind] of [[name, 'name'], [text, 'figure'], [felt, 'felt']]) {
      const cell = row.insertCell();
      cell.className = kind;
      cell.textContent = what;
      if (kind === 'name') cell.style.borderColor = css;
    }
    return row;
  });
  $('fingers').replaceChildren(...rows);
  $('scale').textContent = `${Number(said.scale.toPrecision(3))} kPa`;
}

// Without a headset: a camera to turn with the mouse.

function lookAtWorld() {
  const at = drawing.world.position;
  orbit.target.copy(at).y += 0.06;
  camera.position.set(0.16, 0.22, 0.42).applyAxisAngle(new THREE.Vector3(0, 1, 0), Math.PI / 10).add(at);
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
  if (status.writer === false) return; // another page holds the hand, and the table
  const eyes = new THREE.Vector3();
  const forward = new THREE.Vector3();
  const head = renderer.xr.getCamera();
  head.getWorldPosition(eyes);
  head.getWorldDirection(forward); // cameras look along -z, and three.js says so here
  if (socket?.readyState === WebSocket.OPEN) {
    socket.send(JSON.stringify({ type: 'recentre', position: eyes.toArray(), forward: forward.toArray() }));
    status.recentred += 1;
  }
}

/** Asks for the object where it stood at the start. */
function reset() {
  if (status.writer === false || socket?.readyState !== WebSocket.OPEN) return;
  socket.send(JSON.stringify({ type: 'reset' }));
  status.resets += 1;
}
$('reset').onclick = reset;

let stopListening = null;
async function offerVoice() {
  const recogniser = await localRecogniser();
  $('listen').hidden = !recogniser;
  const listening = (on) => $('listen').setAttribute('aria-pressed', on);
  $('listen').onclick = () => {
    if (stopListening) {
      stopListening();
      stopListening = null;
    } else {
      stopListening = listenFor(recogniser, 'reset', reset, (why) => {
        stopListening = null;
        listening(false);
        $('device').textContent = `The browser does not listen any more: ${why}`;
      });
    }
    listening(stopListening !== null);
  };
}
offerVoice();

/** What is shown around the scene: a room of ours, or the person's own. */
function surround(mode) {
  const own = mode === MODES.ar;
  floor.show(!own);
  drawing.passthrough(own);
  board.mesh.visible = mode !== null;
  status.session = mode;
  status.visibility = mode && 'visible';
  for (const id of ['recentre', 'help', 'leave']) $(id).hidden = mode === null;
  for (const id of Object.keys(MODES)) $(id).hidden = mode !== null || !offered[id];
}

async function enter(mode) {
  let session = null;
  try {
    session = await navigator.xr.requestSession(mode, {
      requiredFeatures: ['local-floor', 'hand-tracking'],
      optionalFeatures: ['bounded-floor'],
    });
    $('leave').onclick = () => session.end();
    session.addEventListener('visibilitychange', () => (status.visibility = session.visibilityState));
    session.addEventListener('end', () => {
      surround(null);
      skeleton.show(null);
      resize();
      lookAtWorld();
    });
    await renderer.xr.setSession(session);
    surround(mode);
  } catch (error) {
    await session?.end().catch(() => {}); // or the headset stays in a session that shows nothing
    $('device').textContent = `The headset did not start a session with hand tracking: ${error.message}`;
  }
}

const offered = { vr: false, ar: false };
async function offer() {
  for (const [id, mode] of Object.entries(MODES)) {
    offered[id] = await (navigator.xr?.isSessionSupported(mode).catch(() => false) ?? false);
    $(id).hidden = !offered[id] || status.session !== null;
    $(id).onclick = () => enter(mode);
  }
  const any = offered.vr || offered.ar;
  if (any) $('device').textContent = 'Headset found. Put the controllers down and show your hands.';
  else if (!isSecureContext) $('device').textContent =
    'WebXR needs https (start the program with --certificate FILE), or localhost through a USB port forward (adb reverse).';
  else $('device').textContent = 'No WebXR device here: this page only shows the scene. Drag to turn, scroll to come nearer.';
}
$('recentre').onclick = recentre;

renderer.setAnimationLoop((milliseconds, frame) => {
  const began = performance.now();
  if (frame) {
    const message = hands.read(frame, renderer.xr.getReferenceSpace(), milliseconds);
    skeleton.show(hands.out.joints);
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
  status.frames = timed(status.frameTimes, status.frames, began);
});

resize();
lookAtWorld();
surround(null);
connect();
navigator.xr?.addEventListener?.('devicechange', offer);
offer();
