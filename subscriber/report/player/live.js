// SPDX-License-Identifier: Apache-2.0
// The page of `watch`: the same film, as a web socket brings it, and what each process says of itself. It only listens.
'use strict';

const kBehind_ms = 900, kRefresh_ms = 1000;

class Live {
  constructor(player) {
    this.player = player;
    this.follows = true;  // the picture shows what has just come
    this.refreshed = 0;
    this.state = document.querySelector('[data-live="state"]');
    this.table = document.querySelector('[data-live="processes"]');
  }
  connect() {
    const place = new URL('film', location.href);
    place.protocol = 'ws:';
    const socket = new WebSocket(place);
    socket.binaryType = 'arraybuffer';
    socket.onmessage = event => typeof event.data === 'string' ? this.takeText(JSON.parse(event.data)) : this.take(new Uint8Array(event.data));
    socket.onopen = () => { this.state.textContent = 'waiting for peers'; };
    socket.onclose = () => {
      this.state.textContent = 'the program that this page is from has ended';
      this.ended = true;
    };
  }
  take(message) {
    const {film} = this.player, size = message[0], name = new TextDecoder().decode(message.subarray(1, 1 + size));
    const bytes = message.slice(1 + size), [kind, id] = [name.split('-')[0], name.slice(name.indexOf('-') + 1)];
    if (kind === 'models') film.takeModels(bytes);
    else if (kind === 'world') film.takeWorld(bytes);
    else if (kind === 'answers') film.peer(id).takeAnswers(bytes);
    else if (kind === 'mesh') film.peer(id).takeMesh(bytes);
    else film.peer(id).takeBus(bytes);
    this.player.dirty = true;
  }
  takeText(told) {
    const {player} = this;
    if (told.anew) { location.reload(); return; }
    for (const process of told.processes) if (process.name) player.facts.names[process.id] = process.name;
    this.tell(told);
    const now = performance.now();
    if (now - this.refreshed < kRefresh_ms) return;
    this.refreshed = now;
    player.refresh();
    // The first pair with meshes is what the page opens with; then the user chooses.
    const hasMesh = [...player.film.peers.values()].some(peer => peer.pairs.length > 0 && peer.meshes.size > 0);
    if (!this.opened && hasMesh) {
      this.opened = true;
      player.open();
    }
  }
  /** Time goes on as it does, so far behind what came last that no gap between two messages shows. */
  tick(passed) {
    const {player} = this, {end} = player.film;
    if (!this.follows || player.playing || end === 0) return;
    const behind = end - player.time;
    if (behind > 3 * kBehind_ms) player.time = end - kBehind_ms;
    else player.time = Math.min(end, player.time + passed * (behind > 1.5 * kBehind_ms ? 1.1 : behind < 0.5 * kBehind_ms ? 0.9 : 1));
    if (!this.ended) player.dirty = true;
  }
  tell(told) {
    const row = (cells, kind) => {
      const line = document.createElement('tr');
      line.append(...cells.map(text => Object.assign(document.createElement(kind), {textContent: text})));
      return line;
    };
    const speed = process => bytesText(Math.round(process.bytes_per_s)) + '/s';
    const publishers = told.processes.filter(process => process.publisher), peers = told.processes.filter(process => !process.publisher);
    const certificates = process => `${process.certified_pairs} of ${process.watched_pairs} pairs certified`;
    const oldest = process => !process.oldest_body ? 'hears no pose'
        : `${process.oldest_body}: ${process.oldest_age_s === null ? 'none yet' : metresAge(process.oldest_age_s)}`;
    this.table.replaceChildren(row(['process', 'role', 'answers or peers', 'oldest pose', 'bytes', 'batches that wait', 'requests, refused', 'memory'], 'th'),
      ...publishers.map(process => row([process.name, 'publisher', `${process.peers} peers`, '', 'sends ' + speed(process), process.waiting_batches,
        `${process.requests}, ${process.refused}`, bytesText(process.resident_bytes)], 'td')),
      ...peers.map(process => row([process.name, 'peer', certificates(process), oldest(process), 'receives ' + speed(process), process.waiting_batches,
        `${process.requests}, ${process.refused}`, bytesText(process.resident_bytes)], 'td')),
      ...told.errors.map(error => row(['', 'error', error], 'td')));
    if (!this.ended) this.state.textContent = `${publishers.length} publishers, ${peers.length} peers`;
  }
}
