// Plays roles on the page of teleoperation in headless Chromium with an emulated headset: node teleoperation_page.mjs JOB.
// Prints one JSON object with what happened. What is wanted of it is said in the test, this only tells.

import fs from 'node:fs';
import { createRequire } from 'node:module';

const job = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const require = createRequire(`${job.web}/`);
const { chromium } = require('playwright-core');

const FLAGS = [
  '--no-sandbox', '--no-first-run', '--disable-background-networking', '--disable-component-update',
  '--disable-sync', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
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
  // Hold the clutch, and open the mouth.
  eat() {
    window.emulated.hold('right', 1);
    window.emulated.close('right', 1);
  },
};

const out = { errors: [], outside: [], players: {} };
const origin = new URL(job.url).origin;
const browser = await chromium.launch({ executablePath: job.chromium, headless: true, args: FLAGS });
try {
  if (job.kind === 'strangers') await strangers();
  else if (job.kind === 'watch') await watch();
  else if (job.kind === 'replay') await replay();
  else {
    for (const role of job.roles) await enter(role);
    await Promise.all(job.roles.map(play));
  }
} finally {
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
  const { law, until } = job.players[role];
  await page.evaluate(([text]) => {
    window.emulated.law = new Function(`return (${text})`)();
    window.emulated.law(window.emulated.scene, window.emulated.memory);
  }, [LAWS[law].toString().replace(/^(\w+)\(/, 'function $1(')]);
  await page.waitForFunction(until ?? (() => window.emulated.scene.is_over));
  if (job.pictures) {
    await page.screenshot({ path: `${job.pictures}/${job.name}_${role}_in.png` });
  }
  const { scene, memory, refused } = await page.evaluate(() => ({ ...window.emulated, device: null, socket: null, told: null, law: null }));
  out.players[role] = { first: out.players[role].first, last: scene, memory, refused };
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
  const painted = () => page.evaluate(() => window.teleoperation.surfaces.map(({ userData: { base }, attributes: { color } }) =>
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
