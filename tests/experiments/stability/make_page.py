#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes stability.md and stability.svg from what nearmesh-stability counted.

Usage: make_page.py DOCS            reads DOCS/stability/*.csv, writes DOCS/stability.md and DOCS/stability.svg
       make_page.py DOCS --check    only says whether these are what it would write
Same files, same bytes.
"""
import csv
import pathlib
import sys
from xml.sax.saxutils import escape

HEAD = """# Stability: scenes in which methods fail

For whoever asks when a collision method gives a wrong answer. Each row is a kind of scene that is known to be hard, each cell says how
many answers were right. Written from counts of `nearmesh-stability`; no cell is typed in.

![Wrong answers by scene and system. nearmesh: none in any scene. FCL, Bullet and CGAL: some in most.](stability.svg)

Right answers / cases asked. Bold: all right. "Undecided" is an answer that claims nothing, and counts as right.

"""

RIGHT = """
## What counts as right

The truth of a case is computed from the very doubles that every system is given, in exact rational arithmetic over all pairs of
triangles. Touching is contact.

* **Nothing hangs on rounding.** Coordinates are multiples of a power of two within 21 bits of the mesh, and rotations are quarter
  turns. Variants are exact in doubles too: 24 quarter turns, swapped bodies, renumbered vertices and faces, both bodies sheared
  by one random integer matrix. "Far from the origin, tiny, huge" also moves both bodies or their vertices by 2^0 to 2^23 m, and scales
  by 2^-20 to 2^20.
* **Left out** is what nearmesh cannot resolve: translations off the pair's lattice (a quarter of the finer cell, not below 2^-38 of the
  larger model), turns by other angles where exact touching is asked for, single points closer than 2^-22 m.
* **nearmesh is asked three times** in every case: over the full meshes, from the base by `certify`, and from a random partial state. Two
  answers that differ make the case wrong.
* **"Uncertain" counts as right** and is shown as undecided: it claims nothing. Once the nodes that it names have come, the answer must be
  the truth; that is part of the case.
* **An error instead of an answer is wrong** where there is an answer. CGAL documents that its triangles must not be degenerate and throws
  when one is: "refused".
* **A crash or a hang is a cell**, not the end of the run. Every case runs in a child process of its own, with 10 s of CPU time (60 s
  for large meshes) and 8 GiB of memory.
* **n/a**: the system has no such function at all (no file reader, no limit, no pairs).

Rows that end in "contact or not" and "number of touching pairs" ask two questions about the same cases. Of the other scenes:

| scene | what is asked, and what is right |
|---|---|
"""

# By scene: what the table above says of it.
ASKED = {
    "F1": 'the others are given the triangles that a client of the stream would hold at that moment; "free" on these is wrong when the full meshes touch',
    "F2": "bodies with their insides. FCL and Bullet are asked by their default calls, which know surfaces only; CGAL by the call that it offers for bounded sides",
    "F5": "NaN and infinities: only a refusal (an error, an exception) is right. Finite but useless poses (1e308 m, matrices that are no rotations, taken as the affine maps they are), and a mesh of denormal size beside one of metres: refused or answered truly. Translations of denormals or negative zeros: answered. A crash is never right",
    "F7": "does b's path, one second of constant velocity (and half a turn), touch a at any time? \"Free\" is wrong when it hits; \"uncertain\" claims nothing",
    "F8": "every contact point within 2^-16 m of both surfaces, or between them where one is sunk into the other; every normal within 0.15 rad of the true one, the plane's (the facets next to a ball's pole tilt by 0.1)",
    "F9": "contact points as in the row before, normals within 1e-6 rad. The plate is flat at every level, so coarse triangles are as good as fine ones; each system gets those that have come",
    "F10": 'a ball stands on a vertex of terrain, which refines and coarsens; the others get the triangles of the moment, and "free" on the way is a contact lost',
    "F11": "only nearmesh stores bounds",
    "F12": "only nearmesh refines",
    "F13": "the same case once alone and four times in each of two threads: all answers the same and right",
    "F16": "a file must load or be refused as its table says; either is right where the table leaves it open",
    "F18": "at most so many pairs are asked for; right when the answer itself tells whether there are more",
}

SCALE = """
## Time to the first answer, and memory

Terrain against an aircraft of 2,000 faces that touches it; one run, so times are good to some tens of per cent.
nearmesh opens an `.spm` file that was baked once (and is in the page cache); the others are given the triangles in memory and build their
tree. Memory is how much the process grew (peak).

| system | faces | offline, s | first answer, s | memory, MB |
|---|---|---|---|---|
"""

FAILURES = """
## The first failure of each cell

`stability/failures.csv` has a few more.

| scene | system | case | expected | found |
|---|---|---|---|---|
"""

AGAIN = """
## To make it again

`stability/results.csv` has each row's short name, which `--scenes` takes.

    cmake --build --preset dev --target experiments
    build/dev/bin/nearmesh-stability --out docs/stability
    python3 tests/experiments/stability/make_page.py docs
"""


class Counts:
    def __init__(self, folder):
        read = lambda name: list(csv.DictReader(open(folder / name, newline="", encoding="utf-8")))
        self.about = {row["system"]: row for row in read("systems.csv") if row["system"] != "compiler"}
        self.compiler = next(row["version"] for row in read("systems.csv") if row["system"] == "compiler")
        self.cells, self.titles = {}, {}  # (scene, system) -> row; scene -> words, in order
        for row in read("results.csv"):
            self.titles[row["scene"]] = row["title"]
            counts = {key: int(row[key]) for key in ("right", "undecided", "wrong", "crash", "hang", "not_applicable", "cases")}
            counts["asked"] = counts["cases"] - counts["not_applicable"]
            counts["good"] = counts["right"] + counts["undecided"]
            self.cells[row["scene"], row["system"]] = counts
        self.failures = read("failures.csv")
        self.scale = read("scale.csv") if (folder / "scale.csv").exists() else []


def cell(counts):
    """812/812, with what went worse than wrong."""
    if not counts["asked"]:
        return "n/a"
    text = f"{counts['good']}/{counts['asked']}"
    if counts["good"] == counts["asked"]:
        text = f"**{text}**"
    text += "".join(f", {counts[name]} {name}" for name in ("crash", "hang") if counts[name])
    return text + (f" ({counts['undecided']} undecided)" if counts["undecided"] else "")


def capital(words):
    return words[0].upper() + words[1:]


def page(counts):
    systems = list(counts.about)
    rows = [["scene"] + [f"{name} {counts.about[name]['version']}" for name in systems]]
    rows += [[capital(title)] + [cell(counts.cells[scene, name]) for name in systems] for scene, title in counts.titles.items()]
    lines = [f"| {' | '.join(row)} |\n" for row in rows]
    text = HEAD + lines[0] + "|" + "---|" * len(rows[0]) + "\n" + "".join(lines[1:])
    text += RIGHT + "".join(f"| {capital(counts.titles[scene])} | {said} |\n" for scene, said in ASKED.items() if scene in counts.titles)
    text += "\n## How each system is called\n\n"
    text += "".join(f"* **{name} {about['version']}**: {about['call']}.\n" for name, about in counts.about.items())
    text += f"\nCompiler: {counts.compiler}.\n"
    if counts.scale:
        text += SCALE
        for row in counts.scale:
            prepared = f"{float(row['prepare_s']):.6f}"[:5] if float(row["prepare_s"]) > 0 else "-"
            text += (f"| {row['system']} | {row['faces']} | {prepared} | {float(row['first_answer_s']):.3f} | "
                     f"{float(row['memory_bytes']) / 1e6:.1f} |\n")
    text += FAILURES
    first = {}
    for row in counts.failures:
        first.setdefault((row["scene"], row["system"]), row)
    for row in first.values():
        text += f"| {capital(counts.titles[row['scene']])} | {row['system']} | {row['case']} | {row['expected']} | {row['found']} |\n"
    return text + AGAIN


WORDS, COLUMN, LINE, TOP = 400, 125, 30, 96  # pixels


def picture(counts):
    """Blue where no answer was wrong, orange by the share that was: told apart by everybody, and by lightness alone."""
    systems = list(counts.about)
    width, height = WORDS + COLUMN * len(systems) + 12, TOP + LINE * len(counts.titles) + 44
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
           'font-family="Helvetica, Arial, sans-serif" font-size="13">',
           "<title>Wrong answers by scene and system</title>",
           f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
           '<text x="12" y="28" font-size="18" font-weight="bold">Scenes in which collision methods fail</text>',
           '<text x="12" y="50" fill="#454f5b">Wrong answers, of so many asked. Truth: exact rational arithmetic over all pairs of triangles.</text>']
    for x, name in enumerate(systems):
        out.append(f'<text x="{WORDS + COLUMN * (x + 0.5):g}" y="{TOP - 10}" text-anchor="middle" font-weight="bold">'
                   f"{escape(name)} {escape(counts.about[name]['version'])}</text>")
    for y, (scene, title) in enumerate(counts.titles.items()):
        top = TOP + LINE * y
        out.append(f'<text x="{WORDS - 10}" y="{top + 20}" text-anchor="end">{escape(capital(title))}</text>')
        for x, name in enumerate(systems):
            c = counts.cells[scene, name]
            wrong = c["asked"] - c["good"]
            if not c["asked"]:
                fill, ink, said = "#eceff2", "#6a7480", "not offered"
            elif not wrong:
                fill, ink, said = "#1254a8", "#ffffff", f"0 of {c['asked']:,}"
            else:
                share = (wrong / c["asked"]) ** 0.5
                light, dark = (0xFB, 0xE7, 0xC6), (0xE0, 0x7B, 0x00)
                fill = "#" + "".join(f"{round(a + (b - a) * share):02x}" for a, b in zip(light, dark))
                ink, said = "#101820", f"{wrong:,} of {c['asked']:,}"
            said += "".join(f", {c[kind]} {kind}" for kind in ("crash", "hang") if c[kind])
            left = WORDS + COLUMN * x
            out.append(f'<rect x="{left + 1}" y="{top + 1}" width="{COLUMN - 2}" height="{LINE - 2}" fill="{fill}"/>')
            out.append(f'<text x="{left + COLUMN / 2:g}" y="{top + 20}" text-anchor="middle" fill="{ink}">{said}</text>')
    undecided = [f"{c['undecided']:,} in “{counts.titles[scene]}”" for (scene, _), c in counts.cells.items() if c["undecided"]]
    under = "Blue: none wrong. Orange: the darker, the more. Undecided answers of nearmesh, which claim nothing and are not wrong:"
    out += [f'<text x="12" y="{height - 26}" fill="#454f5b">{under}</text>',
            f'<text x="12" y="{height - 9}" fill="#454f5b">{escape("; ".join(undecided))}.</text>', "</svg>"]
    return "\n".join(out) + "\n"


def main():
    if len(sys.argv) not in (2, 3) or sys.argv[2:] not in ([], ["--check"]):
        sys.exit(__doc__)
    docs = pathlib.Path(sys.argv[1])
    counts = Counts(docs / "stability")
    made = {docs / "stability.md": page(counts), docs / "stability.svg": picture(counts)}
    for path, text in made.items():
        if len(sys.argv) == 3 and path.read_text(encoding="utf-8") != text:
            sys.exit(f"{path}: is not what make_page.py makes of the counts")
        if len(sys.argv) == 2:
            path.write_text(text, encoding="utf-8")
    if len(sys.argv) == 3:
        print("The page is what was counted.")


if __name__ == "__main__":
    main()
