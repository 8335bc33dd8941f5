# SPDX-License-Identifier: Apache-2.0
"""Probes of models at hand and of a session's bodies; poses that the host heard; poses of quaternions."""
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
