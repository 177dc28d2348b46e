// Both figures on a canvas: solid where there is WebGL, else as lines.

import { FlatView } from '/web/canvas.js';

// Draw on a canvas as long as it is shown; `each` gets the time, and the frame of a headset where one is entered.
export async function drawn(canvas, each) {
  const step = (view) => (time, frame) => {
    each(time, frame);
    if (view.canvas.checkVisibility()) view.draw();
  };
  try {
    const { SolidView } = await import('/web/scene.js');
    const view = new SolidView(canvas);
    view.renderer.setAnimationLoop(step(view));
    return view;
  } catch (error) {
    console.warn(`no WebGL, so lines: ${error.message}`);
    const plain = canvas.cloneNode(); // a canvas keeps the kind of drawing that was tried on it
    canvas.replaceWith(plain);
    const view = new FlatView(plain);
    const loop = (time) => {
      step(view)(time);
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
    return view;
  }
}

// What the system asks for, unless the button has said otherwise.
export function dresser(button, dress) {
  const [contrast, dark] = ['(prefers-contrast: more)', '(prefers-color-scheme: dark)'].map((each) => matchMedia(each));
  const root = document.documentElement;
  const put = (wish = contrast.matches ? 'high' : 'usual') => {
    root.dataset.contrast = wish;
    button.setAttribute('aria-pressed', String(wish === 'high'));
    dress();
  };
  button.addEventListener('click', () => put(button.getAttribute('aria-pressed') === 'true' ? 'usual' : 'high'));
  contrast.addEventListener('change', () => put());
  dark.addEventListener('change', () => put(root.dataset.contrast));
  put();
}
