# SPDX-License-Identifier: Apache-2.0
"""Draws how far apart two models are while one comes down on the other. See README.md in this folder.

    python3 chart.py A.spm B.spm chart.svg
"""
import sys

import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import nearmesh as nm

a, b = nm.Model(sys.argv[1]), nm.Model(sys.argv[2])
pair = nm.Pair(a, b)
top_m, bottom_m = a.mesh()[0][:, 2].max(), b.mesh()[0][:, 2].min()
height_m = np.linspace(1.5, -0.5, 200) * (top_m - bottom_m)  # of b's origin above a's
poses = np.tile(np.eye(4), (len(height_m), 1, 1))
poses[:, 2, 3] = height_m
answers = pair.query(np.eye(4), poses)
print(f"{answers['certified'].sum()} of {len(answers)} answers certified, {pair.held_splits} of "
      f"{a.vertex_count + b.vertex_count} vertices' detail needed")

figure, left = plt.subplots(figsize=(7, 4), layout="constrained")
left.plot(height_m, np.where(answers["status"] == nm.Status.FREE, answers["clearance_m"], 0), color="tab:blue")
left.set(xlabel="height, m", ylabel="certified clearance, m", title="One body comes down on another")
right = left.twinx()
right.plot(height_m, answers["pairs"], color="tab:orange")
right.set_ylabel("pairs of faces that touch")
figure.savefig(sys.argv[3])
