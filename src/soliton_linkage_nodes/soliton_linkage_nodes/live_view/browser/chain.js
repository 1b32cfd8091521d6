// SPDX-License-Identifier: Apache-2.0
// The chain to scale, and what is done to it with the mouse, a finger or the keys.

import { Canvas, finite, leanColour, scaled, theme, ticks } from './drawing.js';

const NEAR = 22; // pixels within which an edge rotor is grabbed
const STILL = 5; // pixels that a click may move

export class ChainView {
  // act(name, arguments) sends an action; window(first, last) asks for rotors of a part.
  constructor(element, { act, window: ask, strength }) {
    this.canvas = new Canvas(element);
    this.act = act;
    this.ask = ask;
    this.strength = strength;
    this.first = 0;
    this.last = NaN;
    this.mark = NaN; // rotor that the keys have chosen
    this.pull = null; // drag of an edge rotor
    this.stretch = 1e-9; // extension at the ends of the colours
    this.pointers = new Map();
    this.listen(element);
  }

  get rotors() { return this.frame ? this.frame.rotors : 0; }

  show(frame, chain) {
    const margin = Math.max(0.9, (chain.rotor_length || 0.5) / (chain.spacing || 1) + 0.5);
    if (this.name !== chain.name || this.known !== frame.rotors || this.margin !== margin) {
      Object.assign(this, { name: chain.name, known: frame.rotors, margin, mark: NaN });
      this.all();
    }
    this.frame = frame;
    this.chain = chain;
  }

  all() {
    this.first = -this.margin;
    this.last = this.known - 1 + this.margin;
    this.tell();
  }

  tell() {
    this.ask(Math.floor(this.first) - 2, Math.ceil(this.last) + 2);
  }

  zoom(factor, at) {
    const centre = Number.isFinite(at) ? at : (this.first + this.last) / 2;
    const span = this.last - this.first;
    const wanted = Math.max(3, Math.min(this.known - 1 + 2 * this.margin, span * factor));
    const share = (centre - this.first) / span;
    this.move(centre - share * wanted, centre + (1 - share) * wanted);
  }

  move(first, last) {
    const span = last - first;
    this.first = Math.max(-this.margin, Math.min(first, this.known - 1 + this.margin - span));
    this.last = this.first + span;
    this.tell();
  }

  // Pixels to metres along the chain and back.
  scale() {
    const { chain, canvas } = this;
    const spacing = chain.spacing || 1;
    const perMetre = canvas.width / ((this.last - this.first) * spacing);
    return { perMetre, spacing, middle: canvas.height / 2 - 8 };
  }

  rotorAt(x) {
    return this.first + (x / this.canvas.width) * (this.last - this.first);
  }

  pivot(n) {
    const { pivots } = this.chain;
    return pivots && pivots.length ? pivots[Math.max(0, Math.min(n, pivots.length - 1))]
      : n * (this.chain.spacing || 1);
  }

  // Pixels of pivots and masses of the rotors that came with the frame.
  places() {
    const { frame, chain } = this;
    const { perMetre, spacing, middle } = this.scale();
    const points = [];
    const lengths = chain.rotor_lengths && chain.rotor_lengths.length ? chain.rotor_lengths : null;
    for (let i = 0; i < frame.angles.length; i += 1) {
      const n = frame.first + i;
      const length = lengths ? lengths[n] : chain.rotor_length || 0.5;
      const x = (this.pivot(n) - this.first * spacing) * perMetre;
      points.push([x, x + length * Math.sin(frame.angles[i]) * perMetre,
        middle - length * Math.cos(frame.angles[i]) * perMetre, length * perMetre]);
    }
    return points;
  }

  draw() {
    const look = theme();
    const { canvas, frame } = this;
    if (!frame || !this.chain) return;
    if (!frame.rotors) { canvas.absent(look, this.chain.complaint || 'no joint_states yet'); return; }
    const c = canvas.begin();
    const { middle } = this.scale();
    this.drawWalls(c, look);
    if (frame.angles.length) this.drawRotors(c, look, this.places(), middle);
    else this.drawBand(c, look, middle);
    this.drawMarks(c, look);
    this.drawScale(c, look);
  }

  drawRotors(c, look, points, middle) {
    const { frame } = this;
    const spacing = points.length > 1 ? points[1][0] - points[0][0] : 30;
    const overlapping = points.length > 0 && points[0][3] > spacing;
    const width = Math.max(0.8, Math.min(6, spacing / 6));
    this.drawSprings(c, look, points, Math.max(1, 0.7 * width));
    c.lineCap = 'round';
    // Where rotors reach over their neighbours every other one is grey, as in the figures.
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
      const radius = Math.max(1.5, Math.min(7, 1.2 * width));
      points.forEach(([, mx, my]) => {
        if (Number.isFinite(mx)) { c.moveTo(mx + radius, my); c.arc(mx, my, radius, 0, 7); }
      });
      c.fill();
    }
    if (frame.mode.length) this.drawMode(c, look, points, width);
    if (frame.angles.some(Number.isNaN)) {
      c.fillStyle = look.soft;
      points.forEach(([px, mx]) => { if (Number.isNaN(mx)) c.fillText('?', px - 4, middle); });
    }
  }

  drawSprings(c, look, points, width) {
    const { extensions } = this.frame;
    let largest = 0;
    extensions.forEach((e) => { if (Math.abs(e) > largest) largest = Math.abs(e); });
    // Below a ten-thousandth of their length springs are at rest to the eye.
    const least = 1e-4 * (this.chain.rest_length || 1e-5);
    this.stretch = Math.max(largest, 0.98 * this.stretch, least);
    const groups = new Map();
    for (let i = 0; i + 1 < points.length; i += 1) {
      const e = extensions[i];
      const level = Number.isFinite(e) ? Math.round((e / this.stretch) * 4) : 0;
      if (!groups.has(level)) groups.set(level, []);
      groups.get(level).push(i);
    }
    groups.forEach((members, level) => {
      c.strokeStyle = level > 0 ? look.red : level < 0 ? look.blue : look.soft;
      c.globalAlpha = level ? 0.35 + 0.65 * Math.abs(level) / 4 : 0.55;
      c.lineWidth = width * (0.8 + 0.3 * Math.abs(level));
      c.beginPath();
      members.forEach((i) => {
        if (!Number.isFinite(points[i][1]) || !Number.isFinite(points[i + 1][1])) return;
        c.moveTo(points[i][1], points[i][2]);
        c.lineTo(points[i + 1][1], points[i + 1][2]);
      });
      c.stroke();
    });
    c.globalAlpha = 1;
  }

  drawMode(c, look, points, width) {
    const { frame, chain } = this;
    const { perMetre } = this.scale();
    const longest = 1.2 * Math.max(chain.rotor_length || 0, chain.spacing || 0) * perMetre;
    c.strokeStyle = look.green;
    c.fillStyle = look.green;
    c.lineWidth = Math.max(1.5, 0.8 * width);
    points.forEach(([, mx, my], i) => {
      const size = frame.mode[i] * longest;
      if (Math.abs(size) < 3 || !Number.isFinite(mx)) return;
      const dx = size * Math.cos(frame.angles[i]);
      const dy = size * Math.sin(frame.angles[i]);
      arrow(c, mx, my, mx + dx, my + dy);
    });
  }

  // Of a chain too long to be drawn rotor by rotor: how far its rotors lean.
  drawBand(c, look, middle) {
    const { frame, chain, canvas } = this;
    const values = frame.overview;
    const groups = values.length / 2;
    const high = 0.35 * canvas.height;
    const largest = chain.longest_rotor || 1;
    for (let x = 0; x < canvas.width; x += 2) {
      const g = Math.floor((this.rotorAt(x) / frame.rotors) * groups);
      if (g < 0 || g >= groups) continue;
      const [low, top] = values.subarray(2 * g, 2 * g + 2);
      c.fillStyle = leanColour(chain.lean((low + top) / 2));
      c.fillRect(x, middle - (top / largest) * high, 2, Math.max(2, ((top - low) / largest) * high));
    }
    c.fillStyle = look.soft;
    c.textAlign = 'center';
    c.fillText('lean of groups of rotors; zoom in to see each', canvas.width / 2, 14);
  }

  drawWalls(c, look) {
    const { frame, canvas, chain } = this;
    const toX = (rotor) => ((rotor - this.first) / (this.last - this.first)) * canvas.width;
    for (let i = 0; i + 2 < frame.places.length; i += 3) {
      const [rotor, deviation, charge] = frame.places.subarray(i, i + 3);
      const x = toX(rotor);
      const half = chain.spacing ? toX(rotor + (2 * deviation) / chain.spacing) - x : 0;
      c.fillStyle = look.red;
      c.globalAlpha = 0.25;
      c.fillRect(x - Math.max(half, 3), 18, 2 * Math.max(half, 3), canvas.height - 44);
      c.globalAlpha = 1;
      c.beginPath();
      c.moveTo(x - 7, 4);
      c.lineTo(x + 7, 4);
      c.lineTo(x, 17);
      c.fill();
      c.fillText(charge > 0 ? 'soliton' : 'anti-soliton', clampText(c, x + 11, canvas, 90), 10);
    }
    const goal = frame.goal;
    if (Number.isFinite(goal)) {
      c.strokeStyle = look.purple;
      c.lineWidth = 3;
      c.setLineDash([7, 5]);
      c.beginPath();
      c.moveTo(toX(goal), 18);
      c.lineTo(toX(goal), canvas.height - 26);
      c.stroke();
      c.setLineDash([]);
    }
    if (Number.isFinite(this.mark)) {
      c.strokeStyle = look.ink;
      c.lineWidth = 2;
      c.beginPath();
      c.moveTo(toX(this.mark), 18);
      c.lineTo(toX(this.mark), canvas.height - 26);
      c.stroke();
    }
  }

  // Edges with their actuators, and the pull on one of them.
  drawMarks(c, look) {
    const { canvas, frame } = this;
    const { middle } = this.scale();
    const toX = (rotor) => ((rotor - this.first) / (this.last - this.first)) * canvas.width;
    const able = this.chain.able !== false;
    [0, this.known - 1].forEach((rotor, last) => {
      const near = frame.mode.length && Number.isFinite(frame.zero_mode_rotor)
        && (frame.zero_mode_rotor > (this.known - 1) / 2) === Boolean(last);
      c.strokeStyle = near && able ? look.green : look.soft;
      c.lineWidth = near && able ? 3 : 1.5;
      const x = toX(rotor + (last ? 1 : -1) * (this.margin - 0.35));
      c.beginPath();
      c.moveTo(x, middle - 26);
      c.lineTo(x, middle + 26);
      c.moveTo(x, middle - 26);
      c.lineTo(x + (last ? -7 : 7), middle - 26);
      c.moveTo(x, middle + 26);
      c.lineTo(x + (last ? -7 : 7), middle + 26);
      c.stroke();
    });
    if (this.pull) {
      c.strokeStyle = look.purple;
      c.fillStyle = look.purple;
      c.lineWidth = 4;
      arrow(c, this.pull.x, this.pull.y, this.pull.toX, this.pull.toY);
      c.font = 'bold 16px system-ui, sans-serif';
      c.fillText(`${finite(this.pull.speed, 1)} rad/s`,
        clampText(c, this.pull.toX + 12, canvas, 100), this.pull.toY - 14);
    }
  }

  drawScale(c, look) {
    const { canvas } = this;
    c.fillStyle = look.soft;
    c.font = '14px system-ui, "DejaVu Sans", sans-serif';
    c.textAlign = 'center';
    ticks(Math.max(0, this.first), Math.min(this.known - 1, this.last), canvas.width / 90)
      .filter(Number.isInteger)
      .forEach((n) => {
        const x = ((n - this.first) / (this.last - this.first)) * canvas.width;
        const half = c.measureText(n).width / 2 + 1;
        c.fillText(n, Math.max(half, Math.min(canvas.width - half, x)), canvas.height - 9);
      });
    c.textAlign = 'left';
  }

  note() {
    const { frame } = this;
    if (!frame || !frame.rotors) return '';
    const parts = [`${frame.rotors} rotors`];
    if (this.chain.motion) parts.unshift(this.chain.motion);
    if (Number.isFinite(frame.rotor)) {
      const deviation = frame.position_deviation / (this.chain.spacing || 1);
      parts.push(`soliton at rotor ${finite(frame.rotor)} ± ${finite(deviation, 3)}`);
      parts.push(`${finite(frame.velocity / (this.chain.spacing || 1), 1)} rotors/s`);
    }
    if (frame.extensions.length) parts.push(`springs ±${scaled(this.stretch, 'm')}`);
    if (!this.chain.spacing) parts.push('no chain: its scale, springs and zero mode are unknown');
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
      this.pointers.set(event.pointerId, { x, y, from: [x, y] });
      this.began = { x, first: this.first, last: this.last, moved: 0 };
      if (this.pointers.size === 1) this.pull = this.grab(x, y);
    });
    element.addEventListener('pointermove', (event) => {
      const pointer = this.pointers.get(event.pointerId);
      if (!pointer) return;
      const [x, y] = at(event);
      if (this.pointers.size === 2) this.pinch(event.pointerId, x);
      else if (this.pull) this.stretchPull(x, y);
      else {
        this.began.moved = Math.max(this.began.moved, Math.abs(x - this.began.x));
        if (this.began.moved > STILL) {
          const shift = ((this.began.x - x) / this.canvas.width) * (this.began.last - this.began.first);
          this.move(this.began.first + shift, this.began.last + shift);
        }
      }
      Object.assign(pointer, { x, y });
    });
    const end = (event) => {
      const alone = this.pointers.size === 1;
      if (!this.pointers.delete(event.pointerId)) return;
      const { pull } = this;
      this.pull = null;
      if (event.type === 'pointercancel' || !alone) return;
      if (pull && pull.far > STILL) {
        if (pull.speed) this.act('nudge', { speed: pull.speed, edge: pull.edge });
      } else if (this.began.moved <= STILL) this.carry(this.rotorAt(at(event)[0]));
    };
    element.addEventListener('pointerup', end);
    element.addEventListener('pointercancel', end);
    element.addEventListener('dblclick', (event) => event.preventDefault());
    element.addEventListener('keydown', (event) => this.key(event));
  }

  carry(rotor) {
    const place = Math.max(0, Math.min(this.known - 1, rotor));
    this.act('move', { rotor: Math.round(place * 100) / 100 });
  }

  key(event) {
    const span = this.last - this.first;
    const step = event.shiftKey ? 10 : 1;
    const from = Number.isFinite(this.mark) ? this.mark : Math.round(this.frame?.rotor || 0);
    const keys = {
      ArrowLeft: () => { this.mark = Math.max(0, from - step); },
      ArrowRight: () => { this.mark = Math.min(this.known - 1, from + step); },
      Enter: () => { if (Number.isFinite(this.mark)) this.carry(this.mark); },
      Escape: () => { this.mark = NaN; },
      '+': () => this.zoom(1 / 1.3, this.mark),
      '-': () => this.zoom(1.3, this.mark),
      0: () => this.all(),
      PageUp: () => this.move(this.first - span / 2, this.last - span / 2),
      PageDown: () => this.move(this.first + span / 2, this.last + span / 2),
      ' ': () => this.act('pause', { paused: !this.chain.paused }),
      n: () => this.act('nudge', { speed: this.strength(), edge: 'nearest' }),
    };
    if (keys[event.key] && this.frame) {
      event.preventDefault();
      keys[event.key]();
    }
  }

  // The edge rotor under the pointer, where its mass can be pulled.
  grab(x, y) {
    const { frame } = this;
    if (!frame.mode.length) return null;
    const points = this.places();
    let best = null;
    [0, this.known - 1].forEach((rotor) => {
      const point = points[rotor - frame.first];
      if (!point || !Number.isFinite(point[1])) return;
      const far = Math.hypot(point[1] - x, point[2] - y);
      if (far < NEAR && (!best || far < best.near)) {
        const i = rotor - frame.first;
        best = {
          near: far, edge: rotor ? 'last' : 'first', x: point[1], y: point[2], toX: x, toY: y,
          length: point[3], angle: frame.angles[i], sign: Math.sign(frame.mode[i]) || 1, speed: 0,
          far: 0,
        };
      }
    });
    return best;
  }

  // The speed grows with the pull along the way that the mass can go.
  stretchPull(x, y) {
    const { pull } = this;
    const along = (x - pull.x) * Math.cos(pull.angle) + (y - pull.y) * Math.sin(pull.angle);
    const share = along / Math.max(pull.length, 20);
    Object.assign(pull, { toX: x, toY: y });
    pull.far = Math.max(pull.far, Math.hypot(x - pull.x, y - pull.y));
    const speed = Math.abs(this.strength()) * Math.max(-5, Math.min(5, share)) * pull.sign;
    pull.speed = Math.round(10 * speed) / 10;
  }

  pinch(moving, x) {
    const pair = [...this.pointers.entries()];
    const other = pair.find(([id]) => id !== moving)[1];
    const before = Math.abs(this.pointers.get(moving).x - other.x);
    const now = Math.abs(x - other.x);
    if (before > 8 && now > 8) this.zoom(before / now, this.rotorAt((x + other.x) / 2));
    this.pull = null;
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

function clampText(c, x, canvas, width) {
  return x + width > canvas.width ? x - width - 22 : x;
}
