// What both drawings share: which points make a figure, and how the frame of the body is seen.

export const SIDES = ['left', 'right'];

// Lines of a skeleton, by the names of the server's points.
export const BONES = [
  ['pelvis', 'neck'],
  ['neck', 'head'],
  ['left_shoulder', 'right_shoulder'],
  ...SIDES.flatMap((side) => [
    [`${side}_shoulder`, `${side}_elbow`],
    [`${side}_elbow`, `${side}_wrist`],
    [`${side}_wrist`, `${side}_hand`],
  ]),
];

// The body has x ahead, y left, z up [m]. It is seen as in a mirror: what is left of the person is left of the
// picture, ahead is towards the viewer. (This turns right-handed axes into left-handed ones, as mirrors do.)
export function mirrored([x, y, z]) {
  return [-y, z, x];
}

const ASIDE = 0.9; // width over height of a stage from which on both stand side by side; else one above the other

// Where on a stage coach and person are drawn, apart, so that neither covers the other: from its upper left corner.
export function shares(width, height) {
  const isWide = width > ASIDE * height;
  const [w, h] = isWide ? [width / 2, height] : [width, height / 2];
  return { coach: { x: 0, y: 0, w, h }, user: { x: isWide ? w : 0, y: isWide ? 0 : h, w, h } };
}

// How much of a figure a share shows: legs, too, where they cost nothing. Its height and middle above the floor, its width [m].
export function extent({ w, h }) {
  const tall = w > h ? 1.5 : 2.05;
  return { tall, middle: w > h ? 1.22 : 0.96, across: 1.9 };
}

// Put the figures' names into the lower left corner of their shares.
export function label(canvas) {
  const size = [canvas.clientWidth, canvas.clientHeight];
  for (const [name, { x, y, h }] of Object.entries(shares(...size))) {
    const { style } = canvas.parentElement.querySelector(`.${name}-name`);
    style.left = `${x + 5}px`;
    style.bottom = `${size[1] - y - h + 5}px`;
  }
}
