// SPDX-License-Identifier: Apache-2.0
// The stream of the page: draws what comes, and tells how it is.

import { CameraPanel } from './camera.js';
import { ChainView } from './chain.js';
import { leanScale } from './drawing.js';
import { Layout, Track, readCamera, readHistory } from './frames.js';
import { Dial, EnergyPlot, Kymograph, LeanPlot, TimeLine, TopologyPlot } from './plots.js';

const SILENCE = 1; // seconds without joint_states, or pictures of the camera, that are said
const ALL = '*';
const element = (id) => document.getElementById(`live-${id}`);

class Live {
  constructor() {
    this.chains = [];
    this.status = { chains: [], complaints: [], replay: null };
    this.watched = null;
    this.tracks = new Map();
    this.frames = new Map(); // newest frame of each chain by its number, and when it came
    this.pending = new Map();
    this.strength = 10;
    this.drawn = 0;
    this.owed = 0; // pictures that came and are not drawn yet
    this.cost = 0; // milliseconds that the last picture took
    this.costs = [];
    this.connected = 0;
    this.said = [];
    const act = (name, more) => this.act(name, more);
    this.view = new ChainView(element('chain'), {
      act, window: (first, last) => this.send({ window: [first, last] }), strength: () => this.strength,
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
      ask: (camera) => this.send({ camera }), drawn: () => this.send('seen'), silence: SILENCE,
    });
    this.tiles = new Map();
    this.turn = 0;
    this.connect();
    const loop = () => { this.paint(); requestAnimationFrame(loop); };
    requestAnimationFrame(loop);
    setInterval(() => this.tell(), 100);
  }

  connect() {
    const address = new URL('/stream', window.location.href);
    address.protocol = address.protocol.replace('http', 'ws');
    const socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      if (this.watched) this.send({ watch: this.watched });
      if (this.view.known) this.view.tell();
      this.send({ camera: this.camera.wanted });
    };
    socket.onmessage = ({ data }) => (typeof data === 'string' ? this.hear(JSON.parse(data)) : this.take(data));
    socket.onclose = () => setTimeout(() => this.connect(), 500);
    this.socket = socket;
  }

  send(message) {
    if (this.socket && this.socket.readyState === WebSocket.OPEN) {
      this.socket.send(typeof message === 'string' ? message : JSON.stringify(message));
    }
  }

  hear(message) {
    this.connected = performance.now();
    if (message.layout) this.layout = new Layout(message.layout);
    if (message.chains) this.chains = message.chains.map(scaleOf);
    if (message.track) this.time.track = message.track;
    if (message.status) this.status = message.status;
    if ('answer' in message) this.answer(message.answer, message.good);
    if (!this.watched && this.chains.length) this.watch(this.chains[0].name);
  }

  answer(text, good) {
    this.said.push(text);
    this.said = this.said.slice(-20);
    if (text && window.Quasar) {
      window.Quasar.Notify.create({ message: text, type: good ? 'positive' : 'negative', position: 'bottom-right', timeout: good ? 2000 : 6000 });
    }
  }

  take(buffer) {
    this.connected = performance.now();
    const kind = this.layout.kind(buffer);
    if (kind === 'history') {
      const history = readHistory(buffer);
      this.track(history.chain).recall(history);
    } else if (kind === 'camera') {
      this.camera.take(readCamera(buffer));
    } else {
      const frame = this.layout.read(buffer);
      this.owed += 1;
      this.pending.set(frame.chain, frame);
    }
  }

  track(number) {
    const name = this.chains[number] ? this.chains[number].name : String(number);
    if (!this.tracks.has(name)) this.tracks.set(name, new Track(this.layout.energies));
    return this.tracks.get(name);
  }

  watch(name) {
    if (name === this.watched) return;
    this.watched = name;
    this.frames.clear();
    this.pending.clear();
    this.camera.forget();
    this.acknowledge();
    this.send({ watch: name });
    document.querySelector('.live-plots').classList.toggle('several', name === ALL);
    element('small').hidden = name !== ALL;
  }

  act(name, more) {
    this.send({ act: name, chain: this.watched, ...more });
  }

  // What is known of a chain by its number: how it is made and how it is doing.
  known(number) {
    const chain = this.chains[number] || scaleOf({ name: '' });
    const status = this.status.chains.find((s) => s.name === chain.name) || {};
    const able = status.reasons ? !status.reasons.drive : true;
    return { ...chain, status, able, paused: this.status.replay && status.replay ? this.status.replay.paused : status.health && status.health.paused };
  }

  paint() {
    if (!this.pending.size) return;
    const begun = performance.now();
    this.pending.forEach((frame, number) => {
      this.frames.set(number, { frame, came: begun });
      this.track(number).add(frame);
      if (this.watched === ALL) this.tile(number, frame);
      else if (this.known(number).name === this.watched) this.single(number, frame);
    });
    this.pending.clear();
    this.acknowledge();
    this.drawn += 1;
    this.cost = performance.now() - begun;
    this.costs.push(this.cost);
    if (this.costs.length > 600) this.costs.shift();
  }

  // The next pictures come when those before are dealt with.
  acknowledge() {
    for (; this.owed; this.owed -= 1) this.send('drawn');
  }

  // The chain with each picture; what is slower to read, in turn.
  single(number, frame) {
    const chain = this.known(number);
    const track = this.track(number);
    this.shown = frame;
    this.view.show(frame, chain);
    this.view.draw();
    this.plots.lean.draw(frame, chain);
    this.turn = (this.turn + 1) % 3;
    const all = this.seen !== chain.name || frame.age > 0.15;
    this.seen = chain.name;
    const due = { kymograph: this.turn !== 2, dial: this.turn === 0, topology: this.turn === 1, energy: this.turn === 2 };
    Object.entries(due).forEach(([name, turn]) => {
      const plot = this.plots[name];
      if (all || turn || plot.canvas.cleared) plot.draw(frame, chain, track);
    });
  }

  tile(number, frame) {
    const chain = this.known(number);
    if (!this.tiles.has(chain.name)) {
      const tile = document.createElement('button');
      tile.className = 'live-figure live-tile';
      tile.innerHTML = '<figcaption><b></b><span></span></figcaption><canvas></canvas>';
      tile.addEventListener('click', () => window.emitEvent('live-chosen', chain.name));
      element('small').append(tile);
      const view = new ChainView(tile.querySelector('canvas'), { act: () => {}, window: () => {}, strength: () => 0 });
      view.listen = () => {};
      view.canvas.element.style.pointerEvents = 'none';
      this.tiles.set(chain.name, { tile, view });
    }
    const { tile, view } = this.tiles.get(chain.name);
    view.show(frame, chain);
    view.draw();
    tile.dataset.chain = chain.name;
    setText(tile.querySelector('b'), chain.name.replaceAll('/', ' ').trim() || 'chain');
    const stale = frame.age > SILENCE;
    tile.classList.toggle('stopped', stale);
    const stopped = `no joint_states since ${frame.age.toFixed(1)} s`;
    setText(tile.querySelector('span'), stale ? stopped : view.note());
  }

  // Ten times a second: words, and whether what is seen is still alive.
  tell() {
    this.tellHealth();
    this.tellStale();
    const watched = this.status.chains.find((s) => s.name === this.watched);
    this.camera.tell(watched ? watched.camera : '');
    const number = this.chains.findIndex((chain) => chain.name === this.watched);
    const newest = this.frames.get(number);
    if (!newest) return;
    const chain = this.known(number);
    const { frame } = newest;
    setText(element('chain-note'), this.view.note());
    ['lean', 'kymograph', 'dial', 'energy', 'topology'].forEach((name) => {
      setText(element(`${name}-note`), this.plots[name].note(frame, chain));
    });
    ['lean', 'energy'].forEach((name) => setText(element(`${name}-title`), this.plots[name].title(chain)));
    this.tellMove(chain);
    this.tellReplay(chain, frame);
  }

  tellHealth() {
    const status = this.status.chains.find((s) => s.name === this.watched);
    const parts = [];
    const add = (text, kind = '') => parts.push([text, kind]);
    const health = status && status.health;
    if (health) {
      if (status.replay) add(`replay of ${this.status.replay ? this.status.replay.bag : 'a bag'}`, 'badge');
      else if (health.replay) add(`replay of ${health.replay}`, 'badge');
      if (health.rate) add(`${health.rate} Hz`);
      if (health.factor) add(`${Number(health.factor).toFixed(2)} × real time`);
      if (health.missed !== '') add(`${health.missed} deadlines missed`);
      if (health.lost !== null) add(`${health.lost} messages lost`, health.lost ? 'warning' : '');
      if (health.complaint) add(health.complaint, 'warning');
      health.warnings.forEach((warning) => add(warning, 'warning'));
    }
    const { recorder, complaints } = this.status;
    if (recorder) add(`● recorder: ${recorder.message}`);
    (complaints || []).forEach((complaint) => add(complaint, 'warning'));
    const key = JSON.stringify(parts);
    if (key === this.healthKey) return;
    this.healthKey = key;
    element('health').replaceChildren(...parts.map(([text, kind]) => {
      const span = document.createElement('span');
      span.textContent = text;
      span.className = kind;
      return span;
    }));
  }

  tellStale() {
    const place = element('stale');
    const silent = (performance.now() - this.connected) / 1000;
    let text = '';
    let paused = false;
    const number = this.chains.findIndex((chain) => chain.name === this.watched);
    const newest = this.frames.get(number);
    if (silent > SILENCE) text = `no answer from live_view since ${silent.toFixed(1)} s`;
    else if (this.watched !== ALL && newest) {
      const age = newest.frame.age + (performance.now() - newest.came) / 1000;
      const chain = this.known(number);
      if (age === Infinity) text = 'no joint_states yet';
      else if (age > SILENCE) {
        paused = Boolean(chain.paused);
        const ended = chain.status.replay && this.status.replay && this.status.replay.ended;
        text = ended ? 'the replay is at its end' : `no joint_states since ${age.toFixed(1)} s`;
        paused = paused || ended;
        if (chain.paused) text = `paused, ${text}`;
      }
    }
    place.hidden = !text;
    place.classList.toggle('paused', paused);
    setText(place, text);
  }

  tellMove(chain) {
    const { move } = chain.status;
    const place = element('move');
    if (!move || !move.state) { setText(place, ''); return; }
    const under = move.state === 'under way';
    const key = `${move.state}|${move.message}|${move.progress}`;
    if (place.dataset.key === key) return;
    place.dataset.key = key;
    place.replaceChildren();
    const whose = move.elsewhere ? ', as asked for elsewhere ' : ' ';
    place.append(under ? `carrying to rotor ${Number(move.goal).toFixed(2)}${whose}` : `${move.state}: ${move.message}`);
    if (under) {
      const bar = document.createElement('progress');
      bar.value = move.progress;
      bar.setAttribute('aria-label', 'way done');
      place.append(bar, ` ${Math.round(100 * move.progress)} %`);
    }
  }

  tellReplay(chain, frame) {
    const { replay } = this.status;
    const here = Boolean(replay && chain.status.replay);
    element('time-figure').hidden = !here;
    if (!here) return;
    this.time.canvas.fit();
    this.time.draw(replay, frame.rotors);
    const state = replay.ended ? 'at its end' : replay.paused ? 'paused' : `${replay.rate} × as fast as recorded`;
    setText(element('time-note'), `of ${replay.bag}, ${(replay.position || 0).toFixed(1)} s of ${replay.duration.toFixed(1)} s, ${state}`);
  }
}

// A chain with the function that gives the leans of its rotors their colours.
function scaleOf(chain) {
  return { ...chain, lean: leanScale(chain.rest_lean || NaN, chain.longest_rotor || 1) };
}

function setText(place, text) {
  if (place.textContent !== text) place.textContent = text;
}

function begin() {
  if (!element('topology')) { requestAnimationFrame(begin); return; }
  window.live = new Live();
}

begin();
