// SPDX-License-Identifier: Apache-2.0
// Draws one moment of a film, as one peer held it, with three.js. Colours are told apart with any colour vision: what is
// coarse is pale, what is exact is deep; bodies that move are amber, what stands is blue; contact is magenta, lacking black.
'use strict';

const kColours = {
  sky: 0xe4ebf2, contact: 0xd6006c, lacking: 0x101820, asked: 0x7a3fb0, halfSpace: 0x2e8b57, edge: 0x1c2430,
  standing: [[0.93, 0.905, 0.85], [0.83, 0.85, 0.82], [0.62, 0.77, 0.80], [0.40, 0.64, 0.78]], standingExact: [0.07, 0.33, 0.66],
  moving: [[0.95, 0.90, 0.80], [0.95, 0.84, 0.62], [0.95, 0.78, 0.42]], movingExact: [0.91, 0.58, 0.02],
};
const kAgeSpan_ms = 5000, kTrail_ms = 6000, kRequest_ms = 400, kMostBoxes = 3000, kMostPrisms = 3000;

function blend(stops, x) {
  const at = Math.min(Math.max(x, 0), 1) * (stops.length - 1), i = Math.min(Math.floor(at), stops.length - 2);
  return stops[i].map((c, k) => c + (at - i) * (stops[i + 1][k] - c));
}

/** Matrix of a pose, of what is drawn relative to a model's grid origin, about the scene's centre. */
function matrixOf(pose, origin, centre) {
  const matrix = new THREE.Matrix4(), turn = new THREE.Quaternion(pose[4], pose[5], pose[6], pose[3]).normalize();
  const offset = new THREE.Vector3(...origin).applyQuaternion(turn);
  matrix.makeRotationFromQuaternion(turn);
  matrix.setPosition(pose[0] + offset.x - centre[0], pose[1] + offset.y - centre[1], pose[2] + offset.z - centre[2]);
  return matrix;
}

/** Lines through places given as flat numbers. */
function makeLines(colour, opacity, onTop) {
  const lines = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial(
      {color: colour, transparent: true, opacity, depthTest: !onTop}));
  lines.frustumCulled = false;
  lines.renderOrder = onTop ? 3 : 1;
  return lines;
}
function setPlaces(object, places) {
  object.geometry.dispose();
  object.geometry = new THREE.BufferGeometry();
  object.geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(places), 3));
  object.visible = places.length > 0;
}
const kBoxEdges = [0, 1, 1, 3, 3, 2, 2, 0, 4, 5, 5, 7, 7, 6, 6, 4, 0, 4, 1, 5, 2, 6, 3, 7];
function addBox(places, low, high, matrix) {
  const corners = [];
  for (let i = 0; i < 8; ++i)
    corners.push(new THREE.Vector3(i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2])
        .applyMatrix4(matrix));
  for (const i of kBoxEdges) places.push(corners[i].x, corners[i].y, corners[i].z);
}

/** One peer's scene. */
class Pane {
  constructor(film) {
    this.film = film;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(kColours.sky);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x9a9288, 0.66));
    const sun = new THREE.DirectionalLight(0xfff4e0, 0.52);
    sun.position.set(-0.5, -0.8, 1.1);
    this.scene.add(sun);
    this.bodies = new Map();
    this.meshes = new Map();  // by model and kind: geometry, with what it was made of
    this.marks = {
      lacking: makeLines(kColours.lacking, 0.95, true), boxes: makeLines(kColours.edge, 0.25, false),
      asked: makeLines(kColours.asked, 0.9, true), halfSpaces: makeLines(kColours.halfSpace, 0.8, false),
      trails: makeLines(0xb87400, 0.8, false)};
    this.contact = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial(
        {color: kColours.contact, depthTest: false, side: THREE.DoubleSide}));
    this.contact.renderOrder = 4;
    this.contact.frustumCulled = false;
    for (const mark of [...Object.values(this.marks), this.contact]) this.scene.add(mark);
    this.segments = [];
    this.counts = {};
  }

  /** The geometry of a model as the peer held it, made anew where it changed. */
  geometryOf(peer, index, options, time, isMoving) {
    const model = this.film.models[index], mesh = peer.meshes.get(index);
    if (!model || !mesh) return null;
    const change = lastUntil(mesh.changes, time);
    if (change < 0) return null;
    const step = options.colour === 'age' ? Math.floor(time / 100) : 0;
    const key = [peer.id, change, options.colour, step, isMoving, options.scale.join()].join('|'), name = index + '|' + isMoving;
    const known = this.meshes.get(name);
    if (known && known.key === key) return known;
    if (known) { known.faces.dispose(); known.edges.dispose(); }
    const eps = new Float32Array(model.vertices);
    mesh.nodes.forEach(time, number => { eps[model.nodes[number].vertex] = model.nodes[number].eps; });
    const made = this.build(model, mesh, eps, options, time, isMoving);
    made.key = key;
    this.meshes.set(name, made);
    return made;
  }
  build(model, mesh, eps, options, time, isMoving) {
    const list = [];
    mesh.faces.forEach(time, (number, from) => list.push(number, from));
    const count = list.length / 2, places = new Float32Array(9 * count), colours = new Float32Array(9 * count),
          normals = new Float32Array(9 * count), edges = new Float32Array(18 * count);
    const {data: at} = model.places, {data: corners} = model.corners;
    const coarse = isMoving ? kColours.moving : kColours.standing, fine = isMoving ? kColours.movingExact : kColours.standingExact;
    const [least, most] = options.scale.map(Math.log);
    const a = new THREE.Vector3(), b = new THREE.Vector3(), c = new THREE.Vector3();
    let exact = 0;
    for (let f = 0; f < count; ++f) {
      const number = list[2 * f], vertices = [0, 1, 2].map(i => corners[3 * number + i]);
      const isExact = vertices.every(v => eps[v] === 0);
      if (isExact) ++exact;
      vertices.forEach((v, i) => {
        places.set(at.subarray(3 * v, 3 * v + 3), 9 * f + 3 * i);
        let colour = fine;
        if (options.colour === 'age')
          colour = blend([fine, coarse[0]], (time - list[2 * f + 1]) / kAgeSpan_ms);
        else if (!isExact)
          colour = options.colour === 'exact' ? coarse[0]
              : blend(coarse, eps[v] === 0 ? 1 : (most - Math.log(eps[v])) / (most - least || 1));
        colours.set(colour, 9 * f + 3 * i);
      });
      a.fromArray(places, 9 * f); b.fromArray(places, 9 * f + 3); c.fromArray(places, 9 * f + 6);
      for (const [i, from, to] of [[0, a, b], [1, b, c], [2, c, a]]) { from.toArray(edges, 18 * f + 6 * i); to.toArray(edges, 18 * f + 6 * i + 3); }
      b.sub(a); c.sub(a);
      b.cross(c).normalize();
      for (let i = 0; i < 3; ++i) b.toArray(normals, 9 * f + 3 * i);
    }
    const faces = new THREE.BufferGeometry(), lines = new THREE.BufferGeometry();
    faces.setAttribute('position', new THREE.BufferAttribute(places, 3));
    faces.setAttribute('normal', new THREE.BufferAttribute(normals, 3));
    faces.setAttribute('color', new THREE.BufferAttribute(colours, 3));
    lines.setAttribute('position', new THREE.BufferAttribute(edges, 3));
    let edge = 0;
    for (let i = 0; i < edges.length; i += 6) edge += Math.hypot(edges[i] - edges[i + 3], edges[i + 1] - edges[i + 4], edges[i + 2] - edges[i + 5]);
    faces.computeBoundingSphere();
    return {faces, edges: lines, count, exact, edge: edge / (3 * count || 1), radius: faces.boundingSphere ? faces.boundingSphere.radius : 0,
            middle: faces.boundingSphere ? faces.boundingSphere.center.clone() : new THREE.Vector3()};
  }

  show(peer, time, options, centre) {
    const {film} = this;
    this.counts = {faces: 0, exact: 0, bodies: 0, lacking: 0, segments: 0};
    this.places = new Map();
    for (const body of this.bodies.values()) body.faces.visible = body.edges.visible = false;
    film.bodies.forEach((body, number) => {
      const pose = film.poseAt(number, peer, time);
      if (!pose) return;
      const isMoving = options.moving.has(number), made = body.model >= 0 && this.geometryOf(peer, body.model, options, time, isMoving);
      const model = made ? film.models[body.model] : null, matrix = matrixOf(pose, model ? model.origin : [0, 0, 0], centre);
      const place = {matrix, middle: made ? made.middle.clone().applyMatrix4(matrix) : new THREE.Vector3().setFromMatrixPosition(matrix),
                     radius: made ? made.radius : 0, count: made ? made.count : 0, exact: made ? made.exact : 0, isMoving};
      this.places.set(number, place);
      if (!made) return;
      this.drawBody(number, made, matrix, options);
      this.counts.bodies += 1;
      this.counts.faces += made.count;
      this.counts.exact += made.exact;
    });
    this.showAnswers(peer, time, options, centre);
    setPlaces(this.marks.boxes, options.boxes ? this.unresolvedBoxes(peer, time) : []);
    setPlaces(this.marks.halfSpaces, options.halfSpaces ? this.halfSpaces(peer, time) : []);
    setPlaces(this.marks.asked, options.asked ? this.asked(peer, time) : []);
    setPlaces(this.marks.trails, options.trails ? this.trails(peer, time, options, centre) : []);
  }
  drawBody(number, made, matrix, options) {
    if (!this.bodies.has(number)) {
      const faces = new THREE.Mesh(made.faces, new THREE.MeshLambertMaterial(
          {vertexColors: THREE.VertexColors, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1}));
      const edges = makeLines(kColours.edge, 0.16, false);
      for (const object of [faces, edges]) {
        object.matrixAutoUpdate = false;
        object.frustumCulled = false;
        this.scene.add(object);
      }
      this.bodies.set(number, {faces, edges});
    }
    const body = this.bodies.get(number);
    body.faces.geometry = made.faces;
    body.edges.geometry = made.edges;
    for (const object of [body.faces, body.edges]) {
      object.matrix.copy(matrix);
      object.matrixWorldNeedsUpdate = true;
    }
    body.faces.visible = true;
    body.edges.visible = options.edges;
    body.edge = made.edge;
    body.middle = this.places.get(number).middle;
  }
  /** Edges fade where they stand so close that they would hide the faces. */
  fadeEdges(camera, height) {
    for (const body of this.bodies.values()) {
      if (!body.edges.visible) continue;
      const eye = Math.max(body.middle.distanceTo(camera.position) - body.faces.geometry.boundingSphere.radius, camera.near);
      const pixels = body.edge / (eye * Math.tan(camera.fov * Math.PI / 360) * 2) * height;
      body.edges.material.opacity = Math.min(Math.max((pixels - 3) / 60, 0), 1) * 0.24;
    }
  }
  showAnswers(peer, time, options, centre) {
    const lacking = [];
    this.segments = [];
    peer.pairs.forEach((pair, number) => {
      const answer = peer.answerAt(pair, time);
      if (!answer || (options.pair !== null && options.pair !== number)) return;
      for (let i = 0; i < answer.segments.length; i += 3)
        this.segments.push(answer.segments[i] - centre[0], answer.segments[i + 1] - centre[1], answer.segments[i + 2] - centre[2]);
      for (const side of [0, 1]) {
        const body = side === 0 ? pair.a : pair.b, place = this.places.get(body), model = this.film.models[this.film.bodies[body].model];
        this.counts.lacking += answer.lacking[side];
        if (place && model) for (const node of answer.missing[side]) this.addNode(lacking, model, model.nodes[node], place.matrix);
      }
    });
    this.counts.segments = this.segments.length / 6;
    setPlaces(this.marks.lacking, lacking);
    this.thickness = 0;
  }
  addNode(places, model, node, matrix) {
    if (!node || !node.reach) return;
    const at = [0, 1, 2].map(k => model.places.data[3 * node.vertex + k]);
    addBox(places, at.map((x, k) => x - node.reach[2 * k]), at.map((x, k) => x + node.reach[2 * k + 1]), matrix);
  }
  forEachNode(peer, time, visit) {
    for (const [number, place] of this.places) {
      const index = this.film.bodies[number].model, mesh = index >= 0 && peer.meshes.get(index);
      if (mesh) mesh.nodes.forEach(time, node => visit(this.film.models[index], this.film.models[index].nodes[node], place));
    }
  }
  unresolvedBoxes(peer, time) {
    const places = [];
    this.forEachNode(peer, time, (model, node, place) => {
      if (places.length < kMostBoxes * 72) this.addNode(places, model, node, place.matrix);
    });
    return places;
  }
  /** A square of each, where it ends, with its normal. */
  halfSpaces(peer, time) {
    const places = [], from = new THREE.Vector3(), to = new THREE.Vector3();
    const line = (a, b, matrix) => {
      from.copy(a).applyMatrix4(matrix).toArray(places, places.length);
      to.copy(b).applyMatrix4(matrix).toArray(places, places.length);
    };
    this.forEachNode(peer, time, (model, node, {matrix}) => {
      for (const told of node.halfSpaces || []) {
        const normal = new THREE.Vector3(...told.normal), size = Math.max(...node.reach) / 2;
        const at = new THREE.Vector3().fromArray(model.places.data, 3 * node.vertex).addScaledVector(normal, told.reach);
        const u = new THREE.Vector3(Math.abs(normal.x) < 0.7 ? 1 : 0, Math.abs(normal.x) < 0.7 ? 0 : 1, 0).cross(normal).normalize();
        const v = normal.clone().cross(u);
        const corner = (s, t) => at.clone().addScaledVector(u, s * size).addScaledVector(v, t * size);
        const corners = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
        corners.forEach((c, i) => line(c, corners[(i + 1) % 4], matrix));
        line(at, at.clone().addScaledVector(normal, size / 3), matrix);
      }
    });
    return places;
  }
  /** Regions as boxes; of what was asked by poses, the way of the second body as far as certificates were asked for. */
  asked(peer, time) {
    const places = [];
    for (const request of peer.requests) {
      if (request.time > time || request.time < time - kRequest_ms) continue;
      for (const [number, place] of this.places) {
        const body = this.film.bodies[number];
        if (request.boxes.length > 0 && body.model === request.model) {
          const {cell} = this.film.models[body.model];
          for (const box of request.boxes) addBox(places, box.slice(0, 3).map(x => x * cell), box.slice(3).map(x => x * cell), place.matrix);
        }
      }
      for (const asked of request.pairs) this.addAskedPair(places, request, asked, peer, time);
    }
    return places;
  }
  addAskedPair(places, request, asked, peer, time) {
    let best = null, least = Infinity;
    for (const pair of peer.pairs) {
      for (const [a, b] of [[pair.a, pair.b], [pair.b, pair.a]]) {
        if (this.film.bodies[a].model !== asked.models[0] || this.film.bodies[b].model !== asked.models[1]) continue;
        const first = this.film.poseAt(a, peer, time), second = this.film.poseAt(b, peer, time);
        if (!first || !second || !this.places.has(a) || !this.places.has(b)) continue;
        const turn = new THREE.Quaternion(first[4], first[5], first[6], first[3]).normalize();
        const expected = new THREE.Vector3(...asked.offset).applyQuaternion(turn);
        const away = Math.hypot(...[expected.x, expected.y, expected.z].map((x, k) => x + first[k] - second[k]));
        if (away < least) { least = away; best = {turn, middle: this.places.get(b).middle, radius: this.places.get(b).radius + request.margin}; }
      }
    }
    if (!best) return;
    const reach = new THREE.Vector3(...asked.velocity).applyQuaternion(best.turn).multiplyScalar(request.horizon);
    const to = best.middle.clone().add(reach);
    places.push(best.middle.x, best.middle.y, best.middle.z, to.x, to.y, to.z);
    for (let i = 0; i < 24; ++i)
      for (const angle of [i, i + 1].map(x => x * Math.PI / 12))
        places.push(to.x + best.radius * Math.cos(angle), to.y + best.radius * Math.sin(angle), to.z);
  }
  trails(peer, time, options, centre) {
    const places = [];
    for (const number of options.moving) {
      const own = peer.ways.get(number), way = own && own.times.length > 1 ? own : this.film.bodies[number].way;
      let last = null;
      for (let i = Math.max(0, lastUntil(way.times, time - kTrail_ms)); i < way.times.length && way.times.data[i] <= time; ++i) {
        const at = [0, 1, 2].map(k => way.values.data[7 * i + k] - centre[k]);
        if (last) places.push(...last, ...at);
        last = at;
      }
    }
    return places;
  }
  /** Lines have no width in WebGL: contacts are prisms as wide as some pixels. */
  thicken(camera, height) {
    if (this.segments.length === 0) { this.contact.visible = false; return; }
    const eye = new THREE.Vector3(this.segments[0], this.segments[1], this.segments[2]).distanceTo(camera.position);
    const width = eye * Math.tan(camera.fov * Math.PI / 360) * 2 / height * 1.6;
    if (Math.abs(width - this.thickness) < 0.15 * width) return;
    this.thickness = width;
    const places = [], p = new THREE.Vector3(), q = new THREE.Vector3(), u = new THREE.Vector3(), v = new THREE.Vector3();
    for (let i = 0; i < Math.min(this.segments.length, 6 * kMostPrisms); i += 6) {
      p.fromArray(this.segments, i); q.fromArray(this.segments, i + 3);
      u.copy(q).sub(p);
      if (u.lengthSq() < 1e-18) u.set(0, 0, width);
      u.normalize();
      v.set(Math.abs(u.x) < 0.7 ? 1 : 0, Math.abs(u.x) < 0.7 ? 0 : 1, 0).cross(u).normalize().multiplyScalar(width);
      p.addScaledVector(u, -width); q.addScaledVector(u, width);
      u.cross(v).normalize().multiplyScalar(width);
      const ring = [v.clone().add(u), v.clone().sub(u), v.clone().add(u).negate(), u.clone().sub(v)];
      for (let k = 0; k < 4; ++k) {
        const a = ring[k], b = ring[(k + 1) % 4];
        for (const [end, side] of [[p, a], [p, b], [q, b], [p, a], [q, b], [q, a]]) places.push(end.x + side.x, end.y + side.y, end.z + side.z);
      }
    }
    setPlaces(this.contact, places);
  }
}

/** The camera that turns about a place; z is up. */
class Orbit {
  constructor(canvas, changed) {
    this.target = new THREE.Vector3();
    this.distance = 100;
    this.turn = -2.2;
    this.rise = 0.42;
    let drag = null;
    canvas.addEventListener('contextmenu', event => event.preventDefault());
    canvas.addEventListener('pointerdown', event => {
      drag = {x: event.clientX, y: event.clientY, pans: event.button !== 0 || event.shiftKey};
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener('pointerup', () => { drag = null; });
    canvas.addEventListener('pointermove', event => {
      if (!drag) return;
      const dx = event.clientX - drag.x, dy = event.clientY - drag.y;
      drag.x = event.clientX; drag.y = event.clientY;
      if (drag.pans) this.pan(dx / canvas.clientHeight, dy / canvas.clientHeight);
      else { this.turn -= dx * 0.006; this.rise = Math.min(1.55, Math.max(-1.2, this.rise + dy * 0.005)); }
      changed();
    });
    canvas.addEventListener('wheel', event => {
      event.preventDefault();
      this.distance *= Math.exp(Math.sign(event.deltaY) * 0.12);
      changed();
    }, {passive: false});
  }
  direction() {
    return new THREE.Vector3(Math.cos(this.rise) * Math.cos(this.turn), Math.cos(this.rise) * Math.sin(this.turn), Math.sin(this.rise));
  }
  pan(x, y) {
    const right = new THREE.Vector3(-Math.sin(this.turn), Math.cos(this.turn), 0), up = this.direction().cross(right);
    this.target.addScaledVector(right, -x * this.distance).addScaledVector(up, y * this.distance);
  }
  place(camera, reach) {
    camera.position.copy(this.target).addScaledVector(this.direction(), this.distance);
    camera.near = Math.max(this.distance / 200, reach / 200000);
    camera.far = this.distance + 4 * reach;
    camera.up.set(0, 0, 1);
    camera.lookAt(this.target);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  }
}

/** The canvas: one pane, or two side by side under one camera. */
class View {
  constructor(canvas, film, changed) {
    this.canvas = canvas;
    this.film = film;
    this.renderer = new THREE.WebGLRenderer({canvas, antialias: true, preserveDrawingBuffer: true});
    this.renderer.setScissorTest(true);
    this.camera = new THREE.PerspectiveCamera(42, 1, 1, 1000);
    this.orbit = new Orbit(canvas, changed);
    this.panes = [new Pane(film), new Pane(film)];
    this.centre = null;
  }
  show(peers, time, options) {
    if (!this.centre) this.centre = this.findCentre(peers[0], time);
    this.shown = peers.length;
    peers.forEach((peer, i) => this.panes[i].show(peer, time, options, this.centre));
    this.follow(options.follow);
  }
  findCentre(peer, time) {
    for (let number = 0; number < this.film.bodies.length; ++number) {
      const pose = this.film.poseAt(number, peer, time);
      if (pose) return [pose[0], pose[1], pose[2]];
    }
    return null;
  }
  follow(body) {
    const place = body === null ? null : this.panes[0].places.get(body);
    if (place && this.followed === body) this.orbit.target.add(place.middle).sub(this.followedAt);
    else if (place) this.orbit.target.copy(place.middle);
    this.followed = place ? body : null;
    if (place) this.followedAt = place.middle.clone();
  }
  /** How far the scene reaches. */
  reach() {
    let reach = 1;
    for (const place of this.panes[0].places.values())
      reach = Math.max(reach, place.radius, place.middle.distanceTo(this.orbit.target));
    return reach;
  }
  draw() {
    const {canvas, renderer, camera} = this, ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.floor(width * ratio) || canvas.height !== Math.floor(height * ratio)) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(width, height, false);
    }
    camera.aspect = width / this.shown / height;
    this.orbit.place(camera, this.reach());
    for (let i = 0; i < this.shown; ++i) {
      const x = i * width / this.shown;
      renderer.setViewport(x, 0, width / this.shown, height);
      renderer.setScissor(x, 0, width / this.shown, height);
      this.panes[i].thicken(camera, height);
      this.panes[i].fadeEdges(camera, height);
      renderer.render(this.panes[i].scene, camera);
    }
  }
  /** Where a place in the world is on the canvas, in CSS pixels of the first pane; null behind the camera. */
  project(place) {
    const at = place.clone().project(this.camera);
    if (at.z > 1) return null;
    return [(at.x + 1) / 2 * this.canvas.clientWidth / this.shown, (1 - at.y) / 2 * this.canvas.clientHeight];
  }
}
