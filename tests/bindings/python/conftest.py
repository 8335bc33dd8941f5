# SPDX-License-Identifier: Apache-2.0
"""Shapes for the tests of the Python package."""
import numpy as np
import pytest

import nearmesh as nm


def sphere(rings=16):
    """A closed ball of radius 1 m: vertices, faces that turn outward."""
    around = 2 * rings
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    azimuth = np.linspace(0, 2 * np.pi, around, endpoint=False)
    vertices = [[np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)] for u in polar for v in azimuth]
    top, bottom = len(vertices), len(vertices) + 1
    faces = []
    for i in range(rings - 2):
        for j in range(around):
            a, b = i * around + j, i * around + (j + 1) % around
            faces += [[a, a + around, b], [b, a + around, b + around]]
    last = (rings - 2) * around
    for j in range(around):
        faces += [[top, j, (j + 1) % around], [bottom, last + (j + 1) % around, last + j]]
    return np.array(vertices + [[0, 0, 1], [0, 0, -1]]), np.array(faces)


def at(x_m):
    """A pose that far along x."""
    pose = np.eye(4)
    pose[0, 3] = x_m
    return pose


@pytest.fixture(scope="session")
def ball(tmp_path_factory):
    return nm.bake(*sphere(), str(tmp_path_factory.mktemp("models") / "ball.spm"))
