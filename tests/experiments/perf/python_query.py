#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What Python adds: Pair.query beside `nearmesh-model query` on the same models and poses.
Usage: PYTHONPATH=build/dev/python python_query.py PROGRAM [POSES] [ROUNDS]

Prints, for each scene, microseconds of processor time a pose. Each is measured with POSES poses (10,000) and with twice as many, and the
difference divided by POSES: so starting, opening files and what the first poses need drop out. Of ROUNDS (5) the median. The program reads
a table and prints a line for each pose, Python has arrays.
"""
import csv
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

import nearmesh as nm

NAMES = [f"{body}_{name}" for body in "AB" for name in [*(f"R{i}{j}" for i in range(3) for j in range(3)), "T0", "T1", "T2"]]


def turns(count, random):
    """Rotations, evenly spread: of normalised quaternions."""
    w, x, y, z = (q := random.normal(size=(count, 4))).T / np.linalg.norm(q, axis=1)
    return np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w), 1 - 2 * (x * x + z * z),
                     2 * (y * z - x * w), 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1).reshape(-1, 3, 3)


def poses(count, near_m, far_m, seed):
    """Of b about a, which turns too: from touching to apart."""
    random = np.random.default_rng(seed)
    a, b = np.tile(np.eye(4), (2, count, 1, 1))
    a[:, :3, :3], b[:, :3, :3] = turns(count, random), turns(count, random)
    way = random.normal(size=(count, 3))
    b[:, :3, 3] = way / np.linalg.norm(way, axis=1)[:, None] * random.uniform(near_m, far_m, size=(count, 1))
    return a, b


def write_poses(path, a, b):
    with open(path, "w", newline="") as out:
        table = csv.writer(out)
        table.writerow(["id", *NAMES])
        for i, (m, n) in enumerate(zip(a, b)):
            table.writerow([i, *(repr(float(x)) for t in (m, n) for x in (*t[:3, :3].flat, *t[:3, 3]))])


def of_program(program, model, table, method):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    printed = subprocess.run([program, "query", model, model, "--poses", table, "--method", method, "--json"],
                             check=True, capture_output=True, text=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, printed.count('"contact"')


def of_python(model, a, b):
    start = time.process_time()
    pair = nm.Pair(nm.Model(str(model)), nm.Model(str(model)))
    rows = pair.query(a, b, clearance="none")
    return time.process_time() - start, int((rows["status"] == nm.Status.CONTACT).sum())


def main():
    program = str(pathlib.Path(sys.argv[1]).absolute())
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 10_000
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    print("scene,poses,touching,program_certified_us,program_full_us,python_us,python_to_full")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for kind, size, radius_m in ("sphere", 32, 1), ("aircraft", 2000, 15):
            mesh, model = folder / f"{kind}.ply", folder / f"{kind}.spm"
            subprocess.run([program, "generate", kind, "--size", str(size), "-o", mesh], check=True, capture_output=True)
            subprocess.run([program, "build", mesh, "-o", model], check=True, capture_output=True)
            a, b = poses(2 * count, radius_m, 2.2 * radius_m, 1)
            tables = folder / "some.csv", folder / "all.csv"
            write_poses(tables[0], a[:count], b[:count])
            write_poses(tables[1], a, b)
            seconds = {"certified": [], "full": [], "python": []}
            for _ in range(rounds):  # one after the other, so that all meet the same load
                touching = set()
                for method in "certified", "full":
                    some, _ = of_program(program, model, tables[0], method)
                    every, touch = of_program(program, model, tables[1], method)
                    seconds[method].append((every - some) / count)
                    touching.add(touch)
                some, _ = of_python(model, a[:count], b[:count])
                every, touch = of_python(model, a, b)
                seconds["python"].append((every - some) / count)
                touching.add(touch)
                assert len(touching) == 1, f"they differ: {touching}"
            us = {who: 1e6 * statistics.median(times) for who, times in seconds.items()}
            print(f"{kind},{count},{touching.pop()},{us['certified']:.2f},{us['full']:.2f},{us['python']:.2f},"
                  f"{us['python'] / us['full']:.3f}", flush=True)


main()
