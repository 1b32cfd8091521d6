// SPDX-License-Identifier: Apache-2.0
// The plots beside the chain: lean, kymograph, cycle, energies, topology and the time line.

import { Canvas, REST, axes, finite, leanColour, leanPixel, line, scaled, theme, ticks } from './drawing.js';
import { SPAN, Track } from './frames.js';

const NO_STATE = 'no soliton_state: start soliton_analyser';

// Whether the analyser tells something of this frame.
function analysed(frame) {
  return frame.state_age < 2;
}

export class LeanPlot {
  constructor(element) { this.canvas = new Canvas(element); }

  draw(frame, chain) {
    const { canvas } = this;
    const look = theme();
    if (!frame.rotors || !frame.overview.length) { canvas.absent(look, 'no joint_states yet'); return; }
    const c = canvas.begin();
    const largest = chain.rest_lean ? Math.max(1.3 * chain.rest_lean, 1.05 * chain.longest_rotor) : 1.1;
    const unit = chain.rest_lean ? 1e3 : 1;
    const grouped = frame.overview.length !== frame.rotors;
    const frameOf = axes(canvas, look, {
      x: [-0.5, frame.rotors - 0.5], y: [-largest * unit, largest * unit],
      xLabel: 'rotor n',
    });
    const { toX, toY, top, h } = frameOf;
    for (let i = 0; analysed(frame) && i + 2 < frame.places.length; i += 3) {
      const [rotor, deviation] = frame.places.subarray(i, i + 2);
      const half = chain.spacing ? (2 * deviation) / chain.spacing : 0;
      c.fillStyle = look.red;
      c.globalAlpha = 0.25;
      c.fillRect(toX(rotor - half), top, Math.max(toX(rotor + half) - toX(rotor - half), 4), h);
      c.globalAlpha = 1;
      c.fillRect(toX(rotor) - 1, top, 2, h);
    }
    const n = frame.overview.length;
    const points = Array.from(frame.overview, (u, i) => [
      toX(grouped ? ((i + 0.5) / n) * frame.rotors : i), toY(u * unit)]);
    line(c, points, look.blue, n > 200 ? 1.5 : 2);
    if (n <= 120) {
      c.fillStyle = look.blue;
      c.beginPath();
      points.forEach(([x, y]) => { if (Number.isFinite(y)) { c.moveTo(x + 3.5, y); c.arc(x, y, 3.5, 0, 7); } });
      c.fill();
    }
  }

  title(chain) {
    return chain.rest_lean ? 'Lean u of each rotor [mm]' : 'Lean of each rotor, sin φ';
  }

  note(frame, chain) {
    if (!analysed(frame)) return frame.rotors ? 'no soliton_state' : '';
    if (!(frame.walls > 0)) return 'no wall';
    return `wall at ${finite(frame.rotor)}, band of ± ${finite((2 * frame.position_deviation) / (chain.spacing || 1), 3)}`;
  }
}

export class Kymograph {
  constructor(element) {
    this.canvas = new Canvas(element);
    this.buffer = document.createElement('canvas');
  }

  // Brings the columns that are new into the picture, which is a ring.
  paint(track, lean) {
    const { buffer } = this;
    const context = buffer.getContext('2d', { willReadFrequently: false });
    if (track.whole || buffer.height !== track.height || this.track !== track || this.lean !== lean) {
      buffer.width = Track.columns;
      buffer.height = Math.max(track.height, 1);
      track.written = [];
      for (let n = 0; n < Track.columns; n += 1) track.written.push(track.newest - n);
      track.whole = false;
      this.track = track;
      this.lean = lean;
    }
    if (!Number.isFinite(track.newest) || !track.height) { track.written = []; return; }
    const column = context.createImageData(1, track.height);
    const pixels = new Uint32Array(column.data.buffer);
    [...new Set(track.written.map((n) => track.at(n)))].forEach((at) => {
      for (let i = 0; i < track.height; i += 1) {
        pixels[track.height - 1 - i] = leanPixel(lean(track.image[at * track.height + i]));
      }
      context.putImageData(column, at, 0);
    });
    track.written = [];
  }

  draw(frame, chain, track) {
    const { canvas } = this;
    const look = theme();
    this.paint(track, chain.lean);
    if (!track.height || !Number.isFinite(track.newest)) { canvas.absent(look, 'no joint_states yet'); return; }
    const c = canvas.begin();
    const { toX, toY, left, top, w, h } = axes(canvas, look, {
      x: [-SPAN, 0], y: [-0.5, frame.rotors - 0.5], xLabel: 'time [s]',
      yFormat: (n) => (Number.isInteger(n) ? String(n) : ''),
    });
    const newest = track.at(track.newest) + 1;
    const older = Track.columns - newest;
    c.imageSmoothingEnabled = false;
    if (older) c.drawImage(this.buffer, newest, 0, older, track.height, left, top, (w * older) / Track.columns, h);
    c.drawImage(this.buffer, 0, 0, newest, track.height, left + (w * older) / Track.columns, top, (w * newest) / Track.columns, h);
    const points = [];
    for (let n = Track.columns - 1; n >= 0; n -= 1) {
      points.push([toX((-n * SPAN) / Track.columns), toY(track.places[track.at(track.newest - n)])]);
    }
    c.save();
    c.beginPath();
    c.rect(left, top, w, h);
    c.clip();
    line(c, points, '#ffffff', 5);
    line(c, points, '#000000', 2.2);
    c.restore();
  }

  note(frame, chain) {
    const mm = chain.longest_rotor ? `${(1e3 * chain.longest_rotor).toFixed(0)} mm` : '1';
    return `orange left, purple right, to ±${mm}`;
  }
}

export class Dial {
  constructor(element) { this.canvas = new Canvas(element); }

  draw(frame, chain) {
    const { canvas } = this;
    const look = theme();
    if (!analysed(frame)) { canvas.absent(look, NO_STATE); return; }
    const c = canvas.begin();
    const legs = chain.motion === 'spinner' ? 2 : 4;
    const radius = Math.max(30, Math.min(canvas.width / 2 - 62, canvas.height / 2 - 22));
    const [x, y] = [canvas.width / 2, canvas.height / 2];
    const angle = (phase) => phase - Math.PI / 2;
    const leg = frame.leg;
    c.lineWidth = 16;
    for (let n = 0; n < legs; n += 1) {
      const from = angle((2 * Math.PI * n) / legs) + 0.03;
      c.strokeStyle = n === leg ? look.blue : look.line;
      c.beginPath();
      c.arc(x, y, radius, from, from + (2 * Math.PI) / legs - 0.06);
      c.stroke();
      const middle = angle((2 * Math.PI * (n + 0.5)) / legs);
      c.fillStyle = n === leg ? look.ink : look.soft;
      c.font = n === leg ? 'bold 15px system-ui, sans-serif' : '14px system-ui, sans-serif';
      c.textAlign = 'center';
      c.fillText(`leg ${n}`, x + (radius + 36) * Math.cos(middle), y + (radius + 22) * Math.sin(middle));
    }
    c.textAlign = 'center';
    c.fillStyle = look.ink;
    if (Number.isFinite(frame.phase)) {
      c.strokeStyle = look.ink;
      c.lineWidth = 4;
      c.beginPath();
      c.moveTo(x + 0.45 * radius * Math.cos(angle(frame.phase)), y + 0.45 * radius * Math.sin(angle(frame.phase)));
      c.lineTo(x + (radius + 8) * Math.cos(angle(frame.phase)), y + (radius + 8) * Math.sin(angle(frame.phase)));
      c.stroke();
    }
    c.font = 'bold 26px system-ui, sans-serif';
    c.fillText(Number.isFinite(frame.phase) ? finite(frame.completed, 0) : '–', x, y - 8);
    c.font = '14px system-ui, sans-serif';
    c.fillStyle = look.soft;
    c.fillText(frame.completed === 1 ? 'cycle' : 'cycles', x, y + 14);
  }

  note(frame) {
    if (!analysed(frame)) return '';
    if (!Number.isFinite(frame.phase)) return 'not recognised on the cycle';
    const turns = frame.phase / Math.PI;
    return `phase ${finite(turns)} π, ${finite(frame.phase_rate)} rad/s`;
  }
}

const SMALL = '13px system-ui, "DejaVu Sans", sans-serif';
const NAMES = ['kinetic', 'elastic', 'at wall', 'in wake'];

export class EnergyPlot {
  constructor(element) { this.canvas = new Canvas(element); }

  draw(frame, chain, track) {
    const { canvas } = this;
    const look = theme();
    if (!chain.spacing) { canvas.absent(look, 'no chain: energies are unknown'); return; }
    const c = canvas.begin();
    let largest = 1e-9;
    track.energies.forEach((series) => series.forEach((value) => { if (value > largest) largest = value; }));
    largest *= 1.15;
    const power = Math.min(0, 3 * Math.floor(Math.log10(largest) / 3));
    const unit = { 0: 'J', '-3': 'mJ', '-6': 'µJ', '-9': 'nJ', '-12': 'pJ' }[power] || 'J';
    this.unit = unit;
    const rows = this.rows(c);
    const { toX, toY, left, top, w, h } = axes(canvas, look, {
      x: [-SPAN, 0], y: [0, largest / 10 ** power], xLabel: 'time [s]', bottom: 28 + 20 * rows.length,
    });
    const colours = [look.blue, look.red, look.ink, look.purple];
    // What noise makes of an energy near zero lies below it.
    c.save();
    c.beginPath();
    c.rect(left, top, w, h + 2);
    c.clip();
    track.energies.forEach((series, i) => {
      const points = [];
      for (let n = Track.columns - 1; n >= 0; n -= 1) {
        points.push([toX((-n * SPAN) / Track.columns), toY(series[track.at(track.newest - n)] / 10 ** power)]);
      }
      c.setLineDash(i > 1 ? [6, 3] : []);
      line(c, points, colours[i], 2);
    });
    c.restore();
    c.setLineDash([]);
    this.legend(c, look, colours, rows);
  }

  // Names of the legend with their widths, in one row or in as many as there have to be.
  rows(c) {
    c.save();
    c.font = SMALL;
    const wide = NAMES.map((name, i) => [name, i, c.measureText(name).width + 28]);
    c.restore();
    const fits = wide.reduce((sum, each) => sum + each[2], 0) <= this.canvas.width;
    return fits ? [wide] : [wide.slice(0, 2), wide.slice(2)];
  }

  legend(c, look, colours, rows) {
    const { canvas } = this;
    c.font = SMALL;
    c.textAlign = 'left';
    rows.forEach((row, number) => {
      const y = canvas.height - 10 - 20 * (rows.length - 1 - number);
      let x = Math.max(4, (canvas.width - row.reduce((sum, each) => sum + each[2], 0)) / 2);
      row.forEach(([name, i, width]) => {
        c.setLineDash(i > 1 ? [6, 3] : []);
        line(c, [[x, y], [x + 16, y]], colours[i], 3);
        c.fillStyle = look.ink;
        c.fillText(name, x + 20, y + 1);
        x += width;
      });
    });
    c.setLineDash([]);
  }

  title(chain) {
    return this.unit && chain.spacing ? `Energy [${this.unit}]` : 'Energy';
  }

  note(frame) {
    // An estimate from noisy readings may lie a little below zero.
    const sum = Math.max(0, frame.kinetic + frame.elastic);
    return Number.isFinite(sum) ? `${scaled(sum, 'J')} in all` : '';
  }
}

export class TopologyPlot {
  constructor(element) { this.canvas = new Canvas(element); }

  draw(frame) {
    const { canvas } = this;
    const look = theme();
    if (!analysed(frame)) { canvas.absent(look, NO_STATE); return; }
    const c = canvas.begin();
    const left = 20;
    const w = canvas.width - 40;
    const [top, h] = [canvas.height / 2 - 30, 34];
    const toX = (rotor) => left + ((rotor + 0.5) / frame.rotors) * w;
    const walls = [];
    for (let i = 0; i + 2 < frame.places.length; i += 3) walls.push(frame.places.subarray(i, i + 3));
    // A side that winds once leans left, one that does not leans right.
    const colour = (winding) => leanColour(winding ? -REST : REST);
    const ends = [left, ...walls.map(([rotor]) => toX(rotor)), left + w];
    for (let n = 0; n + 1 < ends.length; n += 1) {
      const winding = n === 0 ? frame.winding_before
        : n + 2 === ends.length ? frame.winding_beyond : (walls[n - 1][2] > 0 ? 1 : 0);
      c.fillStyle = colour(winding);
      c.fillRect(ends[n], top, Math.max(ends[n + 1] - ends[n], 0), h);
    }
    c.strokeStyle = look.ink;
    c.lineWidth = 1.5;
    c.strokeRect(left, top, w, h);
    c.textAlign = 'center';
    walls.forEach(([rotor, , charge]) => {
      c.fillStyle = look.panel;
      c.strokeStyle = look.ink;
      c.lineWidth = 2;
      c.beginPath();
      c.arc(toX(rotor), top + h / 2, 13, 0, 7);
      c.fill();
      c.stroke();
      c.fillStyle = look.ink;
      c.font = 'bold 18px system-ui, sans-serif';
      c.fillText(charge > 0 ? '+' : '−', toX(rotor), top + h / 2 + 1);
    });
    const x = toX(frame.zero_mode_rotor);
    if (Number.isFinite(x)) {
      c.fillStyle = look.green;
      c.beginPath();
      c.moveTo(x, top + h + 4);
      c.lineTo(x - 9, top + h + 20);
      c.lineTo(x + 9, top + h + 20);
      c.fill();
      c.font = '14px system-ui, sans-serif';
      c.fillText('zero mode', Math.max(54, Math.min(canvas.width - 54, x)), top + h + 33);
    }
    c.fillStyle = look.ink;
    c.font = '15px system-ui, sans-serif';
    c.textAlign = 'left';
    c.fillText(`ν = ${finite(frame.winding_before, 0)}`, left, top - 16);
    c.textAlign = 'right';
    c.fillText(`ν = ${finite(frame.winding_beyond, 0)}`, left + w, top - 16);
    c.fillStyle = look.soft;
    c.font = '14px system-ui, sans-serif';
    c.textAlign = 'left';
    c.fillText('purple leans right, orange left', left, canvas.height - 12);
  }

  note(frame) {
    if (!analysed(frame)) return '';
    return `charge ${finite(frame.charge, 0)}, zero mode at ${finite(frame.zero_mode_rotor, 1)}`;
  }
}

// The bag that is played: its soliton's track, and where it is.
export class TimeLine {
  constructor(element, seek) {
    this.canvas = new Canvas(element);
    this.track = [];
    element.addEventListener('pointerdown', (event) => {
      if (!this.replay) return;
      const box = element.getBoundingClientRect();
      const share = (event.clientX - box.left - 10) / (box.width - 20);
      seek(Math.max(0, Math.min(1, share)) * this.replay.duration);
    });
    element.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10 }[event.key];
      if (!step || !this.replay) return;
      event.preventDefault();
      const { duration, position } = this.replay;
      seek(Math.max(0, Math.min(duration, (position || 0) + (step * duration) / 50)));
    });
  }

  draw(replay, rotors) {
    this.replay = replay;
    if (!replay) return;
    const { canvas } = this;
    const look = theme();
    const c = canvas.begin();
    const w = canvas.width - 20;
    const h = canvas.height - 24;
    const toX = (time) => 10 + (time / Math.max(replay.duration, 1e-9)) * w;
    const element = canvas.element;
    element.setAttribute('aria-valuemax', replay.duration.toFixed(1));
    element.setAttribute('aria-valuenow', (replay.position || 0).toFixed(1));
    c.strokeStyle = look.line;
    c.strokeRect(10, 3, w, h);
    line(c, this.track.map(([t, n]) => [toX(t), n === null ? NaN : 3 + h - (n / Math.max(rotors - 1, 1)) * h]), look.red, 2);
    if (!this.track.length) {
      c.fillStyle = look.soft;
      c.textAlign = 'center';
      c.fillText('the bag holds no soliton_state', canvas.width / 2, 3 + h / 2);
    }
    c.fillStyle = look.soft;
    c.textAlign = 'center';
    ticks(0, replay.duration, w / 90).forEach((t) => {
      c.fillText(`${t} s`, Math.max(16, Math.min(canvas.width - 20, toX(t))), canvas.height - 9);
    });
    if (Number.isFinite(replay.position)) {
      c.fillStyle = look.ink;
      c.fillRect(toX(replay.position) - 1.5, 0, 3, h + 6);
    }
  }
}
