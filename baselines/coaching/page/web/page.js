// The page: form, session, end; keyboard, speech, screen readers; one websocket to this computer.

import { Headset, isSupported } from '/web/headset.js';
import { AGAIN, UNREACHABLE, ask, ours, session } from '/web/link.js';
import { drawn, dresser } from '/web/view.js';
import { Webcam } from '/web/webcam.js';

const $ = (id) => document.getElementById(id);
const MISTAKES = {
  none: 'does all right', half_range: 'goes half the way', one_side: 'moves one side only',
  wrong_plane: 'moves in another direction', trunk_lean: 'leans with the trunk', still: 'keeps still',
};
const KEYS = { ' ': 'pause', s: 'skip', r: 'rest', c: 'recentre', Escape: 'stop' };
const PHASES = { settling: 'Sit upright and look ahead', paused: 'Paused', resting: 'Rest' };

let socket;
let view;
let headset;
let state = { phase: 'waiting' };
let isOn = false; // a session has been asked for and is not over
let from = ''; // source of the session
let begun = 0; // number of the session that was asked for, on this connection
let heard = { count: 0, number: 0, told: '' };

function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function set(id, text) {
  const element = $(id);
  if (element.textContent !== text) element.textContent = text;
}

function alarm(text) {
  set('trouble', text);
  $('trouble').hidden = !text;
}

function show(part) {
  for (const id of ['setup', 'session', 'over']) $(id).hidden = id !== part;
}

// The server.

function connect() {
  socket = session();
  socket.addEventListener('open', () => {
    state = { phase: 'waiting', session: 0 };
    begun = 0;
    alarm('');
  });
  socket.addEventListener('message', ({ data }) => take(JSON.parse(data)));
  socket.addEventListener('close', () => {
    if (isOn) {
      finish();
      show('setup');
    }
    alarm(UNREACHABLE);
    setTimeout(async () => { if (await ask(alarm)) connect(); }, AGAIN);
  });
}

function take(message) {
  if (message.type === 'refused') {
    console.warn('refused:', message.why);
    if (state.phase === 'waiting' || state.phase === 'over') alarm(`The coach says: ${message.why}`);
    if (isOn && state.session !== begun && ['begin', ''].includes(message.what)) { // what was asked for does not begin
      begun = state.session;
      finish();
      show('setup');
      $('main').focus();
    }
    return;
  }
  state = message;
  if (isOn && state.session !== begun) return; // of the session before, under way when this one was asked for
  if (isOn && state.phase !== 'waiting') tell();
  keepRecord();
}

// What a session shows.

function verdict() {
  if (state.phase === 'measuring') return state.calibration.say;
  if (state.phase in PHASES) return PHASES[state.phase];
  if (state.following) return 'That is it – go on';
  if (!state.seen) return 'I cannot see you';
  return state.phase === 'explaining' ? 'Listen to the coach' : 'Watch me and do it with me';
}

function tell() {
  const { last } = state;
  if (state.over) {
    end();
    return;
  }
  const words = verdict();
  $('window').dataset.state = state.following ? 'green' : 'neutral';
  set('sign', state.following ? '✓' : '○');
  set('verdict-words', words);
  const measuring = state.phase === 'measuring' && state.calibration;
  const number = measuring ? `Part ${measuring.part} of ${measuring.of}, ${Math.ceil(measuring.left_s)} s left`
    : `Exercise ${state.exercise.number} of ${state.exercise.of}`;
  set('number', number);
  const title = measuring ? 'I measure you' : state.exercise.title;
  set('title', title);
  set('right', String(state.right));
  set('wanted', String(state.wanted));
  const score = $('score');
  if (last) set('score', String(last.score));
  else if (score.firstElementChild === null) score.innerHTML = '<small>none yet</small>';
  $('progress').value = state.progress;
  set('hint', state.hint);
  set('note', state.note);
  if (state.count !== heard.count) {
    heard.count = state.count;
    set('said', state.said);
    if ($('speech').checked && 'speechSynthesis' in window) {
      const speech = new SpeechSynthesisUtterance(state.said);
      speech.lang = 'en';
      window.speechSynthesis.speak(speech);
    }
  }
  if (last && last.number !== heard.number) {
    heard.number = last.number;
    set('told', last.right ? `${state.right} of ${state.wanted} right, score ${last.score}` : `Not right: ${last.why}`);
  }
  const paused = state.phase === 'paused';
  set('pause-word', paused ? 'Go on' : 'Pause');
  set('rest-word', state.phase === 'resting' ? 'Go on' : 'Rest');
  view?.show(state, {
    green: state.following, verdict: `${state.following ? '✓ ' : '○ '}${words}`,
    title: measuring ? number : `${state.exercise.number}/${state.exercise.of}  ${title}`,
    count: `${state.right} of ${state.wanted}`, score: last ? `score ${last.score}` : '', hint: state.hint,
  });
}

function keepRecord() {
  const { recording } = state;
  $('recording-now').hidden = !(recording?.consent && isOn);
  $('kept').hidden = !recording?.report;
  if (recording?.report) set('report', recording.report);
}

function wish(name) {
  if (name === 'pause' && state.phase === 'paused') name = 'resume';
  if (name === 'rest' && state.phase === 'resting') name = 'resume';
  if (name === 'recentre') headset?.recentre();
  if (name === 'stop' || name === 'pause') window.speechSynthesis?.cancel();
  send({ type: 'command', wish: name });
}

// Begin and end.

async function begin(event) {
  event.preventDefault();
  alarm('');
  if (socket?.readyState !== WebSocket.OPEN) {
    alarm(UNREACHABLE);
    return;
  }
  const source = document.querySelector('input[name="source"]:checked').value;
  const exercises = [...document.querySelectorAll('#exercises input:checked')].map((box) => box.value);
  if (!exercises.length) {
    alarm('Please choose at least one exercise.');
    return;
  }
  if (source === 'hands') {
    if (view?.kind !== 'solid') {
      alarm('A headset needs WebGL, which this browser does not offer.');
      return;
    }
    headset = new Headset(view, send, () => {
      headset = undefined;
      if (isOn) wish('stop');
    });
    try {
      await headset.enter();
    } catch (error) {
      headset = undefined;
      alarm(`The headset cannot be entered: ${error.message}`);
      return;
    }
  }
  heard = { count: 0, number: 0, told: '' };
  for (const id of ['said', 'told', 'hint', 'note', 'deleted', 'keeping']) set(id, '');
  send({
    type: 'begin', source, exercises, height_m: $('height').valueAsNumber / 100,
    repetitions: $('repetitions').valueAsNumber, tempo: Number($('tempo').value),
    lift_left_deg: $('lift-left').valueAsNumber, lift_right_deg: $('lift-right').valueAsNumber,
    turn_deg: $('turn').valueAsNumber, mistake: $('mistake').value,
    measure: source !== 'landmarks' && $('measure').checked, body: source === 'hands' ? body() : null,
  });
  if (state.recording) send({ type: 'consent', given: $('consent').checked }); // for this session alone
  begun = (state.session ?? 0) + 1;
  from = source;
  $('live-mistake').hidden = source !== 'simulated';
  $('mistake-now').value = $('mistake').value;
  isOn = true;
  show('session');
  window.scrollTo(0, 0); // the button was at the end of the form
  $('session').focus({ preventScroll: true });
}

function finish() {
  isOn = false;
  headset?.leave();
  if (webcam.isOn) webcam.stop();
}

function end() {
  finish();
  const { complete, exercises } = state.over;
  set('over-title', complete ? '✓ Well done, that was everything.' : 'The session is over.');
  $('summary').replaceChildren(...exercises.map(({ title, right, wanted, wrong }) => {
    const row = document.createElement('tr');
    const head = document.createElement('th');
    head.scope = 'row';
    head.textContent = title;
    row.append(head, ...[`${right} of ${wanted}`, String(wrong)].map((text) => {
      const cell = document.createElement('td');
      cell.textContent = text;
      return cell;
    }));
    return row;
  }));
  $('measured').hidden = !state.calibration?.body;
  set('measured-words', state.calibration?.words ?? '');
  show('over');
  window.scrollTo(0, 0);
  $('over').focus({ preventScroll: true });
}

// What is known of how people are built, kept in this browser by name.

const BODIES = 'rcare-marl-coach-bodies';

function bodies() {
  return JSON.parse(localStorage.getItem(BODIES) ?? '{}');
}

function body() {
  return $('measure').checked ? null : bodies()[$('person').value] ?? null;
}

// Offer those that are kept; choose one, or nobody's.
function offerBodies(chosen = '') {
  const names = Object.keys(bodies()).sort();
  $('person').replaceChildren(new Option('nobody’s: a usual body', ''), ...names.map((name) => new Option(name, name)));
  $('person').value = chosen;
  $('known').hidden = !names.length;
}

function keepBody() {
  const name = $('name').value.trim();
  if (!name) {
    set('keeping', 'Please say whose they are.');
    return;
  }
  localStorage.setItem(BODIES, JSON.stringify({ ...bodies(), [name]: state.calibration.body }));
  offerBodies(name);
  $('measure').checked = false;
  set('keeping', `Kept as those of ${name}. Choose them before the next session.`);
}

function forgetBody() {
  const { [$('person').value]: _, ...others } = bodies();
  localStorage.setItem(BODIES, JSON.stringify(others));
  offerBodies();
}

// A webcam sees how somebody is built; who wears a headset is measured unless somebody's measures are chosen.
function chooseSource() {
  const isHands = $('source-hands').checked;
  $('measures').hidden = $('source-webcam').checked;
  $('measure').checked = isHands && !$('person').value;
}

function choosePerson() {
  const found = bodies()[$('person').value];
  $('measure').checked = !found;
  if (found) $('height').value = Math.round(100 * found.height);
}

// Hand out a file of the recording: the report in a tab, which holds no address with a token, others to save.
async function fetchKept(name) {
  const folder = state.recording.report.split(/[\\/]/).at(-2);
  const answer = await fetch(ours(`/kept/${folder}/${name}`));
  if (!answer.ok) {
    alarm(`The recording is not there (${answer.status}).`);
    return;
  }
  const address = URL.createObjectURL(await answer.blob());
  if (name.endsWith('.html')) window.open(address);
  else Object.assign(document.createElement('a'), { href: address, download: name }).click();
}

function withdraw() {
  send({ type: 'consent', given: false });
  $('consent').checked = false;
  set('deleted', 'The recording has been deleted.');
  set('told', 'The recording has been deleted.');
}

// Preparation.

function choices(select, names) {
  select.replaceChildren(...names.map((name) => new Option(MISTAKES[name] ?? name, name)));
}

function offer(setting) {
  $('exercises').replaceChildren(...setting.exercises.map(({ name, title, about }) => {
    const label = document.createElement('label');
    const box = Object.assign(document.createElement('input'), { type: 'checkbox', value: name, checked: true });
    const words = document.createElement('span');
    const more = document.createElement('small');
    more.textContent = about;
    words.append(title, more);
    label.append(box, words);
    return label;
  }));
  for (const id of ['mistake', 'mistake-now']) choices($(id), setting.mistakes);
  if (setting.record) {
    $('recording-off').hidden = true;
    $('recording-on').hidden = false;
    document.querySelectorAll('.folder').forEach((element) => { element.textContent = setting.record; });
  }
}

// The webcam, which is on from its button to the end of the session.

const webcam = new Webcam($('webcam-picture'), (landmarks) => {
  set('webcam-note', landmarks ? 'I see you' : 'I cannot see you: head, hips and both arms have to be in the picture');
  if (isOn && from === 'landmarks' && landmarks) send(landmarks);
}, (why) => webcamIs(false, why));

function webcamIs(isOnNow, why = '') {
  $('webcam').setAttribute('aria-pressed', String(isOnNow));
  set('webcam', isOnNow ? 'Turn the webcam off' : 'Turn the webcam on');
  $('webcam-picture').hidden = !isOnNow;
  $('source-webcam').disabled = !isOnNow;
  $(isOnNow ? 'source-webcam' : 'source-simulated').checked = true;
  $('mistake-field').hidden = isOnNow;
  chooseSource();
  set('webcam-note', why || (isOnNow ? 'it gets ready' : 'pictures are looked at in this browser, and neither kept nor sent'));
}

async function turnWebcam() {
  if (webcam.isOn) {
    webcam.stop();
    return;
  }
  try {
    webcamIs(true);
    await webcam.start();
  } catch (error) {
    webcamIs(false, error.message);
  }
}

async function lookForHeadset() {
  const found = await isSupported();
  $('source-hands').disabled = !found;
  set('headset-note', found ? 'Begin enters VR; hands or controllers' : 'none found: open this page in the headset, or plug it in');
}

document.addEventListener('keydown', (event) => {
  if ($('session').hidden || event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  const wanted = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!wanted) return;
  const at = event.target.closest('button, select, input, summary, a');
  if (at && (event.key === ' ' || at.tagName === 'SELECT')) return; // these have keys of their own
  event.preventDefault();
  wish(wanted);
});
document.querySelectorAll('[data-wish]').forEach((button) => {
  button.addEventListener('click', () => wish(button.dataset.wish));
});
$('setup').addEventListener('submit', begin);
$('setup').addEventListener('change', (event) => {
  $('mistake-field').hidden = !$('source-simulated').checked;
  if (event.target.name === 'source') chooseSource();
});
$('person').addEventListener('change', choosePerson);
$('forget').addEventListener('click', forgetBody);
$('keep').addEventListener('click', keepBody);
$('mistake-now').addEventListener('change', (event) => send({ type: 'simulate', mistake: event.target.value }));
$('webcam').addEventListener('click', turnWebcam);
$('withdraw').addEventListener('click', withdraw);
document.querySelectorAll('[data-kept]').forEach((button) => {
  button.addEventListener('click', () => fetchKept(button.dataset.kept));
});
$('delete').addEventListener('click', withdraw);
$('again').addEventListener('click', () => {
  show('setup');
  $('main').focus();
  window.scrollTo(0, 0);
});
const setting = await ask(alarm);
if (setting) {
  offer(setting);
  offerBodies();
  view = await drawn($('scene'), (time, frame) => {
    if (frame && headset && isOn) headset.stream(time, frame);
  });
  dresser($('contrast'), () => view.dress?.());
  await lookForHeadset();
  navigator.xr?.addEventListener?.('devicechange', lookForHeadset);
  connect();
}
show(setting ? 'setup' : undefined);
