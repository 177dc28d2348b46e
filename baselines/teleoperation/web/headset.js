// A headset, by WebXR: the scene in stereo at true scale, head and hands for the server, and ghosts of the hands.

import * as THREE from '/three/three.module.js';

const GAP = 1000 / 66;  // between two messages [ms]
const STANDS_AT = 1.1;  // of who leads a robot, from what the scene is about [m]; our own choice
const BEHIND = 0.05;  // from which the hand of the person counts as left behind [m]
const [PINCHED, OPENED] = [0.02, 0.035];  // between thumb and index: the clutch of a bare hand [m]
const [FIST, FLAT] = [0.09, 0.15];  // from the wrist to the tips of ring and little finger [m]
const ASIDE = 0.75;  // to the left of where the person looks at first: the board, which is to hide nothing [rad]
const STILL = 0.15;  // of a stick, below which it rests
const LOOKS = { idle: 0x6b7580, held: 0x17602b, behind: 0xb01818 };
const FOLLOW = 0.2;  // of the way that the person went since, in each picture: no jolts

export async function isSupported() {
  try {
    return Boolean(await navigator.xr?.isSessionSupported('immersive-vr'));
  } catch {
    return false;  // the browser forbids it here
  }
}

const matrix = ({ position: p, orientation: q }) => new THREE.Matrix4().compose(
  new THREE.Vector3(p.x, p.y, p.z), new THREE.Quaternion(q.x, q.y, q.z, q.w), new THREE.Vector3(1, 1, 1));
const ground = ([x, y, z, yaw]) => new THREE.Matrix4().makeRotationZ(yaw).setPosition(x, y, z);

// A hand as large as one, along x to the right of the palm, and a line to the hand that follows it.
class Ghost extends THREE.Group {
  constructor() {
    super();
    this.look = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.45, color: LOOKS.idle });
    this.shape = new THREE.Group();
    for (const [x, y, z, w, h, d] of [[0, 0, 0, 0.03, 0.08, 0.085], [0, 0, -0.085, 0.022, 0.075, 0.085], [0, 0.055, -0.02, 0.022, 0.03, 0.06]]) {
      const part = new THREE.Mesh(new THREE.SphereGeometry(0.5, 16, 10), this.look);
      part.position.set(x, y, z);
      part.scale.set(w, h, d);
      this.shape.add(part);
    }
    this.line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: LOOKS.behind }));
    this.line.frustumCulled = false;
    this.add(this.shape, this.line);
  }

  // Return how far the hand that follows is behind [m].
  show(pose, isHeld, follower) {
    this.visible = Boolean(pose);
    if (!pose) return 0;
    pose.decompose(this.shape.position, this.shape.quaternion, this.shape.scale);
    const gap = follower && isHeld ? this.shape.position.distanceTo(new THREE.Vector3(...follower)) : 0;
    this.line.visible = gap > BEHIND;
    if (this.line.visible) this.line.geometry.setFromPoints([this.shape.position, new THREE.Vector3(...follower)]);
    this.look.color.set(this.line.visible ? LOOKS.behind : isHeld ? LOOKS.held : LOOKS.idle);
    return gap;
  }
}

class Board extends THREE.Mesh {
  constructor() {
    const canvas = Object.assign(document.createElement('canvas'), { width: 1024, height: 256 });
    const texture = new THREE.CanvasTexture(canvas);
    texture.colorSpace = THREE.SRGBColorSpace;
    super(new THREE.PlaneGeometry(0.8, 0.2), new THREE.MeshBasicMaterial({ map: texture }));
    Object.assign(this, { canvas, texture });
  }

  write(lines) {
    if (this.written === String(lines)) return;
    this.written = String(lines);
    const draw = this.canvas.getContext('2d');
    draw.fillStyle = '#16181b';
    draw.fillRect(0, 0, 1024, 256);
    draw.fillStyle = '#ffffff';
    draw.font = '40px sans-serif';
    lines.forEach((line, k) => draw.fillText(line, 24, 60 + 64 * k, 976));
    this.texture.needsUpdate = true;
  }
}

export class Headset {
  // `scene` draws, `send` gets each message, `wish` what buttons ask for, `ended` is called at the end.
  constructor(scene, { send, wish, ended }) {
    Object.assign(this, { scene, send, wish, ended, sentAt: -Infinity, body: null, number: 0, lines: [], pressed: {}, pinched: {} });
    this.ghosts = { left: new Ghost(), right: new Ghost() };
    this.board = new Board();
    this.shown = new THREE.Group();
    this.shown.visible = false;
    this.shown.add(...Object.values(this.ghosts));
    scene.room.add(this.shown);
    scene.scene.add(this.board);
    this.board.visible = false;
  }

  get isOn() {
    return Boolean(this.session);
  }

  async enter() {
    this.session = await navigator.xr.requestSession('immersive-vr', {
      requiredFeatures: ['local-floor'], optionalFeatures: ['hand-tracking'],
    });
    this.anchor = null;
    this.session.addEventListener('end', () => this.left());
    this.scene.onFrame = (time, frame) => { if (frame) this.stream(time, frame); };
    await this.scene.renderer.xr.setSession(this.session);
    this.shown.visible = this.board.visible = true;
  }

  left() {
    this.session = null;
    this.scene.onFrame = () => {};
    this.shown.visible = this.board.visible = false;
    this.scene.level();
    this.scene.key = null;
    this.ended();
  }

  tell(number, body, lines) {
    Object.assign(this, { number, body, lines });
  }

  // Put the room round the person: their eyes where those of who they are in the scene are, or before a robot.
  settle(viewer) {
    const { room, target, away } = this.scene;
    const { eyes, ahead, pelvis } = this.body ?? {};
    const turn = new THREE.Vector3(0, 0, -1).transformDirection(viewer);
    let way = [-away.x, -away.y];
    let from = target.clone().add(new THREE.Vector3(away.x, away.y, 0).setLength(Math.min(STANDS_AT, Math.hypot(away.x, away.y)))).setZ(0);
    if (eyes) {
      way = Math.hypot(ahead[0], ahead[1]) > 0.3 ? ahead : [Math.cos(pelvis[3]), Math.sin(pelvis[3])];
      from = new THREE.Vector3(...eyes);
    }
    const yaw = Math.atan2(-turn.z, turn.x) - Math.atan2(way[1], way[0]);
    room.quaternion.setFromAxisAngle(new THREE.Vector3(0, 1, 0), yaw)
      .multiply(new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(1, 0, 0), -Math.PI / 2));
    const head = new THREE.Vector3().setFromMatrixPosition(viewer);
    if (!eyes) head.y = 0;
    room.position.copy(head).sub(from.applyQuaternion(room.quaternion));
    room.updateMatrixWorld(true);
    this.anchor = { room: room.matrix.clone(), pelvis, now: pelvis };
    const aside = turn.setY(0).normalize().applyAxisAngle(new THREE.Vector3(0, 1, 0), ASIDE);
    this.board.position.setFromMatrixPosition(viewer).addScaledVector(aside, 1.2).add(new THREE.Vector3(0, -0.1, 0));
    this.board.lookAt(new THREE.Vector3().setFromMatrixPosition(viewer));
  }

  // Who walks in the scene takes the person along.
  follow() {
    const { anchor, body } = this;
    if (!anchor.pelvis || !body?.pelvis) return;
    anchor.now = anchor.now.map((value, k) => {
      let change = body.pelvis[k] - value;
      if (k === 3) change = Math.atan2(Math.sin(change), Math.cos(change));
      return value + FOLLOW * change;
    });
    const at = anchor.room.clone().multiply(ground(anchor.pelvis)).multiply(ground(anchor.now).invert());
    const { room } = this.scene;
    at.decompose(room.position, room.quaternion, room.scale);
    room.updateMatrixWorld(true);
  }

  // A pose in the scene, as seven numbers.
  place(pose) {
    const [p, q, s] = [new THREE.Vector3(), new THREE.Quaternion(), new THREE.Vector3()];
    pose.decompose(p, q, s);
    return [...p.toArray().map((x) => Number(x.toFixed(5))), ...q.normalize().toArray().map((x) => Number(x.toFixed(6)))];
  }

  // Where a hand is, whether it holds the clutch and how far it is closed; null where it is not tracked.
  hand(frame, source, space) {
    const side = source.handedness;
    if (source.hand) {
      const poses = Object.fromEntries(['wrist', 'middle-finger-phalanx-proximal', 'thumb-tip', 'index-finger-tip', 'ring-finger-tip', 'pinky-finger-tip']
        .map((name) => [name, frame.getJointPose(source.hand.get(name), space)?.transform]));
      if (!Object.values(poses).every(Boolean)) return null;
      const at = (name) => new THREE.Vector3().setFromMatrixPosition(matrix(poses[name]));
      const open = at('thumb-tip').distanceTo(at('index-finger-tip'));
      this.pinched[side] = open < (this.pinched[side] ? OPENED : PINCHED);
      const tips = (at('ring-finger-tip').distanceTo(at('wrist')) + at('pinky-finger-tip').distanceTo(at('wrist'))) / 2;
      const pose = matrix(poses.wrist).setPosition(at('wrist').lerp(at('middle-finger-phalanx-proximal'), 0.85));
      return { pose, clutch: this.pinched[side], grasp: THREE.MathUtils.clamp((FLAT - tips) / (FLAT - FIST), 0, 1) };
    }
    const pose = source.gripSpace && frame.getPose(source.gripSpace, space);
    if (!pose || pose.emulatedPosition) return null;  // a guess of the device is no measurement
    const buttons = source.gamepad?.buttons ?? [];
    return { pose: matrix(pose.transform), clutch: Boolean(buttons[1]?.pressed), grasp: buttons[0]?.value ?? 0 };
  }

  // Once for each time that a button goes down.
  press(key, isDown, wish) {
    if (isDown && !this.pressed[key]) this.wish(wish);
    this.pressed[key] = isDown;
  }

  stream(time, frame) {
    const space = this.scene.renderer.xr.getReferenceSpace();
    const viewer = space && frame.getViewerPose(space);
    if (!viewer) return;
    if (!this.anchor) this.settle(matrix(viewer.transform));
    this.follow();
    const inside = this.scene.room.matrixWorld.clone().invert();
    const message = {
      type: 'tracked', seen: this.number, head: this.place(inside.clone().multiply(matrix(viewer.transform))),
      left: null, right: null, walk: [0, 0, 0], kneel: [0, 0],
    };
    const isSeen = frame.session.visibilityState === 'visible';
    const found = {};
    for (const source of frame.session.inputSources) {
      const side = source.handedness;
      const hand = side in this.ghosts && isSeen ? this.hand(frame, source, space) : null;
      if (!hand) continue;
      hand.pose.premultiply(inside);
      found[side] = { ...hand, source };
      message[side] = { place: this.place(hand.pose), clutch: hand.clutch, grasp: Number(hand.grasp.toFixed(3)) };
      const { buttons = [], axes = [] } = source.hand ? {} : source.gamepad ?? {};
      const stick = [axes[2] ?? 0, axes[3] ?? 0].map((value) => (Math.abs(value) > STILL ? value : 0));
      if (side === 'left') [message.walk[1], message.walk[0]] = [-stick[0], -stick[1]];
      else message.walk[2] = -stick[0];
      if (buttons[4]?.pressed) message.kneel[side === 'left' ? 0 : 1] = 1;
      if (buttons[5]?.pressed) message.kneel = [-1, -1];
      this.press(side, Boolean(buttons[3]?.pressed), side === 'left' ? 'pause' : 'reset');
    }
    for (const [side, ghost] of Object.entries(this.ghosts)) {
      const { pose, clutch, source } = found[side] ?? {};
      const gap = ghost.show(pose, clutch, this.body?.palms?.[side]);
      if (gap > BEHIND) source.gamepad?.hapticActuators?.[0]?.pulse?.(Math.min(4 * gap, 1), 40);
    }
    this.board.write([...this.lines, ...Object.entries(this.body?.behind ?? {}).map((each) => each.join(': '))]);
    if (time - this.sentAt < GAP) return;
    this.sentAt = time;
    this.send(message);
  }
}
