// Drives the coach's page in headless Chromium: node coach_page.mjs JOB, a JSON file.
// Prints one JSON object with what happened. What is wanted of it is said in the test, this only tells.

import fs from 'node:fs';
import { createRequire } from 'node:module';

import { access } from './coach_access.mjs';
import { EMULATOR, headset } from './coach_headset.mjs';
import { axe, button, editor, layout, saved, webcam } from './coach_tools.mjs';

const job = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const require = createRequire(`${job.web}/`);
const { chromium } = require('playwright-core');

// Software drawing; nothing that Chromium does by itself reaches out.
const FLAGS = [
  '--no-sandbox', '--no-first-run', '--disable-background-networking', '--disable-component-update',
  '--disable-sync', '--disable-quic', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
];
const origin = new URL(job.url).origin;
const out = { errors: [], outside: [] };

const browser = await chromium.launch({ executablePath: job.chromium, headless: true, args: [...FLAGS, ...job.flags] });
try {
  const page = await browser.newPage({ viewport: job.viewport, hasTouch: job.touch, isMobile: job.touch, ignoreHTTPSErrors: true });
  page.setDefaultTimeout(job.patience);
  page.on('pageerror', (error) => out.errors.push(error.message));
  page.on('console', (message) => {
    const isExpected = job.expected.some((text) => message.text().includes(text));
    if (message.type() === 'error' && !isExpected) out.errors.push(message.text());
  });
  page.on('request', (request) => {
    const url = request.url();
    if (!url.startsWith(`${origin}/`) && !/^(data|blob):/.test(url)) out.outside.push(url);
  });
  if (job.kind === 'headset') {
    await page.addInitScript({ path: require.resolve('iwer/build/iwer.min.js') });
    await page.addInitScript(EMULATOR);
  }
  await page.goto(job.url);
  await ({ access, arrive, axe, button, editor, headset, layout, measured, recorded, refused, simulated, stranger, webcam }[job.kind])(page, job, out, { fill, words });
} finally {
  await browser.close();
}
console.log(JSON.stringify(out));

// Choose one exercise and fill in the form.
async function fill(page, repetitions = 9) {
  await page.waitForSelector('#exercises input');
  await page.waitForSelector('#setup:not([hidden])');
  for (const box of await page.$$('#exercises input')) await box.setChecked((await box.inputValue()) === job.exercise);
  await page.fill('#height', String(job.height_cm));
  await page.fill('#repetitions', String(repetitions));
}

// Wait until the page says words that are, or are not, those.
async function words(page, text, { not = false } = {}) {
  await page.waitForFunction(
    ([wanted, turned]) => document.querySelector('#verdict-words').textContent.startsWith(wanted) !== turned, [text, not]);
}

// The first session cannot begin: the arms reach too little for what is asked. The page says so, and goes on.
async function refused(page) {
  await fill(page);
  await page.click('summary');
  for (const id of ['#lift-left', '#lift-right']) await page.fill(id, '10');
  await page.click('#begin');
  await page.waitForSelector('#trouble:not([hidden])');
  out.trouble = await page.textContent('#trouble');
  await page.waitForSelector('#setup:not([hidden])');
  for (const id of ['#lift-left', '#lift-right']) await page.fill(id, '180');
  await simulated(page);
}

async function arrive(page) {
  await page.waitForFunction(() => document.querySelector('#exercises input') && !document.querySelector('#setup').hidden);
  out.address = page.url();
  await page.reload(); // the token is kept for this tab
  await simulated(page);
}

async function stranger(page) {
  await page.waitForSelector('#trouble:not([hidden])');
  out.trouble = await page.textContent('#trouble');
  await page.waitForSelector('#setup', { state: 'hidden' });
}

async function simulated(page) {
  await fill(page, 20);
  await page.focus('#begin');
  await page.keyboard.press('Enter'); // by keyboard alone
  const green = await page.waitForFunction(() => document.querySelector('#window').dataset.state === 'green'
    && document.querySelector('#verdict-words').textContent); // at once: it is green for a moment only
  out.words = await green.jsonValue();
  out.kind = await page.evaluate(() => (document.querySelector('#scene').getContext('2d') ? 'flat' : 'solid'));
  if (job.keeps) await page.screenshot({ path: `${job.pictures}/${job.name}.png` }); // takes long where much else runs
  await page.waitForFunction(() => Number(document.querySelector('#right').textContent) > 0);
  await page.keyboard.press('Space');
  await words(page, 'Paused');
  await page.keyboard.press('Space');
  await words(page, 'Paused', { not: true });
  await page.keyboard.press('r');
  await words(page, 'Rest');
  await page.keyboard.press('r');
  await words(page, 'Rest', { not: true });
  await page.keyboard.press('Escape');
  await page.waitForSelector('#over:not([hidden])');
  out.title = await page.textContent('#over-title');
  out.focus = await page.evaluate(() => document.activeElement.id);
}

// A calibration of who keeps still at first; what came out is kept by a name, chosen for the next session, forgotten.
async function measured(page) {
  await fill(page, 1);
  await page.selectOption('#mistake', 'still');
  await page.check('#measure');
  await page.click('#begin');
  await words(page, 'Sit upright');
  out.number = await page.textContent('#number');
  const trouble = await page.waitForFunction(() => document.querySelector('#hint').textContent);
  out.trouble = await trouble.jsonValue();
  await page.selectOption('#mistake-now', 'none');
  await words(page, 'Draw one big circle');
  if (job.keeps) await page.screenshot({ path: `${job.pictures}/measuring.png` });
  await page.waitForSelector('#over:not([hidden])');
  out.words = await page.textContent('#measured-words');
  await page.fill('#name', 'Ada');
  await page.click('#keep');
  out.kept = await page.textContent('#keeping');
  if (job.keeps) await page.screenshot({ path: `${job.pictures}/measured.png`, fullPage: true });
  await page.reload();
  await page.waitForSelector('#known:not([hidden])');
  await page.selectOption('#person', 'Ada');
  out.chosen = await page.evaluate(() => ['measure', 'height'].map((id) => document.getElementById(id)).map(({ checked, value }) => [checked, value]));
  out.body = await page.evaluate(() => JSON.parse(localStorage.getItem('rcare-marl-coach-bodies')).Ada);
  if (job.keeps) await page.screenshot({ path: `${job.pictures}/known.png`, fullPage: true });
  await page.click('#forget');
  out.left = await page.evaluate(() => localStorage.getItem('rcare-marl-coach-bodies'));
  out.gone = await page.isHidden('#known');
}

// A session without consent, one with it, and one that is deleted on the last page.
async function recorded(page) {
  out.reports = [];
  out.indicated = {};
  for (const wish of ['no', 'keep', 'delete']) {
    await fill(page, 1);
    out.offered = await page.textContent('#recording-on');
    await page.setChecked('#consent', wish !== 'no');
    await page.evaluate(() => { // whether it ever says that it records: the session may be over before we look
      const sign = document.getElementById('recording-now');
      window.indicated = false;
      new MutationObserver(() => { window.indicated ||= !sign.hidden; }).observe(sign, { attributes: true });
    });
    await page.click('#begin');
    await page.waitForSelector('#over:not([hidden])');
    out.title = await page.textContent('#over-title');
    out.indicated[wish] = await page.evaluate(() => window.indicated);
    if (wish !== 'no') {
      await page.waitForSelector('#kept:not([hidden])');
      out.reports.push(await page.textContent('#report'));
      if (wish === 'keep') await saved(page, job, out);
    }
    if (wish === 'delete') {
      await page.click('#delete');
      await page.waitForSelector('#kept', { state: 'hidden' });
      out.told = await page.textContent('#deleted');
    } else {
      await page.click('#again');
    }
  }
}
