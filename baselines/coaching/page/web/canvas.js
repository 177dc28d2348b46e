// Both figures as lines, where there is no WebGL.

import { BONES, extent, label, mirrored, shares } from './figure.js';

const HIPS = 0.62; // height of the hips above the floor [m]

export class FlatView {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.kind = 'flat';
  }

  show(state) {
    this.state = state;
  }

  draw() {
    const { canvas, context } = this;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    const style = getComputedStyle(document.documentElement);
    context.fillStyle = style.getPropertyValue('--stage');
    context.fillRect(0, 0, canvas.width, canvas.height);
    if (!this.state) return;
    const ink = style.getPropertyValue('--ink');
    label(canvas);
    const { coach, user } = shares(canvas.width, canvas.height);
    this.figure(this.state.coach, coach, style.getPropertyValue('--accent'), 0.05);
    this.figure(this.state.user, user, ink, 0.025);
  }

  figure(points, share, colour, thickness) {
    if (!points) return;
    const { context } = this;
    const { tall, middle, across } = extent(share);
    const scale = Math.min(share.h / tall, share.w / across);
    const place = (point) => {
      const [x, y] = mirrored(point);
      return [share.x + share.w / 2 + x * scale, share.y + share.h / 2 - (y + HIPS - middle) * scale];
    };
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = thickness * scale;
    context.lineCap = 'round';
    for (const [from, to] of BONES) {
      if (!points[from] || !points[to]) continue;
      context.beginPath();
      context.moveTo(...place(points[from]));
      context.lineTo(...place(points[to]));
      context.stroke();
    }
    if (points.head && points.eyes) {
      context.beginPath();
      context.arc(...place(points.head), 0.12 * scale, 0, 2 * Math.PI);
      context.fill();
      const [x, y] = place(points.eyes); // where it looks
      context.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--stage');
      context.beginPath();
      context.arc(x, y, 0.035 * scale, 0, 2 * Math.PI);
      context.fill();
    }
  }
}
