// Looks over the coach's page as somebody who sees little, or nothing, or has a keyboard only.

const SIZES = { wide: { width: 1280, height: 800 }, phone: { width: 390, height: 844 }, narrow: { width: 320, height: 640 } };
const SCHEMES = {
  light: { colorScheme: 'light', contrast: 'no-preference' },
  dark: { colorScheme: 'dark', contrast: 'no-preference' },
  contrast: { colorScheme: 'light', contrast: 'more' },
};
const CONTROLS = ['button', 'checkbox', 'combobox', 'image', 'img', 'link', 'radio', 'spinbutton', 'textbox'];

// Least contrast of text with its ground, and of the edges of controls with theirs, in both states of the window.
function contrasts() {
  const canvas = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
  const rgba = (colour) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const luminance = (colour) => {
    const [r, g, b] = rgba(colour).map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ground = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = getComputedStyle(at).backgroundColor;
      if (rgba(colour)[3] === 255) return colour;
    }
    return 'white';
  };
  const ratio = (one, other) => {
    const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  };
  const isSeen = (element) => element.checkVisibility({ visibilityProperty: true }) && !element.closest('.unseen')
    && element.getBoundingClientRect().right > 0;
  let [text, edge, smallest] = [{ ratio: Infinity }, { ratio: Infinity }, Infinity];
  const before = document.getElementById('window').dataset.state;
  for (const state of ['neutral', 'green']) {
    document.getElementById('window').dataset.state = state;
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
      const element = walker.currentNode.parentElement;
      if (!walker.currentNode.textContent.trim() || element.closest('script, select') || !isSeen(element)) continue;
      const style = getComputedStyle(element);
      const found = ratio(style.color, ground(element));
      if (found < text.ratio) text = { ratio: found, at: walker.currentNode.textContent.trim().slice(0, 40), state };
      smallest = Math.min(smallest, parseFloat(style.fontSize));
    }
    for (const element of document.querySelectorAll('button, select, input[type="number"]')) {
      if (!isSeen(element)) continue;
      const found = ratio(getComputedStyle(element).borderColor, ground(element.parentElement));
      if (found < edge.ratio) edge = { ratio: found, at: element.id || element.textContent };
    }
  }
  document.getElementById('window').dataset.state = before;
  const { scrollWidth, clientWidth } = document.documentElement;
  return { text, edge, smallest, overflow: scrollWidth - clientWidth };
}

// Where Tab goes, from the top of the page until it leaves: places in the document.
async function tour(page) {
  await page.evaluate(() => { document.activeElement.blur(); window.scrollTo(0, 0); document.body.tabIndex = -1; document.body.focus(); });
  const order = [];
  for (let i = 0; i < 60; i += 1) {
    await page.keyboard.press('Tab');
    const at = await page.evaluate(() => {
      const element = document.activeElement;
      if (!element || element === document.body) return null;
      const style = getComputedStyle(element);
      return {
        place: [...document.querySelectorAll('*')].indexOf(element),
        name: element.id || element.value || element.textContent.trim(),
        outline: style.outlineStyle === 'none' ? 0 : parseFloat(style.outlineWidth),
      };
    });
    if (!at || order.some(({ place }) => place === at.place)) break;
    order.push(at);
  }
  return order;
}

async function nameless(page) {
  const session = await page.context().newCDPSession(page);
  const { nodes } = await session.send('Accessibility.getFullAXTree');
  await session.detach();
  return nodes.filter(({ ignored, role, name }) => !ignored && CONTROLS.includes(role?.value) && !name?.value)
    .map(({ role }) => role.value);
}

export async function access(page, job, out, { fill, words }) {
  out.looks = {};
  const look = async (part) => {
    for (const [size, viewport] of Object.entries(SIZES)) {
      await page.setViewportSize(viewport);
      for (const [scheme, media] of Object.entries(SCHEMES)) {
        await page.emulateMedia(media);
        await page.waitForFunction((high) => (document.documentElement.dataset.contrast === 'high') === high, scheme === 'contrast');
        out.looks[`${part} ${size} ${scheme}`] = await page.evaluate(contrasts);
        if (job.keeps) await page.screenshot({ path: `${job.pictures}/${part}_${size}_${scheme}.png`, fullPage: true });
      }
    }
    await page.setViewportSize(SIZES.wide);
    out.looks[part] = { nameless: await nameless(page), tour: await tour(page) };
  };
  await fill(page, 20);
  await page.click('summary');
  await look('setup');
  await page.focus('#begin');
  await page.keyboard.press('Enter');
  await page.waitForFunction(() => document.querySelector('#told').textContent);
  out.told = await page.textContent('#told');
  out.hint = await page.textContent('#hint');
  out.live = await page.$$eval('[aria-live="polite"], [role="status"]', (all) => all.map(({ id }) => id));
  await page.keyboard.press('Space'); // or it may be over before all has been looked at
  await words(page, 'Paused');
  await look('session');
  await page.focus('#session');
  await page.keyboard.press('Escape');
  await page.waitForSelector('#over:not([hidden])');
  await look('over');
}
