// The scene, drawn as the server tells it: shapes once, then where they are in each frame.

import * as THREE from '/three/three.module.js';

const TYPES = { f4: Float32Array, u4: Uint32Array, u2: Uint16Array, i1: Int8Array, u1: Uint8Array };
const STEPS = 65535;  // that a position is told in, from one side of its box to the other
const LINEAR = Float32Array.from({ length: 256 }, (_, k) => (k <= 10 ? k / 3294.6 : ((k / 255 + 0.055) / 1.055) ** 2.4));
const [LOWEST, HIGHEST] = [-10, 85].map(THREE.MathUtils.degToRad);  // from where one may look
const FORCE = 10;  // that is drawn 10 cm long [N]
// A force on the skin is spread as a bell, this wide [m]; [Pa] that is painted full; from the skin at most [m]: own choices.
const [SPREAD, FULL, OFF] = [0.02, 10000, 0.06];
const PRESSED = [0.75, 0.0, 0.02];  // linear RGB
const [SLOW, QUICK, PATIENT, COARSEST] = [34, 20, 15, 0.5];  // [ms] of a picture, twice; pictures; pixels of the picture for one of the page
const SKY = 0xe6ebf0;

// Without a graphics card each pixel costs: then the picture has no more of them than the page, and rough edges.
export const isSoftware = (() => {
  const gl = new OffscreenCanvas(1, 1).getContext('webgl2');
  const info = gl?.getExtension('WEBGL_debug_renderer_info');
  return !info || /SwiftShader|llvmpipe|Software/i.test(gl.getParameter(info.UNMASKED_RENDERER_WEBGL));
})();

export function headerOf(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  return JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
}

function unpack(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const { arrays, ...facts } = headerOf(buffer);
  for (const [name, [type, at, count]] of Object.entries(arrays)) facts[name] = new TYPES[type](buffer, 4 + size + at, count);
  return facts;
}

// Lit at the vertices, not in each pixel, which is what software GL is slow at. Where there are `places`, vertices
// lie where the transform of their slot puts them, one row of a texture each.
function look(alpha, closed, places = null) {
  return new THREE.ShaderMaterial({
    uniforms: { alpha: { value: alpha }, ...(places ? { places } : {}) },
    transparent: alpha < 0.99,
    side: closed ? THREE.FrontSide : THREE.DoubleSide,
    defines: { ...(places ? { PLACED: 1 } : {}), ...(closed ? {} : { OPEN: 1 }) },
    vertexShader: `
      uniform highp sampler2D places;
      attribute float slot;
      attribute vec3 color;
      varying vec3 shade;
      void main() {
        vec3 at = position;
        vec3 up = normal;
        #ifdef PLACED
          int row = int(slot + 0.5);
          vec4 x = texelFetch(places, ivec2(0, row), 0), y = texelFetch(places, ivec2(1, row), 0), z = texelFetch(places, ivec2(2, row), 0);
          at = vec3(dot(x, vec4(at, 1.0)), dot(y, vec4(at, 1.0)), dot(z, vec4(at, 1.0)));
          up = vec3(dot(x.xyz, up), dot(y.xyz, up), dot(z.xyz, up));
        #endif
        vec4 seen = modelViewMatrix * vec4(at, 1.0);
        #ifdef OPEN  // the side that is seen
          if (dot(normalMatrix * up, seen.xyz) > 0.0) up = -up;
        #endif
        vec3 light = mix(vec3(0.42, 0.38, 0.34), vec3(0.66), 0.5 + 0.5 * up.z) + 0.55 * max(dot(up, vec3(0.27, -0.53, 0.80)), 0.0);
        shade = pow(min(color * light, 1.0), vec3(1.0 / 2.2));
        gl_Position = projectionMatrix * seen;
      }`,
    fragmentShader: `
      uniform float alpha;
      varying vec3 shade;
      void main() { gl_FragColor = vec4(shade, alpha); }`,
  });
}

function colours(rgba) {
  const out = new Float32Array(rgba.length / 4 * 3);
  for (let i = 0; i < rgba.length / 4; i += 1) for (let k = 0; k < 3; k += 1) out[3 * i + k] = LINEAR[rgba[4 * i + k]];
  return new THREE.BufferAttribute(out, 3);
}

export class Scene {
  constructor(canvas, camera) {
    Object.assign(this, { canvas, drawn: 0, before: null, now: null, shownAt: 0, step: 0.1, took: 0, since: 0 });
    this.ratio = isSoftware ? 1 : Math.min(devicePixelRatio, 2);
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: devicePixelRatio < 1.5 && !isSoftware });
    this.renderer.xr.enabled = true;
    this.renderer.xr.setReferenceSpaceType('local-floor');
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(SKY);
    this.room = new THREE.Group();  // in the axes of the scene: x, y on the floor, z up
    this.level();
    this.scene.add(this.room);
    this.shapes = new THREE.Group();
    this.room.add(this.shapes);
    this.touches = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0xd00000, depthTest: false }));
    this.touches.frustumCulled = false;
    this.room.add(this.touches);
    this.camera = new THREE.PerspectiveCamera(camera.fov_deg, 4 / 3, 0.03, 60);
    this.look(camera);
    this.renderer.setAnimationLoop((time, frame) => this.draw(time, frame));
    this.onFrame = () => {};
  }

  // The room as it is on a screen; a headset puts it elsewhere.
  level() {
    this.room.position.set(0, 0, 0);
    this.room.quaternion.setFromAxisAngle(new THREE.Vector3(1, 0, 0), -Math.PI / 2);
  }

  // See it as the task's own camera does.
  look(camera) {
    this.target = new THREE.Vector3(...camera.target);
    this.away = new THREE.Vector3(...camera.eye).sub(this.target);
    this.view = { turned: 0, raised: 0, nearness: 1 };
    this.camera.fov = camera.fov_deg;
    this.key = null;
  }

  // Forces on a person, each as a line from where it presses, 10 cm for FORCE.
  touch(found) {
    const points = found.flatMap(([x, y, z, ...force]) => [
      new THREE.Vector3(x, y, z), new THREE.Vector3(x, y, z).addScaledVector(new THREE.Vector3(...force.slice(0, 3)), -0.1 / FORCE)]);
    this.touches.geometry.dispose();
    this.touches.geometry = new THREE.BufferGeometry().setFromPoints(points);
    this.isDrawn = false;
  }

  // Paint what presses on the skin of people of these names, and return the greatest pressure [Pa]: the normal part of
  // each force, on the skin that is nearest, as a bell of SPREAD.
  press(found, names) {
    let most = 0;
    this.surfaces?.forEach(({ geometry: { attributes: { color }, userData: { base, name } } }, k) => {
      if (!names.includes(name) || !this.now) return;
      const at = this.now[k + 1];
      const pressure = new Float32Array(at.length / 3);
      const square = (i, point) => (at[3 * i] - point[0]) ** 2 + (at[3 * i + 1] - point[1]) ** 2 + (at[3 * i + 2] - point[2]) ** 2;
      for (const [x, y, z, , , , force] of found) {
        let [nearest, least] = [-1, OFF * OFF];
        for (let i = 0; i < pressure.length; i += 1) {
          const gap = square(i, [x, y, z]);
          if (gap < least) [nearest, least] = [i, gap];
        }
        if (nearest < 0) continue;
        const middle = at.slice(3 * nearest, 3 * nearest + 3);
        for (let i = 0; i < pressure.length; i += 1) {
          const gap = square(i, middle);
          if (gap < 9 * SPREAD * SPREAD) pressure[i] += force / (2 * Math.PI * SPREAD * SPREAD) * Math.exp(-gap / (2 * SPREAD * SPREAD));
        }
      }
      pressure.forEach((value, i) => {
        most = Math.max(most, value);
        const share = Math.min(value / FULL, 1);
        for (let c = 0; c < 3; c += 1) color.array[3 * i + c] = (1 - share) * base[3 * i + c] + share * PRESSED[c];
      });
      color.needsUpdate = true;
    });
    this.isDrawn = false;
    return most;
  }

  // The picture as it is now, drawn for it: what a canvas showed is gone after.
  picture() {
    this.renderer.render(this.scene, this.camera);
    return new Promise((done) => this.canvas.toBlob(done, 'image/png'));
  }

  take(buffer) {
    const data = unpack(buffer);
    if (data.kind === 'shapes') this.furnish(data);
    else if (data.kind === 'surface') this.covers.push(data);  // its vertices come with the frame
    else this.move(data);
  }

  furnish(data) {
    for (const mesh of this.shapes.children) { mesh.geometry.dispose(); mesh.material.dispose(); }
    this.shapes.clear();
    this.before = this.now = null;
    this.covers = [];
    const shared = {
      position: new THREE.BufferAttribute(data.position, 3), normal: new THREE.BufferAttribute(data.normal, 4, true),
      color: colours(data.rgba), slot: new THREE.BufferAttribute(data.slot, 1),
    };
    this.places = { value: null };
    for (const [first, count, alpha, closed, isFloor] of data.runs) {
      const geometry = new THREE.BufferGeometry();
      for (const [name, attribute] of Object.entries(shared)) geometry.setAttribute(name, attribute);
      geometry.setIndex(new THREE.BufferAttribute(data.index.subarray(first, first + count), 1));
      const mesh = new THREE.Mesh(geometry, look(alpha, closed, this.places));
      mesh.renderOrder = Number(isFloor);  // drawn last, where nothing stands before it
      mesh.frustumCulled = false;
      this.shapes.add(mesh);
    }
    this.surfaces = Array.from({ length: data.surfaces }, () => {
      const mesh = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.Material());
      mesh.frustumCulled = false;
      this.shapes.add(mesh);
      return mesh;
    });
  }

  // Faces and colours of a skin or of lines. With other faces it does not move from where it was.
  cover({ number, alpha, closed, name, faces, rgba }) {
    const mesh = this.surfaces[number];
    const [color, old] = [colours(rgba), mesh.geometry];
    const stays = old.index?.count === faces.length && faces.every((vertex, i) => vertex === old.index.array[i]);
    if (this.now && !stays) this.now[number + 1] = null;
    const at = stays ? old.attributes.position.array : new Float32Array(3 * color.count);
    mesh.geometry = new THREE.BufferGeometry();
    mesh.geometry.setIndex(new THREE.BufferAttribute(faces, 1));
    mesh.geometry.setAttribute('position', new THREE.BufferAttribute(at, 3));
    mesh.geometry.setAttribute('normal', new THREE.BufferAttribute(new Int8Array(4 * color.count), 4, true));
    mesh.geometry.setAttribute('color', color);
    mesh.geometry.userData = { name, base: color.array.slice() };
    old.dispose();
    mesh.material.dispose();
    mesh.material = look(alpha, closed);
  }

  move(data) {
    const now = performance.now();
    if (this.now) this.step = Math.min(Math.max((now - this.arrivedAt) / 1000, 0.02), 0.25);
    this.arrivedAt = now;
    if (this.now) this.blend();
    for (const each of this.covers.splice(0)) this.cover(each);
    const held = this.now && this.held().map((array) => array.slice());  // where the way to the next frame begins
    const next = [data.places, ...data.boxes.map(([x, y, z, span], k) => {
      const steps = data[`position${k}`];
      const at = new Float32Array(steps.length);
      for (let i = 0; i < at.length; i += 3) {
        at[i] = x + span / STEPS * steps[i];
        at[i + 1] = y + span / STEPS * steps[i + 1];
        at[i + 2] = z + span / STEPS * steps[i + 2];
      }
      return at;
    })];
    this.before = next.map((to, k) => (this.now?.[k] ? held[k] : to));
    this.now = next;
    if (!this.places.value) {
      this.places.value = new THREE.DataTexture(Float32Array.from(data.places), 3, data.places.length / 12, THREE.RGBAFormat, THREE.FloatType);
    }
    this.surfaces.forEach(({ geometry: { attributes: { normal } } }, k) => { normal.array.set(data[`normal${k}`]); normal.needsUpdate = true; });
    this.shownAt = now;
    this.isSettled = false;
  }

  // What is drawn: transforms, and the vertices of each surface.
  held() {
    return [this.places.value.image.data, ...this.surfaces.map(({ geometry }) => geometry.attributes.position.array)];
  }

  // Put things where they are between the last frame and this one, so that they move in every picture.
  blend() {
    const share = Math.min((performance.now() - this.shownAt) / 1000 / this.step, 1);
    this.held().forEach((array, k) => {
      const [from, to] = [this.before[k], this.now[k]];
      if (share < 1 && from !== to) for (let i = 0; i < array.length; i += 1) array[i] = from[i] + share * (to[i] - from[i]);
      else array.set(to);
    });
    return share;
  }

  // Without a graphics card the picture gets coarser until it comes often enough, and finer again where it may.
  ease(time) {
    const took = time - this.easedAt;
    this.easedAt = time;
    if (!isSoftware || !(took < 500)) return;
    this.took += 0.1 * (took - this.took);
    this.since += 1;
    const change = this.took > SLOW ? 0.8 : this.took < QUICK ? 1.25 : 1;
    const ratio = Math.min(Math.max(change * this.ratio, COARSEST), 1);
    if (this.since < (change > 1 ? 5 : 1) * PATIENT || ratio === this.ratio) return;
    [this.ratio, this.since, this.key] = [ratio, 0, null];
  }

  draw(time, frame) {
    this.onFrame(time, frame);
    if (!this.renderer.xr.isPresenting) this.ease(time);
    if (this.now && !this.isSettled) {
      this.isSettled = this.blend() === 1;
      this.places.value.needsUpdate = true;
      for (const { geometry } of this.surfaces) geometry.attributes.position.needsUpdate = true;
      this.isDrawn = false;
    }
    if (!this.renderer.xr.isPresenting) {
      if (!this.frame() && this.isDrawn) return;  // nothing is new
    }
    this.renderer.render(this.scene, this.camera);
    this.isDrawn = true;
    this.drawn += 1;
  }

  // Put the camera where the view says; return whether it or the size of the picture changed.
  frame() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const size = this.renderer.getSize(new THREE.Vector2());
    const key = JSON.stringify([width, height, this.view]);
    if (!width || key === this.key) return false;
    this.key = key;
    if (this.renderer.getPixelRatio() !== this.ratio) this.renderer.setPixelRatio(this.ratio);
    if (size.x !== width || size.y !== height) this.renderer.setSize(width, height, false);
    const { x, y, z } = this.away;
    const turned = Math.atan2(y, x) + THREE.MathUtils.degToRad(this.view.turned);
    let level = Math.atan2(z, Math.hypot(x, y)) + THREE.MathUtils.degToRad(this.view.raised);
    level = Math.min(Math.max(level, LOWEST), HIGHEST);
    const far = this.away.length() / this.view.nearness;
    const eye = new THREE.Vector3(Math.cos(level) * Math.cos(turned), Math.cos(level) * Math.sin(turned), Math.sin(level));
    this.camera.aspect = width / height;
    this.camera.position.copy(this.room.localToWorld(eye.multiplyScalar(far).add(this.target)));
    this.camera.lookAt(this.room.localToWorld(this.target.clone()));
    this.camera.updateProjectionMatrix();
    return true;
  }

  // Which way on the floor is to the right in the picture: x and y of a unit vector.
  right() {
    const turned = Math.atan2(this.away.y, this.away.x) + THREE.MathUtils.degToRad(this.view.turned);
    return [-Math.sin(turned), Math.cos(turned)];
  }
}
