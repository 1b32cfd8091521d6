// SPDX-License-Identifier: Apache-2.0
// Reader of the messages that frame_layout.py packs, and the recent history of each chain.

export const SPAN = 20; // seconds that the kymograph and the energies show
const COLUMNS = 600;
const STEP = SPAN / COLUMNS;
const LONGEST_GAP = 24; // longest gap that the next value fills [columns], 0.8 s

export class Layout {
  constructor(layout) { Object.assign(this, layout); }

  kind(buffer) { return this.kinds[new Float64Array(buffer, 0, 1)[0]]; }

  // Returns a frame as an object of its fields and arrays.
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

// Returns position [rotor spacings], standard deviation [m] and charge of each soliton.
export function solitonsOf(frame) {
  return Array.from({ length: Math.floor(frame.solitons.length / 3) }, (_, i) => (
    frame.solitons.subarray(3 * i, 3 * i + 3)));
}

export function readHistory(buffer) {
  const [chain, columns, height, count] = new Float64Array(buffer, 8, 4);
  const numbers = new Float64Array(buffer, 40, count * columns);
  const data = new Float32Array(buffer, 40 + 8 * numbers.length, columns * height);
  return { chain, columns, height, count, numbers, data };
}

export function readCamera(buffer) {
  const [, , age] = new Float64Array(buffer, 8, 3);
  return { age, jpeg: new Uint8Array(buffer, 32) };
}

// Returns the first column that a new value fills. The value also fills a short gap before it.
function firstFilled(newest, number) {
  const gap = number - newest;
  return gap > 0 && gap <= LONGEST_GAP ? newest + 1 : number;
}

// Ring buffer of columns, indexed by the stamps of frames. A column is a thirtieth of a second.
export class Track {
  constructor(series) {
    this.series = series;
    this.reset(0);
  }

  reset(height) {
    this.height = height;
    this.newest = -Infinity; // number of the newest column since the epoch
    this.newestState = -Infinity; // number of the newest column with a state
    this.image = new Float32Array(COLUMNS * height).fill(NaN);
    this.positions = new Float32Array(COLUMNS).fill(NaN);
    this.energies = this.series.map(() => new Float32Array(COLUMNS).fill(NaN));
    this.written = []; // columns that changed since they were last drawn
    this.whole = true;
  }

  static get columns() { return COLUMNS; }

  // Returns the index of a column in the ring.
  at(column) { return ((column % COLUMNS) + COLUMNS) % COLUMNS; }

  // Returns the pixels of a series.
  points(series, toX, toY) {
    return Array.from(series, (_, i) => {
      const n = COLUMNS - 1 - i;
      return [toX((-n * SPAN) / COLUMNS), toY(series[this.at(this.newest - n)])];
    });
  }

  add(frame) {
    if (!(frame.age < Infinity) || !frame.overview.length) return;
    this.addAngles(frame.stamp, frame.overview);
    this.addState(frame.state_stamp, frame.rotor, this.series.map((name) => frame[name]));
  }

  addAngles(stamp, column) {
    const number = Math.floor(stamp / STEP);
    let gap = number - this.newest;
    if (column.length !== this.height || gap < -1 || gap > COLUMNS) {
      this.reset(column.length);
      gap = Infinity;
    }
    if (gap < 0) return;
    for (let n = Math.max(this.newest + 1, number - COLUMNS + 1); n <= number; n += 1) this.clear(n);
    for (let n = firstFilled(this.newest, number); n <= number; n += 1) {
      this.image.set(column, this.at(n) * this.height);
      this.written.push(n);
    }
    this.newest = number;
  }

  // Stores a state in the column of its own stamp, slightly before the newest column.
  addState(stamp, position, energies) {
    const number = Math.min(Math.floor(stamp / STEP), this.newest);
    if (!(number > this.newest - COLUMNS)) return;
    const first = firstFilled(this.newestState, number);
    const before = first > this.newestState + 1 ? NaN : this.positions[this.at(first - 1)];
    for (let n = first; n <= number; n += 1) {
      // Interpolate linearly in a gap, because the soliton moves between two frames.
      const share = (n - first + 1) / (number - first + 1);
      const between = Number.isFinite(before) && n < number;
      this.positions[this.at(n)] = between ? before + share * (position - before) : position;
      this.energies.forEach((series, i) => { series[this.at(n)] = energies[i]; });
    }
    this.newestState = number;
  }

  clear(number) {
    const at = this.at(number);
    this.image.fill(NaN, at * this.height, (at + 1) * this.height);
    this.positions[at] = NaN;
    this.energies.forEach((series) => { series[at] = NaN; });
    this.written.push(number);
  }

  // Adds the columns of a history. Columns before the newest column replace the track.
  load({ columns, height, count, numbers, data }) {
    for (let n = 0; n < columns; n += 1) {
      const [stamp, stateStamp, position, ...energies] = numbers.subarray(n * count, (n + 1) * count);
      this.addAngles(stamp, data.subarray(n * height, (n + 1) * height));
      this.addState(stateStamp, position, energies);
    }
  }
}
