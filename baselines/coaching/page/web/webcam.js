// Landmarks of who sits before the webcam, by MediaPipe in this browser: pictures are neither kept nor sent.

const AT = '/package/pose/';
const REFUSED = {
  NotAllowedError: 'The browser does not let this page use the webcam.',
  NotFoundError: 'There is no webcam.',
  NotReadableError: 'Another program uses the webcam.',
};

function load(address) {
  return new Promise((done, failed) => {
    const script = Object.assign(document.createElement('script'), { src: address });
    script.addEventListener('load', done);
    script.addEventListener('error', () => failed(new Error(`${address} cannot be loaded`)));
    document.head.append(script);
  });
}

export class Webcam {
  // `video` shows the picture, `found` gets each message, or null where nobody is seen, `ended` a reason.
  constructor(video, found, ended) {
    Object.assign(this, { video, found, ended, isOn: false });
  }

  async start() {
    if (!document.createElement('canvas').getContext('webgl2')) throw new Error('The webcam needs WebGL, which this browser does not offer.');
    try {
      this.stream = await navigator.mediaDevices.getUserMedia({ audio: false, video: { width: 640, height: 480, facingMode: 'user' } });
    } catch (error) {
      throw new Error(REFUSED[error.name] ?? error.message);
    }
    this.isOn = true;
    this.stream.getVideoTracks()[0].addEventListener('ended', () => this.stop('The webcam has been switched off.'));
    this.video.srcObject = this.stream;
    await this.video.play();
    this.watch().catch((error) => this.stop(`The webcam cannot be used: ${error.message ?? error}`));
  }

  stop(why = '') {
    this.isOn = false;
    this.stream?.getTracks().forEach((track) => track.stop());
    this.video.srcObject = null;
    this.ended(why);
  }

  async watch() {
    if (!this.pose) {
      await load(`${AT}pose.js`);
      this.pose = new window.Pose({ locateFile: (file) => AT + file });
      this.pose.setOptions({ modelComplexity: 1, smoothLandmarks: false });
      this.pose.onResults(({ poseWorldLandmarks: marks }) => { if (this.isOn) this.found(marks ? this.message(marks) : null); });
    }
    while (this.isOn) {
      await new Promise((done) => { requestAnimationFrame(done); });
      this.time = performance.now() / 1000;
      if (this.isOn && this.video.currentTime !== this.seen) {
        this.seen = this.video.currentTime;
        await this.pose.send({ image: this.video });
      }
    }
  }

  message(marks) {
    const rounded = (value) => Number(value.toFixed(4));
    return {
      type: 'landmarks', time: rounded(this.time), points: marks.map(({ x, y, z }) => [x, y, z].map(rounded)),
      visibility: marks.map(({ visibility }) => Math.min(Math.max(rounded(visibility), 0), 1)),
    };
  }
}
