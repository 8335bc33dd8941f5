#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws results.csv of nearmesh-stability as a heat map: scene x system, coloured by the share of right answers.

Usage: plot_stability.py RESULTS.csv STEM   (writes STEM.svg and STEM.png)
"""
import csv
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def read(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    systems = list(dict.fromkeys(row["system"] for row in rows))
    return scenes, systems, {(row["scene"], row["system"]): row for row in rows}


def draw(scenes, systems, cells, stem):
    matplotlib.rcParams["svg.hashsalt"] = "nearmesh"  # the same bytes every time
    figure, axes = plt.subplots(figsize=(1.7 * len(systems) + 1.2, 0.36 * len(scenes) + 1.1))
    colours = plt.get_cmap("RdYlGn")
    for y, scene in enumerate(scenes):
        for x, system in enumerate(systems):
            row = {k: int(v) for k, v in cells[scene, system].items() if k not in ("scene", "system")}
            asked = row["cases"] - row["not_applicable"]
            right = row["right"] + row["undecided"]
            text = f"{right}/{asked}" if asked else "n/a"
            marks = [f"{row[k]} {k}" for k in ("crash", "hang") if row[k]]
            colour = colours(right / asked) if asked else "0.85"
            axes.add_patch(plt.Rectangle((x, y), 1, 1, facecolor=colour, edgecolor="white"))
            axes.text(x + 0.5, y + 0.5, ", ".join([text] + marks), ha="center", va="center", fontsize=8,
                      fontweight="bold" if asked and right == asked else "normal")
    axes.set_xlim(0, len(systems))
    axes.set_ylim(len(scenes), 0)
    axes.set_xticks([x + 0.5 for x in range(len(systems))], systems)
    axes.set_yticks([y + 0.5 for y in range(len(scenes))], scenes)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_xlabel("right answers / cases asked (nearmesh: honest \"uncertain\" included); grey: not offered",
                    fontsize=8)
    figure.tight_layout()
    figure.savefig(stem + ".svg", metadata={"Date": None})
    figure.savefig(stem + ".png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    draw(*read(sys.argv[1]), sys.argv[2])
