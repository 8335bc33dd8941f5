# SPDX-License-Identifier: Apache-2.0
"""Recorded sessions as arrays: the session of the tests' own data."""
import os

import numpy as np
import pytest

import nearmesh as nm

SESSION = os.environ["NEARMESH_GOLDEN_SESSION"]


def test_reports_are_rows():
    recording = nm.Recording(SESSION)
    reports, names = recording.reports()
    assert len(reports) == next(count for name, count in recording.topics().items() if name.endswith("contact_report"))
    assert set(names[i] for i in reports["a"]) | set(names[i] for i in reports["b"]) == set(names)
    assert (np.diff(reports["received_ns"]) >= 0).all()
    asked = reports[reports["asked"]]
    assert len(asked) > 10
    turns = asked["pose_b"][:, :3, :3]
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (len(asked), 1, 1)), atol=1e-4)
    certified = np.isin(reports["status"], [nm.Status.FREE, nm.Status.CONTACT, nm.Status.CONTAINED])
    np.testing.assert_array_equal(certified, reports["certified"])
    assert certified.any() and 0 < recording.duration_s < 3600 and "terrain" in recording.models.values()


def test_a_scene_is_what_a_peer_held():
    recording = nm.Recording(SESSION)
    reports, names = recording.reports()
    touching = reports[reports["status"] == nm.Status.CONTACT][-1]
    scene = recording.scene(received_ns=int(touching["received_ns"]), body=names[touching["a"]], other=names[touching["b"]])
    assert scene.received_ns <= touching["received_ns"] and scene.status == nm.Status.CONTACT
    assert {body.name for body in scene.bodies} == {names[touching["a"]], names[touching["b"]]}
    for body in scene.bodies:
        assert body.faces.max() < len(body.vertices) == len(body.error_m)
        assert (body.error_m >= 0).all() and (body.error_m == 0).any()
    # Contacts lie on exact faces of both.
    points = scene.contacts.segments["p_m"]
    assert len(points) > 0
    for body in scene.bodies:
        exact = body.faces[(body.error_m[body.faces] == 0).all(axis=1)]
        corners = body.vertices[exact]
        low, high = corners.min(axis=1) - 1e-3, corners.max(axis=1) + 1e-3
        for point in points:
            assert ((low <= point) & (point <= high)).all(axis=1).any()


def test_what_is_wrong_is_told(tmp_path):
    with pytest.raises(LookupError, match="/nowhere.db3"):
        nm.Recording("/nowhere.db3")
    junk = tmp_path / "junk.db3"
    junk.write_bytes(b"junk" * 1000)
    with pytest.raises(nm.errors.CorruptError, match="junk.db3"):
        nm.Recording(str(junk))
    with pytest.raises(LookupError, match="nobody"):
        nm.Recording(SESSION).scene(body="nobody")
