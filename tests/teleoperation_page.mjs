// Plays roles on the page of teleoperation in headless Chromium with an emulated headset: node teleoperation_page.mjs JOB.
// Prints one JSON object with what happened. What is wanted of it is said in the test, this only tells.

import { spawn } from 'node:child_process';
import fs from 'node:fs';
import { createInterface } from 'node:readline';
import { createRequire } from 'node:module';

const job = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const require = createRequire(`${job.web}/`);
const { chromium } = require('playwright-core');

const FLAGS = [
  '--no-sandbox', '--no-first-run', '--disable-background-networking', '--disable-component-update',
  '--disable-sync', '--enable-unsafe-swiftshader',
];

// A headset whose hands follow a law of what the page is told, one step for each scene.
const EMULATOR = `
  const device = new IWER.XRDevice(IWER.metaQuest3, { stereoEnabled: true });
  device.installRuntime({ forceInstall: true });
  // This emulator calls every position emulated; the page takes that, rightly, for a guess.
  Object.defineProperty(XRPose.prototype, 'emulatedPosition', { get: () => false });
  const emulated = { device, told: [], refused: [], law: null, memory: {} };
  window.emulated = emulated;
  window.WebSocket = class extends WebSocket {
    constructor(...given) {
      super(...given);
      emulated.socket = this;
      this.addEventListener('message', ({ data }) => {
        const message = typeof data === 'string' ? JSON.parse(data) : {};
        if (message.type === 'refused') emulated.refused.push(message.why);
        if (message.type !== 'scene') return;
        if (emulated.scene?.number !== message.number) emulated.law?.(message, emulated.memory);
        emulated.scene = message;
      });
    }
  };
  // Where a point of the scene is in the room of the headset, and back.
  emulated.outside = ([x, y, z]) => { const { room } = window.teleoperation;
    return room.localToWorld(room.position.clone().set(x, y, z)); };
  // Let the grip of a controller be at a place of the scene: the device is told where its ray begins.
  emulated.grip = (side, [x, y, z, ...turn]) => {
    const { room } = window.teleoperation;
    const at = room.matrixWorld.clone();
    const grip = at.clone().makeRotationFromQuaternion(room.quaternion.clone().set(...turn)).setPosition(x, y, z);
    const ray = at.clone().fromArray(IWER.metaQuest3.controllerConfig.layout[side].gripOffsetMatrix).invert();
    const [p, q, size] = [room.position.clone(), room.quaternion.clone(), room.scale.clone()];
    at.multiply(grip).multiply(ray).decompose(p, q, size);
    device.controllers[side].position.copy(p);
    device.controllers[side].quaternion.copy(q);
  };
  // Do what a message of a headset says, in each picture: who walks in the scene takes the hand along.
  emulated.follow = () => {
    const { said } = emulated;
    if (!said) return;
    emulated.grip('left', said.left.place);
    emulated.hold('left', Number(said.left.clutch));
    emulated.close('left', said.left.grasp);
    emulated.stick('left', -said.walk[1], -said.walk[0]);
    emulated.press('left', 'x-button', said.kneel[0]);
  };
  emulated.put = (side, point) => device.controllers[side].position.copy(emulated.outside(point));
  emulated.hold = (side, value) => device.controllers[side].updateButtonValue('squeeze', value);
  emulated.close = (side, value) => device.controllers[side].updateButtonValue('trigger', value);
  emulated.stick = (side, x, y) => device.controllers[side].updateAxes('thumbstick', x, y);
  emulated.press = (side, name, value) => device.controllers[side].updateButtonValue(name, value);`;

const LAWS = {
  // Lead the spoon before the mouth, and in when it is open.
  feed(told, memory) {
    const { bowl_to_mouth: way, face_direction: face, jaw_opening: jaw } = told.seen;
    const away = jaw[0] > 0.18 ? 0 : 0.09;
    let step = way.map((x, k) => 0.25 * (x + away * face[k]));
    const size = Math.hypot(...step);
    const most = Math.hypot(...way) < 0.12 ? 0.006 : 0.018;
    if (size > most) step = step.map((x) => x * most / size);
    memory.at = memory.at ? memory.at.map((x, k) => x + step[k]) : told.body.tool;
    window.emulated.put('right', memory.at);
    window.emulated.hold('right', 1);
  },
  // What the program that the job names answers.
  async ask(told) {
    window.emulated.said = await window.answer(told);
  },
  // Hold the clutch, and open the mouth.
  eat() {
    window.emulated.hold('right', 1);
    window.emulated.close('right', 1);
  },
};

const programs = [];
const out = { errors: [], outside: [], players: {} };
const origin = new URL(job.url).origin;
const browser = await chromium.launch({ executablePath: job.chromium, headless: true, args: FLAGS });
try {
  if (job.kind === 'strangers') await strangers();
  else if (job.kind === 'watch') await watch();
  else if (job.kind === 'replay') await replay();
  else if (job.kind === 'rate') await rate();
  else {
    for (const role of job.roles) await enter(role);
    await Promise.all(job.roles.map(play));
  }
} finally {
  for (const program of programs) program.kill();
  await browser.close();
}
console.log(JSON.stringify(out));

async function open() {
  const context = await browser.newContext({ viewport: job.viewport });  // a browser of its own
  const page = await context.newPage();
  page.setDefaultTimeout(job.patience);
  page.on('pageerror', (error) => out.errors.push(error.message));
  page.on('console', (message) => { if (message.type() === 'error') out.errors.push(message.text()); });
  page.on('request', (request) => {
    const url = request.url();
    if (!url.startsWith(`${origin}/`) && !url.startsWith('data:')) out.outside.push(url);
  });
  await page.addInitScript({ path: require.resolve('iwer/build/iwer.min.js') });
  await page.addInitScript(EMULATOR);
  await page.goto(job.url);
  return page;
}

async function enter(role) {
  const page = await open();
  const player = { page, role };
  out.players[role] = player;
  if (job.roles.length > 1) await page.click(`#roles button:has-text("${role}")`);
  await page.waitForSelector('#headset:not([hidden]):not([disabled])');
  await page.waitForFunction(() => window.teleoperation?.now && window.emulated.scene);
  player.first = await page.evaluate(() => window.emulated.scene);
  if (job.pictures) await page.screenshot({ path: `${job.pictures}/${job.name}_${role}.png` });
  await page.click('#headset');
  await page.waitForFunction(() => window.teleoperation.renderer.xr.isPresenting);
}

async function play(role) {
  const { page } = out.players[role];
  const { law, until, program } = job.players[role];
  if (program) await page.exposeFunction('answer', answers(program));
  await page.evaluate(([text]) => {
    const { scene, emulated } = { scene: window.teleoperation, emulated: window.emulated };
    const stream = scene.onFrame;
    scene.onFrame = (...given) => { emulated.follow(); stream(...given); };
    window.emulated.law = new Function(`return (${text})`)();
    window.emulated.law(window.emulated.scene, window.emulated.memory);
  }, [LAWS[law].toString().replace(/^(async )?(\w+)\(/, '$1function $2(')]);
  await page.waitForFunction(until ?? (() => window.emulated.scene.is_over));
  if (job.pictures) {
    await page.screenshot({ path: `${job.pictures}/${job.name}_${role}_in.png` });
  }
  const { scene, memory, refused } = await page.evaluate(() => ({ ...window.emulated, device: null, socket: null, told: null, law: null }));
  out.players[role] = { first: out.players[role].first, last: scene, memory, refused };
}

// Ask a program, one line of JSON for each.
function answers([command, ...given]) {
  const program = spawn(command, given, { stdio: ['pipe', 'pipe', 'inherit'] });
  const waiting = [];
  createInterface({ input: program.stdout }).on('line', (line) => waiting.shift()(JSON.parse(line)));
  programs.push(program);
  return (told) => new Promise((done) => { waiting.push(done); program.stdin.write(`${JSON.stringify(told)}\n`); });
}

// Bad messages over the page's own socket change nothing; a page of another origin gets nowhere.
async function strangers() {
  const page = await open();
  await page.waitForFunction(() => window.emulated.scene);
  const before = await page.evaluate(() => window.emulated.scene.number);
  for (const [k, text] of job.bad.entries()) {
    await page.evaluate((each) => window.emulated.socket.send(each), text);
    await page.waitForFunction((count) => window.emulated.refused.length >= count, k + 1);
  }
  out.refused = await page.evaluate(() => window.emulated.refused);
  out.numbers = [before, await page.evaluate(() => window.emulated.scene.number)];
  const other = await (await browser.newContext()).newPage();
  await other.goto('about:blank');
  out.foreign = await other.evaluate(async ([url]) => {
    const address = new URL(url);
    const asked = `ws://${address.host}/session${address.search}&role=robot`;
    const socket = await new Promise((done) => {
      const socket = new WebSocket(asked);
      socket.onopen = () => done('open');
      socket.onerror = () => done('refused');
    });
    const read = await fetch(`${address.origin}/setting${address.search}`).then(() => 'read', () => 'refused');
    return { socket, read };
  }, [job.url]);
}

// How many pictures a second the page draws, how fine they are, and what one costs that is drawn at full size.
async function rate() {
  const page = await open();
  await page.waitForFunction(() => window.teleoperation?.now);
  await page.evaluate(() => Object.assign(window.teleoperation.canvas.style, { position: 'fixed', inset: 0, width: '100vw', height: '100vh', maxHeight: 'none' }));
  await page.waitForTimeout(1000 * job.settles);
  out.rate = await page.evaluate(async (seconds) => {
    const scene = window.teleoperation;
    const [before, start] = [scene.drawn, performance.now()];
    await new Promise((done) => setTimeout(done, 1000 * seconds));
    return 1000 * (scene.drawn - before) / (performance.now() - start);
  }, job.seconds);
  if (job.pictures) await page.screenshot({ path: `${job.pictures}/${job.name}.png` });
  out.once = await page.evaluate(() => {
    const { renderer, scene, camera, canvas, ratio } = window.teleoperation;
    const gl = renderer.getContext();
    const took = (size) => {
      renderer.setPixelRatio(size);
      const times = Array.from({ length: 15 }, () => {
        const start = performance.now();
        renderer.render(scene, camera);
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));  // waits until it is drawn
        return performance.now() - start;
      });
      return times.sort((a, b) => a - b)[7];
    };
    const size = [canvas.clientWidth, canvas.clientHeight];
    return { size, ratio, whole_ms: took(1), triangles_ms: took(0.02), triangles: renderer.info.render.triangles };
  });
}

async function audit(page) {
  await page.evaluate(fs.readFileSync(require.resolve('axe-core/axe.min.js'), 'utf8'));
  const { violations } = await page.evaluate(() => window.axe.run());
  return violations.map(({ id, nodes }) => `${id} at ${nodes.map(({ target }) => target).join(', ')}`);
}

// What a button of the page saves: its name and first bytes.
async function saved(page, press) {
  const [download] = await Promise.all([page.waitForEvent('download'), press()]);
  const path = await download.path();
  const bytes = fs.readFileSync(path);
  if (job.pictures) fs.copyFileSync(path, `${job.pictures}/${job.name}_${download.suggestedFilename()}`);
  return { name: download.suggestedFilename(), size: bytes.length, begins: bytes.subarray(0, 8).toString('hex') };
}

// Look at a recorded episode to its end, then at its middle; with pressure and without; save a picture and a film.
async function replay() {
  const page = await open();
  await page.waitForFunction(() => document.querySelector('#moment-now').textContent);
  await page.click('#take-film');
  const at = () => page.$eval('#moment', ({ value, max }) => [Number(value), Number(max)]);
  await page.waitForFunction(() => { const { value, max } = document.querySelector('#moment'); return Number(max) > 0 && value === max; });
  out.film = await saved(page, () => page.click('#take-film'));
  out.end = { at: await at(), says: await page.textContent('#outcome'), status: await page.textContent('#status') };
  const seek = async (k) => {
    await page.$eval('#moment', (slider, k) => { slider.value = k; slider.dispatchEvent(new Event('input')); }, k);
    await page.waitForTimeout(500);
  };
  const painted = () => page.evaluate(() => window.teleoperation.surfaces.map(({ geometry: { userData: { base }, attributes: { color } } }) =>
    base.some((value, i) => Math.abs(value - color.array[i]) > 1e-3)));
  await page.click('#pause');  // from the end it begins again
  await page.click('#pause');
  await seek(job.touched);
  out.middle = { at: await at(), moment: await page.textContent('#moment-now'), painted: await painted() };
  if (job.pictures) await page.screenshot({ path: `${job.pictures}/${job.name}.png`, fullPage: true });
  out.picture = await saved(page, () => page.click('#take-picture'));
  await page.uncheck('#show-pressure');
  out.middle.bare = await painted();
  await page.waitForTimeout(300);
  out.middle.stays = await at();
  out.violations = await audit(page);
}

// Watch, go back to the beginning, ask for what there is not, then for another task; and look at it on a phone.
async function watch() {
  const page = await open();
  const picture = () => page.evaluate(() => {
    const { renderer, scene, camera } = window.teleoperation;
    renderer.render(scene, camera);
    return document.querySelector('#picture').toDataURL();
  });
  await page.waitForFunction(() => window.emulated.scene?.number > 15);
  await page.click('#pause');
  await page.waitForTimeout(400);
  const before = await picture();
  out.terms = await page.$$eval('#terms th', (cells) => cells.map((cell) => cell.textContent));
  await page.evaluate(() => { const at = document.querySelector('#moment'); at.value = 0; at.dispatchEvent(new Event('input')); });
  await page.waitForTimeout(400);
  out.back = { moment: await page.textContent('#moment-now'), differs: before !== await picture() };
  if (job.pictures) await page.screenshot({ path: `${job.pictures}/${job.name}.png`, fullPage: true });
  await page.setViewportSize({ width: 390, height: 844 });
  await page.waitForTimeout(400);
  out.overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  await page.check('#show-vitals');
  await page.check('#show-muscles');
  out.overlays = await page.$$eval('#vitals th, #muscles th', (cells) => cells.map((cell) => cell.textContent));
  out.violations = await audit(page);
  if (job.pictures) await page.screenshot({ path: `${job.pictures}/${job.name}_phone.png`, fullPage: true });
  await page.click('#pause');
  const ask = (recipient) => page.evaluate((name) => window.emulated.socket.send(JSON.stringify(
    { type: 'choice', task: 'feeding', robot: '', recipient: name, home: '', policy: '', seed: 2 })), recipient);
  await ask('nobody_9');
  await page.waitForFunction(() => window.emulated.refused.length);
  out.refused = (await page.evaluate(() => window.emulated.refused)).join();
  await ask('kim');
  await page.waitForFunction(() => document.querySelector('#chosen').textContent.includes('Kim'));
  await page.waitForFunction(() => window.emulated.scene.number > 1 && window.emulated.scene.seed === 2);
  out.chosen = await page.textContent('#chosen');
}
