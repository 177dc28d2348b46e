// An emulated headset before the coach's page, in step with the server: each pose that is played is reported by
// the page, which puts the clock of the session to its time, and what the page then shows is read. So how fast
// this machine draws changes nothing but how long it takes.

const SIDES = ['left', 'right'];
const MOST = 600; // poses that are played while something is waited for: half a minute

export const EMULATOR = `
  const device = new IWER.XRDevice(IWER.metaQuest3, { stereoEnabled: true });
  device.installRuntime({ forceInstall: true });
  // This emulator calls every position emulated; the page takes that, rightly, for a guess.
  Object.defineProperty(XRPose.prototype, 'emulatedPosition', { get: () => false });
  const emulated = { device, time: 1, drawn: 0, sent: null, state: null, waiting: [], isHeld: false };
  window.emulated = emulated;
  // Once a session is on there is one frame for each pose: the emulator clears and reads the picture in each, which
  // takes long without a graphics card.
  const held = [];
  const animate = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (callback) => (emulated.isHeld ? -held.push(callback) : animate(callback));
  const ask = XRSession.prototype.requestAnimationFrame;
  XRSession.prototype.requestAnimationFrame = function request(callback) {
    return ask.call(this, (_, frame) => {
      if (emulated.drawn === emulated.time) request.call(this, callback);
      else callback(1000 * (emulated.drawn = emulated.time), frame);
    });
  };
  const note = () => setTimeout(() => { // when the page has shown it
    emulated.waiting = emulated.waiting.filter(({ holds, done }) => !(holds() && (done(), true)));
  }, 0);
  emulated.until = (holds) => new Promise((done) => { emulated.waiting.push({ holds, done }); note(); });
  window.WebSocket = class extends WebSocket {
    constructor(...given) {
      super(...given);
      this.addEventListener('message', ({ data }) => {
        const message = JSON.parse(data);
        if (message.type === 'state') emulated.state = message;
        note();
      });
    }

    send(text) {
      super.send(text);
      const message = JSON.parse(text);
      if (message.type === 'hands') emulated.sent = message;
      note();
    }
  };
  // Take poses at the next step in time; return what the page shows of them.
  emulated.step = async (step, what, poses) => {
    const put = (item, [x, y, z, ...turn]) => { item.position.set(x, y, z); item.quaternion.set(...turn); };
    put(device, poses.head);
    for (const side of ['left', 'right']) put(device[what][side], poses[side]);
    const before = emulated.state?.time ?? 0;
    emulated.time += step;
    const due = Number(emulated.time.toFixed(4));
    while (!emulated.sent || Math.abs(emulated.sent.time - due) > 1e-3) {
      for (const callback of held.splice(0)) callback(performance.now());
      await new Promise((done) => { setTimeout(done, 0); });
    }
    await emulated.until(() => emulated.state.time > before || emulated.state.phase === 'waiting');
    const text = (id) => document.getElementById(id).textContent;
    return { sent: emulated.sent, phase: emulated.state.phase, green: document.getElementById('window').dataset.state === 'green',
      right: Number(text('right')), score: text('score'), hint: text('hint'), told: text('told'), words: text('verdict-words') };
  };`;

export async function headset(page, job, out, { fill }) {
  const { Matrix4, Quaternion, Vector3 } = await import(`${job.web}/node_modules/three/build/three.module.js`);

  const matrix = ([x, y, z, ...turn]) => new Matrix4().compose(
    new Vector3(x, y, z), new Quaternion(...turn), new Vector3(1, 1, 1));
  const seven = (pose) => {
    const [place, turn, scale] = [new Vector3(), new Quaternion(), new Vector3()];
    pose.decompose(place, turn, scale);
    return [...place.toArray(), ...turn.toArray()];
  };
  // Wrist and axes of a hand: x along the fingers, z out of its back.
  const palm = (side, joints) => {
    const [wrist, index, middle, pinky] = joints.map((joint) => new Vector3(...joint));
    const fingers = middle.sub(wrist).normalize();
    const across = pinky.sub(index).multiplyScalar(side === 'left' ? 1 : -1);
    const back = fingers.clone().cross(across).normalize();
    return new Matrix4().makeBasis(fingers, back.clone().cross(fingers), back).setPosition(wrist);
  };
  const WAYS = {
    hand: { put: 'hands', kind: 'joints', played: 'palm', pose: (side, hand) => palm(side, hand.joints) },
    controller: { put: 'controllers', kind: 'grip', played: 'grip', pose: (_, hand) => matrix(hand.grip) },
  };

  // Play poses one after the other; return what is seen of each.
  const play = (what, poses) => page.evaluate(async ([duration, item, given]) => {
    const seen = [];
    for (const each of given) seen.push(await window.emulated.step(duration, item, each));
    return seen;
  }, [job.step, what, poses]);
  // Play one pose until something holds of what is seen.
  const hold = async (what, poses, holds) => {
    for (let i = 0; i < MOST; i += 1) {
      const [seen] = await play(what, [poses]);
      if (holds(seen)) return seen;
    }
    throw new Error(`waited in vain for ${holds}`);
  };

  // Hands or controllers: learn where the emulator puts them, sit still until the coach shows, then do it.
  const begin = async (mode) => {
    const { put, kind, played, pose } = WAYS[mode];
    await page.evaluate((name) => { window.emulated.device.primaryInputMode = name; }, mode);
    const known = { head: job.right[0].head, left: [0, 1, 0, 0, 0, 0, 1], right: [0, 1, 0, 0, 0, 0, 1] };
    await hold(put, known, ({ sent }) => SIDES.every((side) => sent[side]?.[kind]));
    const [{ sent }] = await play(put, [known]);
    const offset = Object.fromEntries(SIDES.map((side) => [
      side, new Matrix4().makeTranslation(0, -1, 0).multiply(pose(side, sent[side])).invert()]));
    const frames = (performance) => performance.map((frame) => ({
      head: frame.head,
      ...Object.fromEntries(SIDES.map((side) => [side, seven(matrix(frame[side][played]).multiply(offset[side]))])),
    }));
    const rest = frames(job.right.slice(0, 1))[0];
    await play(put, [rest]);
    await page.keyboard.press('c'); // so far the hands were somewhere
    await hold(put, rest, ({ phase }) => phase === 'settling');
    await hold(put, rest, ({ phase }) => phase === 'exercising');
    return {
      kinds: Object.keys(sent.left),
      attempt: async (performance) => {
        const before = await hold(put, rest, ({ green }) => !green);
        const seen = await play(put, frames(performance));
        const { right, score, told } = seen.at(-1);
        return {
          counted: right - before.right, score, told, green: seen.some(({ green }) => green),
          hints: [...new Set(seen.map(({ hint }) => hint))],
        };
      },
    };
  };

  await page.waitForSelector('#source-hands:not([disabled])');
  await page.check('#source-hands');
  out.measures = await page.isChecked('#measure'); // as long as nothing is known of somebody
  await page.uncheck('#measure');
  await fill(page);
  await page.click('#begin');
  await page.waitForSelector('#session:not([hidden])');
  await page.evaluate(() => { window.emulated.isHeld = true; });
  const hands = await begin('hand');
  out.hands = hands.kinds;
  out.right = await hands.attempt(job.right);
  if (job.keeps) await page.screenshot({ path: `${job.pictures}/headset.png` });
  const controllers = await begin('controller');
  out.controllers = await controllers.attempt(job.right);
  out.wrong = await controllers.attempt(job.wrong);
}
