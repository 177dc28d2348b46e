// The coach's webcam, editor and report in headless Chromium, how its pages fit their screens, and what axe says.

import fs from 'node:fs';

const SCREENS = { wide: { width: 1280, height: 800 }, phone: { width: 390, height: 844 } };

async function picture(page, job, name) {
  if (job.keeps) await page.screenshot({ path: `${job.pictures}/${name}.png` });
}

// Turn the webcam on and off; whether its light would be on is told by the track of its picture.
export async function button(page, job, out) {
  await page.route('**/package/pose/pose.js', () => {}); // MediaPipe never comes: nothing is drawn while this is told
  await page.waitForSelector('#setup:not([hidden])');
  await page.click('#webcam');
  out.states = [];
  if (!job.flags.length) { // no camera may be used
    await page.waitForFunction(() => document.querySelector('#webcam-note').textContent.endsWith('.'));
    out.note = await page.textContent('#webcam-note');
    return;
  }
  await page.waitForFunction(() => document.querySelector('#webcam-picture').videoWidth > 0);
  const state = () => page.evaluate(() => ({
    pressed: document.querySelector('#webcam').getAttribute('aria-pressed'), source: document.querySelector('input[name=source]:checked').value,
    light: window.track?.readyState, shown: !document.querySelector('#webcam-picture').hidden,
  }));
  await page.evaluate(() => { [window.track] = document.querySelector('#webcam-picture').srcObject.getVideoTracks(); });
  out.states.push(await state());
  await picture(page, job, 'webcam');
  await page.click('#webcam');
  out.states.push(await state());
}

// A session before the webcam, in which MediaPipe finds the person, until a repetition is right.
export async function webcam(page, job, out, { fill }) {
  await page.waitForSelector('#setup:not([hidden])');
  await page.click('#webcam');
  await page.waitForFunction(() => document.querySelector('#webcam-note').textContent === 'I see you');
  await page.evaluate(() => { [window.track] = document.querySelector('#webcam-picture').srcObject.getVideoTracks(); });
  await fill(page);
  await page.click('#begin');
  await page.waitForFunction(() => document.querySelector('#right').textContent === '1');
  out.told = await page.textContent('#told');
  await picture(page, job, 'webcam_session');
  await page.click('[data-wish="stop"]');
  await page.waitForSelector('#over:not([hidden])');
  out.light = await page.evaluate(() => window.track.readyState);
}

// Write an exercise: a bad value is named, a good one is shown and saved.
export async function editor(page, job, out) {
  const words = (start) => page.waitForFunction((text) => document.querySelector('#verdict').textContent.startsWith(text), start);
  await page.click('a[href="/editor"]');
  await page.selectOption('#start', 'front_raise');
  await page.fill('#name', 'reach_up');
  const lifted = '.pose:nth-child(2) [data-motion="shoulder_elevation"]';
  await page.fill(lifted, '300');
  await words('!');
  out.bad = await page.textContent('#verdict');
  out.barred = await page.isDisabled('#save');
  await page.fill(lifted, '120');
  await page.fill('#title', 'Reach up');
  await page.fill('#lift_right_deg', '20');
  await page.waitForFunction(() => document.querySelector('#yaml').textContent.includes('title: Reach up'));
  await words('✓');
  out.good = await page.textContent('#verdict');
  await page.click('#more');
  await words('✓');
  await page.fill('.pose:nth-child(3) [data-motion="elbow_flexion"]', '90');
  await page.waitForFunction(() => document.querySelector('#yaml').textContent.includes('elbow_flexion: 90'));
  await page.waitForSelector('#save:not([disabled])');
  await picture(page, job, 'editor');
  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#save')]);
  out.file = `${job.pictures}/${download.suggestedFilename()}`;
  await download.saveAs(out.file);
}

// Whether all that matters is seen without scrolling, and coach and person apart, on a screen and on a phone.
export async function layout(page, job, out) {
  out.screens = {};
  await page.waitForSelector('#setup:not([hidden])');
  await page.setViewportSize(SCREENS[job.screen]);
  const inView = (selector) => page.evaluate((wanted) => {
    const { top, bottom, left, right } = document.querySelector(wanted).getBoundingClientRect();
    return window.scrollY === 0 && top >= 0 && left >= 0 && bottom <= window.innerHeight && right <= window.innerWidth;
  }, selector);
  out.begin = await inView('#begin');
  await picture(page, job, `${job.screen}_setup`);
  await page.click('#begin');
  await page.waitForFunction(() => document.querySelector('#told').textContent);
  out.stage = await inView('#stage');
  out.keys = await page.isVisible('kbd');
  await picture(page, job, `${job.screen}_session`);
  out.shares = await page.evaluate(async () => {
    const { shares } = await import('/web/figure.js');
    const { clientWidth, clientHeight } = document.querySelector('#scene');
    return { ...shares(clientWidth, clientHeight), size: [clientWidth, clientHeight] };
  });
}

// What axe finds on each part of the pages.
export async function axe(page, job, out, { fill, words }) {
  const source = fs.readFileSync(`${job.web}/node_modules/axe-core/axe.min.js`, 'utf8');
  out.violations = [];
  const audit = async (part) => {
    await page.evaluate(source);
    const { violations } = await page.evaluate(() => window.axe.run());
    out.violations.push(...violations.map(({ id, nodes }) => `${part}: ${id} at ${nodes.map(({ target }) => target).join(', ')}`));
  };
  await fill(page, 20);
  await audit('setup');
  await page.click('#begin');
  await page.waitForFunction(() => document.querySelector('#told').textContent);
  await page.keyboard.press('Space');
  await words(page, 'Paused');
  await audit('session');
  await page.keyboard.press('Escape');
  await page.waitForSelector('#over:not([hidden])');
  await audit('over');
  await page.click('#again');
  await page.click('a[href="/editor"]');
  await page.waitForSelector('#save:not([disabled])');
  await audit('editor');
}

// The report in a tab of its own, and the table and the observations as files.
export async function saved(page, job, out) {
  const [report] = await Promise.all([page.waitForEvent('popup'), page.click('[data-kept="report.html"]')]);
  await report.waitForLoadState();
  out.address = report.url();
  out.report = await report.innerText('body');
  out.plots = await report.$$eval('img', (images) => images.map(({ naturalWidth, alt }) => [naturalWidth, alt]));
  out.border = await report.evaluate(() => getComputedStyle(document.querySelector('th')).borderTopStyle);
  if (job.keeps) await report.screenshot({ path: `${job.pictures}/report.png`, fullPage: true });
  await report.close();
  out.files = {};
  for (const name of ['repetitions.csv', 'observations.json']) {
    const [download] = await Promise.all([page.waitForEvent('download'), page.click(`[data-kept="${name}"]`)]);
    out.files[name] = fs.readFileSync(await download.path(), 'utf8');
  }
}
