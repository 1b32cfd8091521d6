// SPDX-License-Identifier: Apache-2.0
// Plots beside the chain: lean, kymograph, cycle, energies, topology and the time line.

import { triangle } from './chain.js';
import {
  Canvas, REST, axes, clipped, energyScale, finite, leanColour, leanPixel, line, theme, trackLine, uncertain,
} from './drawing.js';
import { SPAN, Track, solitonsOf } from './frames.js';

const NO_STATE = 'no recent soliton_state; start soliton_analyser if it does not run';
const NO_RECORDED_STATE = 'no soliton_state in the replay at this time';
const NO_JOINTS = 'waiting for joint_states';
const [LEFT, RIGHT] = [62, 10]; // margins of the time line [pixels]
const SMALL = '14px system-ui, sans-serif';

// Returns whether the analyser published until the time of the frame, and no other node mixes its
// messages with those of the chain.
function analysed(frame, { conflict }) { return frame.state_age - frame.age < 2 && !conflict; }

// Returns the reason why no state is drawn, or ''.
function noState(frame, chain) {
  if (analysed(frame, chain)) return '';
  return chain.conflict || (chain.status && chain.status.replay ? NO_RECORDED_STATE : NO_STATE);
}

// A subclass draws with paint(), unless reason() returns why the plot is empty.
class Plot {
  constructor(element) { this.canvas = new Canvas(element); }

  draw(frame, chain, track) {
    const look = theme();
    const reason = this.reason(frame, chain, track);
    if (reason) this.canvas.showReason(look, reason);
    else this.paint(this.canvas.begin(), look, frame, chain, track);
  }
}

export class LeanPlot extends Plot {
  reason(frame, { conflict }) {
    return conflict || (frame.rotors && frame.overview.length ? '' : NO_JOINTS);
  }

  paint(c, look, frame, chain) {
    const n = frame.overview.length;
    const largest = chain.rest_lean ? Math.max(1.3 * chain.rest_lean, 1.05 * chain.longest_rotor) : 1.1;
    const unit = chain.rest_lean ? 1e3 : 1;
    const { toX, toY, top, h } = axes(this.canvas, look, {
      x: [-0.5, frame.rotors - 0.5], y: [-largest * unit, largest * unit], xLabel: 'rotor n', yLabel: chain.rest_lean ? 'u [mm]' : 'sin φ',
    });
    c.fillStyle = look.red;
    if (analysed(frame, chain)) {
      solitonsOf(frame).forEach(([rotor, deviation]) => {
        const half = chain.spacing ? (2 * deviation) / chain.spacing : 0;
        c.globalAlpha = 0.25;
        c.fillRect(toX(rotor - half), top, Math.max(toX(rotor + half) - toX(rotor - half), 4), h);
        c.globalAlpha = 1;
        c.fillRect(toX(rotor) - 1, top, 2, h);
      });
    }
    const grouped = n !== frame.rotors;
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

  title(chain) { return chain.rest_lean ? 'Lean u of each rotor [mm]' : 'Lean of each rotor, sin φ'; }

  note(frame, chain) {
    if (!analysed(frame, chain)) return frame.rotors && !chain.conflict ? 'no soliton_state' : '';
    if (!(frame.walls > 0)) return 'no soliton';
    return `soliton at ${uncertain(frame.rotor, frame.position_deviation / (chain.spacing || 1))}`;
  }
}

export class Kymograph extends Plot {
  constructor(element) {
    super(element);
    this.buffer = document.createElement('canvas');
  }

  // Draws new columns into the ring buffer.
  fill(track, lean) {
    const { buffer } = this;
    const context = buffer.getContext('2d', { willReadFrequently: false });
    if (track.whole || buffer.height !== track.height || this.track !== track || this.lean !== lean) {
      buffer.width = Track.columns;
      buffer.height = Math.max(track.height, 1);
      track.written = Array.from({ length: Track.columns }, (_, n) => track.newest - n);
      track.whole = false;
      Object.assign(this, { track, lean });
    }
    const written = new Set(track.written.map((n) => track.at(n)));
    track.written = [];
    if (!Number.isFinite(track.newest) || !track.height) return;
    const column = context.createImageData(1, track.height);
    const pixels = new Uint32Array(column.data.buffer);
    written.forEach((at) => {
      for (let i = 0; i < track.height; i += 1) {
        pixels[track.height - 1 - i] = leanPixel(lean(track.image[at * track.height + i]));
      }
      context.putImageData(column, at, 0);
    });
  }

  reason(frame, { conflict, lean }, track) {
    this.fill(track, lean);
    return conflict || (track.height && Number.isFinite(track.newest) ? '' : NO_JOINTS);
  }

  paint(c, look, frame, chain, track) {
    const box = axes(this.canvas, look, {
      x: [-SPAN, 0], y: [-0.5, frame.rotors - 0.5], xLabel: 'time [s]', yLabel: 'rotor n',
      yFormat: (n) => (Number.isInteger(n) ? String(n) : ''),
    });
    const { toX, toY, left, top, w, h } = box;
    const newest = track.at(track.newest) + 1;
    const older = Track.columns - newest;
    const middle = (w * older) / Track.columns;
    c.imageSmoothingEnabled = false;
    if (older) c.drawImage(this.buffer, newest, 0, older, track.height, left, top, middle, h);
    c.drawImage(this.buffer, 0, 0, newest, track.height, left + middle, top, w - middle, h);
    clipped(c, box, () => trackLine(c, track.points(track.positions, toX, toY)));
  }

  note(frame, chain) {
    const largest = chain.longest_rotor ? `${(1e3 * chain.longest_rotor).toFixed(0)} mm` : '1';
    return `orange left, purple right, ±${largest}`;
  }
}

export class Dial extends Plot {
  reason(frame, chain) { return noState(frame, chain); }

  paint(c, look, frame, chain) {
    const { canvas } = this;
    const legs = chain.motion === 'spinner' ? 2 : 4;
    const radius = Math.max(30, Math.min(canvas.width / 2 - 62, canvas.height / 2 - 14));
    const [x, y] = [canvas.width / 2, canvas.height / 2];
    const angle = (phase) => phase - Math.PI / 2;
    const roomy = radius > 45; // whether the word fits below the number
    c.lineWidth = Math.min(16, radius / 3);
    c.textAlign = 'center';
    for (let n = 0; n < legs; n += 1) {
      const present = n === frame.leg;
      const from = angle((2 * Math.PI * n) / legs) + 0.03;
      c.strokeStyle = present ? look.blue : look.line;
      c.beginPath();
      c.arc(x, y, radius, from, from + (2 * Math.PI) / legs - 0.06);
      c.stroke();
      const middle = angle((2 * Math.PI * (n + 0.5)) / legs);
      c.fillStyle = present ? look.ink : look.soft;
      c.font = present ? 'bold 15px system-ui, sans-serif' : SMALL;
      c.fillText(`leg ${n}`, x + (radius + 36) * Math.cos(middle), y + (radius + 22) * Math.sin(middle));
    }
    c.fillStyle = look.ink;
    if (Number.isFinite(frame.phase)) {
      const [cos, sin] = [Math.cos(angle(frame.phase)), Math.sin(angle(frame.phase))];
      const ends = [roomy ? Math.max(0.45 * radius, 32) : 0.45 * radius, radius + 8].map((r) => [x + r * cos, y + r * sin]);
      line(c, ends, look.ink, 4);
    }
    c.font = `bold ${Math.round(Math.min(26, radius / 2))}px system-ui, sans-serif`;
    c.fillText(Number.isFinite(frame.phase) ? finite(frame.completed, 0) : '–', x, roomy ? y - 8 : y);
    if (!roomy) return;
    c.font = SMALL;
    c.fillStyle = look.soft;
    c.fillText(frame.completed === 1 ? 'cycle' : 'cycles', x, y + 14);
  }

  note(frame, chain) {
    if (!analysed(frame, chain)) return '';
    if (!Number.isFinite(frame.phase)) return 'the phase is unknown';
    return `phase ${finite(frame.phase / Math.PI)} π, ${finite(frame.phase_rate)} rad/s`;
  }
}

export class EnergyPlot extends Plot {
  reason(frame, { conflict, spacing }) {
    return conflict || (spacing ? '' : 'energies are unknown: no node publishes the topic chain');
  }

  paint(c, look, frame, chain, track) {
    const scale = energyScale(track.energies, 1e-9);
    Object.assign(this, scale);
    const { unit, power, top } = scale;
    const box = axes(this.canvas, look, {
      x: [-SPAN, 0], y: [0, top], xLabel: 'time [s]', yLabel: `E [${unit}]`,
    });
    const { toX, toY } = box;
    const colours = [look.blue, look.red, look.ink, look.purple];
    // Noise can make estimates of small energies negative. The legend is in plots.html.
    clipped(c, { ...box, h: box.h + 2 }, () => track.energies.forEach((series, i) => {
      const points = track.points(series, toX, (value) => toY(value / 10 ** power));
      c.setLineDash(i > 1 ? [3, 3] : []);
      line(c, points, colours[i], 2);
      // A thin line across each gap shows that the curve continues.
      c.setLineDash([]);
      c.globalAlpha = 0.4;
      if (i < 2) line(c, points.filter(([, y]) => Number.isFinite(y)), colours[i], 1);
      c.globalAlpha = 1;
    }));
  }

  title(chain) { return this.unit && chain.spacing ? `Energy [${this.unit}]` : 'Energy'; }

  note(frame, { conflict }) {
    if (conflict) return '';
    // Noise can make the estimate slightly negative.
    const sum = Math.max(0, frame.kinetic + frame.elastic);
    if (!Number.isFinite(sum) || !this.unit) return '';
    // The unit is that of the axis. Much smaller values are rounding errors.
    const shown = sum / 10 ** this.power;
    return `total ${shown < 1e-3 ? 0 : shown.toPrecision(3)} ${this.unit}`;
  }
}

export class TopologyPlot extends Plot {
  reason(frame, chain) { return noState(frame, chain); }

  paint(c, look, frame) {
    const { canvas } = this;
    const left = 20;
    const w = canvas.width - 40;
    const [top, h] = [canvas.height / 2 - 24, 34];
    const toX = (rotor) => left + ((rotor + 0.5) / frame.rotors) * w;
    const solitons = solitonsOf(frame);
    const ends = [left, ...solitons.map(([rotor]) => toX(rotor)), left + w];
    for (let n = 0; n + 1 < ends.length; n += 1) {
      const winding = n === 0 ? frame.winding_before
        : n + 2 === ends.length ? frame.winding_beyond : (solitons[n - 1][2] > 0 ? 1 : 0);
      // Rotors lean left where the winding number is 1, and right where it is 0.
      c.fillStyle = leanColour(winding ? -REST : REST);
      c.fillRect(ends[n], top, Math.max(ends[n + 1] - ends[n], 0), h);
    }
    c.strokeStyle = look.ink;
    c.lineWidth = 1.5;
    c.strokeRect(left, top, w, h);
    c.textAlign = 'center';
    c.lineWidth = 2;
    solitons.forEach(([rotor, , charge]) => {
      c.fillStyle = look.panel;
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
      triangle(c, x, top + h + 4, 9, 16);
      c.font = SMALL;
      c.fillText('zero mode', Math.max(54, Math.min(canvas.width - 54, x)), top + h + 33);
    }
    c.fillStyle = look.ink;
    c.font = '15px system-ui, sans-serif';
    c.textAlign = 'left';
    c.fillText(`winding number ν = ${finite(frame.winding_before, 0)}`, left, top - 16);
    c.textAlign = 'right';
    c.fillText(`ν = ${finite(frame.winding_beyond, 0)}`, left + w, top - 16);
  }

  note(frame, chain) {
    if (!analysed(frame, chain)) return '';
    // The charge of the whole chain is 0 up to one rotor before the soliton is at the edge.
    const charge = solitonsOf(frame).reduce((sum, soliton) => sum + soliton[2], 0 * frame.charge);
    return `charge ${finite(charge, 0)}, zero mode at ${finite(frame.zero_mode_rotor)}`;
  }
}

// Time line of a replay: the track of the soliton in the bag, and the present time.
export class TimeLine {
  constructor(element, seek) {
    this.canvas = new Canvas(element);
    this.track = [];
    element.addEventListener('pointerdown', (event) => {
      if (!this.replay) return;
      const box = element.getBoundingClientRect();
      const part = (event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
      seek(Math.max(0, Math.min(1, part)) * this.replay.duration);
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
    const { canvas, canvas: { element } } = this;
    const look = theme();
    const c = canvas.begin();
    const { toX, toY: at, top, h } = axes(canvas, look, {
      x: [0, Math.max(replay.duration, 1e-9)], y: [0, Math.max(rotors - 1, 1)], xLabel: 'time [s]', yLabel: 'rotor', left: LEFT, right: RIGHT,
    });
    const toY = (rotor) => (rotor === null ? NaN : at(rotor));
    element.setAttribute('aria-valuemax', replay.duration.toFixed(1));
    element.setAttribute('aria-valuenow', (replay.position || 0).toFixed(1));
    line(c, this.track.map(([t, rotor]) => [toX(t), toY(rotor)]), look.red, 2);
    c.fillStyle = look.soft;
    c.textAlign = 'center';
    if (!this.track.length) c.fillText('the bag contains no soliton_state', canvas.width / 2, canvas.height / 2 - 9);
    if (Number.isFinite(replay.position)) {
      c.fillStyle = look.ink;
      c.fillRect(toX(replay.position) - 1.5, top, 3, h);
    }
  }
}
