// Drives the coach's page in headless Chromium with an emulated headset: node coach_page.mjs JOB, a JSON file.
// Prints one JSON object with what happened. The poses come from the test, this only plays them.

import fs from 'node:fs';
import { createRequire } from 'node:module';

const job = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const require = createRequire(`${job.web}/`);
const { chromium } = require('playwright-core');
const { Matrix4, Quaternion, Vector3 } = await import(`${job.web}/node_modules/three/build/three.module.js`);

const FLAGS = [
  '--no-sandbox', '--no-first-run', '--disable-background-networking', '--disable-component-update',
  '--disable-sync', '--disable-quic', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
];
const EMULATOR = `
  const device = new IWER.XRDevice(IWER.metaQuest3, { stereoEnabled: true });
  device.installRuntime({ forceInstall: true });
  // This emulator calls every position emulated; the page takes that, rightly, for a guess.
  Object.defineProperty(XRPose.prototype, 'emulatedPosition', { get: () => false });
  window.emulated = device;`;
const OVER = ['left', 'right'];
const offset = {}; // how the emulator's poses have to be moved so that a hand comes out where it is wanted

function matrix(seven) {
  const [x, y, z, ...turn] = seven;
  return new Matrix4().compose(new Vector3(x, y, z), new Quaternion(...turn), new Vector3(1, 1, 1));
}

function seven(pose) {
  const [place, turn, scale] = [new Vector3(), new Quaternion(), new Vector3()];
  pose.decompose(place, turn, scale);
  return [...place.toArray(), ...turn.toArray()];
}

// Wrist and axes of a hand: x along the fingers, z out of its back.
function palm(side, joints) {
  const [wrist, index, middle, pinky] = joints.map((joint) => new Vector3(...joint));
  const fingers = middle.sub(wrist).normalize();
  const across = pinky.sub(index).multiplyScalar(side === 'left' ? 1 : -1);
  const back = fingers.clone().cross(across).normalize();
  return new Matrix4().makeBasis(fingers, back.clone().cross(fingers), back).setPosition(wrist);
}

const browser = await chromium.launch({ executablePath: job.chromium, headless: true, args: [...FLAGS, ...job.flags] });
const out = { errors: [], outside: [] };
let gap = 0; // longest time between two messages of the headset in what was played last [s]
try {
  const page = await browser.newPage({ viewport: job.viewport });
  page.on('pageerror', (error) => out.errors.push(error.message));
  page.on('console', (message) => {
    const isExpected = job.kind !== 'headset' && message.text().startsWith('THREE.WebGLRenderer');
    if (message.type() === 'error' && !isExpected) out.errors.push(message.text());
  });
  page.on('request', (request) => {
    if (!request.url().startsWith(job.url) && !request.url().startsWith('data:')) out.outside.push(request.url());
  });
  let sent;
  page.on('websocket', (socket) => socket.on('framesent', ({ payload }) => {
    const message = JSON.parse(payload);
    if (message.type !== 'hands') return;
    if (sent) gap = Math.max(gap, message.time - sent.time);
    sent = message;
  }));
  if (job.kind === 'headset') {
    await page.addInitScript({ path: require.resolve('iwer/build/iwer.min.js') });
    await page.addInitScript(EMULATOR);
  }
  await page.goto(job.url);
  await page.waitForFunction(() => document.querySelector('#exercises input'));
  await ({ headset, simulated }[job.kind])(page, () => sent, () => { sent = undefined; });
} finally {
  await browser.close();
}
console.log(JSON.stringify(out));

async function simulated(page) {
  await fill(page);
  await page.selectOption('#mistake', 'none');
  await page.focus('#begin');
  await page.keyboard.press('Enter'); // by keyboard alone
  await page.waitForSelector('#window[data-state="green"]', { timeout: job.patience });
  out.words = await page.textContent('#verdict-words');
  out.kind = await page.evaluate(() => (document.querySelector('#scene').getContext('2d') ? 'flat' : 'solid'));
  await page.screenshot({ path: `${job.pictures}/simulated.png` });
  await page.waitForFunction(() => document.querySelector('#right').textContent === '1', null, { timeout: job.patience });
  await page.keyboard.press('Space');
  await page.waitForFunction(() => document.querySelector('#verdict-words').textContent === 'Paused');
  await page.keyboard.press('Space');
  await page.waitForFunction(() => document.querySelector('#verdict-words').textContent !== 'Paused');
  await page.keyboard.press('Escape');
  await page.waitForSelector('#over:not([hidden])');
  out.title = await page.textContent('#over-title');
  out.focus = await page.evaluate(() => document.activeElement.id);
}

async function headset(page, last, forget) {
  await page.waitForSelector('#source-hands:not([disabled])');
  await page.check('#source-hands');
  await fill(page);
  await page.evaluate(() => { window.emulated.primaryInputMode = 'hand'; });
  await page.click('#begin');
  out.hands = await offsets(page, last, forget, (side, hand) => palm(side, hand.joints));
  const byHand = (frames, kind) => frames.map(({ time, head, ...poses }) => ({
    time, head, ...Object.fromEntries(OVER.map((side) => [side,
      seven(matrix(poses[side][kind]).multiply(offset[side]))])) }));
  await play(page, byHand(job.right.slice(0, 1), 'palm'), 'hands');
  await page.keyboard.press('c'); // so far the hands were somewhere
  await page.waitForFunction(() => document.querySelector('#verdict-words').textContent.startsWith('Sit upright'));
  await page.waitForFunction(() => !document.querySelector('#verdict-words').textContent.startsWith('Sit upright'));
  out.right = await attempt(page, byHand(job.right, 'palm'), 'hands');
  await page.screenshot({ path: `${job.pictures}/headset.png` });
  out.wrong = await attempt(page, byHand(job.wrong, 'palm'), 'hands');
  await page.evaluate(() => { window.emulated.primaryInputMode = 'controller'; });
  await offsets(page, last, forget, (_, hand) => matrix(hand.grip), 'controllers');
  await play(page, byHand(job.right.slice(0, 1), 'grip'), 'controllers');
  await page.keyboard.press('c');
  await page.waitForFunction(() => document.querySelector('#verdict-words').textContent.startsWith('Sit upright'));
  await page.waitForFunction(() => !document.querySelector('#verdict-words').textContent.startsWith('Sit upright'));
  out.controllers = await attempt(page, byHand(job.right, 'grip'), 'controllers');
}

async function fill(page) {
  for (const box of await page.$$('#exercises input')) await box.setChecked((await box.inputValue()) === job.exercise);
  await page.fill('#height', String(job.height_cm));
  await page.fill('#repetitions', '9');
}

async function offsets(page, last, forget, pose, what = 'hands') {
  await page.evaluate((kind) => {
    for (const side of ['left', 'right']) {
      window.emulated[kind][side].position.set(0, 1, 0);
      window.emulated[kind][side].quaternion.set(0, 0, 0, 1);
    }
  }, what);
  await page.waitForTimeout(600);
  forget();
  const kind = what === 'hands' ? 'joints' : 'grip';
  for (let i = 0; i < 100 && !(last()?.left?.[kind] && last()?.right?.[kind]); i++) await page.waitForTimeout(50);
  const message = last();
  for (const side of OVER) {
    const shown = new Matrix4().makeTranslation(0, -1, 0).multiply(pose(side, message[side]));
    offset[side] = shown.invert();
  }
  return Object.keys(message.left);
}

// Play once; again, twice at most, if this machine was too busy to send the poses in time.
async function attempt(page, frames, what) {
  let seen;
  for (let i = 0; i < 3; i += 1) {
    await page.waitForFunction(() => document.querySelector('#window').dataset.state === 'neutral');
    gap = 0;
    seen = { ...await play(page, frames, what), gap };
    if (gap < job.gap) break;
  }
  return seen;
}

// Play frames in real time; return whether the window was green, and what the page said at the end.
function play(page, frames, what) {
  return page.evaluate(async ([frames, what]) => {
    const device = window.emulated;
    const element = (id) => document.getElementById(id);
    const before = Number(element('right').textContent);
    const start = performance.now();
    let green = false;
    const hints = new Set();
    const put = (item, [x, y, z, ...turn]) => { item.position.set(x, y, z); item.quaternion.set(...turn); };
    for (let i = 0; i < frames.length;) {
      const frame = frames[i];
      put(device, frame.head);
      for (const side of ['left', 'right']) put(device[what][side], frame[side]);
      await new Promise((done) => { setTimeout(done, 8); });
      green ||= element('window').dataset.state === 'green';
      if (element('hint').textContent) hints.add(element('hint').textContent);
      while (i < frames.length && frames[i].time <= (performance.now() - start) / 1000) i += 1;
    }
    return { green, hints: [...hints], counted: Number(element('right').textContent) - before,
      score: element('score').textContent, words: element('verdict-words').textContent };
  }, [frames, what]);
}
