// SPDX-License-Identifier: Apache-2.0
// The pictures of the camera at the chain: asked for only while somebody can see them.

export class CameraPanel {
  // ask(wanted) asks for pictures or for none any more; drawn() asks for the next.
  constructor(figure, { ask, drawn, silence }) {
    Object.assign(this, { figure, ask, drawn, silence, inView: false, wanted: false });
    this.box = figure.querySelector('details');
    this.canvas = { element: figure.querySelector('canvas') };
    this.context = this.canvas.element.getContext('bitmaprenderer');
    this.note = figure.querySelector('.live-camera-note');
    this.why = figure.querySelector('.live-camera-why');
    this.forget();
    new IntersectionObserver((entries) => {
      this.inView = entries[entries.length - 1].isIntersecting;
      this.heed();
    }).observe(this.box);
    this.box.addEventListener('toggle', () => this.heed());
    document.addEventListener('visibilitychange', () => this.heed());
  }

  // What was seen of another chain.
  forget() {
    this.came = -Infinity; // when the newest picture was taken, by the clock of the page
    this.gap = 0; // seconds between the last two pictures
    this.count = 0;
    this.rate = NaN;
    this.since = performance.now();
    this.complaint = '';
    this.context.transferFromImageBitmap(null);
  }

  heed() {
    const wanted = this.inView && this.box.open && document.visibilityState === 'visible';
    if (wanted === this.wanted) return;
    this.wanted = wanted;
    this.forget();
    this.ask(wanted);
  }

  async take({ age, jpeg }) {
    try {
      const bitmap = await createImageBitmap(new Blob([jpeg], { type: 'image/jpeg' }));
      this.size = `${bitmap.width} × ${bitmap.height}`;
      this.canvas.element.width = bitmap.width;
      this.canvas.element.height = bitmap.height;
      this.context.transferFromImageBitmap(bitmap);
      const came = performance.now() - 1000 * age;
      this.gap = (came - this.came) / 1000;
      this.came = came;
      this.count += 1;
      this.complaint = '';
    } catch (error) {
      this.complaint = 'the picture cannot be read';
    }
    this.drawn();
  }

  // Says how old the picture is, and why there is none; ten times a second.
  tell(reason) {
    const now = performance.now();
    if (now - this.since > 2000) {
      this.rate = (1000 * this.count) / (now - this.since);
      this.count = 0;
      this.since = now;
    }
    const seen = this.came > -Infinity;
    const age = (now - this.came) / 1000;
    const stopped = seen && this.wanted && age > Math.max(this.silence, this.gap < Infinity ? 2 * this.gap : 0);
    this.figure.classList.toggle('absent', Boolean(reason) && !seen);
    this.figure.classList.toggle('stopped', stopped);
    let text = '';
    if (stopped) text = `no picture since ${age.toFixed(1)} s`;
    else if (seen && this.rate >= 0) text = `${this.size}, ${this.rate.toFixed(0)} pictures/s`;
    set(this.note, text);
    set(this.why, this.complaint || reason || (seen || !this.wanted ? '' : 'no picture yet'));
  }
}

function set(place, text) {
  if (place.textContent !== text) place.textContent = text;
}
