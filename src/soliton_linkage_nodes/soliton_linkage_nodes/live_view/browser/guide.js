// SPDX-License-Identifier: Apache-2.0
// First steps for a new user. One sentence and one button are shown at a time, until the user
// has completed or closed all steps.

import { setText } from './drawing.js';

const KEY = 'soliton-linkage-first-steps';
// A successful action completes the step of the same name.
const STEPS = [
  ['Nudge', 'Nudge the edge to send a soliton.', 'Nudge'],
  ['Move', 'Click on the chain to move the soliton there.', 'Move it to the middle'],
  ['Pull', 'Drag a rotor, or press ↑ or ↓ on the chain, to pull it.', ''],
  ['Record', 'Record the chain: press Record, later Stop, then Play beside the bag.', 'Open Bags'],
];

export class Guide {
  // acts[name]() performs the action of the button in the step `name`.
  constructor(element, acts) {
    this.element = element;
    [this.text, this.button, this.next, this.close] = element.children;
    this.done = new Set(this.stored());
    this.button.addEventListener('click', () => acts[this.step[0]]());
    this.next.addEventListener('click', () => this.finish(this.step[0]));
    this.close.addEventListener('click', () => STEPS.forEach(([name]) => this.finish(name)));
  }

  // Returns the step after the last completed step.
  get step() { return STEPS[STEPS.findLastIndex(([name]) => this.done.has(name)) + 1]; }

  finish(name) {
    if (this.done.has(name)) return;
    this.done.add(name);
    try { localStorage.setItem(KEY, JSON.stringify([...this.done])); } catch { /* not remembered */ }
  }

  stored() {
    try { return JSON.parse(localStorage.getItem(KEY)) || []; } catch { return []; }
  }

  // Shows the current step if the chain can be driven. A soliton that moves, and a move that any
  // program requested, complete their steps too.
  refresh(able, { moves, carried }) {
    if (moves) this.finish('Nudge');
    if (carried) this.finish('Move');
    const { step } = this;
    this.element.hidden = !step || !able;
    if (this.element.hidden) return;
    setText(this.text, `${STEPS.indexOf(step) + 1}/${STEPS.length} ${step[1]}`);
    setText(this.button, step[2]);
    this.button.hidden = !step[2];
  }
}
