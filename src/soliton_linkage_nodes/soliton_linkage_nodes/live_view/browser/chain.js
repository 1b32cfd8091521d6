// SPDX-License-Identifier: Apache-2.0
// Drawing of the chain to scale, and control of the chain by mouse, finger or keys.

import { Canvas, finite, leanColour, scaled, theme, ticks, uncertain } from './drawing.js';
import { solitonsOf } from './frames.js';

const NEAR = 22; // largest distance from the pointer to a rotor that is grabbed [pixels]
const STILL = 5; // largest movement of the pointer during a click [pixels]
const UNCONTROLLED = { act: () => {}, send: () => {}, window: () => {}, nudgeSpeed: () => 0 };

export class ChainView {
  // act(name, arguments) sends an action; window(first, last) requests a range of rotors.
  // send(message) sends the position of the pointer. Without arguments, the view only shows a chain.
  constructor(element, { act, send, window: requestWindow, nudgeSpeed } = UNCONTROLLED) {
    this.canvas = new Canvas(element);
    Object.assign(this, { act, send, requestWindow, nudgeSpeed });
    this.first = 0;
    this.last = NaN;
    this.mark = NaN; // rotor that the keys selected
    this.pull = null; // rotor that the pointer or a key pulls
    this.stretch = 1e-9; // extension at the ends of the colour scale [m]
    this.pointers = new Map();
    this.listen(element);
  }

  show(frame, chain) {
    const margin = Math.max(0.9, (chain.rotor_length || 0.5) / (chain.spacing || 1) + 0.5);
    const renewed = this.name !== chain.name || this.known !== frame.rotors || this.margin !== margin;
    if (renewed) {
      Object.assign(this, { name: chain.name, known: frame.rotors, margin, mark: NaN });
      this.all();
    }
    this.frame = frame;
    this.chain = chain;
    if (renewed || this.canvas.width !== this.fitted) {
      this.fitted = this.canvas.width;
      this.heighten();
    }
  }

  all() {
    this.first = -this.margin;
    this.last = this.known - 1 + this.margin;
    this.heighten();
    this.sendWindow();
  }

  // Sets the height of the strip so that all rotors of the chain fit.
  heighten() {
    const { element } = this.canvas;
    if (!element.id) return;
    const metres = (this.known - 1 + 2 * this.margin) * (this.chain?.spacing || 1);
    const reach = (2 * (this.chain?.longest_rotor || 0.5) * element.clientWidth) / metres;
    const height = Math.round(Math.max(116, Math.min(reach + 66, 0.34 * window.innerHeight)));
    element.style.height = `${height}px`;
    this.canvas.fit();
  }

  sendWindow() { this.requestWindow(Math.floor(this.first) - 2, Math.ceil(this.last) + 2); }

  zoom(factor, at) {
    const centre = Number.isFinite(at) ? at : (this.first + this.last) / 2;
    const span = this.last - this.first;
    const wanted = Math.max(3, Math.min(this.known - 1 + 2 * this.margin, span * factor));
    const before = (centre - this.first) / span;
    this.move(centre - before * wanted, centre + (1 - before) * wanted);
  }

  move(first, last) {
    const span = last - first;
    this.first = Math.max(-this.margin, Math.min(first, this.known - 1 + this.margin - span));
    this.last = this.first + span;
    this.sendWindow();
  }

  get spacing() { return this.chain.spacing || 1; }

  get perMetre() { return this.canvas.width / ((this.last - this.first) * this.spacing); }

  get middle() { return this.canvas.height / 2 - 8; }

  rotorAt(x) { return this.first + (x / this.canvas.width) * (this.last - this.first); }

  toX(rotor) { return ((rotor - this.first) / (this.last - this.first)) * this.canvas.width; }

  pivot(n) {
    const { pivots } = this.chain;
    return pivots && pivots.length ? pivots[Math.max(0, Math.min(n, pivots.length - 1))] : n * this.spacing;
  }

  // Returns [x of the pivot, x and y of the mass, length] of each rotor of the frame, in pixels.
  masses() {
    const { frame, chain, perMetre, middle } = this;
    const lengths = chain.rotor_lengths && chain.rotor_lengths.length ? chain.rotor_lengths : null;
    return Array.from(frame.angles, (angle, i) => {
      const n = frame.first + i;
      const length = (lengths ? lengths[n] : chain.rotor_length || 0.5) * perMetre;
      const x = (this.pivot(n) - this.first * this.spacing) * perMetre;
      return [x, x + length * Math.sin(angle), middle - length * Math.cos(angle), length];
    });
  }

  draw() {
    const look = theme();
    const { canvas, frame } = this;
    if (!frame || !this.chain) return;
    if (this.chain.conflict) { canvas.showReason(look, this.chain.conflict); return; }
    if (!frame.rotors) { canvas.showReason(look, this.chain.error || 'waiting for joint_states'); return; }
    const c = canvas.begin();
    this.drawSolitons(c, look);
    if (frame.angles.length) this.drawRotors(c, look, this.masses());
    else this.drawGroups(c, look);
    this.drawEdges(c, look);
    this.drawPull(c, look);
    this.drawScale(c, look);
  }

  drawRotors(c, look, points) {
    const { frame, middle } = this;
    const spacing = points.length > 1 ? points[1][0] - points[0][0] : 30;
    const overlapping = points.length > 0 && points[0][3] > spacing;
    const width = Math.max(0.8, Math.min(6, spacing / 5));
    this.drawSprings(c, look, points, Math.max(1, 0.7 * width));
    c.lineCap = 'round';
    // If rotors overlap their neighbours, every other one is grey, as in the figures.
    [1, 0].forEach((odd) => {
      const bars = new Path2D();
      points.forEach(([px, mx, my], i) => {
        const other = overlapping ? (frame.first + i) % 2 : 0;
        if (Number.isFinite(mx) && other === odd) { bars.moveTo(px, middle); bars.lineTo(mx, my); }
      });
      if (overlapping) {
        c.strokeStyle = look.panel;
        c.lineWidth = width + 2;
        c.stroke(bars);
      }
      c.strokeStyle = odd ? look.grey : look.ink;
      c.lineWidth = width;
      c.stroke(bars);
    });
    c.lineCap = 'butt';
    if (spacing > 4) {
      c.fillStyle = look.ink;
      points.forEach(([px]) => c.fillRect(px - width / 2, middle - width / 2, width, width));
      c.fillStyle = look.blue;
      c.beginPath();
      // The diameter is at least 6 pixels if the masses do not touch then.
      const radius = Math.max(Math.min(3, 0.4 * spacing), Math.min(7, 1.2 * width));
      points.forEach(([, mx, my]) => {
        if (Number.isFinite(mx)) { c.moveTo(mx + radius, my); c.arc(mx, my, radius, 0, 7); }
      });
      c.fill();
    }
    if (frame.mode.length) this.drawMode(c, look, points, width);
    c.fillStyle = look.soft;
    points.forEach(([px, mx]) => { if (Number.isNaN(mx)) c.fillText('?', px - 4, middle); });
  }

  drawSprings(c, look, points, width) {
    const { extensions } = this.frame;
    const largest = extensions.reduce((most, e) => (Math.abs(e) > most ? Math.abs(e) : most), 0);
    // The colour scale never ends below this extension, because smaller ones are invisible.
    const least = 1e-4 * (this.chain.rest_length || 1e-5);
    this.stretch = Math.max(largest, 0.98 * this.stretch, least);
    const paths = new Map(); // springs of about equal extension are drawn together
    for (let i = 0; i + 1 < points.length; i += 1) {
      const [[, fromX, fromY], [, toX, toY]] = [points[i], points[i + 1]];
      if (!Number.isFinite(fromX) || !Number.isFinite(toX)) continue;
      const level = Math.round((extensions[i] / this.stretch) * 4) || 0;
      if (!paths.has(level)) paths.set(level, new Path2D());
      paths.get(level).moveTo(fromX, fromY);
      paths.get(level).lineTo(toX, toY);
    }
    paths.forEach((path, level) => {
      c.strokeStyle = level > 0 ? look.red : level < 0 ? look.blue : look.soft;
      c.globalAlpha = level ? 0.35 + 0.65 * Math.abs(level) / 4 : 0.55;
      c.lineWidth = width * (0.8 + 0.3 * Math.abs(level));
      c.stroke(path);
    });
    c.globalAlpha = 1;
  }

  drawMode(c, look, points, width) {
    const { frame, chain } = this;
    const longest = 1.2 * Math.max(chain.rotor_length || 0, chain.spacing || 0) * this.perMetre;
    c.strokeStyle = look.green;
    c.fillStyle = look.green;
    c.lineWidth = Math.max(1.5, 0.8 * width);
    points.forEach(([, mx, my], i) => {
      const size = frame.mode[i] * longest;
      if (Math.abs(size) < 3 || !Number.isFinite(mx)) return;
      arrow(c, mx, my, mx + size * Math.cos(frame.angles[i]), my + size * Math.sin(frame.angles[i]));
    });
  }

  // Draws the lean of groups of rotors if the chain is too long to be drawn rotor by rotor.
  drawGroups(c, look) {
    const { frame, chain, canvas, middle } = this;
    const groups = frame.overview.length / 2;
    const high = (0.35 * canvas.height) / (chain.longest_rotor || 1);
    for (let x = 0; x < canvas.width; x += 2) {
      const g = Math.floor((this.rotorAt(x) / frame.rotors) * groups);
      if (g < 0 || g >= groups) continue;
      const [low, top] = frame.overview.subarray(2 * g, 2 * g + 2);
      c.fillStyle = leanColour(chain.lean((low + top) / 2));
      c.fillRect(x, middle - top * high, 2, Math.max(2, (top - low) * high));
    }
    c.fillStyle = look.soft;
    c.textAlign = 'center';
    c.fillText('lean of groups of rotors; zoom in to see each rotor', canvas.width / 2, 14);
  }

  drawSolitons(c, look) {
    const { frame, canvas, chain } = this;
    solitonsOf(frame).forEach(([rotor, deviation, charge]) => {
      const x = this.toX(rotor);
      const half = Math.max(chain.spacing ? this.toX(rotor + (2 * deviation) / chain.spacing) - x : 0, 3);
      c.fillStyle = look.red;
      c.globalAlpha = 0.25;
      c.fillRect(x - half, 18, 2 * half, canvas.height - 44);
      c.globalAlpha = 1;
      triangle(c, x, 17, -7, -13);
      const name = charge > 0 ? 'soliton' : 'anti-soliton';
      const { width } = c.measureText(name);
      c.fillText(name, x + 11 + width > canvas.width ? x - 11 - width : x + 11, 10);
    });
    this.drawLine(c, frame.goal, look.purple, 3, [7, 5]);
    this.drawLine(c, this.mark, look.ink, 2, []);
  }

  drawLine(c, rotor, colour, width, dash) {
    if (!Number.isFinite(rotor)) return;
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.setLineDash(dash);
    c.beginPath();
    c.moveTo(this.toX(rotor), 18);
    c.lineTo(this.toX(rotor), this.canvas.height - 26);
    c.stroke();
    c.setLineDash([]);
  }

  // Draws the edges, green where the actuator acts.
  drawEdges(c, look) {
    const { canvas, frame, middle } = this;
    const able = this.chain.able !== false;
    [0, this.known - 1].forEach((rotor, last) => {
      const near = able && frame.mode.length && Number.isFinite(frame.zero_mode_rotor)
        && (frame.zero_mode_rotor > (this.known - 1) / 2) === Boolean(last);
      c.strokeStyle = near ? look.green : look.soft;
      c.lineWidth = near ? 3 : 1.5;
      const x = this.toX(rotor + (last ? 1 : -1) * (this.margin - 0.35));
      const foot = x + (last ? -7 : 7);
      c.beginPath();
      c.moveTo(foot, middle - 26);
      c.lineTo(x, middle - 26);
      c.lineTo(x, middle + 26);
      c.lineTo(foot, middle + 26);
      c.stroke();
    });
  }

  // Draws the spring from the pulled mass to the pointer.
  drawPull(c, look) {
    const { pull, frame } = this;
    const point = pull && pull.sent && this.masses()[pull.rotor - frame.first];
    if (!point) return;
    c.strokeStyle = look.purple;
    c.lineWidth = 3;
    c.setLineDash([5, 4]);
    c.beginPath();
    c.moveTo(point[1], point[2]);
    c.lineTo(pull.x, pull.y);
    c.stroke();
    c.setLineDash([]);
    c.beginPath();
    c.arc(point[1], point[2], 9, 0, 7);
    c.stroke();
  }

  drawScale(c, look) {
    const { canvas } = this;
    c.fillStyle = look.soft;
    c.font = '14px system-ui, "DejaVu Sans", sans-serif';
    c.textAlign = 'center';
    ticks(Math.max(0, this.first), Math.min(this.known - 1, this.last), canvas.width / 90)
      .filter(Number.isInteger)
      .forEach((n) => {
        const half = c.measureText(n).width / 2 + 1;
        c.fillText(n, Math.max(half, Math.min(canvas.width - half, this.toX(n))), canvas.height - 9);
      });
    c.textAlign = 'left';
  }

  note() {
    const { frame, chain } = this;
    if (!frame || !frame.rotors || chain.conflict) return '';
    const parts = [`${frame.rotors} rotors`];
    if (chain.motion) parts.unshift(chain.motion);
    if (Number.isFinite(frame.rotor)) {
      parts.push(`soliton at rotor ${uncertain(frame.rotor, frame.position_deviation / this.spacing)}`);
      parts.push(`${finite(frame.velocity / this.spacing, 1)} rotors/s`);
    }
    if (frame.extensions.length) parts.push(`spring extensions up to ±${scaled(this.stretch, 'm')}`);
    if (!chain.spacing) parts.push('no topic chain: lengths, springs and zero mode are unknown');
    return parts.join(' · ');
  }

  listen(element) {
    const at = (event) => {
      const box = element.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    element.addEventListener('wheel', (event) => {
      if (!this.frame) return;
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.2 : 1 / 1.2, this.rotorAt(at(event)[0]));
    }, { passive: false });
    element.addEventListener('pointerdown', (event) => {
      if (!this.frame || !this.frame.rotors) return;
      element.setPointerCapture(event.pointerId);
      const [x, y] = at(event);
      this.pointers.set(event.pointerId, x);
      this.began = { x, first: this.first, last: this.last, moved: 0 };
      if (this.pointers.size === 1) this.pull = this.grab(x, y);
      else this.release();
    });
    element.addEventListener('pointermove', (event) => {
      if (!this.pointers.has(event.pointerId)) return;
      const [x, y] = at(event);
      if (this.pointers.size === 2) this.pinch(event.pointerId, x);
      else if (this.pull) this.dragPull(x, y);
      else this.pan(x);
      this.pointers.set(event.pointerId, x);
    });
    const end = (event) => {
      const alone = this.pointers.size === 1;
      if (!this.pointers.delete(event.pointerId)) return;
      const pulled = this.pull && this.pull.sent;
      this.release();
      if (event.type === 'pointercancel' || !alone || pulled) return;
      if (this.began.moved <= STILL) this.moveSoliton(this.rotorAt(at(event)[0]));
    };
    element.addEventListener('pointerup', end);
    element.addEventListener('pointercancel', end);
    element.addEventListener('dblclick', (event) => event.preventDefault());
    element.addEventListener('keydown', (event) => this.key(event));
    const lift = (event) => { if (this.pull && event.key === this.pull.key) this.release(); };
    element.addEventListener('keyup', lift);
    element.addEventListener('blur', () => { if (this.pull && this.pull.key) this.release(); });
  }

  moveSoliton(rotor) {
    const goal = Math.max(0, Math.min(this.known - 1, rotor));
    this.act('move', { rotor: Math.round(goal * 100) / 100 });
  }

  key(event) {
    const span = this.last - this.first;
    const step = event.shiftKey ? 10 : 1;
    const from = Number.isFinite(this.mark) ? this.mark : Math.round(this.frame?.rotor || 0);
    const keys = {
      ArrowLeft: () => { this.mark = Math.max(0, from - step); },
      ArrowRight: () => { this.mark = Math.min(this.known - 1, from + step); },
      ArrowUp: () => this.pullByKey(event, from, -1),
      ArrowDown: () => this.pullByKey(event, from, 1),
      Enter: () => { if (Number.isFinite(this.mark)) this.moveSoliton(this.mark); },
      Escape: () => { this.mark = NaN; },
      '+': () => this.zoom(1 / 1.3, this.mark),
      '-': () => this.zoom(1.3, this.mark),
      0: () => this.all(),
      PageUp: () => this.move(this.first - span / 2, this.last - span / 2),
      PageDown: () => this.move(this.first + span / 2, this.last + span / 2),
      ' ': () => this.act('pause', { paused: !this.chain.paused }),
      n: () => this.act('nudge', { speed: this.nudgeSpeed(), edge: 'nearest' }),
    };
    if (keys[event.key] && this.frame) {
      event.preventDefault();
      keys[event.key]();
    }
  }

  // Returns a pull of the rotor whose mass is nearest to the pointer, or null if no mass is near.
  grab(x, y) {
    const { frame } = this;
    if (!this.chain.spacing || this.chain.able === false) return null;
    const near = this.masses().map(([, mx, my], i) => [Math.hypot(mx - x, my - y), frame.first + i])
      .filter(([distance]) => distance < NEAR)
      .sort((a, b) => a[0] - b[0]);
    return near.length ? { rotor: near[0][1], fromX: x, fromY: y, x, y, sent: false } : null;
  }

  // Moves the target of a pull. The server pulls the rotor until the button is released.
  dragPull(x, y) {
    const { pull } = this;
    if (!pull.sent && Math.hypot(x - pull.fromX, y - pull.fromY) <= STILL) return;
    Object.assign(pull, { x, y });
    const target = [this.rotorAt(x) * this.spacing, (this.middle - y) / this.perMetre];
    if (pull.sent) this.send({ pull: target });
    else this.act('pull', { rotor: pull.rotor, x: target[0], z: target[1] });
    pull.sent = true;
  }

  // Pulls the marked rotor along its circle while a key is down.
  pullByKey(event, rotor, sign) {
    if (event.repeat || this.pull || !this.chain.spacing || this.chain.able === false) return;
    this.mark = rotor;
    this.pull = { rotor, key: event.key, sign, fromX: -Infinity, fromY: 0, sent: false };
    this.followKey();
  }

  // Keeps the target of a pull by key at a right angle to the rotor.
  followKey() {
    const { pull, frame } = this;
    const point = pull && pull.key && this.masses()[pull.rotor - frame.first];
    if (!point) return;
    const [px, mx, my] = point;
    const sign = pull.sign;
    this.dragPull(px - sign * (my - this.middle), this.middle + sign * (mx - px));
  }

  release() {
    if (this.pull && this.pull.sent) this.send({ pull: null });
    this.pull = null;
  }

  pan(x) {
    const { began } = this;
    began.moved = Math.max(began.moved, Math.abs(x - began.x));
    if (began.moved <= STILL) return;
    const shift = ((began.x - x) / this.canvas.width) * (began.last - began.first);
    this.move(began.first + shift, began.last + shift);
  }

  pinch(moving, x) {
    const [, other] = [...this.pointers.entries()].find(([id]) => id !== moving);
    const before = Math.abs(this.pointers.get(moving) - other);
    const now = Math.abs(x - other);
    if (before > 8 && now > 8) this.zoom(before / now, this.rotorAt((x + other) / 2));
    this.release();
    this.began.moved = Infinity;
  }
}

function arrow(c, fromX, fromY, toX, toY) {
  const angle = Math.atan2(toY - fromY, toX - fromX);
  const size = Math.min(10, 0.5 * Math.hypot(toX - fromX, toY - fromY) + 2);
  c.beginPath();
  c.moveTo(fromX, fromY);
  c.lineTo(toX - size * 0.7 * Math.cos(angle), toY - size * 0.7 * Math.sin(angle));
  c.stroke();
  c.beginPath();
  c.moveTo(toX, toY);
  c.lineTo(toX - size * Math.cos(angle - 0.45), toY - size * Math.sin(angle - 0.45));
  c.lineTo(toX - size * Math.cos(angle + 0.45), toY - size * Math.sin(angle + 0.45));
  c.fill();
}

// Fills a triangle with its tip at a point.
export function triangle(c, x, y, half, height) {
  c.beginPath();
  c.moveTo(x, y);
  c.lineTo(x - half, y + height);
  c.lineTo(x + half, y + height);
  c.fill();
}
