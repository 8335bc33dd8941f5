// SPDX-License-Identifier: Apache-2.0
// The player: what its buttons and keys do, and what stands around the picture. `window.nearmesh` is for tests and scripts.
'use strict';

const kSpeeds = [0.1, 0.25, 0.5, 1, 2, 4, 8];

function metresText(metres) {
  if (!Number.isFinite(metres)) return 'without bound';
  if (metres === 0) return '0 m';
  const size = Math.abs(metres);
  return size >= 1000 ? (metres / 1000).toPrecision(3) + ' km' : size >= 1 ? metres.toPrecision(3) + ' m'
      : size >= 0.01 ? (100 * metres).toPrecision(3) + ' cm' : (1000 * metres).toPrecision(3) + ' mm';
}

class Player {
  constructor(root, facts) {
    this.root = root;
    this.facts = facts;
    this.film = new Film();
    this.time = 0;
    this.playing = false;
    this.speed = 1;
    this.peers = [];
    this.options = {colour: 'error', edges: true, boxes: false, halfSpaces: false, asked: true, trails: true, pair: null, follow: null,
                    moving: new Set(), scale: [0.01, 100]};
    this.find = name => root.querySelector(`[data-is="${name}"]`);
    this.loaded = new Set();
    this.dirty = true;
  }

  name(id) {
    const isAlone = [...this.film.peers.keys()].every(other => other === id || !other.startsWith(id.slice(0, 8)));
    return this.facts.names[id] || (isAlone ? id.slice(0, 8) : id);
  }

  /** For sentences. */
  called(id) { return (this.facts.names[id] ? '' : 'peer ') + this.name(id); }

  async begin() {
    await this.load('models', bytes => this.film.takeModels(bytes));
    await this.load('world', bytes => this.film.takeWorld(bytes));
    for (const id of this.facts.peers) {
      await this.load('answers-' + id, bytes => this.film.peer(id).takeAnswers(bytes));
      await this.load('bus-' + id, bytes => this.film.peer(id).takeBus(bytes));
    }
    this.view = new View(this.find('view'), this.film, () => { this.dirty = true; });
    this.lanes = new Lanes(this.find('lanes'), this.film, time => this.seek(time), id => this.choose([id, ...this.peers.slice(1)]));
    this.connect();
    if (!this.facts.live) await this.open();
    const loop = now => {
      this.tick(now);
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }
  /** The first sight of what is there. */
  async open() {
    this.refresh();
    const first = this.choosePair();
    if (first.peer === undefined) return;
    await this.choose([first.peer]);
    this.followPair(first.pair);
    if (!this.facts.live) this.seek(first.time);
  }
  /** A stream of the page, unpacked when it is needed. */
  async load(name, take) {
    if (this.loaded.has(name)) return;
    this.loaded.add(name);
    const element = document.getElementById('film-' + name);
    if (!element) return;
    const text = atob(element.textContent), packed = new Uint8Array(text.length);
    for (let i = 0; i < text.length; ++i) packed[i] = text.charCodeAt(i);
    element.remove();
    const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
    take(new Uint8Array(await new Response(unpacked).arrayBuffer()));
  }
  /** What follows from what was read so far. */
  refresh() {
    const {film, options} = this;
    options.moving = new Set(film.bodies.map((_, i) => i).filter(i => film.moves(i)));
    const eps = [];
    for (const model of film.models) for (const node of model.nodes) if (node.eps > 0) eps.push(node.eps);
    eps.sort((a, b) => a - b);
    if (eps.length > 0) options.scale = [eps[Math.floor(eps.length * 0.05)], eps[Math.floor(eps.length * 0.995)]];
    this.find('least').textContent = metresText(options.scale[0]);
    this.find('most').textContent = metresText(options.scale[1]);
    this.fill('peer', [...film.peers.keys()].map(id => [id, this.called(id)]));
    this.fill('other', [['', 'alone'], ...[...film.peers.keys()].map(id => [id, 'beside ' + this.called(id)])]);
    this.fill('follow', [['', 'nothing'], ...film.bodies.map((body, i) => [String(i), body.name])]);
  }
  fill(name, entries) {
    const list = this.find(name), key = JSON.stringify(entries);
    if (list.dataset.key === key) return;
    const value = list.value;
    list.dataset.key = key;
    list.replaceChildren(...entries.map(([id, text]) => new Option(text, id)));
    if (entries.some(([id]) => id === value)) list.value = value;
  }
  /** Of a pair: its first contact; null where there is none. */
  firstContact(pair) {
    const i = pair.answers.findIndex(answer => answer.facePairs > 0);
    return i < 0 ? null : pair.times.data[i];
  }
  /** What is worth seeing first: something that touches what stands; else what touches; else what is not certain. */
  choosePair() {
    const {film, options} = this;
    let best = null;
    for (const peer of film.peers.values())
      for (const pair of peer.pairs) {
        const contact = this.firstContact(pair), stands = !options.moving.has(pair.a) || !options.moving.has(pair.b);
        const uncertain = pair.answers.findIndex(answer => !isCertified(answer.status));
        const rank = contact !== null ? (stands ? 0 : 1) : uncertain >= 0 ? 2 : 3;
        const time = contact !== null ? contact : uncertain >= 0 ? pair.times.data[uncertain] : film.end / 2;
        if (!best || rank < best.rank || (rank === best.rank && time < best.time)) best = {rank, time, pair, peer: peer.id};
      }
    return best || {time: 0, pair: null, peer: [...film.peers.keys()][0]};
  }
  /** The smaller of the bodies of a pair that move. */
  followPair(pair) {
    const sizes = (pair ? [pair.a, pair.b] : []).filter(body => this.options.moving.has(body) && this.film.bodies[body].model >= 0)
        .map(body => [this.sizeOf(this.film.models[this.film.bodies[body].model]), body]).sort((x, y) => x[0] - y[0]);
    if (sizes.length === 0) { this.wholeScene(); return; }
    [[this.view.orbit.distance, this.options.follow]] = sizes;
    this.view.orbit.distance *= 6;
    this.find('follow').value = String(this.options.follow);
  }
  sizeOf(model) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (let i = 0; i < model.places.length; ++i) {
      low[i % 3] = Math.min(low[i % 3], model.places.data[i]);
      high[i % 3] = Math.max(high[i % 3], model.places.data[i]);
    }
    return Math.max(1e-6, ...low.map((x, k) => high[k] - x).filter(Number.isFinite));
  }
  wholeScene() {
    const sizes = this.film.models.filter(Boolean).map(model => this.sizeOf(model));
    this.options.follow = null;
    this.find('follow').value = '';
    this.view.orbit.distance = 1.3 * Math.max(1e-3, ...sizes);
    const places = [...(this.view.panes[0].places || new Map()).values()];
    const largest = places.reduce((best, place) => !best || place.radius > best.radius ? place : best, null);
    if (largest) this.view.orbit.target.copy(largest.middle);
    this.dirty = true;
  }

  async choose(ids) {
    ids = ids.filter((id, i) => id && ids.indexOf(id) === i).slice(0, 2);
    for (const id of ids) await this.load('mesh-' + id, bytes => this.film.peer(id).takeMesh(bytes));
    this.peers = ids;
    this.options.pair = null;
    this.find('peer').value = ids[0] || '';
    this.find('other').value = ids[1] || '';
    this.dirty = true;
  }
  seek(time) {
    if (this.live) this.live.follows = false;
    this.time = Math.min(Math.max(time, 0), this.film.end);
    this.dirty = true;
  }
  step(frames) {
    const peer = this.film.peers.get(this.peers[0]);
    if (!peer) return;
    const {times} = peer.frames, frame = Math.min(Math.max(peer.frameAt(this.time) + frames, 0), times.length - 1);
    this.playing = false;
    if (frame >= 0) this.seek(times.data[frame]);
  }
  play(on = !this.playing) {
    if (this.live && on) { this.live.follows = true; return; }
    if (this.live) this.live.follows = false;
    if (on && this.time >= this.film.end) this.seek(0);
    this.playing = on;
    this.dirty = true;
  }
  jump(to) {
    const peer = this.film.peers.get(this.peers[0]);
    if (!peer) return;
    const time = to === 'uncertain' ? peer.first(answer => !isCertified(answer.status))
        : to === 'contact' ? peer.first(answer => answer.facePairs > 0) : peer.largestFrame()[0];
    this.playing = false;
    this.say('');
    if (time === null) this.say(`There is no such frame of ${this.called(peer.id)}.`);
    else this.seek(time);
  }
  say(text) { this.find('note').textContent = text; }

  connect() {
    const click = (name, act) => this.find(name).addEventListener('click', act);
    click('play', () => this.play());
    click('back', () => this.step(-1));
    click('next', () => this.step(1));
    click('uncertain', () => this.jump('uncertain'));
    click('contact', () => this.jump('contact'));
    click('largest', () => this.jump('largest'));
    click('whole', () => this.wholeScene());
    this.find('scrub').addEventListener('input', event => this.seek(event.target.value * this.film.end / 1000));
    this.find('peer').addEventListener('change', event => this.choose([event.target.value, this.find('other').value]));
    this.find('other').addEventListener('change', event => this.choose([this.peers[0], event.target.value]));
    this.find('follow').addEventListener('change', event => {
      this.options.follow = event.target.value === '' ? null : Number(event.target.value);
      this.dirty = true;
    });
    this.find('colour').addEventListener('change', event => { this.options.colour = event.target.value; this.dirty = true; });
    this.find('speed').replaceChildren(...kSpeeds.map(x => new Option('\u00d7' + x, x, x === 1, x === 1)));
    this.find('speed').addEventListener('change', event => { this.speed = Number(event.target.value); });
    for (const name of ['edges', 'boxes', 'halfSpaces', 'asked', 'trails']) {
      this.find(name).checked = this.options[name];
      this.find(name).addEventListener('change', event => { this.options[name] = event.target.checked; this.dirty = true; });
    }
    document.addEventListener('keydown', event => this.press(event));
    window.addEventListener('resize', () => { this.dirty = true; });
  }
  press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || /^(SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    const toggle = name => { this.find(name).click(); };
    const keys = {
      ' ': () => this.play(), ArrowRight: () => event.shiftKey ? this.seek(this.time + 1000) : this.step(1),
      ArrowLeft: () => event.shiftKey ? this.seek(this.time - 1000) : this.step(-1), Home: () => this.seek(0),
      End: () => { this.seek(this.film.end); if (this.live) this.live.follows = true; }, u: () => this.jump('uncertain'), c: () => this.jump('contact'), l: () => this.jump('largest'),
      w: () => this.wholeScene(), e: () => toggle('edges'), b: () => toggle('boxes'), h: () => toggle('halfSpaces'),
      r: () => toggle('asked'), t: () => toggle('trails'), p: () => this.nextPeer(), f: () => this.nextFollowed(),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }
  nextPeer() {
    const ids = [...this.film.peers.keys()];
    this.choose([ids[(ids.indexOf(this.peers[0]) + 1) % ids.length], this.peers[1]]);
  }
  nextFollowed() {
    const list = [...this.options.moving], next = list[(list.indexOf(this.options.follow) + 1) % list.length];
    if (next === undefined) return;
    this.options.follow = next;
    this.find('follow').value = String(next);
    this.dirty = true;
  }

  tick(now) {
    if (this.live) this.live.tick(now - (this.lastTick || now));
    if (this.playing && this.lastTick !== undefined) {
      this.time = Math.min(this.time + (now - this.lastTick) * this.speed, this.film.end);
      if (this.time >= this.film.end && !this.facts.live) this.playing = false;
      this.dirty = true;
    }
    this.lastTick = now;
    if (this.dirty) this.draw();
  }
  draw() {
    const peers = this.peers.map(id => this.film.peers.get(id));
    this.dirty = false;
    if (peers.length === 0 || this.view.findCentre(peers[0], this.time) === null) return;
    this.view.show(peers, this.time, this.options);
    this.view.draw();
    this.lanes.draw(this.time, this.peers, id => this.name(id));
    this.find('play').textContent = this.playing || (this.live && this.live.follows) ? '\u275a\u275a' : '\u25b6';
    this.find('scrub').value = 1000 * this.time / (this.film.end || 1);
    this.tell(peers);
    this.labels();
  }
  /** What is in the picture, in words; as data for whoever reads the page. */
  tell(peers) {
    const {counts} = this.view.panes[0], frame = peers[0].frameAt(this.time), hud = this.find('hud');
    const number = frame < 0 ? 'none yet' : peers[0].frames.numbers.data[frame];
    hud.textContent = `${(this.time / 1000).toFixed(3)} s \u00b7 frame ${number} \u00b7 ${counts.faces} faces held, ${counts.exact} exact`;
    Object.assign(hud.dataset, counts, {time: this.time, frame: number, playing: this.playing});
    const rows = peers[0].pairs.map((pair, i) => this.row(peers[0], pair, i));
    this.find('pairs').replaceChildren(...rows.filter(Boolean));
    this.tellPair(peers[0]);
  }
  row(peer, pair, number) {
    const answer = peer.answerAt(pair, this.time);
    if (!answer) return null;
    const row = document.createElement('button');
    row.className = 'pair' + (this.options.pair === number ? ' chosen' : '');
    row.style.setProperty('--status', kStatusColours[answer.status]);
    const names = [pair.a, pair.b].map(body => this.film.bodies[body].name).join(' \u2013 ');
    row.append(Object.assign(document.createElement('b'), {textContent: names}),
               Object.assign(document.createElement('span'), {textContent: this.inShort(answer)}));
    row.addEventListener('click', () => { this.options.pair = this.options.pair === number ? null : number; this.dirty = true; });
    return row;
  }
  inShort(answer) {
    if (answer.unknown === 2) return kUnknown[2];
    const status = kStatuses[answer.status];
    if (answer.facePairs > 0) return `${status}, ${answer.facePairs} face pairs`;
    if (answer.status === 3) return `${status} by ${metresText(answer.uncertainty)}`;
    return answer.clearance > 0 ? `${status}, ${metresText(answer.clearance)} apart at least` : status;
  }
  tellPair(peer) {
    const box = this.find('numbers'), pair = this.options.pair === null ? null : peer.pairs[this.options.pair];
    const answer = pair && peer.answerAt(pair, this.time);
    box.hidden = !answer;
    if (!answer) return;
    const place = this.view.panes[0].places, line = (head, text) => [head, text];
    const lines = [
      line('answer', kStatuses[answer.status] + (isCertified(answer.status) ? ', certified' : ', not certified')),
      line('face pairs', String(answer.facePairs)), line('distance, at least', metresText(answer.clearance)),
      line('uncertainty', metresText(answer.uncertainty))];
    [pair.a, pair.b].forEach((body, side) => {
      const {name, model} = this.film.bodies[body], at = place.get(body);
      lines.push(line(name + ', pose', metresAge(answer.ages[side])));
      lines.push(line(name + ', lacking', answer.lacking[side] + (answer.lacking[side] === 1 ? ' node' : ' nodes')));
      if (at && model >= 0) lines.push(line(name + ', held', `${at.count} of ${this.film.models[model].fullFaces} faces, ${at.exact} exact`));
    });
    if (answer.unknown > 0 && kUnknown[answer.unknown]) lines.push(line('not proved', kUnknown[answer.unknown]));
    box.replaceChildren(...lines.flatMap(([head, text]) =>
      [Object.assign(document.createElement('dt'), {textContent: head}), Object.assign(document.createElement('dd'), {textContent: text})]));
  }
  /** Names of the bodies that move, on the picture. */
  labels() {
    const {view} = this, names = [];
    for (const [number, place] of view.panes[0].places) {
      if (!place.isMoving) continue;
      const above = place.middle.clone();
      above.z += place.radius * 0.7;
      const at = view.project(above);
      if (!at || at[0] < 0 || at[1] < 0 || at[0] > view.canvas.clientWidth / view.shown || at[1] > view.canvas.clientHeight) continue;
      const label = Object.assign(document.createElement('span'), {textContent: this.film.bodies[number].name, className: 'label'});
      label.style.left = at[0] + 'px';
      label.style.top = at[1] + 'px';
      names.push(label);
    }
    this.find('labels').replaceChildren(...names);
    this.find('split').hidden = view.shown < 2;
    this.find('who').textContent = `as ${this.called(this.peers[0])} held it`;
    this.find('who2').textContent = view.shown < 2 ? '' : `as ${this.called(this.peers[1])} held it`;
  }
}

function metresAge(seconds) {
  return Number.isFinite(seconds) ? (1000 * seconds).toFixed(0) + ' ms old' : 'none';
}

window.nearmesh = {};
window.addEventListener('DOMContentLoaded', () => {
  const root = document.getElementById('player');
  if (!root) return;
  const player = new Player(root, JSON.parse(document.getElementById('film-facts').textContent));
  window.nearmesh.player = player;
  if (player.facts.live) player.live = new Live(player);
  window.nearmesh.ready = player.begin().then(() => player.live && player.live.connect()).catch(error => {
    player.say('The moving picture cannot be shown: ' + error.message);
    throw error;
  });
});
