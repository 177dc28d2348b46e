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
