// An exercise is written: each change is sent to the server, which answers how it looks, or what is wrong with it.

import { ask, session, UNREACHABLE } from '/web/link.js';
import { drawn, dresser } from '/web/view.js';

const $ = (id) => document.getElementById(id);
const ARM = {
  shoulder_elevation: 'lifted', shoulder_plane: 'to the front (90), to the side (0)', shoulder_rotation: 'turned inwards',
  elbow_flexion: 'elbow bent', forearm_pronation: 'palm down',
};
const REST_OF = {
  Head: { neck_rotation_left: 'turned to the left', neck_flexion: 'nodding', neck_lateral_flexion_left: 'tilted to the left' },
  Trunk: { trunk_flexion: 'leaning forward', trunk_lateral_flexion_left: 'leaning to the left', trunk_rotation_left: 'turned to the left' },
};
const JUDGED = {
  range_share: ['Share of the way that is enough, 0 to 1', 0.8], lean_deg: ['Leaning that is let pass, degrees', 10],
  plane_deg: ['Leaving the path, degrees', 28], elbow_deg: ['Bending the elbow more, degrees', 25],
  symmetry: ['One arm less than the other, 0 to 1', 0.22], patience_s: ['Seconds until the coach asks', 2],
};
const BLANK = {
  title: '', say: '', about: '', rest: { shoulder_elevation: 12, shoulder_plane: 45, elbow_flexion: 20 },
  poses: [{ angles_deg: {}, move_s: 1.5, hold_s: 0.5 }], return_s: 1.5, repetitions: 5, judged: {},
};
const PAUSE = 0.8; // between two repetitions [s]
const CALM = 250; // after so long without another change it is asked how it looks [ms]
const PERSON = ['lift_left_deg', 'lift_right_deg', 'turn_deg'];

let socket;
let view;
let made; // what the server said last
let begun = 0; // when the picture began to move [ms]
let timer;
let seconds = 0; // into the repetition

function alarm(text) {
  $('trouble').textContent = text;
  $('trouble').hidden = !text;
}

// The form.

function input(label, value, more) {
  const field = Object.assign(document.createElement('p'), { className: 'field' });
  const words = document.createElement('label');
  const box = Object.assign(document.createElement('input'), { type: 'number', step: 'any', value: value ?? '', ...more });
  words.append(`${label} `, box);
  field.append(words);
  return [field, box];
}

// Motions of a pose in groups; a motion that is not named is as at the beginning.
function groups() {
  const arms = $('alike').checked
    ? { 'Both arms': ARM }
    : Object.fromEntries(['left', 'right'].map((side) => [`${side[0].toUpperCase()}${side.slice(1)} arm`,
      Object.fromEntries(Object.entries(ARM).map(([motion, words]) => [`${side}_${motion}`, words]))]));
  return { ...arms, ...REST_OF };
}

function angleOf(angles, motion) {
  const shared = motion.replace(/^(left|right)_/, '');
  return angles[motion] ?? angles[shared] ?? angles[`left_${shared}`];
}

function position(legend, { angles_deg: angles, move_s: move, hold_s: hold }, isRest) {
  const box = document.createElement('fieldset');
  box.className = 'pose';
  box.append(Object.assign(document.createElement('legend'), { textContent: legend }));
  if (!isRest) {
    const times = Object.assign(document.createElement('div'), { className: 'fields' });
    for (const [label, key, value] of [['Seconds to get there', 'move_s', move], ['Seconds to stay', 'hold_s', hold]]) {
      const [field, entry] = input(label, value, { min: 0, step: 0.1 });
      entry.dataset.time = key;
      times.append(field);
    }
    box.append(times);
  }
  for (const [name, motions] of Object.entries(groups())) {
    const part = document.createElement('details');
    part.open = Object.keys(motions).some((motion) => angleOf(angles, motion) !== undefined);
    part.append(Object.assign(document.createElement('summary'), { textContent: `${name}, degrees` }));
    const fields = Object.assign(document.createElement('div'), { className: 'fields' });
    for (const [motion, label] of Object.entries(motions)) {
      const [field, entry] = input(`${label}`, angleOf(angles, motion), { step: 5 });
      entry.dataset.motion = motion;
      fields.append(field);
    }
    part.append(fields);
    box.append(part);
  }
  if (!isRest) {
    const out = Object.assign(document.createElement('button'), { type: 'button', textContent: `Take out ${legend.toLowerCase()}` });
    out.addEventListener('click', () => {
      const now = read();
      now.poses.splice([...$('poses').children].indexOf(box) - 1, 1);
      write(now);
      $('more').focus();
    });
    box.append(out);
  }
  return box;
}

function write(exercise) {
  for (const key of ['title', 'say', 'about', 'repetitions', 'return_s']) $(key).value = exercise[key];
  $('poses').replaceChildren(position('How it begins and ends', { angles_deg: exercise.rest }, true),
    ...exercise.poses.map((pose, i) => position(`Position ${i + 1}`, pose)));
  for (const box of $('judged').querySelectorAll('input')) box.value = exercise.judged[box.dataset.demand] ?? '';
  kept = exercise.judged;
  changed();
}

let kept = {}; // demands of where it began, some of which have no field

function number(box) {
  return Number.isNaN(box.valueAsNumber) ? box.value || null : box.valueAsNumber;
}

function angles(box) {
  const given = [...box.querySelectorAll('[data-motion]')].filter(({ value, validity }) => value || validity.badInput);
  return Object.fromEntries(given.map((each) => [each.dataset.motion, number(each)]));
}

// The exercise as its file will say it.
function read() {
  const [rest, ...poses] = $('poses').children;
  const judged = { ...kept };
  for (const box of $('judged').querySelectorAll('input')) {
    if (box.value) judged[box.dataset.demand] = number(box);
    else delete judged[box.dataset.demand];
  }
  const time = (box, key) => number(box.querySelector(`[data-time="${key}"]`));
  return {
    title: $('title').value, say: $('say').value, about: $('about').value, rest: angles(rest),
    poses: poses.map((box) => ({ angles_deg: angles(box), move_s: time(box, 'move_s'), hold_s: time(box, 'hold_s') })),
    return_s: number($('return_s')), repetitions: number($('repetitions')), judged,
  };
}

// The server.

function changed() {
  $('save').disabled = true;
  clearTimeout(timer);
  timer = setTimeout(() => {
    if (socket.readyState !== WebSocket.OPEN) return;
    const person = Object.fromEntries(PERSON.map((key) => [key, number($(key))]));
    socket.send(JSON.stringify({ type: 'draft', name: $('name').value, exercise: read(), ...person }));
  }, CALM);
}

function take(message) {
  if (message.type === 'refused') {
    $('window').dataset.state = 'neutral';
    $('verdict').textContent = `! ${message.why}`;
    $('save').disabled = true;
  } else if (message.type === 'draft') {
    made = message;
    $('window').dataset.state = 'green';
    const missing = made.parts.filter((part) => !made.left.includes(part));
    const less = missing.length ? `; this person cannot: ${missing.join(', ')}` : '';
    $('verdict').textContent = `✓ ${made.duration} seconds, moves ${made.parts.join(', ')}${less}`;
    $('file').textContent = `${$('name').value}.yaml`;
    $('yaml').textContent = made.yaml;
    $('save').disabled = false;
  }
}

function connect() {
  socket = session();
  socket.addEventListener('open', () => { alarm(''); changed(); });
  socket.addEventListener('message', ({ data }) => take(JSON.parse(data)));
  socket.addEventListener('close', () => {
    $('save').disabled = true;
    alarm(UNREACHABLE);
    setTimeout(async () => { if (await ask(alarm)) connect(); }, 2000);
  });
}

function show(time) {
  if (!made) return;
  if ($('still').getAttribute('aria-pressed') === 'false') seconds = ((time - begun) / 1000) % (made.duration + PAUSE);
  const at = (frames) => frames?.[Math.min(Math.round(seconds * made.rate), frames.length - 1)];
  view.show({ coach: at(made.coach), user: at(made.user) });
}

function save() {
  const link = Object.assign(document.createElement('a'), {
    download: $('file').textContent, href: URL.createObjectURL(new Blob([made.yaml], { type: 'application/yaml' })),
  });
  link.click();
  URL.revokeObjectURL(link.href);
}

const setting = await ask(alarm);
if (setting) {
  const starts = { '': BLANK, ...Object.fromEntries(setting.exercises.map((each) => [each.name, each])) };
  $('start').append(...Object.entries(starts).map(([name, { title }]) => new Option(title || 'nothing', name)));
  $('judged').append(...Object.entries(JUDGED).map(([name, [label, usual]]) => {
    const [field, box] = input(label, '', { min: 0, placeholder: usual });
    box.dataset.demand = name;
    return field;
  }));
  connect();
  $('editor').hidden = false;
  $('start').addEventListener('change', () => {
    const start = starts[$('start').value];
    $('alike').checked = ![start.rest, ...start.poses.map((pose) => pose.angles_deg)]
      .some((each) => Object.keys(each).some((motion) => /^(left|right)_/.test(motion)));
    write(start);
  });
  $('alike').addEventListener('change', () => write(read()));
  $('more').addEventListener('click', () => {
    const now = read();
    now.poses.push(now.poses.at(-1) ?? BLANK.poses[0]);
    write(now);
  });
  $('draft').addEventListener('input', changed);
  $('draft').addEventListener('submit', (event) => event.preventDefault());
  $('still').addEventListener('click', ({ target }) => {
    target.setAttribute('aria-pressed', String(target.getAttribute('aria-pressed') === 'false'));
  });
  $('save').addEventListener('click', save);
  $('start').value = setting.exercises[0].name;
  $('start').dispatchEvent(new Event('change'));
  view = await drawn($('scene'), show);
  dresser($('contrast'), () => view.dress?.());
  begun = performance.now();
}
