// SPDX-License-Identifier: Apache-2.0
// The lanes below the picture: of each peer, the least certain of its answers and the bytes that it was sent, over time.
'use strict';

// As in the charts; free, contact, partial, uncertain, contained.
const kStatusColours = ['#009e73', '#d6006c', '#cc79a7', '#f0a000', '#56b4e9'];
const kLane = 44, kLaneLabel = 150, kLaneTop = 4, kLaneFoot = 20;

class Lanes {
  constructor(canvas, film, seek, choose) {
    this.canvas = canvas;
    this.film = film;
    this.begin = 0;
    this.end = 1;
    let drags = false;
    const jump = event => {
      const x = event.clientX - canvas.getBoundingClientRect().left;
      if (x >= kLaneLabel) seek(this.begin + (x - kLaneLabel) / (canvas.clientWidth - kLaneLabel - 8) * (this.end - this.begin));
    };
    canvas.addEventListener('pointerdown', event => {
      const row = Math.floor((event.clientY - canvas.getBoundingClientRect().top - kLaneTop) / kLane);
      const peer = [...film.peers.values()][row];
      if (event.clientX - canvas.getBoundingClientRect().left < kLaneLabel) { if (peer) choose(peer.id); return; }
      drags = true;
      canvas.setPointerCapture(event.pointerId);
      jump(event);
    });
    canvas.addEventListener('pointermove', event => { if (drags) jump(event); });
    canvas.addEventListener('pointerup', () => { drags = false; });
  }
  x(time) { return kLaneLabel + (time - this.begin) / (this.end - this.begin || 1) * (this.width - kLaneLabel - 8); }

  draw(time, chosen, names) {
    const {canvas} = this, ratio = window.devicePixelRatio || 1;
    const height = kLaneTop + kLane * this.film.peers.size + kLaneFoot;
    this.width = canvas.clientWidth;
    this.end = Math.max(this.film.end, this.begin + 1);
    // What does not move is drawn once.
    const key = [this.width, height, ratio, this.end, ...chosen].join();
    if (this.key !== key) {
      this.key = key;
      canvas.style.height = height + 'px';
      canvas.width = this.width * ratio;
      canvas.height = height * ratio;
      this.still = document.createElement('canvas');
      this.still.width = canvas.width;
      this.still.height = canvas.height;
      this.drawLanes(this.still.getContext('2d'), height, ratio, chosen, names);
    }
    const pen = canvas.getContext('2d');
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(this.still, 0, 0);
    pen.fillStyle = '#e0241b';
    pen.fillRect((this.x(time) - 1) * ratio, 0, 2 * ratio, (height - kLaneFoot) * ratio);
  }
  drawLanes(pen, height, ratio, chosen, names) {
    const style = getComputedStyle(this.canvas), peers = [...this.film.peers.values()];
    pen.scale(ratio, ratio);
    pen.font = '12px system-ui, sans-serif';
    const most = Math.max(1, ...peers.map(peer => this.mostBytes(peer)));
    peers.forEach((peer, i) => {
      const y = kLaneTop + i * kLane;
      pen.fillStyle = style.getPropertyValue('color');
      pen.globalAlpha = chosen.includes(peer.id) ? 1 : 0.65;
      pen.font = (chosen.includes(peer.id) ? 'bold ' : '') + '12px system-ui, sans-serif';
      pen.fillText(names(peer.id), 8, y + 15, kLaneLabel - 16);
      pen.globalAlpha = 0.65;
      pen.font = '11px system-ui, sans-serif';
      pen.fillText('bytes, up to ' + bytesText(most), 8, y + 33, kLaneLabel - 16);
      pen.globalAlpha = 1;
      this.drawStatus(pen, peer, y);
      this.drawBytes(pen, peer, y, most, style.getPropertyValue('--bytes'));
    });
    this.drawTimes(pen, height, style.getPropertyValue('color'));
  }
  /** Each pixel has the least certain answer of its time. */
  drawStatus(pen, peer, y) {
    const {times} = peer.frames;
    if (times.length === 0) return;
    const columns = new Int8Array(Math.ceil(this.width) + 1).fill(-1);
    const note = (status, from, to) => {
      for (let x = Math.floor(this.x(from)); x <= Math.floor(this.x(to)); ++x)
        if (columns[x] < 0 || kWorstFirst.indexOf(status) < kWorstFirst.indexOf(columns[x])) columns[x] = status;
    };
    const end = peer.end;
    for (const pair of peer.pairs)
      pair.answers.forEach((answer, i) => {
        const from = pair.times.data[i], next = i + 1 < pair.answers.length ? pair.times.data[i + 1] : end;
        note(answer.status, from, Math.max(from, next - 1e-3));
      });
    columns.forEach((status, x) => {
      if (status < 0) return;
      pen.fillStyle = kStatusColours[status];
      pen.fillRect(x, y + 3, 1, 16);
    });
  }
  columnsOfBytes(peer) {
    const columns = new Float64Array(Math.ceil(this.width) + 1);
    for (let i = 0; i < peer.sent.times.length; ++i) {
      const x = Math.floor(this.x(peer.sent.times.data[i]) / 3) * 3;
      if (x >= 0 && x < columns.length) columns[x] += peer.sent.bytes.data[i];
    }
    return columns;
  }
  mostBytes(peer) { return this.columnsOfBytes(peer).reduce((a, b) => Math.max(a, b), 0); }
  drawBytes(pen, peer, y, most, colour) {
    pen.fillStyle = 'rgba(128,140,155,.25)';
    pen.fillRect(kLaneLabel, y + 40, this.width - kLaneLabel - 8, 1);
    pen.fillStyle = colour;
    this.columnsOfBytes(peer).forEach((bytes, x) => {
      if (bytes > 0) { const h = Math.max(1, 18 * bytes / most); pen.fillRect(x, y + 40 - h, 2, h); }
    });
  }
  drawTimes(pen, height, colour) {
    const span = (this.end - this.begin) / 1000, raw = span / 8, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].find(f => f * power >= raw) * power;
    pen.fillStyle = colour;
    pen.globalAlpha = 0.75;
    pen.textAlign = 'center';
    for (let s = Math.ceil(this.begin / 1000 / step) * step; s <= this.end / 1000; s += step) {
      pen.fillRect(this.x(1000 * s), height - kLaneFoot, 1, 4);
      pen.fillText(+s.toFixed(6) + ' s', Math.min(this.x(1000 * s), this.width - 18), height - 4);
    }
    pen.textAlign = 'start';
    pen.globalAlpha = 1;
  }
}

function bytesText(bytes) {
  return bytes < 1000 ? bytes + ' B' : bytes < 1e6 ? (bytes / 1000).toFixed(1) + ' kB' : (bytes / 1e6).toFixed(1) + ' MB';
}
