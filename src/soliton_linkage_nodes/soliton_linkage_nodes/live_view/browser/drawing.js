// SPDX-License-Identifier: Apache-2.0
// Canvas at the resolution of the screen, the colours of the figures, and axes.

// Colours of the figures (palette.py).
export const COLOURS = {
  grey: '#7f7f7f', blue: '#0072b2', sky: '#56b4e9', red: '#d55e00', green: '#009e73', purple: '#cc79a7',
};
// Colour map PuOr of the figures: orange for rotors that lean left, purple for right.
const LEAN = ['#7f3b08', '#b35806', '#e08214', '#fdb863', '#fee0b6', '#f7f7f7', '#d8daeb',
  '#b2abd2', '#8073ac', '#542788', '#2d004b']
  .map((hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16)));
const LEVELS = 256;
const TABLE = Array.from({ length: LEVELS }, (_, level) => {
  const at = (level / (LEVELS - 1)) * (LEAN.length - 1);
  const low = Math.min(Math.floor(at), LEAN.length - 2);
  return LEAN[low].map((c, i) => Math.round(c + (LEAN[low + 1][i] - c) * (at - low)));
});
const PACKED = Uint32Array.from(TABLE, ([r, g, b]) => (255 << 24) | (b << 16) | (g << 8) | r);

function level(share) {
  return Math.max(0, Math.min(LEVELS - 1, Math.round((share + 1) * 0.5 * (LEVELS - 1))));
}

// Colour of a relative lean from -1 to 1: as the bytes of a pixel, and as a text for a canvas.
export const leanPixel = (share) => (Number.isNaN(share) ? 0 : PACKED[level(share)]);
export const leanColour = (share) => `rgb(${TABLE[level(share)].join(',')})`;

// Pairs of a lean relative to the lean at rest, and its relative colour (as in palette.py). The
// lean at rest has the relative colour REST in all chains. The colours change fast near this lean,
// so that small oscillations are visible.
export const REST = 0.6;
const NEAR_REST = [[0.95, 0.48], [1.0, REST], [1.02, 0.72], [1.05, 0.82], [1.2, 0.92]];

// Returns the function that maps a lean [m] to a relative colour from -1 to 1. The arguments are
// the lean at rest and the largest lean [m].
export function leanScale(rest, largest) {
  const near = NEAR_REST.filter(([lean]) => lean * rest < 0.99 * largest)
    .map(([lean, share]) => [lean * rest, share]);
  const stops = [[0, 0], ...near, [largest, 1]];
  return (lean) => {
    const size = Math.abs(lean);
    const n = stops.findIndex(([stop]) => size <= stop);
    if (n <= 0) return n ? Math.sign(lean) : 0;
    const [[from, low], [to, high]] = [stops[n - 1], stops[n]];
    return Math.sign(lean) * (low + ((high - low) * (size - from)) / (to - from));
  };
}

export function theme() {
  const style = getComputedStyle(document.body);
  const dark = document.body.classList.contains('body--dark');
  const get = (name) => style.getPropertyValue(name).trim();
  return {
    dark, ink: get('--ink'), soft: get('--soft'), line: get('--line'), panel: get('--panel'),
    ...COLOURS,
    // On a black background, only the dark blue is replaced, because its contrast is too low.
    blue: dark ? COLOURS.sky : COLOURS.blue,
  };
}

export function finite(value, digits = 2) {
  if (!Number.isFinite(value)) return '–';
  return `${value.toFixed(digits).replace(/^-(0\.?0*)$/, '$1').replace('-', '−')}`;
}

// Returns a site and its standard deviation [rotor spacings].
export function uncertain(site, deviation) {
  return `${finite(site)} ± ${deviation < 1e-3 ? '<0.001' : finite(deviation, 3)}`;
}

// Returns a number and its unit with an SI prefix, such as 1.20 mJ.
export function scaled(value, unit) {
  if (!Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  const steps = [[1, ''], [1e-3, 'm'], [1e-6, 'µ'], [1e-9, 'n'], [1e-12, 'p']];
  // Smaller values are rounding errors.
  if (size < 1e-12) return `0 ${unit}`;
  const [factor, prefix] = steps.find(([f]) => size >= f);
  return `${(value / factor).toPrecision(3)} ${prefix}${unit}`;
}

export class Canvas {
  constructor(element) {
    this.element = element;
    this.context = element.getContext('2d');
    this.width = 0;
    this.height = 0;
    this.fit();
    new ResizeObserver(() => this.fit()).observe(element);
  }

  fit() {
    const { width, height } = this.element.getBoundingClientRect();
    const ratio = window.devicePixelRatio || 1;
    if (!width || (width === this.width && height === this.height && ratio === this.ratio)) return;
    Object.assign(this, { width, height, ratio });
    this.element.width = Math.round(width * ratio);
    this.element.height = Math.round(height * ratio);
    this.cleared = true;
  }

  begin() {
    const { context: c, ratio } = this;
    this.cleared = false;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, this.width, this.height);
    c.font = '14px system-ui, "DejaVu Sans", sans-serif';
    c.lineWidth = 1;
    c.setLineDash([]);
    c.globalAlpha = 1;
    c.textAlign = 'left';
    c.textBaseline = 'middle';
    return c;
  }

  // Shows the reason why the plot is empty.
  showReason(look, reason) {
    const c = this.begin();
    c.fillStyle = look.soft;
    c.textAlign = 'center';
    const lines = [''];
    reason.split(' ').forEach((word) => {
      const longer = `${lines[lines.length - 1]} ${word}`.trim();
      if (c.measureText(longer).width > this.width - 24) lines.push(word);
      else lines[lines.length - 1] = longer;
    });
    lines.forEach((line, n) => {
      c.fillText(line, this.width / 2, this.height / 2 + 20 * (n - (lines.length - 1) / 2));
    });
  }
}

// Returns about `wanted` round numbers between `low` and `high`.
export function ticks(low, high, wanted) {
  const rough = (high - low) / Math.max(wanted, 1);
  if (!(rough > 0) || !Number.isFinite(rough)) return [];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((s) => s >= rough);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n += 1) {
    found.push(Number((n * step).toPrecision(12)));
  }
  return found;
}

// Draws a frame with ticks; returns the functions from values to pixels.
export function axes(canvas, look, { x, y, xLabel, yLabel, left = 62, right = 10, yFormat = String }) {
  const c = canvas.context;
  const [top, bottom] = [8, 26];
  const w = canvas.width - left - right;
  const h = canvas.height - top - bottom;
  const toX = (value) => left + ((value - x[0]) / (x[1] - x[0])) * w;
  const toY = (value) => top + h - ((value - y[0]) / (y[1] - y[0])) * h;
  c.strokeStyle = look.line;
  c.fillStyle = look.soft;
  c.textAlign = 'right';
  ticks(y[0], y[1], h / 30).forEach((value) => {
    c.beginPath();
    c.moveTo(left, toY(value));
    c.lineTo(left + w, toY(value));
    c.stroke();
    c.fillText(yFormat(value), left - 6, toY(value));
  });
  c.textAlign = 'center';
  ticks(x[0], x[1], w / 80).forEach((value) => {
    if (toX(value) > left + w - 64) return;
    c.fillText(String(value), toX(value), top + h + 15);
  });
  c.textAlign = 'right';
  c.fillText(xLabel, left + w, top + h + 15);
  c.save();
  c.translate(10, top + h / 2);
  c.rotate(-Math.PI / 2);
  c.textAlign = 'center';
  c.fillText(yLabel, 0, 0);
  c.restore();
  c.strokeRect(left, top, w, h);
  return { toX, toY, left, top, w, h };
}

// Draws inside the box of some axes only.
export function clipped(c, { left, top, w, h }, paint) {
  c.save();
  c.beginPath();
  c.rect(left, top, w, h);
  c.clip();
  paint();
  c.restore();
}

// Draws the track of a soliton in a kymograph.
export function trackLine(c, points) {
  line(c, points, '#ffffff', 5);
  line(c, points, '#000000', 2.2);
}

// Returns the unit for some series of energies [J], its power of ten and the top of the axis. The
// axis ends at 1.15 times the largest value, or at 1.15 times `least` [J] if that is larger.
export function energyScale(allSeries, least) {
  let largest = least;
  allSeries.forEach((series) => series.forEach((value) => { if (value > largest) largest = value; }));
  largest *= 1.15;
  const power = Math.min(0, 3 * Math.floor(Math.log10(largest) / 3));
  const unit = { 0: 'J', '-3': 'mJ', '-6': 'µJ', '-9': 'nJ', '-12': 'pJ' }[power] || 'J';
  return { unit, power, top: largest / 10 ** power };
}

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// Sets a text in a line of constant height, which may cut the text. The tooltip is the whole text.
export function setLine(element, text) {
  setText(element, text);
  if (element.title !== text) element.title = text;
}

export function line(c, points, colour, width = 2) {
  c.strokeStyle = colour;
  c.lineWidth = width;
  c.lineJoin = 'round';
  c.beginPath();
  let pen = false;
  points.forEach(([px, py]) => {
    if (!Number.isFinite(py)) { pen = false; return; }
    if (pen) c.lineTo(px, py); else c.moveTo(px, py);
    pen = true;
  });
  c.stroke();
}
