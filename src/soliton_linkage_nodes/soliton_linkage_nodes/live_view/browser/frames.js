// SPDX-License-Identifier: Apache-2.0
// What comes as frame_layout.py packs it, and what is kept of the frames that were shown.

export const SPAN = 20; // seconds that the kymograph and the energies show
const COLUMNS = 600;
const STEP = SPAN / COLUMNS;
const LEFT_OUT = 24; // columns that are filled by what comes after them: 0.8 s

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

// The first column that a new one fills: those that were left out on the way to it look like it.
function after(before, number) {
  const gap = number - before;
  return gap > 0 && gap <= LEFT_OUT ? before + 1 : number;
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
    this.told = -Infinity; // number of the newest column of which a place is known
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
    this.put(frame.stamp, frame.overview);
    this.tell(frame.state_stamp, frame.rotor, this.series.map((name) => frame[name]));
  }

  put(stamp, column) {
    const number = Math.floor(stamp / STEP);
    let gap = number - this.newest;
    if (column.length !== this.height || gap < -1 || gap > COLUMNS) {
      this.reset(column.length);
      gap = Infinity;
    }
    if (gap < 0) return;
    for (let n = Math.max(this.newest + 1, number - COLUMNS + 1); n <= number; n += 1) this.clear(n);
    for (let n = after(this.newest, number); n <= number; n += 1) {
      this.image.set(column, this.at(n) * this.height);
      this.written.push(n);
    }
    this.newest = number;
  }

  // What the analyser tells stands where it belongs, which is a little before the newest column.
  tell(stamp, place, energies) {
    const number = Math.min(Math.floor(stamp / STEP), this.newest);
    if (!(number > this.newest - COLUMNS)) return;
    for (let n = after(this.told, number); n <= number; n += 1) {
      this.places[this.at(n)] = place;
      this.energies.forEach((series, i) => { series[this.at(n)] = energies[i]; });
    }
    this.told = number;
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
      const [stamp, told, place, ...energies] = numbers.subarray(n * count, (n + 1) * count);
      this.put(stamp, data.subarray(n * height, (n + 1) * height));
      this.tell(told, place, energies);
    }
  }
}
