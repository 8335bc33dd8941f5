#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes docs/perf.md from the CSV files of the benchmarks in docs/perf, and from limits.md beside this file.

Usage: make_page.py docs/perf > docs/perf.md
"""
import csv
import pathlib
import statistics
import sys

HEAD = """# Speed and size

Written by `tests/perf/make_page.py` from the files in [perf](perf); no figure is typed in but in the last section. To make it again (some
fifteen minutes; FCL, Bullet, Embree and CGAL are compared where they are installed):

    bin=build/dev/bin
    $bin/nearmesh-perf -o docs/perf/queries.csv
    $bin/nearmesh-model generate terrain --size 708 -o terrain.ply && $bin/nearmesh-model build terrain.ply -o terrain.spm
    $bin/nearmesh-bench-core terrain.spm > docs/perf/core-terrain.csv
    $bin/nearmesh-bench-bake 1000000 1 > docs/perf/bake-1M-faces-1-thread.csv
    $bin/nearmesh-bench-bake 10000000 2 > docs/perf/bake-10M-faces-2-threads.csv
    $bin/nearmesh-bench-bytes MODEL.spm 0.05 > docs/perf/bytes-MODEL.csv       # terrain: 0.02, the largest with --flight
    python3 tests/perf/make_page.py docs/perf > docs/perf.md
"""

QUERIES = """## Queries

Medians of all poses, microseconds, the least of three calls each, one thread. nearmesh answers on a replica that holds what
the pose needs and no more, certificate included; the others hold the full meshes, posed and built beforehand (Embree has no
transforms: it re-places the moving body, and that is in its time). In brackets: the ratio to nearmesh's time. All answers
were compared first and agree, number of pairs included, but for Bullet's pairs (its test of triangles is an approximate one).
`sphere` is 4,096 faces against itself, `bunny` 39,787; a number after the name is the distance in units of that of first
contact, `near_miss` 1.00001, `grazing` 0.9999. `terrain1m` is a flight of an aircraft of 8,000 faces, low over a million.
"""

REFINING = """## A frame in which detail arrives

The same flight, from the base mesh on: splits that a frame's pose needs are done, the tree follows, one query of all pairs.
Medians of the frames in which something arrived, each measured once and in passing, microseconds.
"""


def read(path):
    with open(path, newline="") as file:
        lines = [line for line in file if not line.startswith("#")]
    return list(csv.DictReader(lines, fieldnames=None if lines[0].startswith("workload") else ("metric", "value", "unit")))


def comments(path):
    with open(path) as file:
        return [line[2:].strip() for line in file if line.startswith("# ")]


def short(value):
    return f"{value:,.0f}" if value >= 100 or value == int(value) else f"{value:.3g}"


def queries(path):
    times = {}
    for row in read(path):
        times.setdefault((row["workload"], row["metric"]), {}).setdefault(row["contender"], []).append(float(row["value"]))
    times = {key: {who: statistics.median(v) for who, v in value.items()} for key, value in times.items()}
    others = []
    for value in times.values():
        others += [who for who in value if who != "nearmesh" and who not in others]
    print(QUERIES)
    print("| | nearmesh | " + " | ".join(others) + " |")
    print("|---|--:|" + "--:|" * len(others))
    for metric, title in (("first_contact_median", "first contact, or none"), ("first_contact_p95", "first contact, or none, 95th percentile"),
                          ("all_pairs_median", "all pairs")):
        for (workload, at), value in times.items():
            if at != metric or "refining" in workload or (metric.endswith("p95") and not workload.startswith("terrain")):
                continue
            cells = [f"{short(value[who])} ({short(value[who] / value['nearmesh'])})" if who in value else "" for who in others]
            print(f"| {workload.replace('/', ' ')}: {title} | **{short(value['nearmesh'])}** | " + " | ".join(cells) + " |")
    print("\n" + REFINING)
    print("| | |\n|---|--:|")
    for (workload, metric), value in times.items():
        if "refining" in workload:
            print(f"| {workload.split('/')[0]} {metric.replace('_median', '').replace('_', ' ')} | {short(value['nearmesh'])} |")
    for line in comments(path):
        print(f"\n{line}", end="")
    print("\n")


def plain(title, paths):
    if not paths:
        return
    tables = {path.stem.split("-", 1)[1]: {r["metric"]: r for r in read(path)} for path in paths}
    metrics = []
    for table in tables.values():
        metrics += [metric for metric in table if metric not in metrics and metric != "content_hash"]
    print(f"## {title}\n\n| | " + " | ".join(name.replace("-", " ") for name in tables) + " | unit |")
    print("|---|" + "--:|" * len(tables) + "---|")
    for metric in metrics:
        unit = next(table[metric]["unit"] for table in tables.values() if metric in table)
        cells = [short(float(table[metric]["value"])) if metric in table else "" for table in tables.values()]
        print(f"| {metric.replace('_', ' ')} | " + " | ".join(cells) + f" | {unit} |")
    print()


def main():
    folder = pathlib.Path(sys.argv[1])
    print(HEAD)
    queries(folder / "queries.csv")
    plain("Codec, refinement, tree", sorted(folder.glob("core-*.csv")))
    plain("Baking and opening", sorted(folder.glob("bake-*.csv")))
    plain("Bytes to certify, and a peer's memory", sorted(folder.glob("bytes-*.csv")))
    print(pathlib.Path(__file__).with_name("limits.md").read_text(), end="")


if __name__ == "__main__":
    main()
