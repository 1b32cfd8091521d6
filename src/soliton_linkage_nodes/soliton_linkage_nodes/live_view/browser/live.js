// SPDX-License-Identifier: Apache-2.0
// Receives the stream of the page, draws each frame and shows the age of the frame.

import { Answers } from './answers.js';
import { CameraPanel } from './camera.js';
import { ChainView } from './chain.js';
import { leanScale, setLine, setText } from './drawing.js';
import { Guide } from './guide.js';
import { placeHelps } from './help.js';
import { Layout, Track, readCamera, readHistory } from './frames.js';
import { download, picture } from './picture.js';
import { Dial, EnergyPlot, Kymograph, LeanPlot, TimeLine, TopologyPlot } from './plots.js';

const SILENCE = 1; // seconds without a message after which the page warns
const ALL = '*';
const LATE = 0.05; // share of missed deadlines above which the header is amber
const LATE_MEANING = 'share of the frames of the last 10 s that were published after their time, because the computer is busy';
const START = 10e3; // time after the loading of the page in which nothing needs to arrive [ms]
const CHANGED = 10e3; // display time of a message that the chain has changed [ms]
const END = 0.2; // last part of a replay that counts as its end [s]
const MOVES = 0.5; // speed of a soliton above which it is not at rest [rotor spacings/s]
const element = (id) => document.getElementById(`live-${id}`);

class Live {
  constructor() {
    this.chains = [];
    this.status = { chains: [], failures: [], replay: null };
    this.watched = null;
    this.tracks = new Map();
    this.frames = new Map(); // newest frame and its arrival time, by the index of the chain
    this.pending = new Map();
    this.nudgeSpeed = 10;
    this.drawn = 0;
    this.unacknowledged = 0; // number of frames that arrived and are not drawn yet
    this.costs = []; // drawing time of each of the last frames [ms]
    this.received = 0; // time of the last message
    this.changed = 0; // time until which the page reports that the chain has changed
    this.guide = new Guide(element('guide'), {
      Nudge: () => this.act('nudge', { speed: this.nudgeSpeed, edge: 'nearest' }),
      Move: () => this.act('move', { rotor: Math.floor(this.view.known / 2) }),
      Record: () => [...document.querySelectorAll('.q-tab')].find((tab) => tab.textContent === 'Bags').click(),
    });
    this.answers = new Answers((name) => this.guide.finish(name));
    this.view = new ChainView(element('chain'), {
      act: (name, more) => this.act(name, more),
      send: (message) => {
        if (message.pull === null) this.answers.expect();
        this.send(message);
      },
      window: (first, last) => this.send({ window: [first, last] }),
      nudgeSpeed: () => this.nudgeSpeed,
    });
    this.plots = {
      lean: new LeanPlot(element('lean')),
      kymograph: new Kymograph(element('kymograph')),
      dial: new Dial(element('dial')),
      energy: new EnergyPlot(element('energy')),
      topology: new TopologyPlot(element('topology')),
    };
    this.time = new TimeLine(element('time'), (at) => this.act('seek', { at }));
    this.camera = new CameraPanel(element('camera-figure'), {
      request: (camera) => this.send({ camera }), shown: () => this.send('seen'), silence: SILENCE,
    });
    placeHelps();
    this.tiles = new Map();
    this.turn = 0;
    this.connect();
    const loop = () => { this.paint(); requestAnimationFrame(loop); };
    requestAnimationFrame(loop);
    setInterval(() => this.refresh(), 100);
  }

  connect() {
    const address = new URL('/stream', window.location.href);
    address.protocol = address.protocol.replace('http', 'ws');
    const socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      if (this.watched) this.send({ watch: this.watched });
      if (this.view.known) this.view.sendWindow();
      this.send({ camera: this.camera.wanted });
    };
    socket.onmessage = ({ data }) => {
      this.received = performance.now();
      if (typeof data === 'string') this.readText(JSON.parse(data));
      else this.readBinary(data);
    };
    socket.onclose = () => setTimeout(() => this.connect(), 500);
    this.socket = socket;
  }

  send(message) {
    if (this.socket && this.socket.readyState === WebSocket.OPEN) {
      this.socket.send(typeof message === 'string' ? message : JSON.stringify(message));
    }
  }

  readText(message) {
    if (message.layout) this.layout = new Layout(message.layout);
    if (message.chains) this.readChains(message.chains.map(withScale));
    if (message.track) this.time.track = message.track;
    if (message.status) this.status = message.status;
    if ('answer' in message) this.answers.show(message);
    if (!this.watched && this.chains.length) this.watch(this.chains[0].name);
  }

  // Stores the constants of the chains. The history of a chain ends if the chain has changed.
  readChains(chains) {
    const before = this.chains.find(({ name }) => name === this.watched);
    const after = chains.find(({ name }) => name === this.watched);
    this.chains = chains;
    if (!before || !before.spacing || !after || JSON.stringify(outline(before)) === JSON.stringify(outline(after))) return;
    this.tracks.delete(after.name);
    this.changed = performance.now() + CHANGED;
  }

  readBinary(buffer) {
    const kind = this.layout.kind(buffer);
    if (kind === 'history') {
      const history = readHistory(buffer);
      // A frame that is not drawn yet is older than this history.
      this.pending.delete(history.chain);
      this.track(history.chain).load(history);
    } else if (kind === 'camera') {
      this.camera.show(readCamera(buffer));
    } else {
      const frame = this.layout.read(buffer);
      this.unacknowledged += 1;
      this.pending.set(frame.chain, frame);
    }
  }

  track(index) {
    const name = this.chains[index] ? this.chains[index].name : String(index);
    if (!this.tracks.has(name)) this.tracks.set(name, new Track(this.layout.energies));
    return this.tracks.get(name);
  }

  watch(name) {
    if (name === this.watched) return;
    this.watched = name;
    this.frames.clear();
    this.pending.clear();
    this.camera.clear();
    this.acknowledge();
    this.send({ watch: name });
    document.querySelector('.live-plots').classList.toggle('several', name === ALL);
    element('small').hidden = name !== ALL;
  }

  act(name, more) { this.send({ act: name, id: this.answers.begin(name), chain: this.watched, ...more }); }

  // Saves the last minute as one HTML file.
  async saveMinute() {
    const id = 'share';
    this.answers.show({ id, name: 'Save', good: null });
    const response = await fetch(`/share?chain=${encodeURIComponent(this.watched)}`);
    if (!response.ok) {
      this.answers.show({ id, name: 'Save', answer: (await response.text()).trim(), good: false });
      return;
    }
    const name = /filename="([^"]+)"/.exec(response.headers.get('content-disposition') || '')[1];
    download(await response.blob(), name);
    this.answers.show({ id, name: 'Save', answer: `the last minute is in ${name}`, good: true });
  }

  // Saves all visible plots as one picture.
  savePicture() {
    picture(document.querySelector('.live-plots')).toBlob((blob) => {
      const name = `soliton_${new Date().toISOString().slice(0, 19).replaceAll(':', '_')}.png`;
      download(blob, name);
      this.answers.show({ id: 'picture', name: 'Save', answer: `the view is in ${name}`, good: true });
    });
  }

  statusOf(name) { return this.status.chains.find((s) => s.name === name) || {}; }

  // Returns the constants and the status of a chain by its index.
  known(index) {
    const chain = this.chains[index] || withScale({ name: '' });
    const status = this.statusOf(chain.name);
    const able = status.reasons ? !status.reasons.drive : true;
    const paused = this.status.replay && status.replay ? this.status.replay.paused : status.health && status.health.paused;
    const conflict = (status.health && status.health.conflict) || '';
    return { ...chain, status, able, paused, conflict };
  }

  paint() {
    if (!this.pending.size) return;
    const begun = performance.now();
    this.pending.forEach((frame, index) => {
      this.frames.set(index, { frame, arrival: begun });
      this.track(index).add(frame);
      if (this.watched === ALL) this.drawTile(index, frame);
      else if (this.known(index).name === this.watched) this.drawChain(index, frame);
    });
    this.pending.clear();
    this.acknowledge();
    this.drawn += 1;
    this.costs.push(performance.now() - begun);
    if (this.costs.length > 600) this.costs.shift();
  }

  // Requests the next frames.
  acknowledge() {
    for (; this.unacknowledged; this.unacknowledged -= 1) this.send('drawn');
  }

  // Draws the chain and its lean in each frame. The slower plots take turns over three frames.
  drawChain(index, frame) {
    const chain = this.known(index);
    const track = this.track(index);
    this.shown = frame;
    this.view.show(frame, chain);
    this.view.followKey();
    this.view.draw();
    this.plots.lean.draw(frame, chain);
    this.turn = (this.turn + 1) % 3;
    const all = this.shownName !== chain.name || frame.age > 0.15;
    this.shownName = chain.name;
    const due = { kymograph: this.turn !== 2, dial: this.turn === 0, topology: this.turn === 1, energy: this.turn === 2 };
    Object.entries(due).forEach(([name, turn]) => {
      const plot = this.plots[name];
      if (all || turn || plot.canvas.cleared) plot.draw(frame, chain, track);
    });
  }

  drawTile(index, frame) {
    const chain = this.known(index);
    if (!this.tiles.has(chain.name)) this.tiles.set(chain.name, this.createTile(chain.name));
    const { tile, view } = this.tiles.get(chain.name);
    view.show(frame, chain);
    view.draw();
    const silent = frame.age > SILENCE;
    tile.classList.toggle('stopped', silent);
    setText(tile.querySelector('span'), silent ? `no joint_states for ${frame.age.toFixed(1)} s` : view.note());
  }

  createTile(name) {
    const tile = document.createElement('button');
    tile.className = 'live-figure live-tile';
    tile.innerHTML = '<figcaption><b></b><span></span></figcaption><canvas></canvas>';
    tile.addEventListener('click', () => window.emitEvent('live-chosen', name));
    tile.dataset.chain = name;
    setText(tile.querySelector('b'), name.replaceAll('/', ' ').trim() || 'chain');
    element('small').append(tile);
    const view = new ChainView(tile.querySelector('canvas'));
    view.canvas.element.style.pointerEvents = 'none';
    return { tile, view };
  }

  // Updates texts and warnings ten times a second.
  refresh() {
    this.answers.refresh();
    const index = this.chains.findIndex((chain) => chain.name === this.watched);
    const newest = this.frames.get(index);
    const age = newest ? newest.frame.age + (performance.now() - newest.arrival) / 1000 : 0;
    this.refreshHealth(age > SILENCE);
    this.refreshWarning(index, newest, age);
    this.camera.refresh(this.statusOf(this.watched).camera || '');
    if (!newest) return;
    const chain = this.known(index);
    const { frame } = newest;
    setLine(element('chain-note'), this.view.note());
    Object.entries(this.plots).forEach(([name, plot]) => {
      setLine(element(`${name}-note`), plot.note(frame, chain));
      if (plot.title) setText(element(`${name}-title`), plot.title(chain));
    });
    this.refreshMove(chain);
    this.guide.refresh(chain.able && !chain.status.replay, {
      moves: Math.abs(frame.velocity) > MOVES * (chain.spacing || 1),
      carried: Boolean(chain.status.move && chain.status.move.state),
    });
    this.refreshReplay(chain, frame);
  }

  refreshHealth(silent) {
    const { health, replay } = this.statusOf(this.watched);
    const parts = [];
    const add = (text, kind = '', title = '') => parts.push([text, kind, title]);
    if (health) {
      if (replay) add(`replay of ${this.status.replay ? this.status.replay.bag : 'a bag'}`, 'badge');
      else if (health.replay) add(`replay of ${health.replay}`, 'badge');
      if (health.rate && !silent) add(`${health.rate} frames/s`);
      if (health.factor && !silent) add(`${Number(health.factor).toFixed(2)} × real time`);
      if (health.late !== null && !silent) add(`${(100 * health.late).toFixed(0)} % late frames`, health.late > LATE ? 'late' : '', LATE_MEANING);
      if (health.lost) add(`${health.lost} lost messages`, 'warning');
    }
    if (this.status.recorder) add(`● recorder: ${this.status.recorder.message}`);
    const warnings = [...this.status.failures, ...(health ? [health.error, ...health.warnings] : [])].filter(Boolean);
    const key = JSON.stringify([parts, warnings]);
    if (key === this.healthKey) return;
    this.healthKey = key;
    const line = element('health');
    const buttons = line.querySelectorAll('button');
    line.querySelectorAll('span').forEach((part) => part.remove());
    line.prepend(...parts.map(([textContent, className, title]) => (
      Object.assign(document.createElement('span'), { textContent, className, title: title || textContent }))));
    // The header shows only one line. A button opens the complete texts. It is kept, because a new
    // element would lose a click.
    [warnings[0] || '', warnings.length > 1 ? `${warnings.length - 1} more` : ''].forEach((text, i) => {
      setText(buttons[i], text);
      buttons[i].title = warnings.join('\n');
      buttons[i].hidden = !text;
    });
    setText(element('warnings'), warnings.join('\n\n') || 'no warnings');
  }

  // Warns if the shown frame is so old that it does not show the present state.
  refreshWarning(index, newest, age) {
    const banner = element('stale');
    const silence = (performance.now() - this.received) / 1000;
    let text = '';
    let expected = false;
    if (silence > SILENCE) text = `no message from live_view for ${silence.toFixed(1)} s`;
    else if (this.watched !== ALL && newest) {
      const { paused, status, conflict } = this.known(index);
      const replay = status.replay && this.status.replay;
      const ended = replay && (replay.ended || replay.position > replay.duration - END);
      const opened = this.status.replay;
      if (conflict) text = conflict;
      else if (opened && !opened.ended && opened.position === null) {
        text = `starting the replay of ${opened.bag}`;
        expected = true;
      } else if (age === Infinity) {
        text = 'waiting for joint_states';
        expected = performance.now() < START;
      } else if (age > SILENCE) {
        expected = Boolean(paused || replay);
        text = ended ? 'end of the replay; End in the tab Bags returns to the live chain' : `no joint_states for ${age.toFixed(1)} s`;
        if (replay && !ended) text = `no joint_states in the replay for ${age.toFixed(1)} s: a gap in the bag, or a busy computer`;
        if (paused) text = replay ? 'paused' : `paused, ${text}`;
      } else if (performance.now() < this.changed) {
        text = `another chain is published now: ${this.chains[index].motion}, ${newest.frame.rotors} rotors`;
        expected = true;
      }
    }
    banner.hidden = !text;
    banner.classList.toggle('paused', expected);
    setLine(banner, text);
  }

  refreshMove({ status: { move } }) {
    const line = element('move');
    const key = move ? `${move.state}|${move.message}|${move.progress}` : '';
    if (line.dataset.key === key) return;
    line.dataset.key = key;
    if (!move || !move.state) { line.replaceChildren(); return; }
    if (move.state !== 'under way') { line.replaceChildren(`${move.state}: ${move.message}`); return; }
    const settles = move.progress > 0.99;
    const bar = Object.assign(document.createElement('progress'), { value: move.progress });
    bar.setAttribute('aria-label', 'completed fraction of the move');
    const client = move.foreign ? ', requested by another program ' : ' ';
    const goal = Number(move.goal).toFixed(2);
    line.replaceChildren(`moving the soliton to rotor ${goal}${client}`, bar, settles ? ' settling' : ` ${Math.floor(100 * move.progress)} %`);
  }

  refreshReplay(chain, frame) {
    const { replay } = this.status;
    const here = Boolean(replay && chain.status.replay);
    element('time-figure').hidden = !here;
    if (!here) return;
    this.time.canvas.fit();
    // The position in the status is older than the frame.
    const position = Number.isFinite(frame.bag_time) ? frame.bag_time : replay.position;
    this.time.draw({ ...replay, position }, frame.rotors);
    const state = replay.ended ? 'ended' : replay.paused ? 'paused' : `${replay.rate} × recorded speed`;
    setText(element('time-note'), `${replay.bag}, ${(position || 0).toFixed(1)} s of ${replay.duration.toFixed(1)} s, ${state}`);
  }
}

// Returns the constants that distinguish two chains. Motors and other small changes do not count.
function outline({ motion, spacing, rotors }) { return [motion, spacing, rotors]; }

// Adds the function that maps the lean of a rotor to a relative colour.
function withScale(chain) {
  return { ...chain, lean: leanScale(chain.rest_lean || NaN, chain.longest_rotor || 1) };
}

function begin() {
  if (!element('topology')) { requestAnimationFrame(begin); return; }
  window.live = new Live();
}

begin();
