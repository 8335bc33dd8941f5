#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures what worlds and many bodies take, and prints one table of all figures beside their aims.

Usage: world_table.py BIN FOLDER          (build/dev/bin; and where the world is baked, 0.9 GB)

Bakes 121 tiles of up to a million faces if FOLDER has no world, and lets them stand 12,100 times: two minutes on two cores, and the
figures of bakes are of those tiles that it bakes. Then some four minutes. The machine should do nothing else.
"""
import concurrent.futures
import csv
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
import time

CELLS, REPEATS, FACES, HOUR, FIVE_MINUTES = 7071, 10, 1_000_000, 72_000, 6_000


class Programs:
    def __init__(self, folder):
        self.folder = pathlib.Path(folder).resolve()

    def run(self, name, *words):
        done = subprocess.run([self.folder / name, *map(str, words)], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit(f"{name} {shlex.join(map(str, words))}: exit code {done.returncode}\n{done.stderr[-2000:]}")
        return done.stdout


def number(pattern, text):
    found = re.search(pattern, text)
    if found is None:
        sys.exit(f"'{pattern}' is not in what was printed:\n{text[-2000:]}")
    return float(found.group(1).replace(",", ""))


def bake(programs, folder):
    """Out: processor seconds of each tile, the greatest memory of a worker in MB; none where a world was there."""
    if (folder / "world" / "world.nmw").exists():
        return [], 0
    programs.run("nearmesh-world-flights", folder, "--cells", CELLS, "--repeats", REPEATS, "--frames", 1)
    build = ["build-world", folder / "heights.raw", "--raw", f"{CELLS + 1}x{CELLS + 1},i16le", "--heights", "0,0.1", "--spacing", "5,5",
             "--crs", "file", "--faces", FACES, "--repeat", f"{REPEATS}x{REPEATS}", "-o", folder / "world"]
    programs.run("nearmesh-model", *build, "--plan", folder / "jobs.txt")
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        used = list(pool.map(bake_tile, (folder / "jobs.txt").read_text().splitlines()[:-1]))
    programs.run("nearmesh-model", *build)
    return [its.ru_utime + its.ru_stime for its in used], max(its.ru_maxrss for its in used) / 1000


def bake_tile(job):
    """Out: what that took of the system."""
    child = subprocess.Popen(["sh", "-c", job], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode != 0:
        raise RuntimeError(f"{job}: exit code {child.returncode}")
    return used


def rows_of_table(text):
    """The medians and so on of a bench's CSV rows, by what and how many."""
    lines = [line for line in text.splitlines() if line.count(",") == 7 and not line.startswith("#")]
    return {(row["what"], int(row["bodies"]), int(row["tiles"])): {key: float(row[key]) for key in list(row)[3:]}
            for row in csv.DictReader(lines)}


class Table:
    def __init__(self):
        print("| figure | aim | measured | |\n|---|--:|--:|---|")

    def row(self, figure, aim, measured, is_met):
        print(f"| {figure} | {aim} | {measured} | {'met' if is_met else 'missed'} |", flush=True)

    def add(self, figure, aim, measured, unit=""):
        """`aim`: at most so much; of two figures in a row, both."""
        measured, aim = (value if isinstance(value, tuple) else (value,) for value in (measured, aim))
        unit = unit and f" {unit}"
        show = lambda values: " / ".join(f"{value:,.3g}" if value < 1000 else f"{value:,.0f}" for value in values) + unit
        self.row(figure, show(aim), show(measured), all(its <= most for its, most in zip(measured, aim, strict=True)))

    def add_all(self, figure, found, of_all):
        """What must hold of all."""
        self.row(figure, "all", f"{found:,.0f} of {of_all:,.0f}", found == of_all > 0)


def add_bodies(table, programs):
    session = rows_of_table(programs.run("nearmesh-bench-world", "session"))
    one, ten = session["session", 1000, 0], session["session", 10000, 0]
    table.add("1,000 bodies far apart, all pairs watched, an update", 0.2, one["median_us"] / 1e3, "ms")
    table.add("10,000 bodies", 3, ten["median_us"] / 1e3, "ms")
    table.add("worst update / median, 1,000 bodies", 5, one["worst_us"] / one["median_us"])
    broad = rows_of_table(programs.run("nearmesh-bench-world", "broad"))
    ours = broad["broad", 1000, 10000]["median_us"]
    if ("fcl", 1000, 10000) in broad:
        table.add("1,000 bodies x 10,000 tiles, broad phase, ms; against FCL's tree, same run", (0.1, 0.4),
                  (ours / 1e3, ours / broad["fcl", 1000, 10000]["median_us"]))
    else:
        table.add("1,000 bodies x 10,000 tiles, broad phase (FCL is not installed)", 0.1, ours / 1e3, "ms")


def add_flights(table, programs, world):
    low = programs.run("nearmesh-bench-world", "low", world)
    table.add("100 aircraft low over 12,100 tiles, an update, median", 2, number(r"\nlow,\d+,\d+,([\d.]+)", low), "ms")
    memory_kb = {}
    for frames in (200, FIVE_MINUTES, HOUR):
        flight = programs.run("nearmesh-bench-world", "stream", world, frames)
        memory_kb[frames] = number(r"memory ([\d.]+) KB", flight)
        if frames == 200:
            table.add("join of a world of 10^10 faces, before the first tile", 6, number(r"first tile (\d+) bytes", flight) / 1e3, "KB")
            table.add("one low flight of 200 frames over it, KB; the peer's memory, MB", (200, 32),
                      (number(r"frames (\d+) bytes", flight) / 1e3, memory_kb[frames] / 1e3))
        table.add_all(f"a low flight of {frames:,} frames, certified", number(r"(\d+) certified", flight), frames)
    table.add("an hour's low flight: memory at its end / after five minutes", 1.1, memory_kb[HOUR] / memory_kb[FIVE_MINUTES])
    memory = programs.run("nearmesh-bench-world", "memory", world)
    table.add("a near tile at a peer, KB; a far one, B", (170, 21),
              (number(r"near_tile_at_peer,(\d+)", memory) / 1e3, number(r"far_tile_at_peer,([\d.]+)", memory)))
    table.add("a tile at rest at the publisher", 0, number(r"at_rest_at_publisher,([\d.]+)", memory), "B")


def add_bus(table, programs, folder):
    count = programs.run("nearmesh-bench-promises", "count").split("without")[0]
    table.add("poses of 1,000 bodies (100 peers) at each peer, counted", 20, number(r"\nall,,(\d+)", count) / 1e3, "KB/s")
    fly = programs.run("nearmesh-bench-promises", "fly", 8, 10, 20).split("\n")
    live = dict(zip(fly[0].split(","), map(float, ["nan", *fly[1].split(",")[1:]]), strict=True))
    table.add("the same live, 80 bodies of 8 peers, % of a core; lost poses and promises", (1, 0),
              (live["core_percent"], live["lost_poses"] + live["lost_promises"] + live["lost_near"]))
    for figure, most_mb, words in (("200 aircraft", 3, ["--bodies", 200]), ("300 bodies over one terrain", None, ["--bodies", 300, "--ground"]),
                                   ("1,000 far bodies", None, ["--bodies", 1000, "--side", 400])):
        path = folder / "session.db3"
        path.unlink(missing_ok=True)
        text = programs.run("nearmesh-bench-bounds", *words, "-o", path)
        path.unlink()
        table.add_all(f"{figure}, frames in which all was certified", number(r"certified in (\d+)", text), number(r"(\d+) frames in", text))
        table.add_all(f"{figure}, recorded, answers that were free by bounds and are proved", number(r"bounds: (\d+) of", text),
                      number(r"bounds: \d+ of (\d+)", text))
        if most_mb:
            table.add(f"recording of {figure} for 2 s", most_mb, number(r"file: ([\d.]+) MB", text), "MB")
        if figure.startswith("1,000"):
            table.add(f"reports of {figure}, a frame", 60, number(r"report of (\d+) bytes", text), "B")


def add_seams(table, programs):
    tests = programs.folder.parent / "tests" / "unit_core_query"
    for figure, name in (("seam vertices equal under any pose", "EveryVertexOfASeamIsEqualInEveryPose"),
                         ("contacts over seams equal to the merged mesh's", "ContactsOverSeamsAreThoseOfTheMeshEachOnceInEveryPose")):
        done = subprocess.run([tests, f"--gtest_filter=Tiles.{name}"], capture_output=True, text=True, check=False)
        is_met = done.returncode == 0 and "[  PASSED  ] 1 test" in done.stdout
        table.row(f"{figure} (`Tiles.{name}`)", "all", "all" if is_met else "not all", is_met)


def main(words):
    if len(words) != 2:
        sys.exit(__doc__)
    programs, folder = Programs(words[0]), pathlib.Path(words[1]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    start_s = time.monotonic()
    seconds, most_mb = bake(programs, folder)
    table = Table()
    add_bodies(table, programs)
    add_flights(table, programs, folder / "world")
    with tempfile.TemporaryDirectory() as scratch:
        add_bus(table, programs, pathlib.Path(scratch))
    add_seams(table, programs)
    if seconds:
        table.add(f"bake of {len(seconds)} tiles of up to 1 M faces, two processes: a tile, s; a worker's memory, MB", (2.2, 170),
                  (sum(seconds) / len(seconds), most_mb))
    print(f"\nIn {time.monotonic() - start_s:.0f} s.", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
