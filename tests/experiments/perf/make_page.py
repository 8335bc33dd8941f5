#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes docs/perf.md from the CSV files of the benchmarks in docs/perf, and from terrain.md.in and limits.md beside this file.

Usage: make_page.py docs/perf > docs/perf.md
"""
import csv
import pathlib
import statistics
import sys

HEAD = """# Speed and size

For whoever asks whether nearmesh is fast and small enough: aims and what was measured, the frame that a host waits for, times beside
PQP, FCL, Coal, Bullet, Embree and CGAL, bytes, baking, and what stands in the way of the aims that are missed.
"""

QUERIES = """## Queries

Microseconds, one thread: medians of all poses, the least of three calls each (of one, where that takes more than 10 ms). In brackets: the
ratio to nearmesh's time.

* **nearmesh** answers on a replica that holds what these poses need and no more, certificate included. No distance is asked for: see below.
* **The others** hold the full meshes, posed and built beforehand. Embree has no transforms: it re-places the moving body, and that
  is in its time.
* **All answers agree**, number of pairs included, but for those of two whose tests of triangles are approximate: Bullet's pairs, and Coal's in 75 of
  some 600 poses: 11 of 25 near misses of bunnies are contacts to it.

`sphere` is 4,096 faces against itself, `bunny` 39,787. A number after the name is the distance in units of that of first contact;
`near_miss` is 1.00001, `grazing` 0.9999. `terrain1m` is a flight of an aircraft of 8,000 faces, low over a million faces.

{measured}
"""

DISTANCES = """## Distances

How far apart are they? The same poses, where the bodies are free; microseconds as above.

* **nearmesh** goes on to the end and gives a bracket whose width is rounding, with all detail held.
* **The others** give one number. PQP begins each search anew, as after a jump: from frame to frame it would begin with the last pair.
* **Bullet and Embree** have no column: they answer no distance of two meshes. Bullet's distances are those of convex shapes; of its meshes (GImpact) it tells contacts.
* **Bounds** are what a session asks for in each frame: a search that ends when it has three quarters of what is known to be there at most, or
  after 256 steps. *Share* is the median of bound to distance, *cut* the poses in which the steps ended it. On *least detail* nothing
  is held but what certifies.
"""

FRAMES = """## The frame of a session

What a host waits for: all of `Session::update` of one peer with the default options, reports, bounds and looking ahead included, over a channel
without a network. Microseconds of this thread's processor time, without what the publisher does in the same thread, which stands in a column of its own.

* `flight`: so many aircraft of 8,000 faces in a square, 100 m apart, at 60 m/s up to 15 m above a terrain of a million faces, into it now and
  then; pairs by `watch_all()`. `touching`: one that always touches. `lying`: 40 in the ground, where they stay.
* `named`: 40 of them, all 820 pairs watched by name, 100 m apart or 15 m one behind the other, into each other.
* `bunny_near_miss`: one of two goes from a near miss 0.01 % of its size away in each frame.
* *Detail*: what the session asks for from the base mesh on (after half a second of flight), or all of it, held from the start. *Pairs* are answers a
  frame, all others are proved free by boxes; of these so many *touch*, and *spared* are those that need no query: free by the bound said
  last, or lying still.
"""

PROBES = """## Probes

10,000 heights above a million faces take {least:.1f} to {most:.1f} ms. Below are milliseconds for 10,000 [probes](answers.md#probes) of a
terrain that is held as a whole, one thread, medians of 21 batches, and the share of rays that hit.

* **nearmesh** says for certain which face comes first, in whatever pose the body is.
* **Embree** rounds to floats and gives no certificate; the body lies in the world's place, and nothing is posed. Packets are of 8 rays.
"""

WAY_OUT = """## The way out

Two spheres of {sphere:,} faces and two bunnies of {bunny:,} that touch, each held whole by a peer, in random directions and turns; one thread, microseconds,
medians of the poses. nearmesh says how far b must be moved along one direction ([depth](answers.md#depth)), after one query. The others tell a depth and a normal of each pair of
triangles: b is pushed along the deepest, they are asked again, and so on until they say that nothing touches, at most twenty times. *Free* counts the poses in which
b is then free of a by the exact query over all faces, after the first push and in the end. *Length* is that of the way, to nearmesh's. *Time* is that of the first answer.
"""

REFINING = """## Detail arrives

The same flight, from the base mesh on: the splits that a frame's pose needs are done (T R), the tree follows (T B), one query finds
all pairs (T Q), without a distance. Medians of the frames in which something arrived, each measured once and in passing, microseconds.
"""


AIMS = """## Aims

Bare numbers are ratios of nearmesh's time to that of FCL's OBB trees over the full meshes in the same run (of distances to its OBBRSS trees), or of
the library that is named. The sections below say what each row measures.
"""

# What is counted, of the tables that have a row for each metric of a CSV file; other names stand as they are.
NAMES = {
    "open": "open a file", "load_all": "load all of a model", "collapse_all": "collapse all", "split_id_order": "split all, in order of ids",
    "split_random_order": "split all, in random order", "split_arrival_order": "split all, in order of arrival",
    "collapse_reverse_order": "collapse all, one by one in reverse", "replica_apply": "decode, split and follow with the tree",
    "tree_update": "tree: faces rebuilt", "tree_update_per_split": "tree: time a split", "tree_bytes_per_face": "tree: memory a held face",
    "bake": "all of it, by the clock", "bake_processor_time": "all of it, processor time", "peak_resident": "peak memory", "split": "file, a split",
    "forest_depth": "depth of the forest", "forest_depth_mean": "mean depth of the forest",
    "resident_after_open": "memory after opening", "private_after_open": "... not shared", "first_request": "answer the first request",
    "first_request_splits": "its splits", "resident_after_request": "memory after it", "private_after_request": "... not shared"}
TENTH = {
    "faces": "faces", "mean_error": "mean error", "rms_error": "root mean square error", "greatest_error": "greatest error",
    "self_intersecting": "faces that meet others", "turned_down": "faces that look down", "non_manifold": "edges of more than two faces"}
LEFT_OUT = ("content_hash", "meshoptimizer", "touching_least_requests", "touching_least_request_bytes")  # a name; what has no requests
REQUESTS = {
    "splits_per_request": "splits a request", "bytes_per_split": "bytes a split", "bytes_per_split_records": "... of records",
    "bytes_per_split_boxes": "... of boxes", "bytes_per_split_heads": "... of heads", "encode": "encode", "decode": "decode",
    "batches_per_request": "batches a request", "attach_per_batch_if_largest_first": "nodes that a batch would name, were splits sorted by size"}
COSTS = {
    "answer": "publisher's processor time", "mirror": "publisher's memory of the peer", "mirror_asleep": "... when not used of late",
    "lean_bytes": "bytes on a wire of least framing", "wire_bytes": "bytes on the wire", "payload": "bytes of batches", "splits": "splits",
    "batches": "batches", "requests": "requests", "request_bytes": "bytes of requests", "rounds": "round trips",
    "frame_p99": "bytes of a frame, 99th percentile", "frame_worst": "bytes of the worst frame", "before": "peer's memory before it",
    "resident": "peer's memory after it", "peak": "peer's memory, peak", "tree": "peer's tree", "exact_faces": "peer's exact faces"}
for whose, said_first in (("", "at a tenth of the vertices"), ("meshoptimizer_", "meshoptimizer")):
    NAMES.update({f"{whose}{key}_at_10_percent": f"{said_first}: {said}" for key, said in TENTH.items()})
NAMES["meshoptimizer_simplify"] = "meshoptimizer: simplify, processor time"
for size in ("small", "large"):
    NAMES.update({f"{size}_{key}": f"{size} requests: {said}" for key, said in REQUESTS.items()})
for kind, said_first in (("touching", "pose"), ("touching_least", "pose, without half-spaces"), ("flight", "flight")):
    NAMES.update({f"{kind}_{key}": f"{said_first}: {said}" for key, said in COSTS.items()})

CORE = """Each step of a peer and a publisher by itself, one thread: decoding, refining, following with the tree. *Small requests* ask for all detail in a
cube about a random vertex, a 128th of the model's grid wide, from the base mesh; those of *large* ones are a 16th wide. *Records* are what a split adds to the mesh, *heads* what a batch costs beside its splits.
"""
BAKING = """`nearmesh-model build` of a generated terrain, step by step. Errors are in diagonals of the model's box, from the centres of all
faces of the full mesh. *meshoptimizer* leaves as many faces, measured alike; it keeps no record of what it does.
"""
BYTES = """A ball of 1,280 faces is set down until it touches, in 45 places, each time from the base mesh on (*pose*: means of a place). On the largest terrain it also
slides along the ground for 200 frames (*flight*). *Without half-spaces* are exactly the splits that the answer needs where no half-space is told. *Bytes on
the wire* are those of batches with the framing of ours, *least framing* takes 76 bytes a batch. Requests are counted apart.
"""

LIBRARIES = ("PQP", "FCL", "Coal", "Bullet", "Embree", "CGAL")

AGAIN = """
## To measure again

Tables are written by `tests/experiments/perf/make_page.py` from the files in [perf](perf); the two sections above by hand, in
`terrain.md.in` and `limits.md` beside it. It takes some fifteen minutes. FCL, Bullet, Embree, CGAL and meshoptimizer are compared where they are installed;
PQP and Coal, which Debian has not, where CMake is told of a built copy (`-DPQP_DIR=`, `-Dcoal_DIR=`); a newer meshoptimizer alike (`-Dmeshoptimizer_DIR=`).

    cmake --build --preset dev --target experiments nearmesh-model    # programs that are run by hand are not in `all`
    bin=build/dev/bin
    $bin/nearmesh-perf --workload sphere bunny terrain1m -o docs/perf/queries.csv               # terrain8m, too: 11 GB
    $bin/nearmesh-perf --workload frames -o docs/perf/frames.csv
    $bin/nearmesh-model generate terrain --size 708 -o terrain.ply && $bin/nearmesh-model build terrain.ply -o terrain.spm
    $bin/nearmesh-bench-probe > docs/perf/probes.csv                            # of six runs the least disturbed
    $bin/nearmesh-bench-solver BUNNY.obj > docs/perf/solver.csv
    $bin/nearmesh-bench-core terrain.spm > docs/perf/core-terrain.csv           # of twelve runs the least disturbed
    $bin/nearmesh-bench-bake 1000000 1 > docs/perf/bake-1M-faces-1-thread.csv
    $bin/nearmesh-bench-bake 10000000 2 > docs/perf/bake-10M-faces-2-threads.csv                 # and 30000000
    $bin/nearmesh-bench-bytes MODEL.spm 0.05 > docs/perf/bytes-MODEL.csv       # terrain: 0.02, the largest with --flight;
                                                                                # generate terrain --size 512 and 1024, --seed 42
    python3 tests/experiments/perf/make_page.py docs/perf > docs/perf.md
"""

MB = 1 << 20


def errors_to_meshoptimizer(bake):
    if "meshoptimizer" not in bake:
        return []
    ratios = [float(bake[f"{which}_error_at_10_percent"]) / float(bake[f"meshoptimizer_{which}_error_at_10_percent"])
              for which in ("mean", "greatest")]
    return [(f"its mean / greatest error, to meshoptimizer's ({bake['meshoptimizer']}) with as many faces", "at most", [1, 1.3], ratios)]


def aims(folder):
    """What is aimed at, in the words of the table below, with a figure each for what was measured."""
    times = query_times(folder / "queries.csv")
    frames = query_times(folder / "frames.csv")
    table = {path.stem: {row["metric"]: row["value"] for row in read(path)} for path in folder.glob("*-*.csv")}

    def ratio(workload, metric):
        at = times[workload, metric]
        return at["nearmesh"] / at["fcl-obb"]

    def core(metric):
        return [float(table[model][metric]) for model in ("core-armadillo", "core-terrain")]

    def codec(metric):
        return [value for size in ("small", "large") for value in core(f"{size}_{metric}")]

    def size(model, metric):
        return float(table["bytes-" + model][metric])

    def bake(model, metric):
        return float(table["bake-" + model][metric])

    def apart(model):
        return [float(table["core-" + model][f"{n}_bytes_per_split"]) - float(table["core-" + model][f"{n}_bytes_per_split_boxes"])
                for n in ("small", "large")]

    def frame(workload, metric, unit=1):
        return frames[workload, metric]["nearmesh"] / unit

    refining = times["terrain1m/refining", "T_R+T_B+T_Q_median"]["nearmesh"] / times["terrain1m/flight", "all_pairs_median"]["fcl-obb"]
    million, ten = "1M-faces-1-thread", "10M-faces-2-threads"
    models = ("bunny", "armadillo", "terrain-263k-vertices", "terrain-1M-vertices")
    flight = "terrain-1M-vertices"
    heights = [value["nearmesh"] for (faces, name), value in probe_times(folder / "probes.csv")[0].items()
               if faces > 1e6 and name.startswith("heights")]
    rows = []
    for metric, what in (("first_contact", "first contact"), ("all_pairs", "all pairs"), ("distance", "exact distance")):
        for who, at_most in slowest(times, metric):
            rows.append((f"{what}, to {who}", "at most", [1], [at_most]))
    if "pqp" in times["sphere/near_miss", "first_contact_median"]:
        at = times["sphere/near_miss", "first_contact_median"]
        rows.append(("sphere near miss, first contact, to PQP", "at most", [0.45], [at["nearmesh"] / at["pqp"]]))
    rows += [("frame: aircraft over a terrain, 100 Hz, mean / p99, us", "at most", [80, 400],
              [frame("flight_1/100hz/least", "mean"), frame("flight_1/100hz/least", "p99")]),
             ("the same, touching, 1,000 Hz, mean, us", "at most", [60], [frame("touching/1000hz/least", "mean")]),
             ("frame: bunny near miss, 100 Hz, mean, us", "at most", [60], [frame("bunny_near_miss/100hz/least", "mean")]),
             ("frame: 40 aircraft 100 m apart, 820 pairs, mean / worst, ms", "at most", [0.5, 2],
              [frame("named_100m/100hz/least", "mean", 1000), frame("named_100m/100hz/least", "worst", 1000)]),
             ("frame: 40 aircraft 15 m apart, 820 pairs, mean, ms", "at most", [8], [frame("named_15m/100hz/least", "mean", 1000)])]
    rows += [("sphere near miss, first contact", "at most", [0.10], [ratio("sphere/near_miss", "first_contact_median")]),
            ("bunny grazing / deep, all pairs", "at most", [0.12, 0.10],
             [ratio("bunny/grazing", "all_pairs_median"), ratio("bunny/deep_0.5", "all_pairs_median")]),
            ("terrain of 1 M faces, 95th percentile of first contact", "at most", [0.15], [ratio("terrain1m/flight", "first_contact_p95")]),
            ("splits, tree and one query where detail arrives, to FCL's query alone", "at most", [1], [refining]),
            ("tree update, armadillo / terrain, M faces/s", "at least", [8, 8], core("tree_update")),
            ("splits / collapses in order of arrival, terrain, M/s", "at least", [10, 10],
             [core("split_arrival_order")[1], core("collapse_reverse_order")[1]]),
            ("encoding, small requests (armadillo, terrain), large ones, M splits/s", "at least", [3] * 4, codec("encode")),
            ("decoding, the same, M splits/s", "at least", [10] * 4, codec("decode")),
            ("bytes a split without boxes, armadillo, small / large", "at most", [8, 8], apart("armadillo")),
            ("the same, terrain", "at most", [5, 5], apart("terrain")),
            ("boxes, bytes a split, as decoding", "at most", [1] * 4, codec("bytes_per_split_boxes")),
            ("bytes to certify a touching pose: bunny, armadillo, terrain of 263 k and 1 M vertices", "at most",
             [1300, 1800, 1000, 1800], [size(m, "touching_lean_bytes") for m in models]),
            ("flight over 1 M vertices, KB in all / in the worst frame", "at most", [500, 10],
             [size(flight, "flight_lean_bytes") / 1000, size(flight, "flight_frame_worst") / 1000]),
            ("a peer's memory after it, MB", "at most", [64], [size(flight, "flight_resident")]),
            ("tree, armadillo / terrain, bytes a face", "at most", [100, 100], core("tree_bytes_per_face")),
            ("header, terrain of 1 M / 10 M faces, KB", "at most", [8, 32], [bake(million, "header") / 1024, bake(ten, "header") / 1024]),
            ("bake 1 M faces on one thread, s / MB", "at most", [1, 200], [bake(million, "bake"), bake(million, "peak_resident") / MB]),
            ("a tenth of its faces: those that meet others / that look down / edges of more than two", "at most", [5, 50, 0],
             [bake(million, f"{fault}_at_10_percent") for fault in ("self_intersecting", "turned_down", "non_manifold")]),
            ("bake 10 M faces on two threads, s / GB", "at most", [40, 3], [bake(ten, "bake"), bake(ten, "peak_resident") / 1024 / MB]),
            *errors_to_meshoptimizer(table["bake-" + million]),
            ("open a file of 10 M faces, ms", "at most", [50], [bake(ten, "open")]),
            ("10,000 heights above a terrain of 1 M faces, ms, the slowest of three kinds", "at most", [5], [max(heights)])]
    print(AIMS)
    print("| | aim | measured | |\n|---|--:|--:|---|")
    for what, bound, aim, found in rows:
        met = [f <= a if bound == "at most" else f >= a for f, a in zip(found, aim, strict=True)]
        wanted = aim[:1] if len(set(aim)) == 1 else aim
        state = "met" if all(met) else "partly" if any(met) else "missed"
        print(f"| {what} | {bound} {' / '.join(map(short, wanted))} | {' / '.join(map(short, found))} | {state} |")
    print()


def read(path):
    with open(path, newline="") as file:
        lines = [line for line in file if not line.startswith("#")]
    return list(csv.DictReader(lines, fieldnames=None if lines[0].startswith("workload") else ("metric", "value", "unit")))


def comments(path):
    with open(path) as file:
        return [line[2:].strip() for line in file if line.startswith("# ")]


def short(value):
    return f"{value:,.0f}" if value >= 100 or value == int(value) else f"{value:.3g}"


def query_times(path):
    times = {}
    for row in read(path):
        times.setdefault((row["workload"], row["metric"]), {}).setdefault(row["contender"], []).append(float(row["value"]))
    return {key: {who: statistics.median(v) for who, v in value.items()} for key, value in times.items()}


def slowest(times, metric):
    """The greatest ratio of nearmesh's median to each library's, of all rows."""
    ratios = {}
    for (workload, at), value in times.items():
        for who, name in (("pqp", "PQP"), ("fcl-obbrss" if metric == "distance" else "fcl-obb", "FCL"), ("coal-obbrss", "Coal")):
            if at == metric + "_median" and who in value:
                ratios.setdefault(name, []).append(value["nearmesh"] / value[who])
    return [(f"{name}'s: the slowest of {len(found)} rows, of which {sum(x > 1 for x in found)} above 1", max(found)) for name, found in ratios.items()]


def summary(folder):
    """How many times as fast as FCL's OBB trees, in one sentence."""
    near, apart = [], []
    for (workload, metric), at in query_times(folder / "queries.csv").items():
        if metric.endswith("median") and "fcl-obb" in at and "refining" not in workload:
            (apart if "/apart" in workload else near).append(at["fcl-obb"] / at["nearmesh"])
    print(f"Where bodies touch or nearly do, queries are {short(min(near))} to {short(max(near))} times as fast as FCL's OBB trees over "
          f"the full meshes; where they are apart,\n{short(min(apart))} to {short(max(apart))} times.\n")


def queries(path):
    times = query_times(path)
    others = []
    for value in times.values():
        others += [who for who in value if not who.startswith("nearmesh") and who not in others]
    absent = [name for name in LIBRARIES if not any(who.startswith(name.lower()) for who in others)]
    print(QUERIES.format(measured=f"Not installed when this was measured: {', '.join(absent)}." if absent else "All of them were installed when this was measured."))
    print("| | nearmesh | " + " | ".join(others) + " |")
    print("|---|--:|" + "--:|" * len(others))
    for metric, title in (("first_contact_median", "first contact, or none"), ("first_contact_p95", "first contact, or none, 95th percentile"),
                          ("all_pairs_median", "all pairs")):
        for (workload, at), value in times.items():
            if at != metric or "refining" in workload or (metric.endswith("p95") and not workload.startswith("terrain")):
                continue
            cells = [f"{short(value[who])} ({short(value[who] / value['nearmesh'])})" if who in value else "" for who in others]
            print(f"| {workload.replace('/', ' ')}: {title} | **{short(value['nearmesh'])}** | " + " | ".join(cells) + " |")
    distances(times, others)
    print("\n" + REFINING)
    print("| | |\n|---|--:|")
    for (workload, metric), value in times.items():
        if "refining" in workload:
            print(f"| {workload.split('/')[0]} {metric.replace('_median', '').replace('_', ' ')} | {short(value['nearmesh'])} |")
    where(path)


def where(path):
    """On which machine, by which build and of which commit a file was measured."""
    print("\n" + "\n".join(f"* {' '.join(line.split())}" for line in comments(path)) + "\n")


def distances(times, others):
    others = [who for who in others if any(at == "distance_median" and who in value for (_, at), value in times.items())]
    others = [who for who in others if not who.startswith("nearmesh")]
    print("\n" + DISTANCES)
    print("| | nearmesh | " + " | ".join(others) + " | bound | share | cut | least detail | share | cut |")
    print("|---|--:|" + "--:|" * len(others) + "--:|" * 6)
    outside = {}
    for (workload, at), value in times.items():
        if at == "distance_outside":
            for who, count in value.items():
                outside[who] = outside.get(who, 0) + count
        if at != "distance_median":
            continue
        cells = [f"{short(value[who])} ({short(value[who] / value['nearmesh'])})" if who in value else "" for who in others]
        poses = times[workload, "distance_poses"]["nearmesh"]
        for who in ("nearmesh-bound", "nearmesh-bound-least"):
            cells += [short(value[who]), f"{100 * times[workload, 'distance_share'][who]:.0f} %",
                      f"{times[workload, 'distance_cut'][who]:.0f} of {poses:.0f}"]
        print(f"| {workload.replace('/', ' ')} | **{short(value['nearmesh'])}** | " + " | ".join(cells) + " |")
    wrong = ", ".join(f"{who} {count:.0f}" for who, count in outside.items() if count)
    print("\nOutside nearmesh's bracket by more than a lattice cell: " + (wrong + " poses." if wrong else "none of the others' numbers."))


def frames(path):
    times = query_times(path)
    print(FRAMES)
    print("| scene | rate | detail | pairs | touch | spared | mean | median | p99 | worst | publisher |")
    print("|---|--:|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    for (workload, at), value in times.items():
        if at != "mean":
            continue
        scene, rate, detail = workload.split("/")
        cells = [short(times[workload, metric]["nearmesh"]) for metric in ("median", "p99", "worst", "publisher")]
        counts = [f"{times[workload, metric]['nearmesh']:.{1 if scene.endswith('_1') else 0}f}" for metric in ("pairs", "touching", "spared")]
        print(f"| {scene} | {rate[:-2]} | {detail} | " + " | ".join(counts) + f" | **{short(value['nearmesh'])}** | " + " | ".join(cells) + " |")
    asked = sum(times[w, "pairs"]["nearmesh"] for (w, at) in times if at == "mean")
    certified = sum(times[w, "pairs"]["nearmesh"] * value["nearmesh"] for (w, at), value in times.items() if at == "certified")
    print(f"\nOf all answers {100 * certified / asked:.3f} % are certified in their frame.")
    where(path)


def probe_times(path):
    """By faces and probes, milliseconds by who; hits; answers that differ."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    times, hits, differ = {}, {}, 0
    for row in rows:
        if row["median_ms"]:
            times.setdefault((int(row["faces"]), row["probes"]), {})[row["who"]] = float(row["median_ms"])
            hits[int(row["faces"]), row["probes"]] = int(row["hits"])
        else:
            differ += int(row["hits"])
    return times, hits, differ


def probes(path):
    times, hits, differ = probe_times(path)
    whos = list(next(iter(times.values())))
    heights = [value["nearmesh"] for (faces, name), value in times.items() if faces > 1e6 and name.startswith("heights")]
    print(PROBES.format(least=min(heights), most=max(heights)))
    print("| faces | | hits | " + " | ".join(whos) + " |\n|--:|---|--:|" + "--:|" * len(whos))
    for (faces, name), value in times.items():
        cells = [f"{value[who]:.2f}" for who in whos]
        print(f"| {faces:,} | {name} | {hits[faces, name] / 100:.0f} % | **{cells[0]}** | " + " | ".join(cells[1:]) + " |")
    for who in whos[2:]:
        shares = [value[who] / value["nearmesh"] for value in times.values()]
        print(f"\n{who[0].upper()}{who[1:]}, takes {min(shares):.2f} to {max(shares):.2f} of nearmesh's time.", end="")
    if whos[2:]:
        print(f" Of {len(times) * 10_000:,} answers {differ or 'none'} differ{'' if differ > 1 else 's'} from Embree's by more than 5 cm.")
    print()


def solver(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    table = {}
    for row in rows:
        table.setdefault(row["scene"], {}).setdefault(row["who"], {})[row["what"]] = float(row["value"])
    faces = {scene: int(whos["mesh"]["faces"]) for scene, whos in table.items() if "mesh" in whos}
    print(WAY_OUT.format(**faces))
    print("| scene | | free at once | in the end | pushes | length | time |\n|---|---|--:|--:|--:|--:|--:|")
    for scene, whos in table.items():
        for who, at in whos.items():
            if "way_out_us" in at:
                print(f"| {scene} | {who} | {at['free_at_once']:.0f} of {at['poses']:.0f} | {at['free_in_the_end']:.0f} | {at['pushes']:.0f} | "
                      f"{at['length_ratio']:.2f} | {at['way_out_us']:.0f} |")
    print()


def plain(title, about, paths):
    if not paths:
        return
    tables = {path.stem.split("-", 1)[1]: {r["metric"]: r for r in read(path)} for path in paths}
    metrics = []
    for table in tables.values():
        metrics += [metric for metric in table if metric not in metrics and metric not in LEFT_OUT]
    print(f"## {title}\n\n{about}\n| | " + " | ".join(name.replace("-", " ") for name in tables) + " | unit |")
    print("|---|" + "--:|" * len(tables) + "---|")
    for metric in metrics:
        unit = next(table[metric]["unit"] for table in tables.values() if metric in table)
        cells = [short(float(table[metric]["value"])) if metric in table else "" for table in tables.values()]
        print(f"| {NAMES.get(metric, metric.replace('_', ' '))} | " + " | ".join(cells) + f" | {unit} |")
    print()


def main():
    folder = pathlib.Path(sys.argv[1])
    print(HEAD)
    summary(folder)
    aims(folder)
    frames(folder / "frames.csv")
    queries(folder / "queries.csv")
    probes(folder / "probes.csv")
    solver(folder / "solver.csv")
    plain("Codec, refinement, tree", CORE, sorted(folder.glob("core-*.csv")))
    plain("Baking and opening", BAKING, sorted(folder.glob("bake-*.csv")))
    plain("Bytes to certify, and a peer's memory", BYTES, sorted(folder.glob("bytes-*.csv")))
    for section in ("terrain.md.in", "limits.md"):
        print(pathlib.Path(__file__).with_name(section).read_text(), end="")
    print(AGAIN, end="")


if __name__ == "__main__":
    main()
