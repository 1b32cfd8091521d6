// SPDX-License-Identifier: Apache-2.0
// Display of the answers to actions of this page. An answer is pending, successful or rejected.

import { setLine } from './drawing.js';

const PATIENCE = 2; // seconds after which a missing answer is reported
const SHOWN = { true: 6, false: 20 }; // display time of a success and of a rejection [s]
const LONG = { Record: 'starting the recorder; this takes a few seconds' };
const NAMES = { move: 'Move', nudge: 'Nudge', pull: 'Pull', seek: 'Seek', pause: 'Pause' };

export class Answers {
  // succeeded(name) is called after a successful action.
  constructor(succeeded) {
    this.succeeded = succeeded;
    this.log = []; // texts of the last answers
    this.last = null; // the action that changed last
    this.count = 0;
  }

  // Registers an action of a canvas and returns the number of the action.
  begin(name) {
    this.count += 1;
    this.show({ id: this.count, name: NAMES[name] || name, good: null, long: name === 'pull' });
    return this.count;
  }

  // Starts the time limit for the answer. Call this when a long action, such as a pull, ends.
  expect() {
    if (this.last) Object.assign(this.last, { long: false, since: performance.now() });
  }

  // Shows the state of an action; `good` is null while the answer is pending. The time limit for
  // answers does not apply to a long action.
  show({ id, name, answer, good, long }) {
    if (good && (name || this.last)) this.succeeded(name || this.last.name);
    if (good !== null) this.log = [...this.log, answer].slice(-20);
    // The answer to an older action does not hide a newer pending action.
    const waits = this.last && this.last.good === null && good !== null && id !== this.last.id;
    if (waits) return;
    if (good !== null && !answer) this.last = null;
    else this.last = { id, name: name || (this.last && this.last.name), answer, good, long, since: performance.now() };
    this.refresh();
  }

  get text() {
    const { last } = this;
    if (!last) return '';
    const seconds = (performance.now() - last.since) / 1000;
    if (last.good === null) {
      if (last.long) return `… ${last.name}: ${LONG[last.name] || 'under way'}`;
      return seconds < PATIENCE ? `… ${last.name}: waiting for the answer` : `▲ ${last.name}: no answer within ${PATIENCE} s, still waiting`;
    }
    if (seconds > SHOWN[last.good]) return '';
    const name = last.name ? `${last.name}: ` : '';
    return last.good ? `✓ ${name}${last.answer}` : `✗ ${name}${last.answer}`;
  }

  refresh() {
    const { text } = this;
    document.querySelectorAll('.live-answer').forEach((line) => {
      setLine(line, text);
      line.dataset.state = text ? text[0] : '';
    });
  }
}
