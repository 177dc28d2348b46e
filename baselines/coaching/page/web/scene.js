// The coach as a small white robot, the person as a body on a stool, and in a headset a panel with the green window.

import * as THREE from '/package/three/three.module.js';

import { SIDES, extent, label, mirrored, shares } from './figure.js';

const HIPS = 0.62; // height of the coach's hips above the floor [m]
const AT = { coach: -0.95, user: 0.95 }; // to the side: arms that are out do not meet [m]
const IN_HEADSET = { distance: 2.0, raise: 0.35 }; // [m]
const GREEN = 0x0b6b2e;
const NEUTRAL = 0x33424f;
const UP = new THREE.Vector3(0, 1, 0);
const FRONT = new THREE.Vector3(0, 0, 1);

function material(color, roughness = 0.45) {
  return new THREE.MeshStandardMaterial({ color, roughness });
}

// A limb between two points, of radius `from` at the first and `to` at the second.
class Limb extends THREE.Group {
  constructor(look, from, to = from) {
    super();
    this.shaft = new THREE.Mesh(new THREE.CylinderGeometry(to, from, 1, 20), look);
    this.ends = [from, to].map((radius) => new THREE.Mesh(new THREE.SphereGeometry(radius, 20, 14), look));
    this.add(this.shaft, ...this.ends);
  }

  span(a, b) {
    this.visible = Boolean(a && b);
    if (!this.visible) return;
    const way = b.clone().sub(a);
    const length = Math.max(way.length(), 1e-4);
    this.shaft.position.copy(a).addScaledVector(way, 0.5);
    this.shaft.scale.y = length;
    this.shaft.quaternion.setFromUnitVectors(UP, way.divideScalar(length));
    this.ends[0].position.copy(a);
    this.ends[1].position.copy(b);
  }
}

function vectors(points) {
  const out = {};
  for (const [name, point] of Object.entries(points)) out[name] = point && new THREE.Vector3(...mirrored(point));
  return out;
}

class Robot extends THREE.Group {
  constructor() {
    super();
    const white = material(0xf7f8fa);
    const grey = material(0x7a8793);
    const orange = material(0xd9601a);
    const dark = material(0x1b2733, 0.25);
    this.trunk = new Limb(white, 0.1, 0.155);
    this.chest = new THREE.Mesh(new THREE.SphereGeometry(0.165, 28, 20), white);
    this.chest.scale.set(1.08, 0.95, 0.78);
    this.button = new THREE.Mesh(new THREE.CylinderGeometry(0.028, 0.028, 0.02, 24), orange);
    this.button.rotation.x = Math.PI / 2;
    this.neck = new Limb(grey, 0.055);
    this.head = new THREE.Group();
    const skull = new THREE.Mesh(new THREE.SphereGeometry(0.15, 32, 24), white);
    skull.scale.set(1.08, 0.98, 1);
    this.head.add(skull);
    for (const sign of [-1, 1]) {
      const eye = new THREE.Mesh(new THREE.SphereGeometry(0.032, 20, 16), dark);
      eye.position.set(0.058 * sign, 0.02, 0.127);
      const ear = new THREE.Mesh(new THREE.CylinderGeometry(0.055, 0.055, 0.04, 28), orange);
      ear.rotation.z = Math.PI / 2;
      ear.position.set(0.158 * sign, 0, 0);
      this.head.add(eye, ear);
    }
    const mouth = new THREE.Mesh(new THREE.SphereGeometry(0.013, 14, 10), dark);
    mouth.position.set(0, -0.055, 0.137);
    this.head.add(mouth);
    this.hips = new THREE.Mesh(new THREE.SphereGeometry(0.115, 24, 18), grey);
    this.add(this.trunk, this.chest, this.button, this.neck, this.head, this.hips);
    this.arms = {};
    for (const side of SIDES) {
      const arm = {
        pad: new THREE.Mesh(new THREE.SphereGeometry(0.088, 24, 18), orange),
        upper: new Limb(white, 0.062, 0.054),
        joint: new THREE.Mesh(new THREE.SphereGeometry(0.058, 20, 16), grey),
        fore: new Limb(white, 0.058, 0.048),
        hand: new Limb(grey, 0.042, 0.05),
      };
      this.arms[side] = arm;
      this.add(...Object.values(arm));
      const sign = side === 'left' ? -1 : 1;
      const leg = new Limb(white, 0.075, 0.062);
      leg.span(new THREE.Vector3(0.1 * sign, -0.02, 0), new THREE.Vector3(0.105 * sign, -0.5, 0.01));
      const foot = new THREE.Mesh(new THREE.SphereGeometry(0.09, 22, 16), white);
      foot.scale.set(0.85, 0.55, 1.5);
      foot.position.set(0.105 * sign, -0.57, 0.05);
      this.add(leg, foot);
    }
  }

  pose(points) {
    const at = vectors(points);
    this.trunk.span(at.pelvis, at.neck.clone().lerp(at.pelvis, 0.25));
    this.hips.position.copy(at.pelvis);
    const spine = at.neck.clone().sub(at.pelvis).normalize();
    const across = at.right_shoulder.clone().sub(at.left_shoulder).normalize();
    const ahead = across.clone().cross(spine).normalize();
    this.chest.position.copy(at.neck).addScaledVector(spine, -0.11);
    this.chest.quaternion.copy(axes(across, spine));
    this.button.position.copy(this.chest.position).addScaledVector(ahead, 0.125);
    this.neck.span(at.neck, at.head);
    this.head.position.copy(at.head);
    const nose = at.eyes.clone().sub(at.head).normalize();
    const side = spine.clone().cross(nose);
    this.head.quaternion.copy(axes(side, nose.cross(side)));
    for (const name of SIDES) {
      const arm = this.arms[name];
      const [shoulder, elbow, wrist, hand] = ['shoulder', 'elbow', 'wrist', 'hand'].map((p) => at[`${name}_${p}`]);
      arm.pad.position.copy(shoulder);
      arm.upper.span(shoulder, elbow);
      arm.joint.position.copy(elbow);
      arm.fore.span(elbow, wrist);
      arm.hand.span(wrist, hand);
    }
  }
}

const TRUNK = [ // radius as a share of half the shoulders' width, height as one of the trunk's length
  [0, -0.2], [0.7, -0.2], [0.98, -0.08], [0.96, 0.1], [0.86, 0.36], [1, 0.66], [1.1, 0.82], [1.1, 0.93], [0.85, 1.03], [0.4, 1.1], [0, 1.1],
];
const DEPTH = 0.66; // of a trunk, over its width

class Person extends THREE.Group {
  constructor() {
    super();
    const skin = material(0xb07a55, 0.7);
    const dark = material(0x2a2320, 0.8);
    const cloth = material(0x46525e, 0.9);
    this.look = material(0x0b4f8a, 0.8); // of the shirt
    this.trunk = new THREE.Mesh(new THREE.LatheGeometry(TRUNK.map(([r, y]) => new THREE.Vector2(r, y)), 40), this.look);
    this.neck = new Limb(skin, 0.05);
    this.head = new THREE.Group();
    const part = (look, radius, [x, y, z], scale = [1, 1, 1]) => {
      const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 28, 20), look);
      mesh.position.set(x, y, z);
      mesh.scale.set(...scale);
      this.head.add(mesh);
    };
    part(skin, 0.1, [0, 0, 0], [0.8, 1.12, 0.94]);
    part(dark, 0.1, [0, 0.032, -0.018], [0.86, 1.0, 0.9]);
    part(skin, 0.015, [0, -0.015, 0.096], [0.9, 1.3, 1]);
    part(dark, 0.03, [0, -0.055, 0.075], [0.75, 0.16, 0.4]);
    for (const sign of [-1, 1]) {
      part(skin, 0.02, [0.08 * sign, -0.005, 0], [0.5, 1.2, 0.8]);
      part(dark, 0.011, [0.032 * sign, 0.015, 0.086]);
    }
    this.add(this.trunk, this.neck, this.head);
    this.arms = {};
    for (const side of SIDES) {
      const arm = {
        sleeve: new Limb(this.look, 0.062, 0.054), upper: new Limb(skin, 0.046, 0.04), fore: new Limb(skin, 0.04, 0.029),
        palm: new Limb(skin, 0.036, 0.036), fingers: new Limb(skin, 0.033, 0.017),
      };
      this.arms[side] = arm;
      const [x, ...legs] = [0.1 * (side === 'left' ? -1 : 1), new Limb(cloth, 0.085, 0.062), new Limb(cloth, 0.06, 0.045)];
      const [hip, knee, ankle] = [[x, -0.02, 0.02], [1.25 * x, 0, 0.42], [1.25 * x, -0.5, 0.44]].map((at) => new THREE.Vector3(...at));
      legs[0].span(hip, knee);
      legs[1].span(knee, ankle);
      const shoe = new THREE.Mesh(new THREE.SphereGeometry(0.075, 22, 16), dark);
      shoe.scale.set(0.75, 0.6, 1.7);
      shoe.position.copy(ankle).add(new THREE.Vector3(0, -0.06, 0.05));
      this.add(...Object.values(arm), ...legs, shoe);
    }
    const seat = new THREE.Mesh(new THREE.CylinderGeometry(0.24, 0.24, 0.06, 40), material(0x8a6a48, 0.8));
    seat.position.set(0, -0.14, 0.04);
    const leg = new Limb(material(0x7a8793), 0.03);
    leg.span(new THREE.Vector3(0, -0.16, 0.04), new THREE.Vector3(0, -HIPS, 0.04));
    this.add(seat, leg);
  }

  pose(points) {
    this.isThere = Boolean(points);
    if (!points) return;
    const at = vectors(points);
    this.trunk.visible = Boolean(at.pelvis && at.neck);
    if (this.trunk.visible) {
      const spine = at.neck.clone().sub(at.pelvis);
      const isKnown = at.left_shoulder && at.right_shoulder;
      const across = isKnown ? at.right_shoulder.clone().sub(at.left_shoulder) : new THREE.Vector3(0.33, 0, 0);
      const half = across.length() / 2;
      this.trunk.position.copy(at.pelvis);
      this.trunk.quaternion.copy(axes(across, spine));
      this.trunk.scale.set(half, spine.length(), DEPTH * half);
    }
    this.neck.span(at.neck, at.head);
    this.head.visible = Boolean(at.head && at.eyes);
    if (this.head.visible) {
      const nose = at.eyes.clone().sub(at.head).normalize();
      const up = at.head.clone().sub(at.neck ?? at.head.clone().sub(UP));
      this.head.position.copy(at.head);
      const side = up.cross(nose);
      this.head.quaternion.copy(axes(side, nose.clone().cross(side)));
    }
    for (const side of SIDES) {
      const arm = this.arms[side];
      const [shoulder, elbow, wrist, hand] = ['shoulder', 'elbow', 'wrist', 'hand'].map((p) => at[`${side}_${p}`]);
      arm.sleeve.span(shoulder, shoulder && elbow && shoulder.clone().lerp(elbow, 0.6));
      arm.upper.span(shoulder, elbow);
      arm.fore.span(elbow, wrist);
      arm.palm.span(wrist, hand);
      arm.fingers.span(hand, wrist && hand && wrist.clone().lerp(hand, 1.8));
    }
  }
}

// How axes are turned of which x is along `across`, and y as near to `up` as can be.
function axes(across, up) {
  const x = across.clone().normalize();
  const z = x.clone().cross(up).normalize();
  return new THREE.Quaternion().setFromRotationMatrix(new THREE.Matrix4().makeBasis(x, z.clone().cross(x), z));
}

// What the page says beside the picture, as a board in the room of the headset.
class Board extends THREE.Group {
  constructor() {
    super();
    this.canvas = document.createElement('canvas');
    this.canvas.width = 1024;
    this.canvas.height = 512;
    this.texture = new THREE.CanvasTexture(this.canvas);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    const face = new THREE.Mesh(
      new THREE.PlaneGeometry(1.5, 0.75), new THREE.MeshBasicMaterial({ map: this.texture, toneMapped: false }));
    this.frameLook = new THREE.MeshBasicMaterial({ color: NEUTRAL, toneMapped: false });
    const frame = new THREE.Mesh(new THREE.PlaneGeometry(1.62, 0.87), this.frameLook);
    frame.position.z = -0.01;
    this.add(frame, face);
    this.written = '';
  }

  write(words) {
    const key = JSON.stringify(words);
    if (key === this.written) return;
    this.written = key;
    const draw = this.canvas.getContext('2d');
    const [width, height] = [this.canvas.width, this.canvas.height];
    draw.fillStyle = '#ffffff';
    draw.fillRect(0, 0, width, height);
    draw.fillStyle = words.green ? '#0b6b2e' : '#33424f';
    draw.fillRect(0, 0, width, 150);
    this.frameLook.color.set(words.green ? GREEN : NEUTRAL);
    draw.fillStyle = '#ffffff';
    this.text(words.verdict, 30, 62, 56, 2);
    draw.fillStyle = '#14202b';
    this.text(words.title, 30, 225, 54, 1);
    this.text(words.count, 30, 330, 96, 1);
    this.text(words.score, 560, 330, 60, 1);
    this.text(words.hint, 30, 400, 46, 2);
    this.texture.needsUpdate = true;
  }

  text(words, x, y, size, lines) {
    const draw = this.canvas.getContext('2d');
    draw.font = `700 ${size}px system-ui, sans-serif`;
    let line = '';
    for (const word of words.split(' ')) {
      if (line && draw.measureText(`${line} ${word}`).width > this.canvas.width - x - 20 && lines > 1) {
        draw.fillText(line, x, y);
        [line, y, lines] = ['', y + size * 1.15, lines - 1];
      }
      line = line ? `${line} ${word}` : word;
    }
    draw.fillText(line, x, y, this.canvas.width - x - 20);
  }
}

export class SolidView {
  constructor(canvas) {
    this.kind = 'solid';
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.xr.enabled = true;
    this.renderer.xr.setReferenceSpaceType('local-floor');
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8a97a3, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(-1.5, 3, 3);
    this.scene.add(sun);
    this.room = new THREE.Group(); // is put before the person in a headset
    this.scene.add(this.room);
    this.floor = new THREE.Mesh(new THREE.CircleGeometry(2.6, 64), material(0xb9c7d3, 1));
    this.floor.rotation.x = -Math.PI / 2;
    this.coach = new Robot();
    this.user = new Person();
    this.board = new Board();
    this.board.position.set(-0.1, 2.15, -0.5);
    this.room.add(this.floor, this.coach, this.user, this.board);
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.05, 50);
    for (const [name, x] of Object.entries(AT)) this[name].position.set(x, HIPS, 0);
    this.board.visible = false;
  }

  show(state, words) {
    if (state.coach) this.coach.pose(state.coach);
    this.user.pose(state.user);
    if (words) this.board.write(words);
  }

  // Colours of the page, so that darkness and a high contrast reach the picture.
  dress() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => new THREE.Color(style.getPropertyValue(`--${name}`).trim());
    this.scene.background = colour('stage');
    this.user.look.color = colour('figure');
    this.floor.material.color = colour('floor');
  }

  draw() {
    const inHeadset = this.renderer.xr.isPresenting;
    this.board.visible = inHeadset;
    this.coach.visible = true;
    this.user.visible = Boolean(this.user.isThere);
    this.renderer.setScissorTest(!inHeadset);
    if (inHeadset) this.renderer.render(this.scene, this.camera);
    else this.shares();
  }

  // Each figure in its own share of the stage, whatever its shape.
  shares() {
    const { canvas, camera, renderer } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    const size = renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height) renderer.setSize(width, height, false);
    this.room.position.set(0, 0, 0);
    this.room.quaternion.identity();
    label(canvas);
    const half = Math.tan((camera.fov / 2) * (Math.PI / 180));
    for (const [name, share] of Object.entries(shares(width, height))) {
      const { x, y, w, h } = share;
      const { tall, middle, across } = extent(share);
      this.coach.visible = name === 'coach';
      this.user.visible = name === 'user' && Boolean(this.user.isThere);
      camera.aspect = w / h;
      camera.position.set(AT[name], middle + 0.2, Math.max(tall, across / camera.aspect) / (2 * half) + 0.3);
      camera.lookAt(AT[name], middle, 0);
      camera.updateProjectionMatrix();
      this.floor.position.x = AT[name];
      renderer.setViewport(x, height - y - h, w, h);
      renderer.setScissor(x, height - y - h, w, h);
      renderer.render(this.scene, camera);
    }
  }

  // In a headset: before where the person looks, at their height.
  settle(head) {
    const turn = new THREE.Quaternion(head[3], head[4], head[5], head[6]);
    const ahead = new THREE.Vector3(0, 0, -1).applyQuaternion(turn);
    ahead.y = 0;
    if (ahead.lengthSq() < 1e-4) return;
    ahead.normalize();
    this.room.position.set(head[0], 0, head[2]).addScaledVector(ahead, IN_HEADSET.distance);
    this.room.quaternion.setFromUnitVectors(FRONT, ahead.clone().negate());
    this.floor.position.x = 0;
    this.board.scale.setScalar(1.3);
    this.board.position.set(0, Math.max(head[1] + 0.72 + IN_HEADSET.raise, 2.05), -0.6);
  }
}
