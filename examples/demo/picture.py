#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Takes the picture of the README: picture.py [OUT.png]

To be run after ./demo, whose report it opens in a headless Chromium: an aircraft as it is about to touch the terrain.
"""
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/support"))
import browser as chromium  # noqa: E402

BEFORE_CONTACT_MS = 250
SCRIPT = f"""nearmesh.ready.then(async () => {{
  const p = nearmesh.player, orbit = p.view.orbit;
  p.seek(p.time - {BEFORE_CONTACT_MS});
  orbit.distance *= 0.75;
  orbit.rise = 0.55;
  orbit.turn = -0.9;
  await new Promise(requestAnimationFrame);
  while (p.dirty) await new Promise(requestAnimationFrame);
  return p.find('hud').textContent;
}})"""


def main():
    out = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/demo.png"
    with chromium.Browser((1280, 718)) as page:
        page.open(str(ROOT / "out/demo/report/index.html"))
        print(page.run(SCRIPT))
        page.picture(out)
        if page.errors:
            sys.exit("\n".join(page.errors))
    print(f"{out}: {out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
