# SPDX-License-Identifier: Apache-2.0
"""Models from arrays, and queries of arrays of poses."""
import json
import os
import subprocess
import threading

import numpy as np
import pytest
from conftest import at, sphere

import nearmesh as nm


def test_a_model_gives_back_the_mesh_that_it_was_baked_from(ball):
    vertices, faces = sphere()
    assert (ball.vertex_count, ball.face_count) == (len(vertices), len(faces))
    own_vertices, own_faces = ball.mesh()
    assert own_faces.shape == faces.shape
    assert np.abs(own_vertices[own_faces] - vertices[faces]).max() <= ball.rounding_error_m < ball.cell_m


def test_the_file_is_the_same_for_any_number_of_threads(ball, tmp_path):
    again = nm.bake(*sphere(), str(tmp_path / "again.spm"), threads=1)
    assert again.content == ball.content
    assert open(again.path, "rb").read() == open(ball.path, "rb").read()


def test_answers_for_an_array_of_poses(ball):
    x_m = np.array([3, 2.5, 1.9, 0.5])
    answers = nm.Pair(ball, ball).query(np.eye(4), np.stack([at(x) for x in x_m]), clearance="exact")
    assert answers["certified"].all()
    assert answers["status"].tolist() == [nm.Status.FREE] * 2 + [nm.Status.CONTACT] * 2
    # A bound from what the answer needed of the models: below the distance, and not far.
    free = answers["status"] == nm.Status.FREE
    distance_m = x_m[free] - 2
    assert (answers["clearance_m"][free] <= distance_m + 2 * ball.rounding_error_m).all()
    assert (answers["clearance_m"][free] > 0.9 * distance_m).all()
    assert (answers["pairs"][~free] > 0).all()


def test_one_pose_stands_for_all_and_counts_must_agree(ball):
    pair = nm.Pair(ball, ball)
    three = np.stack([at(x) for x in (1.5, 2.5, 3.5)])
    alone = [pair.query(np.eye(4), pose)[0] for pose in three]
    together = pair.query(np.eye(4), three)
    for field in together.dtype.names:
        np.testing.assert_array_equal(together[field], [row[field] for row in alone])
    assert len(pair.query(np.eye(4), np.zeros((0, 4, 4)))) == 0
    with pytest.raises(ValueError, match="2 poses, poses_b 3"):
        pair.query(three[:2], three)


def test_a_solid_contains_what_is_inside_it(ball, tmp_path):
    vertices, faces = sphere(6)
    small = nm.bake(vertices / 4, faces, str(tmp_path / "small.spm"))
    hollow, solid = nm.Pair(ball, small), nm.Pair(ball, small, solid_a=True)
    assert hollow.query(np.eye(4), np.eye(4))["status"] == [nm.Status.FREE]
    inside = solid.query(np.eye(4), np.eye(4))
    assert inside["status"] == [nm.Status.CONTAINED] and inside["contained"] == [nm.Contained.B_IN_A]
    sheet = nm.bake([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], str(tmp_path / "sheet.spm"))
    with pytest.raises(nm.Error, match="open|close"):
        nm.Pair(sheet, ball, solid_a=True)


def test_contacts_and_faces_name_where_and_what(ball):
    pair = nm.Pair(ball, ball)
    contacts = pair.contacts(np.eye(4), at(1.9))
    assert len(contacts.patches) == 1 and not contacts.truncated
    patch = contacts.patches[0]
    np.testing.assert_allclose(patch["centroid_m"], [0.95, 0, 0], atol=1e-3)
    np.testing.assert_allclose(patch["normal"], [1, 0, 0], atol=0.1)
    segments = contacts.segments[patch["first"]:patch["first"] + patch["count"]]
    assert (segments["patch"] == 0).all() and len(segments) == len(contacts.segments)
    np.testing.assert_allclose(segments["p_m"][:, 0], 0.95, atol=0.03)
    faces = pair.faces(np.eye(4), at(1.9))
    assert len(faces) == pair.query(np.eye(4), at(1.9))["pairs"][0]
    vertices, triangles = sphere()
    assert (vertices[triangles[faces[:, 0]]][:, :, 0].max(axis=1) > 0.94).all()
    assert (vertices[triangles[faces[:, 1]]][:, :, 0].min(axis=1) < -0.94).all()


def test_distance_is_bracketed_by_points_of_both(ball):
    pair = nm.Pair(ball, ball)
    pair.query(np.eye(4), at(1.9))  # brings the detail
    row = pair.query(np.eye(4), at(2.001), clearance="exact")[0]
    assert row["clearance_m"] <= row["distance_at_most_m"] < row["clearance_m"] + 0.01
    assert np.linalg.norm(row["nearest_b_m"] - row["nearest_a_m"]) == pytest.approx(row["distance_at_most_m"], abs=1e-6)
    np.testing.assert_allclose(np.linalg.norm(row["nearest_a_m"]), 1, atol=0.03)


def test_depth_leads_out(ball):
    pair = nm.Pair(ball, ball)
    assert pair.depth(np.eye(4), at(2.5)) is None
    depth = pair.depth(np.eye(4), at(1.9))
    assert 0.05 < depth.at_least_m <= depth.at_most_m < 0.11 and depth.missing == 0 and not depth.exhausted
    np.testing.assert_allclose(depth.direction, [1, 0, 0], atol=0.1)
    out = at(1.9)
    out[:3, 3] += depth.separation_m
    assert pair.query(np.eye(4), out)["status"][0] == nm.Status.FREE
    up = pair.depth(np.eye(4), at(1.9), directions=[[0, 0, 2]])
    assert up.at_most_m > depth.at_most_m and up.direction.tolist() == [0, 0, 1]
    with pytest.raises(ValueError, match="direction 0"):
        pair.depth(np.eye(4), at(1.9), directions=[[0, 0, 0]])
    patch = pair.contacts(np.eye(4), at(1.9)).patches[0]
    assert patch["manifold_count"] == 4
    np.testing.assert_allclose(patch["manifold_m"][:, 0], 0.95, atol=0.03)


@pytest.mark.parametrize("wrong, kind, text", [
    (lambda ball: nm.Pair(ball, ball).query(np.eye(3), np.eye(4)), ValueError, r"expected an array \(4, 4\)"),
    (lambda ball: nm.Pair(ball, ball).query(at(np.nan), np.eye(4)), ValueError, "pose 0"),
    (lambda ball: nm.Pair(ball, ball).query(2 * np.eye(4), np.eye(4)), ValueError, "last row"),
    (lambda ball: nm.Pair(ball, ball).query(np.eye(4), np.eye(4), clearance="best"), ValueError, "none, bound or exact"),
    (lambda ball: nm.bake([[0, 0, 0]], [[0, 0, 1]], "/nowhere/x.spm"), ValueError, "names vertex 1"),
    (lambda ball: nm.bake([[0, 0, 0]], np.zeros((0, 3)), "/nowhere/x.spm"), ValueError, "at least one"),
    (lambda ball: nm.bake(np.eye(3), [[0, 1, 2.5]], "/nowhere/x.spm"), ValueError, "2.5 is no number of a vertex"),
    (lambda ball: nm.bake(np.eye(3), [[0, 1, np.nan]], "/nowhere/x.spm"), ValueError, "nan is no number of a vertex"),
    (lambda ball: nm.bake(np.eye(3), None, "/nowhere/x.spm"), ValueError, "faces"),
    (lambda ball: nm.bake([[0, 0, np.inf], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "/nowhere/x.spm"), ValueError, "vertex 0"),
    (lambda ball: nm.bake(*sphere(4), "/nowhere/x.spm"), OSError, "/nowhere"),
    (lambda ball: nm.bake(*sphere(4), "/nowhere/x.spm", grid_bits=99), ValueError, "grid_bits"),
    (lambda ball: nm.Model("/nowhere/x.spm"), OSError, "/nowhere/x.spm"),
    (lambda ball: nm.Model(__file__), nm.errors.CorruptError, "test_models.py"),
])
def test_what_is_wrong_is_told(ball, wrong, kind, text):
    with pytest.raises(kind, match=text) as caught:
        wrong(ball)
    assert isinstance(caught.value, nm.Error)


def test_threads_may_share_a_model(ball):
    poses = np.stack([at(x) for x in np.linspace(1, 3, 60)])
    expected = nm.Pair(ball, ball).query(np.eye(4), poses)
    shared, found = nm.Model(ball.path), {}

    def ask(number):
        found[number] = nm.Pair(shared, shared).query(np.eye(4), poses)

    threads = [threading.Thread(target=ask, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all((found[i] == expected).all() for i in range(4))


def test_answers_are_those_of_the_program(ball, tmp_path):
    x_m = np.linspace(1.2, 2.8, 9)
    names = [f"{body}_R{row}{column}" for body in "AB" for row in range(3) for column in range(3)]
    columns = ["id"] + [name for body in "AB" for name in
                        [n for n in names if n[0] == body] + [f"{body}_T{k}" for k in range(3)]]
    identity = ["1", "0", "0", "0", "1", "0", "0", "0", "1"]
    with open(tmp_path / "poses.csv", "w") as poses:
        print(*columns, sep=",", file=poses)
        for i, x in enumerate(x_m):
            print(i, *identity, 0, 0, 0, *identity, x, 0, 0, sep=",", file=poses)
    program = os.path.join(os.environ["NEARMESH_BIN_DIR"], "nearmesh-model")
    run = subprocess.run([program, "query", ball.path, ball.path, "--poses", tmp_path / "poses.csv", "--list-pairs", "--json"],
                         check=True, capture_output=True, text=True)
    pair = nm.Pair(ball, ball)
    answers = pair.query(np.eye(4), np.stack([at(x) for x in x_m]))
    lines = [json.loads(line) for line in run.stdout.splitlines()]
    assert [line["status"] for line in lines] == [nm.Status(row["status"]).name.lower() for row in answers]
    assert [line["faces"] for line in lines] == [pair.faces(np.eye(4), at(x)).tolist() for x in x_m]


def test_a_damaged_block_is_an_error_and_never_a_wrong_answer(tmp_path):
    good = nm.bake(*sphere(32), str(tmp_path / "good.spm"))
    whole = (tmp_path / "good.spm").read_bytes()
    random = np.random.default_rng(1)
    found = {"right": 0, "refused": 0}
    for number, place in enumerate(range(4000, len(whole), 4999)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        file = tmp_path / f"damaged{number}.spm"
        file.write_bytes(damaged)
        model = nm.Model(str(file))
        pair, truth = nm.Pair(model, model), nm.Pair(good, good)
        for _ in range(30):  # on and on after an error
            direction = random.normal(size=3)
            pose = np.eye(4)
            pose[:3, 3] = direction / np.linalg.norm(direction) * random.uniform(1.9, 2.05)
            for ask, right in (
                    (lambda: pair.query(np.eye(4), pose)[["status", "pairs"]], truth.query(np.eye(4), pose)[["status", "pairs"]]),
                    (lambda: model.probe_rays(pose, [[0, 0, 0]], pose[:3, 3])[["status", "distance_m"]],
                     good.probe_rays(pose, [[0, 0, 0]], pose[:3, 3])[["status", "distance_m"]])):
                try:
                    assert ask() == right
                    found["right"] += 1
                except nm.errors.CorruptError as error:
                    assert file.name in str(error)
                    found["refused"] += 1
    assert min(found.values()) > 20, found
