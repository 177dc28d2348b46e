// The coach as a small white robot, the person as a skeleton, and in a headset a panel with the green window.

import * as THREE from '/three/three.module.js';

import { BONES, SIDES, mirrored } from './figure.js';

const HIPS = 0.62; // height of the coach's hips above the floor [m]
const COACH_AT = -0.76;
const USER_AT = 0.78; // to the side, on a screen [m]
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
    this.chest.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(across, spine, ahead));
    this.button.position.copy(this.chest.position).addScaledVector(ahead, 0.125);
    this.neck.span(at.neck, at.head);
    this.head.position.copy(at.head);
    const nose = at.eyes.clone().sub(at.head).normalize();
    const side = spine.clone().cross(nose).normalize();
    this.head.quaternion.setFromRotationMatrix(
      new THREE.Matrix4().makeBasis(side, nose.clone().cross(side), nose));
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

class Skeleton extends THREE.Group {
  constructor() {
    super();
    const look = material(0x0b4f8a);
    this.bones = BONES.map(() => new Limb(look, 0.026));
    this.head = new THREE.Mesh(new THREE.SphereGeometry(0.1, 24, 18), look);
    this.nose = new THREE.Mesh(new THREE.SphereGeometry(0.03, 16, 12), material(0xffffff));
    this.add(...this.bones, this.head, this.nose);
    this.look = look;
  }

  pose(points) {
    this.visible = Boolean(points);
    if (!points) return;
    const at = vectors(points);
    BONES.forEach(([from, to], i) => this.bones[i].span(at[from], at[to]));
    this.head.visible = this.nose.visible = Boolean(at.head && at.eyes);
    if (this.head.visible) {
      this.head.position.copy(at.head);
      this.nose.position.copy(at.head).addScaledVector(at.eyes.clone().sub(at.head).normalize(), 0.1);
    }
  }
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
    this.user = new Skeleton();
    this.board = new Board();
    this.board.position.set(-0.1, 2.15, -0.5);
    this.room.add(this.floor, this.coach, this.user, this.board);
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.05, 50);
    this.coach.position.set(COACH_AT, HIPS, 0);
    this.user.position.set(USER_AT, HIPS, 0);
    this.board.visible = false;
  }

  show(state, words) {
    if (state.coach) this.coach.pose(state.coach);
    this.user.pose(state.user);
    this.board.write(words);
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
    if (!inHeadset) this.frame();
    this.renderer.render(this.scene, this.camera);
  }

  // Fit both figures with their arms out into the stage, whatever its shape.
  frame() {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!width || !height) return;
    const size = this.renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height) this.renderer.setSize(width, height, false);
    const aspect = width / height;
    const narrow = aspect < 1.15; // the person behind and smaller, or both get small
    this.coach.position.x = narrow ? -0.3 : COACH_AT;
    this.user.position.set(narrow ? 0.56 : USER_AT, HIPS, narrow ? -0.6 : 0);
    const middle = narrow ? 0.06 : 0;
    const [across, tall] = narrow ? [2.5, 2.1] : [3.15, 1.95]; // what has to fit [m]
    const half = Math.tan((this.camera.fov / 2) * (Math.PI / 180));
    const distance = Math.max(tall / (2 * half), across / (2 * half * aspect));
    this.camera.aspect = aspect;
    this.camera.position.set(middle, 1.05, distance + 0.3);
    this.camera.lookAt(middle, 0.9, 0);
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    for (const [figure, name] of [[this.coach, '.coach-name'], [this.user, '.user-name']]) {
      const seen = figure.position.clone().project(this.camera);
      document.querySelector(name).style.left = `${50 * (seen.x + 1)}%`;
    }
    this.room.position.set(0, 0, 0);
    this.room.quaternion.identity();
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
    this.coach.position.x = -0.75;
    this.user.position.set(0.85, HIPS, 0);
    this.board.scale.setScalar(1.3);
    this.board.position.set(0, Math.max(head[1] + 0.72 + IN_HEADSET.raise, 2.05), -0.6);
  }
}
