# SPDX-License-Identifier: Apache-2.0
"""Probes of models at hand and of a session's bodies; poses that the host heard; poses of quaternions."""
import os
import subprocess

import numpy as np
import pytest
from conftest import at

import nearmesh as nm


def first_hits(model, origins, directions):
    """The distance of the first face on each ray, by trying all faces; infinite where there is none."""
    vertices, faces = model.mesh()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    distances = []
    for origin, direction in zip(origins, directions):
        direction = direction / np.linalg.norm(direction)
        normal = np.cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.einsum("ij,ij->i", normal, a - origin) / (normal @ direction)
        point = origin + t[:, None] * direction
        inside = np.ones(len(faces), bool)
        for p, q in ((a, b), (b, c), (c, a)):
            inside &= np.einsum("ij,ij->i", np.cross(q - p, point - p), normal) >= 0
        hits = t[inside & (t >= 0)]
        distances.append(hits.min() if len(hits) else np.inf)
    return np.array(distances)


def random_rays(count):
    random = np.random.default_rng(3)
    origins = random.uniform(-3, 3, (count, 3))
    return origins, random.uniform(-0.8, 0.8, (count, 3)) - origins


def test_rays_meet_what_all_faces_say(ball):
    origins, directions = random_rays(500)
    rows = ball.probe_rays(np.eye(4), origins, directions)
    truth = first_hits(ball, origins, directions)
    np.testing.assert_array_equal(rows["status"] == nm.ProbeStatus.HIT, np.isfinite(truth))
    hit = np.isfinite(truth)
    assert 300 < hit.sum() < 500
    np.testing.assert_allclose(rows["distance_m"][hit], truth[hit], atol=1e-4)
    assert np.isnan(rows["distance_m"][~hit]).all()
    np.testing.assert_allclose(np.linalg.norm(rows["normal"][hit], axis=1), 1)
    moved = ball.probe_rays(at(5), origins + (5, 0, 0), directions)
    np.testing.assert_allclose(moved["distance_m"][hit], truth[hit], atol=1e-4)


def test_heights_points_balls_and_boxes(ball):
    heights = ball.probe_rays(np.eye(4), [[0.1, 0, 9], [4, 0, 9]])
    assert list(heights["status"]) == [nm.ProbeStatus.HIT, nm.ProbeStatus.MISS]
    assert heights["distance_m"][0] == pytest.approx(9 - np.sqrt(1 - 0.01), abs=0.02)
    short = ball.probe_rays(np.eye(4), [0.1, 0, 9], range_m=7)
    assert short["status"][0] == nm.ProbeStatus.MISS
    points = ball.probe_points(np.eye(4), [[0, 0, 0], [0, 0, 1.5]])
    assert list(points["status"]) == [nm.ProbeStatus.HIT, nm.ProbeStatus.MISS]
    balls = ball.probe_balls(np.eye(4), [[0, 0, 1.5], [0, 0, 1.5], [0, 0, 0]], [0.6, 0.4, 0.5])
    assert list(balls["status"]) == [1, 0, 0] and balls["has_face"][0]
    boxes = ball.probe_boxes(np.eye(4), np.stack([at(1.5), at(1.5), np.eye(4)]), [[0.6] * 3, [0.4] * 3, [2] * 3])
    assert list(boxes["status"]) == [1, 0, 1] and not boxes["has_face"][2]


def test_what_is_no_probe_is_refused(ball):
    for origins, directions in (([[0, 0]], [0, 0, 1]), ([[0, 0, 0]], [0, 0, 0]), ([[np.nan, 0, 0]], [0, 0, 1]),
                                (np.zeros((3, 3)), np.ones((2, 3)))):
        with pytest.raises(nm.Error):
            ball.probe_rays(np.eye(4), origins, directions)
    with pytest.raises(nm.Error, match="ball 1"):
        ball.probe_balls(np.eye(4), np.zeros((2, 3)), [1, -1])


def test_a_session_is_uncertain_and_then_as_the_model(ball):
    session = nm.Session.local({"ball": ball.path})
    body = session.add_body("b", "ball")
    session.place_body(body, at(2))
    origins, directions = random_rays(300)
    origins[:, 0] += 2
    rows, why = session.probe_rays(body, origins, directions)
    assert why and (rows["status"] == nm.ProbeStatus.UNCERTAIN).all()
    for frame in range(30):
        session.update(frame, 0.0)
        rows, why = session.probe_rays(body, origins, directions)
        if not why:
            break
    assert why == ""
    for name in rows.dtype.names:  # NaN is not equal to itself in rows
        np.testing.assert_array_equal(rows[name], ball.probe_rays(at(2), origins, directions)[name])
    assert session.probe_points(body, [2, 0, 0])[0]["status"][0] == nm.ProbeStatus.HIT


def test_heard_poses_count_and_age(ball):
    session = nm.Session.local({"ball": ball.path})
    mine = session.add_body("mine", "ball", own=True)
    other = session.add_body("other", "ball")
    session.watch(mine, other)
    for frame in range(60):
        if frame < 20:
            session.hear({other: (frame / 10, nm.Motion(at(3)))})
        report = session.update(frame, frame / 10, {mine: np.eye(4)})
        if frame == 19:
            assert report.all_certified, report.reasons
    assert "old" in report.reasons[0]
    with pytest.raises(nm.Error, match="mine"):
        session.hear({mine: (0, np.eye(4))})


def test_poses_of_quaternions():
    half = np.sqrt(0.5)
    np.testing.assert_allclose(nm.pose((1, 2, 3), (half, 0, 0, half)),
                               [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-15)
    np.testing.assert_array_equal(nm.pose(), np.eye(4))
    with pytest.raises(nm.Error, match="quaternion"):
        nm.pose(quaternion=(1, 1, 0, 0))


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    """The same terrain as one model, and as a world of tiles."""
    folder = tmp_path_factory.mktemp("world")
    program = os.path.join(os.environ["NEARMESH_BIN_DIR"], "nearmesh-model")
    for words in (["generate", "terrain", "--size", "24", "-o", "ground.ply"],
                  ["build", "ground.ply", "-o", "ground.spm"],
                  ["build-world", "ground.ply", "--faces", "150", "-o", "WORLD"]):
        subprocess.run([program, *words], cwd=folder, check=True, capture_output=True)
    return nm.Model(str(folder / "ground.spm")), str(folder / "WORLD")


def test_a_body_may_be_a_world(ground):
    model, folder = ground
    ball = os.path.join(os.path.dirname(folder), "ball.spm")
    vertices = np.array([(x, y, z) for x in (-150, 150) for y in (-150, 150) for z in (-150, 150)], float)
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
             (1, 5, 7), (1, 7, 3)]
    nm.bake(vertices, faces, ball)
    session = nm.Session.local({"whole": model.path, "ball": ball}, {"tiles": folder})
    whole, tiles = session.add_body("whole", "whole"), session.add_body("tiles", "tiles")
    flyer = session.add_body("flyer", "ball", own=True)
    for body in (whole, tiles):
        session.place_body(body, np.eye(4))
        session.watch(flyer, body)
    touched = 0
    for frame, (x, z) in enumerate([(0, 0), (100, 50), (-200, 0), (50, 3000)]):
        for _ in range(200):
            report = session.update(frame, float(frame), {flyer: nm.pose((x, 0, z))}, 1)
            if report.all_certified:
                break
        assert report.all_certified
        of_whole, of_tiles = report.find(flyer, whole), report.find(flyer, tiles)
        assert report.world(of_whole) is None
        content, near, missing_pages = report.world(of_tiles)
        assert len(content) == 32 and missing_pages == 0
        answers = report.answers
        assert answers[of_tiles]["status"] == answers[of_whole]["status"]
        assert near["pairs"].sum() == answers[of_tiles]["pairs"]
        assert (near["is_here"] & near["asked"]).all()
        assert all(os.path.exists(f"{folder}/tiles/{tile.decode()}.spm") for tile in near["tile"])
        touched += answers[of_tiles]["pairs"] > 0
    assert touched >= 1 and len(near) == 0
    with pytest.raises(IndexError):
        report.world(7)
    with pytest.raises(nm.errors.NotFoundError):
        nm.Session.local({}, {"tiles": folder + "/tiles"})


def test_a_world_answers_as_the_one_mesh_that_was_cut(ground):
    model, folder = ground
    world = nm.World(folder, most_tiles=2)
    random = np.random.default_rng(5)
    origins = np.column_stack([random.uniform(-450, 450, (300, 2)), np.full(300, 2000.0)])
    directions = np.column_stack([random.uniform(-0.2, 0.2, (300, 2)), -np.ones(300)])
    rows, truth = world.probe_rays(np.eye(4), origins, directions), model.probe_rays(np.eye(4), origins, directions)
    np.testing.assert_array_equal(rows["status"], truth["status"])
    hit = rows["status"] == nm.ProbeStatus.HIT
    assert 100 < hit.sum() < 300
    np.testing.assert_allclose(rows["distance_m"][hit], truth["distance_m"][hit], atol=0.01)
    np.testing.assert_allclose(rows["point_m"][hit], truth["point_m"][hit], atol=0.01)
    tiles = set(rows["tile"][hit])
    assert len(tiles) > 4 and all(os.path.exists(f"{folder}/tiles/{tile.decode()}.spm") for tile in tiles)
    assert set(rows["tile"][~hit]) == {b""}
    centers = rows["point_m"][hit] + (0, 0, 3)
    for radius in (2.9, 3.1, 0.1):
        np.testing.assert_array_equal(world.probe_balls(np.eye(4), centers, radius)["status"],
                                      model.probe_balls(np.eye(4), centers, radius)["status"])
    boxes = np.tile(np.eye(4), (len(centers), 1, 1))
    boxes[:, :3, 3] = centers
    found = world.probe_boxes(np.eye(4), boxes, (1, 1, 3.1))
    assert (found["status"] == nm.ProbeStatus.HIT).all() and found["has_face"].all()
    moved = world.probe_rays(at(100), origins + (100, 0, 0), directions)
    np.testing.assert_allclose(moved["distance_m"][hit], rows["distance_m"][hit], atol=0.01)
    with pytest.raises(nm.Error, match="ray 1"):
        world.probe_rays(np.eye(4), origins, [[0, 0, 1], [0, 0, 0]] * 150)
    with pytest.raises(nm.errors.NotFoundError):
        nm.World(folder + "/tiles")
