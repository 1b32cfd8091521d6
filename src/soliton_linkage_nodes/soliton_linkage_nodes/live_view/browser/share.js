// SPDX-License-Identifier: Apache-2.0
// Viewer of a shared run. It needs no server, because the page contains the data.

import { ChainView } from './chain.js';
import { Canvas, axes, clipped, energyScale, finite, leanPixel, leanScale, line, setText, theme, trackLine } from './drawing.js';
import { LeanPlot } from './plots.js';

const FILLED_GAP = 0.8; // longest time without a frame that the kymograph fills [s]
const shared = (id) => document.getElementById(`live-share-${id}`);

function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

class SharedRun {
  constructor(data) {
    const { chain, rotors } = data;
    this.chain = { ...chain, name: data.title, able: false, lean: leanScale(chain.rest_lean, chain.longest_rotor) };
    this.rotors = rotors;
    this.times = unpacked(data.times);
    this.angles = unpacked(data.angles);
    this.energies = Object.entries(data.energies).map(([name, text]) => [name, unpacked(text)]);
    this.solitons = data.solitons.map((values) => Float32Array.from(values, (v) => (v === null ? NaN : v)));
    this.span = [this.times[0], Math.max(this.times.at(-1), this.times[0] + 1e-3)];
    this.shown = [...this.span];
    this.n = 0;
    this.view = new ChainView(shared('chain'));
    this.lean = new LeanPlot(shared('lean'));
    this.kymograph = new Canvas(shared('kymograph'));
    this.energy = new Canvas(shared('energy'));
    this.image = this.paint();
    this.listen();
    new ResizeObserver(() => this.draw()).observe(document.body);
    const darkness = matchMedia('(prefers-color-scheme: dark)');
    const adapt = () => { document.body.classList.toggle('body--dark', darkness.matches); this.draw(); };
    darkness.addEventListener('change', adapt);
    adapt();
  }

  lengths(n) { return this.chain.rotor_lengths.length ? this.chain.rotor_lengths[n] : this.chain.rotor_length; }

  frameAngles(n) { return this.angles.subarray(n * this.rotors, (n + 1) * this.rotors); }

  // Returns a frame in the format of the stream of the live page.
  frame(n) {
    const angles = this.frameAngles(n);
    const { chain } = this;
    const place = (i) => {
      const pivot = chain.pivots.length ? chain.pivots[i] : i * chain.spacing;
      return [pivot + this.lengths(i) * Math.sin(angles[i]), this.lengths(i) * Math.cos(angles[i])];
    };
    const places = Array.from(angles, (_, i) => place(i));
    const extensions = Float32Array.from(angles, (_, i) => (i + 1 < this.rotors
      ? Math.hypot(places[i + 1][0] - places[i][0], places[i + 1][1] - places[i][1]) - chain.rest_lengths[i] : 0));
    const solitons = this.solitons[n];
    return {
      rotors: this.rotors, first: 0, angles, extensions, mode: [], solitons, age: 0, state_age: 0,
      overview: Float32Array.from(angles, (a, i) => this.lengths(i) * Math.sin(a)),
      rotor: solitons.length ? solitons[0] : NaN, position_deviation: solitons[1], velocity: this.velocity(n),
      walls: solitons.length / 3, goal: NaN, zero_mode_rotor: NaN,
    };
  }

  velocity(n) {
    const [a, b] = [Math.max(0, n - 2), Math.min(this.times.length - 1, n + 2)];
    const [from, to] = [this.solitons[a], this.solitons[b]];
    return from.length && to.length ? ((to[0] - from[0]) / (this.times[b] - this.times[a])) * this.chain.spacing : NaN;
  }

  // Returns the kymograph. Each column is the frame nearest to the column's time, because frames of
  // a busy computer are not equidistant.
  paint() {
    const [from, to] = this.span;
    const image = Object.assign(document.createElement('canvas'), { width: 2 * this.times.length, height: this.rotors });
    const context = image.getContext('2d');
    const data = context.createImageData(image.width, image.height);
    const pixels = new Uint32Array(data.data.buffer);
    for (let n = 0; n < image.width; n += 1) {
      const time = from + ((n + 0.5) / image.width) * (to - from);
      const nearest = this.at(time);
      if (Math.abs(this.times[nearest] - time) > FILLED_GAP / 2) continue;
      const angles = this.frameAngles(nearest);
      for (let i = 0; i < this.rotors; i += 1) {
        pixels[(this.rotors - 1 - i) * image.width + n] = leanPixel(this.chain.lean(this.lengths(i) * Math.sin(angles[i])));
      }
    }
    context.putImageData(data, 0, 0);
    return image;
  }

  // Returns the number of the frame nearest to a time.
  at(time) {
    let [low, high] = [0, this.times.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.times[middle] > time) high = middle; else low = middle;
    }
    return time - this.times[low] < this.times[high] - time ? low : high;
  }

  go(n) {
    this.n = Math.max(0, Math.min(this.times.length - 1, n));
    this.draw();
  }

  draw() {
    const frame = this.frame(this.n);
    const time = this.times[this.n];
    this.view.show(frame, this.chain);
    // The colour scale of the springs belongs to the shown frame only.
    this.view.stretch = 0;
    this.view.draw();
    this.lean.draw(frame, this.chain);
    this.drawKymograph(time);
    this.drawEnergy(time);
    setText(shared('note'), this.view.note());
    setText(shared('lean-title'), this.lean.title(this.chain));
    setText(shared('clock'), `${finite(time, 2)} s of ${finite(this.times.at(-1), 2)} s`);
    shared('time').value = this.n;
  }

  drawKymograph(time) {
    const { kymograph: canvas, shown } = this;
    const look = theme();
    const c = canvas.begin();
    const box = axes(canvas, look, { x: shown, y: [-0.5, this.rotors - 0.5], xLabel: 'time [s]', yLabel: 'rotor n' });
    this.box = box;
    clipped(c, box, () => {
      c.imageSmoothingEnabled = false;
      const [x0, x1] = this.span.map(box.toX);
      c.drawImage(this.image, x0, box.top, x1 - x0, box.h);
      trackLine(c, Array.from(this.times, (t, n) => [box.toX(t), box.toY(this.solitons[n].length ? this.solitons[n][0] : NaN)]));
      c.fillStyle = look.green;
      c.fillRect(box.toX(time) - 1.5, box.top, 3, box.h);
    });
  }

  drawEnergy(time) {
    const { energy: canvas, shown } = this;
    const look = theme();
    const c = canvas.begin();
    const { unit, power, top } = energyScale(this.energies.map(([, series]) => series), 1e-12);
    const box = axes(canvas, look, { x: shown, y: [0, top], xLabel: 'time [s]', yLabel: `E [${unit}]` });
    const colours = { kinetic: look.blue, elastic: look.red, wall_energy: look.ink, wake_energy: look.purple };
    clipped(c, box, () => {
      this.energies.forEach(([name, series]) => {
        line(c, Array.from(series, (value, n) => [box.toX(this.times[n]), box.toY(value / 10 ** power)]), colours[name] || look.ink, 2);
      });
      c.fillStyle = look.green;
      c.fillRect(box.toX(time) - 1.5, box.top, 3, box.h);
    });
    const names = { kinetic: 'kinetic (blue)', elastic: 'elastic (orange)', wall_energy: 'at the soliton', wake_energy: 'in its wake (purple)' };
    setText(shared('energy-title'), `Energy [${unit}]: ${this.energies.map(([name]) => names[name] || name).join(', ')}`);
  }

  zoom(factor, centre) {
    const [low, high] = this.span;
    const width = Math.max(0.05, Math.min(high - low, (this.shown[1] - this.shown[0]) * factor));
    const share = (centre - this.shown[0]) / (this.shown[1] - this.shown[0]);
    const from = Math.max(low, Math.min(high - width, centre - share * width));
    this.shown = [from, from + width];
    this.draw();
  }

  listen() {
    const slider = shared('time');
    slider.max = this.times.length - 1;
    slider.addEventListener('input', () => this.go(Number(slider.value)));
    shared('play').addEventListener('click', () => this.play());
    const element = shared('kymograph');
    const timeAt = (event) => {
      const x = event.clientX - element.getBoundingClientRect().left;
      return this.shown[0] + ((x - this.box.left) / this.box.w) * (this.shown[1] - this.shown[0]);
    };
    element.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8, timeAt(event));
    }, { passive: false });
    element.addEventListener('pointerdown', (event) => {
      element.setPointerCapture(event.pointerId);
      this.grip = { time: timeAt(event), x: event.clientX, moved: false };
    });
    element.addEventListener('pointermove', (event) => {
      if (!this.grip) return;
      this.grip.moved = this.grip.moved || Math.abs(event.clientX - this.grip.x) > 5;
      if (!this.grip.moved) return;
      const width = this.shown[1] - this.shown[0];
      const from = Math.max(this.span[0], Math.min(this.span[1] - width, this.shown[0] + this.grip.time - timeAt(event)));
      this.shown = [from, from + width];
      this.draw();
    });
    element.addEventListener('pointerup', (event) => {
      if (this.grip && !this.grip.moved) this.go(this.at(timeAt(event)));
      this.grip = null;
    });
    element.addEventListener('dblclick', () => { this.shown = [...this.span]; this.draw(); });
  }

  play() {
    const button = shared('play');
    this.playing = !this.playing;
    setText(button, this.playing ? 'Pause' : 'Play');
    if (!this.playing) return;
    if (this.n === this.times.length - 1) this.n = 0;
    const begun = performance.now();
    const from = this.times[this.n];
    const step = () => {
      if (!this.playing) return;
      const time = from + (performance.now() - begun) / 1000;
      this.go(this.at(Math.min(time, this.times.at(-1))));
      if (time >= this.times.at(-1)) this.play();
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
}

window.shared = new SharedRun(JSON.parse(document.getElementById('share-data').textContent));
