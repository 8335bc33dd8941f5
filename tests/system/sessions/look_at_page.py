#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Opens a page of `report` in a headless Chromium and uses it: look_at_page.py PAGE INFO.json

Reads counts back from the page and holds them against what `info` says, plays a second, steps, jumps, puts two peers side by
side, and compares colours at places that it looks straight at: sky, a coarse face, an exact one, a contact. Any error on the
console fails it. Nothing is timed: it waits until something is so. Exit code 77: there is no Chromium here.
"""
import json
import math
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "support"))
import browser as chromium  # noqa: E402

HELP = """
(() => {
  const p = nearmesh.player;
  const frame = () => new Promise(requestAnimationFrame);
  window.test = {
    async until(isSo) { while (!isSo()) await frame(); },
    async drawn() { p.dirty = true; await frame(); await test.until(() => !p.dirty); return {...p.find('hud').dataset}; },
    /** The colour of a pixel of the picture, 0 to 255 each. */
    colour(x, y) {
      const copy = document.createElement('canvas');
      copy.width = copy.height = 1;
      const pen = copy.getContext('2d'), ratio = p.view.canvas.width / p.view.canvas.clientWidth;
      pen.drawImage(p.view.canvas, Math.round(x * ratio), Math.round(y * ratio), 1, 1, 0, 0, 1, 1);
      return [...pen.getImageData(0, 0, 1, 1).data].slice(0, 3);
    },
    /** The colour in the middle of the picture, looking at a place along a direction. */
    async lookAt(place, direction, distance) {
      const orbit = p.view.orbit;
      p.options.follow = null;
      orbit.target.copy(place);
      orbit.distance = distance;
      orbit.rise = Math.asin(direction.z);
      orbit.turn = Math.atan2(direction.y, direction.x);
      await test.drawn();
      return test.colour(p.view.canvas.clientWidth / 2, p.view.canvas.clientHeight / 2);
    },
    /** Of the faces that are (not) exact, of bodies that stand or else of any, the largest: looked at from its front. */
    async largestFace(isExact) {
      let best = null;
      for (const [number, body] of p.view.panes[0].bodies) {
        if (!body.faces.visible) continue;
        const moves = p.options.moving.has(number), geometry = body.faces.geometry;
        const fine = moves ? kColours.movingExact : kColours.standingExact;
        const {array: at} = geometry.attributes.position, {array: colours} = geometry.attributes.color;
        for (let f = 0; f < at.length; f += 9) {
          const exact = [0, 1, 2].every(i => fine.every((c, k) => Math.abs(c - colours[f + 3 * i + k]) < 1e-4));
          if (exact !== isExact) continue;
          const [a, b, c] = [0, 3, 6].map(i => new THREE.Vector3().fromArray(at, f + i).applyMatrix4(body.faces.matrix));
          const normal = b.clone().sub(a).cross(c.clone().sub(a)), size = normal.length();
          if (!best || (best.moves && !moves) || (best.moves === moves && size > best.size))
            best = {moves, size, normal: normal.normalize(), middle: a.add(b).add(c).divideScalar(3), colour: [0, 1, 2].map(k =>
                (colours[f + k] + colours[f + 3 + k] + colours[f + 6 + k]) / 3)};
        }
      }
      if (!best) return null;
      return {expected: best.colour, found: await test.lookAt(best.middle, best.normal, Math.sqrt(best.size) / 4)};
    },
  };
})()
"""

failures = []


def expect(is_so, what):
    if not is_so:
        failures.append(what)


def is_hue(found, expected):
    """The same colour, whatever light falls on it."""
    lengths = math.dist(found, (0, 0, 0)) * math.dist(expected, (0, 0, 0))
    return lengths > 0 and sum(f * e for f, e in zip(found, expected)) / lengths > 0.985


def look(page, info):
    page.run("nearmesh.ready")
    page.run(HELP)
    ids = page.run("[...nearmesh.player.film.peers.keys()]")
    expect(sorted(ids) == sorted(info["peers"]), f"peers {ids}, not {info['peers']}")
    answers = page.run("[...nearmesh.player.film.peers.values()].map(p => p.frames.times.length)")
    expect(all(n > 1 for n in answers), f"frames of the peers: {answers}")

    page.run("nearmesh.player.jump('contact')")
    at = page.run("test.drawn()")
    expect(int(at["segments"]) > 0 and int(at["faces"]) > int(at["exact"]) > 0, f"at the first contact: {at}")
    for name in ("edges", "asked", "trails"):
        page.run(f"nearmesh.player.options.{name} = false")
    contact = page.run("""(async () => { const pane = nearmesh.player.view.panes[0], s = pane.segments;
        const middle = new THREE.Vector3((s[0] + s[3]) / 2, (s[1] + s[4]) / 2, (s[2] + s[5]) / 2);
        return test.lookAt(middle, new THREE.Vector3(0.3, 0.2, 0.93).normalize(), 50); })()""")
    expect(math.dist(contact, (0xd6, 0, 0x6c)) < 16, f"a contact is {contact}")
    for kind, flag in (("exact", "true"), ("coarse", "false")):
        face = page.run(f"test.largestFace({flag})")
        expect(face and is_hue(face["found"], face["expected"]), f"an {kind} face: {face}")
    sky = page.run("test.lookAt(new THREE.Vector3(0, 0, 1e7), new THREE.Vector3(0, 0.8, -0.6), 10)")
    expect(math.dist(sky, (0xe4, 0xeb, 0xf2)) < 4, f"the sky is {sky}")

    page.run("nearmesh.player.seek(0)")
    page.run("nearmesh.player.play(true)")
    page.run("test.until(() => nearmesh.player.time >= 1000)")
    page.run("nearmesh.player.play(false)")
    frames = page.run("""(async () => { const p = nearmesh.player; p.seek(p.film.end / 2); const before = await test.drawn();
        document.body.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true})); const after = await test.drawn();
        return [Number(before.frame), Number(after.frame)]; })()""")
    expect(frames[1] == frames[0] + 1, f"a step went from frame {frames[0]} to {frames[1]}")
    jumps = page.run("""(async () => { const p = nearmesh.player, times = [];
        for (const to of ['uncertain', 'contact', 'largest']) { p.jump(to); times.push(Number((await test.drawn()).time)); } return times; })()""")
    expect(len(set(jumps)) > 1, f"jumps went to {jumps}")
    x, y = page.run("""(() => { const p = nearmesh.player, box = p.lanes.canvas.getBoundingClientRect();
        return [box.left + (kLaneLabel + p.lanes.width - 8) / 2, box.top + 10]; })()""")
    for kind in ("mousePressed", "mouseReleased"):
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
    lane = page.run("test.drawn().then(at => Number(at.time) / nearmesh.player.film.end)")
    expect(abs(lane - 0.5) < 0.02, f"a click in the middle of a lane went to {lane}")
    pairs = page.run("""(async () => { const p = nearmesh.player; p.jump('contact'); await test.drawn();
        p.find('pairs').firstChild.click(); await test.drawn(); return p.find('numbers').textContent; })()""")
    expect("face pairs" in pairs and "lacking" in pairs, f"the numbers of a pair: {pairs}")
    if len(ids) > 1:
        shown = page.run(f"nearmesh.player.choose({json.dumps(ids[:2])}).then(test.drawn).then(() => nearmesh.player.view.shown)")
        expect(shown == 2, f"{shown} peers side by side")
    for name in ("boxes", "halfSpaces", "asked", "trails", "edges"):
        page.run(f"nearmesh.player.options.{name} = true")
    for colour in ("exact", "age", "error"):
        page.run(f"nearmesh.player.options.colour = '{colour}'")
        page.run("test.drawn()")


def main():
    if not chromium.find():
        print("no Chromium here (Debian package chromium)")
        return 77
    info = json.loads(pathlib.Path(sys.argv[2]).read_text())
    with chromium.Browser() as page:
        page.open(sys.argv[1])
        look(page, info)
        failures.extend("console: " + error for error in page.errors)
    print("\n".join(failures) or "as expected")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
