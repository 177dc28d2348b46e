// Looks words up in the search of the docs' site, and lets axe look at its pages: node site_page.mjs JOB, a JSON file.
// Prints one JSON object with what was found. What is wanted of it is said in the test, this only tells.

import fs from 'node:fs';
import { createRequire } from 'node:module';

const job = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const { chromium } = createRequire(`${job.web}/`)('playwright-core');
const FLAGS = [
  '--no-sandbox', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync', '--disable-quic',
];
const out = { errors: [], outside: [], found: {}, violations: [] };

const browser = await chromium.launch({ executablePath: job.chromium, headless: true, args: FLAGS });
try {
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  page.setDefaultTimeout(job.patience);
  page.on('pageerror', (error) => out.errors.push(error.message));
  page.on('request', (request) => {
    if (!request.url().startsWith(job.url) && !/^(data|blob):/.test(request.url())) out.outside.push(request.url());
  });
  for (const word of job.words) {
    await page.goto(`${job.url}/index.html`, { waitUntil: 'networkidle' }); // nothing is left of the word before
    await page.click('input[name="query"]');
    await page.keyboard.type(word);
    const look = () => page.$$eval('.md-search-result__list > li > a', (links) => links.map((each) => new URL(each.href).pathname.slice(1)));
    let before = null;
    const until = Date.now() + job.patience;
    do { // each key asks anew, and answers come late
      before = out.found[word];
      await page.waitForTimeout(400);
      out.found[word] = await look();
    } while (Date.now() < until && !(out.found[word].length && String(before) === String(out.found[word])));
  }
  const source = fs.readFileSync(`${job.web}/node_modules/axe-core/axe.min.js`, 'utf8');
  for (const name of job.pages) {
    await page.goto(`${job.url}/${name}`, { waitUntil: 'networkidle' });
    await page.evaluate(source);
    const { violations } = await page.evaluate(() => window.axe.run());
    out.violations.push(...violations.map(({ id, nodes }) => `${name}: ${id} at ${nodes.map(({ target }) => target).join(', ')}`));
  }
} finally {
  await browser.close();
}
console.log(JSON.stringify(out));
