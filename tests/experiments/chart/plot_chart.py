#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws a run of nearmesh-chart as SVG and PNG, and its tables as Markdown.

Usage: plot_chart.py DIR [DOCS]
Reads DIR/{rows,models,about}.csv (columns: play.hpp); writes the pictures and tables.md beside them. With DOCS, copies the
SVGs to DOCS/results/ and replaces what stands between <!-- table NAME --> and <!-- end --> in DOCS/results.md.
"""
import collections
import csv
import math
import pathlib
import re
import shutil
import statistics
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

STYLES = {  # method: name in legends, colour, line
    "certified": ("nearmesh, certified batches", "#0b6e4f", "-"),
    "clusters-checked": ("rival: clusters, client checks", "#c1121f", "-"),
    "clusters-chosen": ("rival: clusters and half-spaces, server chooses, client checks", "#c1121f", "--"),
    "certified-ahead": ("nearmesh, certified, looking ahead", "#0b6e4f", "-"),
    "clusters-chosen-ahead": ("rival: clusters and half-spaces, server chooses and looks ahead, client checks", "#c1121f", "--"),
    "triangles-trusted": ("rival: triangles, server's word", "#f08a24", "--"),
    "grid8-hoppe": ("paper: 8³ grid, Hoppe closure (reconstruction)", "#264aa8", "-"),
    "grid8": ("8³ grid, ancestor closure", "#5d83de", "--"),
    "grid16": ("16³ grid", "#8fb0ee", "-."),
    "grid32": ("32³ grid", "#a9c7f7", ":"),
    "global": ("global refinement", "#6b6b6b", "--"),
    "static-full": ("whole mesh", "#000000", ":"),
    "certified-least": ("certified, split by split, many round trips", "#0b6e4f", ":"),
    "static": ("static levels (five sizes)", "#000000", "o"),
    "libraries": ("FCL, Bullet, Embree, CGAL: whole mesh", "#8e44ad", "s"),
}
NAMES = {"static-1/16": "a level of a sixteenth", "fcl-obb": "FCL, whole mesh", "embree-collide": "Embree, whole mesh"}  # of bars
SHORT = {"clusters-chosen": "rival: chosen by the server, client checks"}
STATIC = ["static-1/256", "static-1/64", "static-1/16", "static-1/4", "static-full"]
LIBRARIES = ["fcl-obb", "fcl-obbrss", "bullet-gimpact", "embree-collide", "cgal-exact"]
RIVALS = ["clusters-checked", "clusters-chosen", "triangles-trusted"]
MAIN = ["certified"] + RIVALS + ["grid8-hoppe", "global"]
PAPER_AND_LEVELS = ["grid8-hoppe", "grid8", "grid16", "grid32", "global"] + STATIC


class Run:
    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        read = lambda name: list(csv.DictReader(open(self.folder / name, newline="")))
        self.about = {row["key"]: row["value"] for row in read("about.csv")}
        self.models = read("models.csv")
        self.poses = collections.defaultdict(lambda: collections.defaultdict(list))  # (scene, method) -> index -> rows
        self.whole = collections.defaultdict(dict)  # the same without a budget: index -> row
        self.answers = self.certified = self.false_certificates = 0
        for row in read("rows.csv"):
            for key, value in row.items():
                if key not in ("scene", "method", "proof", "kind", "status"):
                    row[key] = float(value) if value else None
            if row["kind"] == "whole":
                self.whole[row["scene"], row["method"]][int(row["index"])] = row
            else:
                self.poses[row["scene"], row["method"]][int(row["index"])].append(row)
            self.answers += 1
            self.certified += int(row["certified"])
            self.false_certificates += int(row["false_certificate"])
        self.scenes = list(dict.fromkeys(scene for scene, _ in self.poses))

    def has(self, scene, method):
        return (scene, method) in self.poses

    def runs(self, scene, method):
        """Rows of each pose."""
        return list(self.poses[scene, method].values())

    def frames(self, scene, method):
        return len(self.poses[scene, method])

    def last(self, scene, method):
        return [rows[-1] for rows in self.runs(scene, method)]

    def stamp(self):
        return (f"false certificates: {self.false_certificates} among {self.certified:,} certified answers  |  "
                f"{self.about.get('commit', '')}  {self.about.get('machine', '')}")


def at(rows, key, x):
    """The last row whose `key` is at most x."""
    found = None
    for row in rows:
        if key(row) <= x:
            found = row
    return found


def share(run, scene, method, column, key, xs):
    """Share of poses whose state at each x has `column` set."""
    poses = run.runs(scene, method)
    return [statistics.mean((at(rows, key, x) or {column: 0})[column] for rows in poses) for x in xs]


def bytes_of(row):
    return row["bytes"]


def compute_s(row):
    return sum(row[k] for k in ("t_r_us", "t_b_us", "t_q_us", "t_l_us")) * 1e-6


def clock(method, mbit, trip_s):
    """Simulated time of a row from the match on, which brings base meshes unasked: round trips, both directions' bytes one after
    the other, and measured compute."""
    return lambda row: (row["requests"] * trip_s + 8 * (row["bytes"] + row["request_bytes"]) / (mbit * 1e6)
                        + compute_s(row))


def log_range(low, high, count=160):
    return [low * (high / low) ** (i / (count - 1)) for i in range(count)]


def style(method):
    name, colour, line = STYLES[method]
    return dict(label=name, color=colour, linestyle=line, linewidth=2.2 if method == "certified" else 1.4)


def save(run, figure, name, title, legend_rows=2):
    """Title: what one sees, in a line."""
    handles = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            handles.setdefault(label, handle)
    columns = max(1, math.ceil(len(handles) / legend_rows))
    height = figure.get_figheight()
    figure.suptitle(title, fontsize=11, y=1 - 0.08 / height, va="top")
    figure.tight_layout(rect=(0, (0.3 + 0.22 * legend_rows) / height, 1, 1))
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="lower center", ncol=columns, fontsize=8, frameon=False,
                      bbox_to_anchor=(0.5, 0.2 / height))
    figure.text(0.5, 0.06 / height, run.stamp(), ha="center", fontsize=7, color="0.35")
    figure.savefig(run.folder / (name + ".svg"), metadata={"Date": None})
    figure.savefig(run.folder / (name + ".png"), dpi=110, metadata={"Software": None})
    plt.close(figure)


def nice(axes, title=None, x=None, y=None, log=True):
    if log:
        axes.set_xscale("log")
    axes.grid(alpha=0.25)
    axes.tick_params(labelsize=8)
    if title:
        axes.set_title(title, fontsize=9)
    if x:
        axes.set_xlabel(x, fontsize=8)
    if y:
        axes.set_ylabel(y, fontsize=8)


def accuracy_bytes(run, scenes, methods, name, title):
    figure, panels = plt.subplots(2, len(scenes), figsize=(3.3 * len(scenes) + 0.6, 6.2), squeeze=False, sharey=True)
    for column, scene in enumerate(scenes):
        most = max(bytes_of(row) for m in methods + STATIC + LIBRARIES if run.has(scene, m) for row in run.last(scene, m))
        xs = log_range(150, 1.3 * most)
        for line, what in enumerate(("correct", "certified")):
            axes = panels[line][column]
            for method in methods:
                if run.has(scene, method):
                    axes.plot(xs, share(run, scene, method, what, bytes_of, xs), drawstyle="steps-post", **style(method))
            for group, members in (("static", STATIC), ("libraries", LIBRARIES)):
                points = [(statistics.mean(map(bytes_of, run.last(scene, m))), statistics.mean(r[what] for r in run.last(scene, m)))
                          for m in members if run.has(scene, m)]
                if points and what == "correct":
                    text, colour, marker = STYLES[group]
                    axes.plot(*zip(*points), marker, color=colour, label=text, markersize=5, fillstyle="none")
            axes.set_ylim(-0.03, 1.05)
            nice(axes, f"{scene}" if line == 0 else None, "bytes received, base meshes included" if line else None,
                 f"share of answers {what}" if column == 0 else None)
    save(run, figure, name, title)


def both_ways(run, scenes, name):
    """Bytes to the final answer, to the peer and from it."""
    methods = ["certified"] + RIVALS
    figure, panels = plt.subplots(1, len(scenes), figsize=(2.4 * len(scenes) + 0.6, 3.6), squeeze=False)
    for axes, scene in zip(panels[0], scenes):
        for x, method in enumerate(m for m in methods if run.has(scene, m)):
            rows = run.last(scene, method)
            mean = lambda key: statistics.mean(row[key] for row in rows) / 1000
            text, colour, _ = STYLES[method]
            hatch = "//" if method == "clusters-chosen" else None
            axes.bar(x, mean("bytes"), color="white" if hatch else colour, edgecolor=colour, hatch=hatch, label=text)
            axes.bar(x, mean("request_bytes"), bottom=mean("bytes"), color="black", label="asked with")
        axes.set_xticks([])
        nice(axes, scene, None, "kB to the final answer, base meshes included" if scene == scenes[0] else None, log=False)
    save(run, figure, name, "Bytes until the answer is final: what comes to the peer, and what it asks with")


def accuracy_time(run, scene, name):
    links, trips = (0.25, 1, 10, 100), (0.005, 0.05, 0.2)
    figure, panels = plt.subplots(len(trips), len(links), figsize=(14, 8), sharey=True)
    for i, trip in enumerate(trips):
        for j, mbit in enumerate(links):
            axes = panels[i][j]
            methods = MAIN + ["static-full"]
            xs = log_range(0.004, 60)
            for method in methods:
                if run.has(scene, method):
                    axes.plot(xs, share(run, scene, method, "correct", clock(method, mbit, trip), xs), drawstyle="steps-post",
                              **style(method))
            if run.has(scene, "certified"):
                axes.fill_between(xs, share(run, scene, "certified", "certified", clock("certified", mbit, trip), xs),
                                  step="post", color="#0b6e4f", alpha=0.12, label="nearmesh: certified")
            axes.set_ylim(-0.03, 1.05)
            nice(axes, f"{mbit:g} Mbit/s, round trip {trip * 1000:g} ms", "seconds since the match" if i == 2 else None,
                 "share of answers correct" if j == 0 else None)
    save(run, figure, name, f"{scene}: how soon answers are right. A simulated clock over measured bytes and compute")


def contacts(run, scenes, name):
    kinds = (("recall", "recall of touching faces"), ("position_error_m", "contact position error, m"),
             ("normal_error_rad", "normal error, rad"))
    figure, panels = plt.subplots(3, len(scenes), figsize=(3.8 * len(scenes) + 0.6, 8.4), squeeze=False)
    for column, scene in enumerate(scenes):
        most = max(bytes_of(row) for m in MAIN if run.has(scene, m) for row in run.last(scene, m))
        xs = log_range(150, 1.3 * most, 60)
        for line, (what, text) in enumerate(kinds):
            axes = panels[line][column]
            for method in MAIN:
                if not run.has(scene, method):
                    continue
                poses = [rows for rows in run.runs(scene, method) if rows[0]["truth"]]
                ys = []
                for x in xs:
                    states = [at(rows, bytes_of, x) for rows in poses]
                    values = [s[what] if s else None for s in states]
                    if what == "recall":
                        values = [v or 0 for v in values]
                    elif sum(v is not None for v in values) * 2 < len(values):
                        values = []  # most poses have nothing to measure
                    values = [v for v in values if v is not None]
                    ys.append(statistics.mean(values) if values else math.nan)
                axes.plot(xs, ys, drawstyle="steps-post", **style(method))
            if what == "position_error_m":
                axes.set_yscale("symlog", linthresh=1e-4 if scene != "terrain-grazing" else 1e-1)
            nice(axes, scene if line == 0 else None, "bytes received, base meshes included" if line == 2 else None,
                 text if column == 0 else None)
    save(run, figure, name, "Contacts found, and their errors, after so many bytes")


def quantile(values, q):
    values = sorted(values)
    return values[min(len(values) - 1, int(q * len(values)))]


def frame_times(run, scenes, name):
    parts = (("t_r_us", "T_R refinement", "#264aa8"), ("t_b_us", "T_B tree", "#f08a24"), ("t_q_us", "T_Q query", "#0b6e4f"),
             ("t_l_us", "T_L loading", "#9b59b6"))
    methods = ["certified"] + RIVALS + ["grid8-hoppe", "grid16", "global",
               "static-1/16", "static-full", "fcl-obb", "embree-collide"]
    figure, panels = plt.subplots(1, len(scenes), figsize=(4.4 * len(scenes) + 1.5, 5), squeeze=False)
    for axes, scene in zip(panels[0], scenes):
        here = [m for m in methods if run.has(scene, m)]
        labels = []
        for y, method in enumerate(here):
            rows = run.last(scene, method)
            total = [1e3 * compute_s(row) for row in rows]
            left = 0
            for key, text, colour in parts:
                width = 1e-3 * quantile([row[key] for row in rows], 0.5)
                axes.barh(y, width, left=left, color=colour, label=text + ", median", height=0.6)
                left += width
            axes.plot(quantile(total, 0.99), y, "k|", markersize=10, label="99th percentile")
            right, sure = (statistics.mean(row[k] for row in rows) for k in ("correct", "certified"))
            labels.append(SHORT.get(method) or NAMES.get(method) or STYLES[method][0])
            axes.text(0.98, y, f"{100 * right:.0f} % right, {100 * sure:.0f} % certified", fontsize=7, ha="right", va="center",
                      transform=axes.get_yaxis_transform())
        axes.set_yticks(range(len(here)), labels if axes is panels[0][0] else [""] * len(here), fontsize=8)
        axes.invert_yaxis()
        axes.set_xscale("symlog", linthresh=1, linscale=3)
        axes.set_xlim(0, 3e4)  # the words stand behind the bars
        axes.set_xticks([0, 1, 10])
        nice(axes, scene, "milliseconds a frame (linear up to 1)", log=False)
    save(run, figure, name, "What a frame of a flight costs, and how far its answers can be trusted", 1)


def overhead(run, scenes, name):
    methods = ["certified"] + RIVALS + ["grid8-hoppe", "grid32", "static-full"]
    figure, panels = plt.subplots(1, 2, figsize=(14, 4.8))
    for axes, (what, text) in zip(panels, (("faces_held", "faces held / faces needed (median)"),
                                           ("tree_bytes", "bytes of the tree in memory (median)"))):
        for i, method in enumerate(methods):
            xs, ys = [], []
            for j, scene in enumerate(scenes):
                if not run.has(scene, method):
                    continue
                rows = [row for row in run.last(scene, method) if row["truth"]]
                if rows:
                    xs.append(j + (i - 3) * 0.11)
                    ys.append(max(1e-1, statistics.median(row[what] / (row["needed_faces"] if what == "faces_held" else 1) for row in rows)))
            _, colour, _ = STYLES[method]
            axes.bar(xs, ys, 0.1, color=colour, label=STYLES[method][0])
        axes.set_yscale("log")
        axes.set_xticks(range(len(scenes)), scenes, rotation=20, ha="right", fontsize=8)
        nice(axes, None, None, text, log=False)
    save(run, figure, name, "What is held in memory, against what the contact needs")


def draw_growth(run, axes, value, methods, unit=1):
    faces = {m["scene"]: int(m["faces"]) for m in run.models if m["body"] == "a"}
    scenes = sorted((s for s in run.scenes if s.startswith("growth-")), key=faces.get)
    for method in methods:
        here = [s for s in scenes if run.has(s, method)]
        axes.plot([faces[s] for s in here],
                  [max(1e-3, statistics.median(map(value, run.whole[s, method].values()))) / unit for s in here],
                  marker="o", **style(method))
    axes.set_yscale("log")


def growth(run, name):
    figure, panels = plt.subplots(1, 3, figsize=(14, 4.6))
    kinds = (("bytes to the final answer, base mesh included", bytes_of),
             ("milliseconds of compute to the final answer", lambda row: 1e3 * compute_s(row)),
             ("faces held", lambda row: row["faces_held"]))
    for axes, (text, value) in zip(panels, kinds):
        draw_growth(run, axes, value, ("certified", "clusters-checked", "clusters-chosen", "grid8", "static-full"))
        nice(axes, None, "faces of the terrain, the same contacts", text)
    save(run, figure, name, "The same ten contacts on larger and larger terrains", 1)


def first_look(run, name):
    """Why one would use this: bytes of a flight over time, and of one answer over the size of the mesh."""
    figure, (flight, size) = plt.subplots(1, 2, figsize=(11, 4.2), width_ratios=(3, 2))
    second = 20  # frames
    for method in ("certified-ahead", "clusters-chosen-ahead", "grid8-hoppe", "static-full"):
        if not run.has("touching-flight", method):
            continue
        whole, late = (run.last(scene, method) for scene in ("touching-flight", "late-flight"))
        seconds = [i / second for i in range(len(whole))]
        flight.plot(seconds, [bytes_of(row) / 1000 for row in whole], **style(method))
        flight.plot(seconds[-len(late):], [bytes_of(row) / 1000 for row in late], alpha=0.6, marker="o", markevery=[0],
                    **style(method))
        right = 100 * statistics.mean(row["correct"] for row in whole)
        sure = "all right, all proved" if whole[-1]["certified"] else f"{right:.0f} % right, none proved"
        flight.annotate(f"{bytes_of(whole[-1]) / 1000:.0f} kB, {sure}", (seconds[-1], bytes_of(whole[-1]) / 1000), fontsize=8,
                        xytext=(5, 4 if method in ("certified-ahead", "grid8-hoppe") else -5), textcoords="offset points",
                        color=STYLES[method][1], va="center")
    flight.set_xlim(0, 7.6)
    flight.set_xticks(range(6))
    flight.set_ylim(0, 1.1 * flight.get_ylim()[1])
    nice(flight, "A touching flight over 131,072 faces at 1 Mbit/s; ● a peer joins late", "seconds", "kB received", log=False)
    draw_growth(run, size, bytes_of, ("certified", "clusters-checked", "static-full"), 1000)
    nice(size, "One answer, on larger and larger terrains", "faces", "kB received")
    save(run, figure, name, "Detail that may be touched, and no more")


# ---- tables -------------------------------------------------------------------------------------

def table(head, rows):
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head)] +
                     ["| " + " | ".join(str(c) for c in row) + " |" for row in rows]) + "\n"


def number(x):
    return "-" if x is None else f"{x:,.0f}" if abs(x) >= 100 else f"{x:.3g}"


def first_lasting(rows, key):
    """When the answer becomes right and stays so."""
    when = None
    for row in rows:
        if row["correct"]:
            when = key(row) if when is None else when
        else:
            when = None
    return when


def certification_table(run):
    rows = []
    for scene in run.scenes:
        if not run.has(scene, "clusters-checked") or run.runs(scene, "certified")[0][0]["kind"] != "pose":
            continue
        mean = lambda method: statistics.mean(r["bytes"] for r in run.last(scene, method))
        base = run.last(scene, "certified")[0]["header_bytes"]
        ours, chosen = mean("certified") - base, mean("clusters-chosen")
        row = [scene, number(base), number(ours)]
        row += [number(mean(m) - base) if run.has(scene, m) else "-" for m in ("certified-least",)]
        row += [number(mean("clusters-checked")), number(chosen),
                number(mean("triangles-trusted")) if run.has(scene, "triangles-trusted") else "-",
                f"{ours / mean('clusters-checked'):.2f}", f"{ours / chosen:.2f}", f"{(ours + base) / chosen:.2f}"]
        if run.has(scene, "triangles-trusted"):
            row.append(f"{(mean('certified') - base) / mean('triangles-trusted'):.2f}")
        else:
            row.append("-")
        rows.append(row)
    return table(["scene", "base meshes", "certified", "split by split", "rival, checked", "rival, chosen and checked",
                  "rival, trusted", "certified / checked", "certified / chosen", "the same with base", "certified / trusted"], rows)


def first_correct_table(run):
    rows = []
    for scene in run.scenes:
        if run.runs(scene, "certified")[0][0]["kind"] != "pose":
            continue
        for method in ["certified"] + RIVALS + ["grid8-hoppe", "grid8", "global", "static-full"]:
            if not run.has(scene, method):
                continue
            times = [first_lasting(r, clock(method, 1, 0.05)) for r in run.runs(scene, method)]
            right = [t for t in times if t is not None]
            ours = [first_lasting(r, clock("certified", 1, 0.05)) for r in run.runs(scene, "certified")]
            ratios = [t / o for t, o in zip(times, ours) if t is not None]
            rows.append([scene, method, f"{len(right)}/{len(times)}", number(statistics.median(right)) if right else "-",
                         number(max(right)) if right else "-", f"{statistics.median(ratios):.2f}" if ratios else "-"])
    return table(["scene", "method", "poses ever right", "median, s", "worst, s", "median of its time / certified's"], rows)


def budget_table(run):
    rows = []
    for scene in run.scenes:
        if run.runs(scene, "certified")[0][0]["kind"] != "pose" or not run.has(scene, "global"):
            continue
        most = max(r["bytes"] for r in run.last(scene, "static-full"))
        xs = log_range(150, 1.3 * most, 120)
        ours = share(run, scene, "certified", "correct", bytes_of, xs)
        worst = (0, "-", 0)
        for method in PAPER_AND_LEVELS:
            for x, o, t in zip(xs, ours, share(run, scene, method, "correct", bytes_of, xs)):
                worst = max(worst, (round(t - o, 4), method, x))
        rows.append([scene, "yes" if worst[0] == 0 else "no", f"{worst[0]:.2f}", worst[1], number(worst[2])])
    return table(["scene", "certified at or above them at every budget", "largest shortfall", "against", "at bytes"], rows)


def overhead_table(run):
    methods = ["certified"] + RIVALS + ["grid8-hoppe", "grid8", "grid16", "grid32", "static-full"]
    rows = []
    for scene in run.scenes:
        if scene.startswith("growth") or not any(r["truth"] for r in run.last(scene, "certified")):
            continue
        row = [scene]
        for method in methods:
            there = [r for r in run.last(scene, method) if r["truth"]] if run.has(scene, method) else []
            row.append(number(statistics.median(r["faces_held"] / r["needed_faces"] for r in there)) if there else "-")
        rows.append(row)
    return table(["scene"] + methods, rows)


def flight_table(run):
    rows = []
    for scene in ("touching-flight", "near-flight", "clear-flight"):
        for method in ("certified", "certified-ahead", "clusters-checked", "clusters-chosen", "clusters-chosen-ahead"):
            if not run.has(scene, method):
                continue
            frames = run.last(scene, method)
            last = frames[-1]
            worst = max(now["bytes"] - before["bytes"] for before, now in zip(frames, frames[1:]))
            rows.append([scene, STYLES[method][0], f"{last['bytes'] / 1000:.1f}", f"{last['request_bytes'] / 1000:.1f}", number(last["requests"]),
                         f"{worst / 1000:.1f}", f"{sum(int(f['certified']) for f in frames)} of {len(frames)}"])
    return table(["flight", "method", "received, KB", "asked with, KB", "requests", "worst frame but the first, KB", "certified frames"], rows)


PAPER_TABLE_1 = {"paper-sphere": ("Sphere", "496", "2050", "50", "27", "2023", "12"),
                 "paper-bunny": ("Bunny", "37576", "20000", "500", "1406", "18594", "16")}
PAPER_TABLE_2 = {"paper-sphere": ("Sphere", 0.19, 0.03, 0.09, 0.30, 0.21),
                 "paper-bunny": ("Bunny", 0.42, 0.05, 0.35, 1.80, 5.40)}


def paper_table_1(run):
    rows = []
    for scene, theirs in PAPER_TABLE_1.items():
        rows.append([theirs[0] + ", paper"] + list(theirs[1:]))
        for m in run.models:
            if m["scene"] == scene and m["body"] == "a":
                rows.append([theirs[0] + ", here"] + [m[k] for k in ("faces", "vertices", "base_faces", "base_vertices",
                                                                    "splits", "tree_height")])
    return table(["model", "faces in M_n", "vertices in M_n", "faces in M_0", "vertices in M_0", "vertex split records",
                  "AB-tree height"], rows)


def paper_table_2(run):
    rows = []
    for scene, theirs in PAPER_TABLE_2.items():
        rows.append([theirs[0] + ", paper (2006)"] + [f"{x:.2f}" for x in theirs[1:]])
        if not run.has(scene, "certified"):
            continue
        # Poses in which the base meshes touch: in the others the paper's method refines nothing.
        poses = [i for i, row in run.whole[scene, "grid8-hoppe"].items() if row["requests"]]
        of = lambda method: [run.whole[scene, method][i] for i in poses]
        ms = lambda rows, key: f"{statistics.median(r[key] for r in rows) / 1000:.3f}"
        base = []
        for i in poses:
            first = [r for r in run.poses[scene, "global"][i] if r["answers"]]
            base += [r for r in first if r["splits"] == 0][:1]
        for method, text in (("grid8-hoppe", "the paper's method here (reconstruction; tree built anew)"),
                             ("certified", "nearmesh, certified"), ("certified-least", "nearmesh, split by split")):
            rows.append([f"{theirs[0]}, {text}", ms(of("static-full"), "t_q_us"), ms(base, "t_q_us"), ms(of(method), "t_q_us"),
                         ms(of(method), "t_b_us"), ms(of(method), "t_r_us")])
        for library in ("fcl-obb", "fcl-obbrss"):
            if run.has(scene, library):
                rows.append([f"{theirs[0]}, {library}", ms([run.poses[scene, library][i][0] for i in poses], "t_q_us"), "", "",
                             "", ""])
    return table(["model", "T_Q original mesh, ms", "T_Q base mesh, ms", "T_Q local refinement, ms", "T_B, ms", "T_R, ms"], rows)


def about_table(run):
    lines = [f"* {key}: {value}" for key, value in run.about.items()]
    lines.append(f"* false certificates: {run.false_certificates} among {run.certified:,} certified answers, {run.answers:,} rows")
    return "\n".join(lines) + "\n"


def main(folder, docs=None):
    matplotlib.rcParams["svg.hashsalt"] = "nearmesh"  # the same bytes every time
    run = Run(folder)
    there = lambda names: [name for name in names if name in run.scenes]
    pose_scenes = there(["terrain-grazing", "two-scans", "needle-in-plain", "bolt-in-nut", "conforming", "paper-bunny"])
    if pose_scenes:
        answers = "Right answers (above) and certified ones (below) after so many bytes"
        few = there(["terrain-grazing", "two-scans", "bolt-in-nut", "paper-bunny"])
        accuracy_bytes(run, few, MAIN, "accuracy_bytes", answers)
        if rest := there(["needle-in-plain", "conforming", "paper-sphere"]):
            accuracy_bytes(run, rest, MAIN, "accuracy_bytes_more", answers)
        accuracy_bytes(run, few[:3], ["certified", "certified-least", "grid8", "grid16",
                                      "grid32"], "variants_bytes", "Right and certified answers after so many bytes: finer grids, smaller steps")
        both_ways(run, there(["terrain-grazing", "two-scans", "needle-in-plain", "paper-sphere", "paper-bunny", "bolt-in-nut",
                              "conforming"]), "both_ways")
        accuracy_time(run, pose_scenes[0], "accuracy_time")
        contacts(run, there(["terrain-grazing", "two-scans", "paper-bunny", "paper-sphere"])[:3], "contacts")
    if flights := there(["touching-flight", "near-flight", "clear-flight"]):
        frame_times(run, flights, "frame_times")
    if pose_scenes:
        overhead(run, there(["terrain-grazing", "touching-flight", "two-scans", "needle-in-plain", "bolt-in-nut", "conforming",
                             "paper-sphere", "paper-bunny"]), "overhead")
    if any(s.startswith("growth-") for s in run.scenes):
        growth(run, "growth")
        if "late-flight" in run.scenes:
            first_look(run, "first_look")
    tables = {"about": about_table(run), "certification": certification_table(run), "budgets": budget_table(run),
              "first-correct": first_correct_table(run), "overhead": overhead_table(run), "flights": flight_table(run), "paper-1": paper_table_1(run),
              "paper-2": paper_table_2(run)}
    (run.folder / "tables.md").write_text("\n".join(f"## {name}\n\n{text}" for name, text in tables.items()))
    if docs:
        pictures = pathlib.Path(docs) / "results"
        pictures.mkdir(exist_ok=True)
        for picture in sorted(run.folder.glob("*.svg")):
            shutil.copy(picture, pictures / picture.name)
        page = pathlib.Path(docs) / "results.md"
        text = page.read_text()
        for name, generated in tables.items():
            text = re.sub(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", lambda m: m[1] + "\n" + generated + "\n" + m[2], text,
                          flags=re.S)
        page.write_text(text)
    print(f"{run.false_certificates} false certificates among {run.certified} certified answers")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    main(*sys.argv[1:])
