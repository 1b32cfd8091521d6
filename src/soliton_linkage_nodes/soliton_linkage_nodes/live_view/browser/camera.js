// SPDX-License-Identifier: Apache-2.0
// Camera pictures of the chain, requested only while the panel is visible.

import { setLine, setText } from './drawing.js';

export class CameraPanel {
  // request(wanted) starts or stops the pictures; shown() requests the next picture.
  constructor(figure, { request, shown, silence }) {
    Object.assign(this, { figure, request, shown, silence, inView: false, wanted: false });
    this.box = figure.querySelector('details');
    this.canvas = { element: figure.querySelector('canvas') };
    this.context = this.canvas.element.getContext('bitmaprenderer');
    this.note = figure.querySelector('.live-camera-note');
    this.reason = figure.querySelector('.live-camera-why');
    this.clear();
    new IntersectionObserver((entries) => {
      this.inView = entries[entries.length - 1].isIntersecting;
      this.adapt();
    }).observe(this.box);
    this.box.addEventListener('toggle', () => this.adapt());
    document.addEventListener('visibilitychange', () => this.adapt());
  }

  clear() {
    this.taken = -Infinity; // time of the newest picture by the clock of the page
    this.gap = 0; // seconds between the last two pictures
    this.count = 0;
    this.rate = NaN;
    this.since = performance.now();
    this.error = '';
    this.context.transferFromImageBitmap(null);
  }

  adapt() {
    const wanted = this.inView && this.box.open && document.visibilityState === 'visible';
    if (wanted === this.wanted) return;
    this.wanted = wanted;
    this.clear();
    this.request(wanted);
  }

  async show({ age, jpeg }) {
    try {
      const bitmap = await createImageBitmap(new Blob([jpeg], { type: 'image/jpeg' }));
      const { width, height } = bitmap;
      this.size = `${width} × ${height}`;
      Object.assign(this.canvas.element, { width, height });
      this.context.transferFromImageBitmap(bitmap);
      const taken = performance.now() - 1000 * age;
      this.gap = (taken - this.taken) / 1000;
      this.taken = taken;
      this.count += 1;
      this.error = '';
    } catch (error) {
      this.error = 'the browser cannot decode the picture; check camera_overlay';
    }
    this.shown();
  }

  // Shows the rate and the age of the pictures, or the reason why no picture is available.
  refresh(reason) {
    const now = performance.now();
    if (now - this.since > 2000) {
      this.rate = (1000 * this.count) / (now - this.since);
      this.count = 0;
      this.since = now;
    }
    const seen = this.taken > -Infinity;
    const age = (now - this.taken) / 1000;
    const limit = Math.max(this.silence, this.gap < Infinity ? 2 * this.gap : 0);
    const stopped = seen && this.wanted && age > limit;
    this.figure.classList.toggle('absent', Boolean(reason) && !seen);
    this.figure.classList.toggle('stopped', stopped);
    let text = '';
    if (stopped) text = `no picture for ${age.toFixed(1)} s`;
    else if (reason && !seen) text = reason;
    else if (seen && this.rate >= 0) text = `${this.size}, ${this.rate.toFixed(0)} pictures/s`;
    setLine(this.note, text);
    setText(this.reason, this.error || reason || (seen || !this.wanted ? '' : 'waiting for a picture'));
  }
}
