// Head and hands of a VR headset, by WebXR, as messages for the server.

const GAP = 1000 / 66; // between two messages [ms]: 60 a second of a headset with 72 or 90 frames
const JOINTS = ['wrist', 'index-finger-phalanx-proximal', 'middle-finger-phalanx-proximal', 'pinky-finger-phalanx-proximal'];

export async function isSupported() {
  if (!navigator.xr) return false;
  try {
    return await navigator.xr.isSessionSupported('immersive-vr');
  } catch {
    return false; // the browser forbids it here
  }
}

const rounded = (values, digits) => values.map((value) => Number(value.toFixed(digits)));

function point({ x, y, z }) {
  return rounded([x, y, z], 4);
}

function place({ position: p, orientation: q }) {
  return [...point(p), ...rounded([q.x, q.y, q.z, q.w], 6)];
}

function hand(frame, source, space) {
  if (source.hand) {
    const poses = JOINTS.map((name) => frame.getJointPose(source.hand.get(name), space));
    return poses.every(Boolean) ? { joints: poses.map((pose) => point(pose.transform.position)) } : null;
  }
  const pose = source.gripSpace && frame.getPose(source.gripSpace, space);
  // An emulated position is a guess of the device, not a measurement.
  return pose && !pose.emulatedPosition ? { grip: place(pose.transform) } : null;
}

export class Headset {
  // `view` draws, `send` gets each message, `ended` is called when the person leaves the headset.
  constructor(view, send, ended) {
    Object.assign(this, { view, send, ended, sentAt: -Infinity, isPlaced: false });
  }

  async enter() {
    this.session = await navigator.xr.requestSession('immersive-vr', {
      requiredFeatures: ['local-floor'], optionalFeatures: ['hand-tracking'],
    });
    this.session.addEventListener('end', () => this.ended());
    await this.view.renderer.xr.setSession(this.session);
  }

  leave() {
    this.session?.end().catch(() => {}); // it has ended already
  }

  recentre() {
    this.isPlaced = false;
  }

  stream(time, frame) {
    const space = this.view.renderer.xr.getReferenceSpace();
    const viewer = space && frame.getViewerPose(space);
    if (viewer && !this.isPlaced) {
      this.view.settle(place(viewer.transform));
      this.isPlaced = true;
    }
    if (!space || time - this.sentAt < GAP) return;
    this.sentAt = time;
    const message = { type: 'hands', time: Number((time / 1000).toFixed(4)), head: null, left: null, right: null };
    if (viewer && !viewer.emulatedPosition) message.head = place(viewer.transform);
    for (const source of frame.session.inputSources) {
      if (source.handedness in message) message[source.handedness] = hand(frame, source, space);
    }
    this.send(message);
  }
}
