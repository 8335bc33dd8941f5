// SPDX-License-Identifier: Apache-2.0
// Reads the streams that subscriber/recorded/film.cpp writes, whole or as they grow, and says what was so at a moment.
'use strict';

/** Bytes to numbers. */
class FilmReader {
  constructor(bytes) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = 0;
  }
  get ended() { return this.at >= this.bytes.length; }
  number() {
    let x = 0, scale = 1;
    for (;;) {
      const byte = this.bytes[this.at++];
      x += (byte & 127) * scale;
      if (byte < 128) return x;
      scale *= 128;
    }
  }
  signed() {
    const x = this.number();
    return x % 2 === 0 ? x / 2 : -(x + 1) / 2;
  }
  real() {
    this.at += 8;
    return this.view.getFloat64(this.at - 8, true);
  }
  rough() {
    FilmReader.words[0] = this.number() * 1024;
    return FilmReader.singles[0];
  }
  text() {
    const size = this.number();
    this.at += size;
    return new TextDecoder().decode(this.bytes.subarray(this.at - size, this.at));
  }
}
FilmReader.words = new Uint32Array(1);
FilmReader.singles = new Float32Array(FilmReader.words.buffer);

/** A typed array that grows. */
class Column {
  constructor(Type) {
    this.data = new Type(256);
    this.length = 0;
  }
  push(x) {
    if (this.length === this.data.length) {
      const wider = new this.data.constructor(2 * this.length);
      wider.set(this.data);
      this.data = wider;
    }
    this.data[this.length++] = x;
  }
}

/** The last place of ascending numbers that is not above x; -1 where all are. */
function lastUntil(column, x) {
  let low = 0, high = column.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (column.data[middle] <= x) low = middle + 1; else high = middle;
  }
  return low - 1;
}

/** Where a body was: moments and seven numbers each. */
class Way {
  constructor() {
    this.times = new Column(Float64Array);
    this.values = new Column(Float64Array);
    this.begin(null);
  }
  begin(unit) {
    this.unit = unit;
    this.last = [0, 0, 0, 0, 0, 0, 0];
    this.step = [0, 0, 0];
    this.isNew = true;
  }
  read(reader, time) {
    for (let k = 0; k < 7; ++k) {
      const before = this.last[k];
      this.last[k] = before + (k < 3 ? this.step[k] : 0) + reader.signed();
      if (k < 3) this.step[k] = this.isNew ? 0 : this.last[k] - before;
    }
    this.isNew = false;
    const cell = 2 ** this.unit;
    this.times.push(time);
    for (let k = 0; k < 7; ++k) this.values.push(k < 3 ? this.last[k] * cell : this.last[k] / 16384);
  }
  /** [x, y, z, w, i, j, k], or null before the first. */
  at(time) {
    const i = lastUntil(this.times, time);
    return i < 0 ? null : this.values.data.subarray(7 * i, 7 * i + 7);
  }
  get moves() {
    for (let i = 7; i < this.values.length; ++i)
      if (Math.abs(this.values.data[i] - this.values.data[i - 7]) > 1e-9) return true;
    return false;
  }
}

/** What a peer had of one kind of thing (faces or nodes of a model): numbers with first and last moment. */
class Holding {
  constructor() {
    this.what = new Column(Uint32Array);
    this.from = new Column(Float64Array);
    this.until = new Column(Float64Array);
    this.open = new Map();
  }
  read(reader, time) {
    let number = 0;
    for (let n = reader.number(); n > 0; --n) {
      number += reader.signed();
      this.open.set(number, this.what.length);
      this.what.push(number);
      this.from.push(time);
      this.until.push(Infinity);
    }
    number = 0;
    for (let n = reader.number(); n > 0; --n) {
      number += reader.signed();
      this.until.data[this.open.get(number)] = time;
      this.open.delete(number);
    }
  }
  forEach(time, visit) {
    const {data: from} = this.from, {data: until} = this.until, {data: what} = this.what;
    for (let i = 0; i < this.what.length && from[i] <= time; ++i)
      if (time < until[i]) visit(what[i], from[i]);
  }
}

const kStatuses = ['free', 'contact', 'partial', 'uncertain', 'contained'];
const kWorstFirst = [3, 2, 1, 4, 0];
const isCertified = status => status === 0 || status === 1 || status === 4;
const kUnknown = ['', '', 'nothing was asked: a header or a pose had not come', 'a pose was too old, or its mover gone',
  'the peer had given up detail, and what it held then is not recorded', 'the recording lacks batches that the peer had',
  'the recording lacks batches that the peer had', 'not asked: its turn did not come within the frame\'s budget', 'one is a world, which is not drawn'];

class FilmPeer {
  constructor(id) {
    this.id = id;
    this.meshes = new Map();  // by model: {faces, nodes, changes}
    this.meshTime = 0;
    this.frames = {times: new Column(Float64Array), numbers: new Column(Float64Array)};
    this.ways = new Map();    // by body
    this.pairs = [];
    this.sent = {times: new Column(Float64Array), bytes: new Column(Float64Array)};
    this.requests = [];
    this.time = 0;
    this.busTime = 0;
  }
  takeMesh(bytes) {
    const reader = new FilmReader(bytes);
    while (!reader.ended) {
      reader.at++;  // 'H'
      this.meshTime += reader.number();
      const model = reader.number();
      if (!this.meshes.has(model))
        this.meshes.set(model, {nodes: new Holding(), faces: new Holding(), changes: new Column(Float64Array)});
      const mesh = this.meshes.get(model);
      mesh.nodes.read(reader, this.meshTime);
      mesh.faces.read(reader, this.meshTime);
      mesh.changes.push(this.meshTime);
    }
  }
  takeAnswers(bytes) {
    const reader = new FilmReader(bytes);
    while (!reader.ended) {
      const kind = String.fromCharCode(reader.bytes[reader.at++]), first = reader.number(), second = reader.number();
      if (kind === 'T') {
        this.time += first;
        this.frames.times.push(this.time);
        this.frames.numbers.push(second);
      } else if (kind === 'P') {
        if (!this.ways.has(first)) this.ways.set(first, new Way());
        const way = this.ways.get(first);
        if (way.unit !== second - 1024) way.begin(second - 1024);
        way.read(reader, this.time);
      } else if (kind === 'D') {
        this.pairs.push({a: first, b: second, times: new Column(Float64Array), answers: []});
      } else {
        const pair = this.pairs[first];
        pair.times.push(this.time);
        pair.answers.push(this.readAnswer(reader, second));
      }
    }
  }
  readAnswer(reader, status) {
    const answer = {status, unknown: reader.number(), clearance: reader.rough(), uncertainty: reader.rough(),
                    facePairs: reader.number(), ages: [reader.rough(), reader.rough()], lacking: [0, 0], missing: [[], []]};
    for (const side of [0, 1]) {
      answer.lacking[side] = reader.number();
      let last = 0;
      for (let n = reader.number(); n > 0; --n) answer.missing[side].push(last += reader.signed());
    }
    const segments = reader.number();
    answer.segments = new Float64Array(6 * segments);
    if (segments > 0) {
      const cell = 2 ** reader.signed(), last = [0, 0, 0];
      for (let i = 0; i < 6 * segments; ++i) answer.segments[i] = (last[i % 3] += reader.signed()) * cell;
    }
    return answer;
  }
  takeBus(bytes) {
    const reader = new FilmReader(bytes);
    const vector = () => [reader.real(), reader.real(), reader.real()];
    while (!reader.ended) {
      const kind = String.fromCharCode(reader.bytes[reader.at++]);
      this.busTime += reader.number();
      const count = reader.number();
      if (kind === 'S') {
        this.sent.times.push(this.busTime);
        this.sent.bytes.push(count);
        continue;
      }
      const request = {time: this.busTime, pairs: [], boxes: []};
      if (kind === 'Q') {
        request.horizon = reader.rough();
        request.margin = reader.rough();
        for (let i = 0; i < count; ++i)
          request.pairs.push({models: [reader.number() - 1, reader.number() - 1], offset: vector(), velocity: vector()});
      } else {
        request.model = reader.number();
        for (let i = 0; i < count; ++i) {
          const box = [0, 0, 0, 0, 0, 0];
          for (let k = 0; k < 3; ++k) { box[k] = reader.signed(); box[3 + k] = reader.signed(); }
          const radius = reader.number();
          request.boxes.push(box.map((x, k) => k < 3 ? x - radius : x + radius));
        }
      }
      this.requests.push(request);
    }
  }
  get end() {
    const {times} = this.frames;
    return times.length === 0 ? 0 : times.data[times.length - 1];
  }
  frameAt(time) { return lastUntil(this.frames.times, time); }
  /** The last answer of a pair until then, or null. */
  answerAt(pair, time) {
    const i = lastUntil(pair.times, time);
    return i < 0 ? null : pair.answers[i];
  }
  /** The status of the pair that is furthest from certified; -1 where there is none. */
  worstAt(time) {
    let worst = -1;
    for (const pair of this.pairs) {
      const answer = this.answerAt(pair, time);
      if (answer && (worst < 0 || kWorstFirst.indexOf(answer.status) < kWorstFirst.indexOf(worst))) worst = answer.status;
    }
    return worst;
  }
  /** The first moment at which an answer of any pair is so; null where none is. */
  first(isSo) {
    let time = null;
    for (const pair of this.pairs) {
      const i = pair.answers.findIndex(isSo);
      if (i >= 0 && (time === null || pair.times.data[i] < time)) time = pair.times.data[i];
    }
    return time;
  }
  /** The frame before which the most bytes came: [moment, bytes]. */
  largestFrame() {
    const {times} = this.frames;
    let best = [null, 0], i = 0;
    for (let f = 0; f < times.length; ++f) {
      let bytes = 0;
      for (; i < this.sent.times.length && this.sent.times.data[i] <= times.data[f]; ++i) bytes += this.sent.bytes.data[i];
      if (bytes > best[1]) best = [times.data[f], bytes];
    }
    return best;
  }
}

class Film {
  constructor() {
    this.models = [];
    this.bodies = [];
    this.peers = new Map();
    this.worldTime = 0;
  }
  peer(id) {
    if (!this.peers.has(id)) this.peers.set(id, new FilmPeer(id));
    return this.peers.get(id);
  }
  takeModels(bytes) {
    const reader = new FilmReader(bytes);
    while (!reader.ended) {
      const kind = String.fromCharCode(reader.bytes[reader.at++]), index = reader.number(), count = reader.number();
      if (kind === 'M') {
        const name = reader.text(), content = reader.text(), cell = 2 ** reader.signed();
        this.models[index] = {name, content, cell, fullFaces: count, origin: [reader.real(), reader.real(), reader.real()],
          places: new Column(Float32Array), vertices: 0, corners: new Column(Uint32Array), faces: 0, nodes: [],
          lastPlace: [0, 0, 0], lastNode: 0, lastCorner: 0};
        continue;
      }
      const model = this.models[index];
      if (kind === 'V') this.readVertices(reader, model, count);
      else if (kind === 'N') this.readNodes(reader, model, count);
      else this.readFaces(reader, model, count);
    }
  }
  readVertices(reader, model, count) {
    const axes = [0, 1, 2].map(k => Array.from({length: count}, () => model.lastPlace[k] += reader.signed()));
    for (let i = 0; i < count; ++i) for (let k = 0; k < 3; ++k) model.places.push(axes[k][i] * model.cell);
    model.vertices += count;
  }
  readNodes(reader, model, count) {
    const nodes = Array.from({length: count}, () => ({vertex: model.lastNode += reader.signed()}));
    for (const node of nodes) node.told = reader.number() - 1;  // -1: exact
    for (const node of nodes) {
      node.eps = 0;
      if (node.told < 0) continue;
      node.reach = Array.from({length: 6}, () => reader.number() * model.cell);
      node.eps = Math.hypot(...[0, 2, 4].map(k => Math.max(node.reach[k], node.reach[k + 1])));
    }
    for (const node of nodes)
      if (node.told > 0)
        node.halfSpaces = Array.from({length: node.told}, () => {
          const normal = [reader.signed(), reader.signed(), reader.signed()], length = Math.hypot(...normal);
          return {normal: normal.map(x => x / length), reach: reader.number() / length * model.cell};
        });
    for (const node of nodes) model.nodes.push(node);
  }
  readFaces(reader, model, count) {
    const first = Array.from({length: count}, () => model.lastCorner += reader.signed());
    const second = first.map(a => a + reader.signed()), third = first.map(a => a + reader.signed());
    for (let i = 0; i < count; ++i) for (const corner of [first[i], second[i], third[i]]) model.corners.push(corner);
    model.faces += count;
  }
  takeWorld(bytes) {
    const reader = new FilmReader(bytes);
    while (!reader.ended) {
      const kind = String.fromCharCode(reader.bytes[reader.at++]), index = reader.number(), second = reader.number();
      if (kind === 'B') {
        const unit = reader.signed(), name = reader.text();
        if (!this.bodies[index]) this.bodies[index] = {name, model: -1, way: new Way()};
        if (second > 0) this.bodies[index].model = second - 1;
        this.bodies[index].way.begin(unit);
      } else {
        this.worldTime += second;
        this.bodies[index].way.read(reader, this.worldTime);
      }
    }
  }
  get end() {
    let end = this.worldTime;
    for (const peer of this.peers.values()) end = Math.max(end, peer.end);
    return end;
  }
  /** As the peer had it; else as its mover told it; else null. */
  poseAt(body, peer, time) {
    const way = peer && peer.ways.get(body);
    return (way && way.at(time)) || this.bodies[body].way.at(time);
  }
  moves(body) {
    if (this.bodies[body].way.moves) return true;
    for (const peer of this.peers.values()) if (peer.ways.has(body) && peer.ways.get(body).moves) return true;
    return false;
  }
}
