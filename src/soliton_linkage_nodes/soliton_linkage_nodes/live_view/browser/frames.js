// SPDX-License-Identifier: Apache-2.0
// What comes as frame_layout.py packs it, and what is kept of the frames that were shown.

export const SPAN = 20; // seconds that the kymograph and the energies show
const COLUMNS = 600;
const STEP = SPAN / COLUMNS;

export class Layout {
  constructor({ kinds, fields, arrays, energies }) {
    Object.assign(this, { kinds, fields, arrays, energies });
  }

  kind(buffer) {
    return this.kinds[new Float64Array(buffer, 0, 1)[0]];
  }

  // A frame as an object of its fields and arrays.
  read(buffer) {
    const names = this.fields.length;
    const values = new Float64Array(buffer, 8, names + this.arrays.length);
    const frame = {};
    this.fields.forEach((name, i) => { frame[name] = values[i]; });
    let begin = 8 + 8 * values.length;
    this.arrays.forEach((name, i) => {
      frame[name] = new Float32Array(buffer, begin, values[names + i]);
      begin += 4 * values[names + i];
    });
    return frame;
  }
}

export function readHistory(buffer) {
  const [chain, columns, height, count] = new Float64Array(buffer, 8, 4);
  const numbers = new Float64Array(buffer, 40, count * columns);
  const data = new Float32Array(buffer, 40 + 8 * numbers.length, columns * height);
  return { chain, columns, height, count, numbers, data };
}

export function readCamera(buffer) {
  const [chain, stamp, age] = new Float64Array(buffer, 8, 3);
  return { chain, stamp, age, jpeg: new Uint8Array(buffer, 32) };
}

// The last seconds of a chain by the stamps of its frames: one column a thirtieth of a second.
export class Track {
  constructor(series) {
    this.series = series;
    this.reset(0);
  }

  reset(height) {
    this.height = height;
    this.newest = -Infinity; // number of the newest column since the epoch
    this.image = new Float32Array(COLUMNS * height).fill(NaN);
    this.places = new Float32Array(COLUMNS).fill(NaN);
    this.energies = this.series.map(() => new Float32Array(COLUMNS).fill(NaN));
    this.written = []; // columns that were written since they were last drawn
    this.whole = true;
  }

  static get columns() { return COLUMNS; }

  // Place of a column in the rings.
  at(column) {
    return ((column % COLUMNS) + COLUMNS) % COLUMNS;
  }

  add(frame) {
    if (!(frame.age < Infinity) || !frame.overview.length) return;
    this.put(frame.stamp, frame.rotor, frame.overview, this.series.map((name) => frame[name]));
  }

  put(stamp, place, column, energies) {
    const number = Math.floor(stamp / STEP);
    let gap = number - this.newest;
    if (column.length !== this.height || gap < -1 || gap > COLUMNS) {
      this.reset(column.length);
      gap = Infinity;
    }
    if (gap < 0) return;
    const first = gap > 0 && gap <= 24 ? this.newest + 1 : number;
    for (let n = Math.max(this.newest + 1, number - COLUMNS + 1); n < first; n += 1) this.clear(n);
    for (let n = Math.min(first, number); n <= number; n += 1) {
      const at = this.at(n);
      this.image.set(column, at * this.height);
      this.places[at] = place;
      this.energies.forEach((series, i) => { series[at] = energies[i]; });
      this.written.push(n);
    }
    this.newest = number;
  }

  clear(number) {
    const at = this.at(number);
    this.image.fill(NaN, at * this.height, (at + 1) * this.height);
    this.places[at] = NaN;
    this.energies.forEach((series) => { series[at] = NaN; });
    this.written.push(number);
  }

  recall({ columns, height, count, numbers, data }) {
    this.reset(height);
    for (let n = 0; n < columns; n += 1) {
      const [stamp, place, ...energies] = numbers.subarray(n * count, (n + 1) * count);
      this.put(stamp, place, data.subarray(n * height, (n + 1) * height), energies);
    }
  }
}
