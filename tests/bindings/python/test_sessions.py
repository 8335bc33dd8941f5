# SPDX-License-Identifier: Apache-2.0
"""Peers: fed from files, and on DDS beside a publisher."""
import concurrent.futures
import decimal
import fractions
import json
import os
import pathlib
import resource
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from conftest import at

import nearmesh as nm


def two_balls(session):
    a = session.add_body("a", "ball", own=True)
    b = session.add_body("b", "ball", own=True)
    return a, b


def fly(session, bodies, x_m, frame=0):
    """Frames at one place until all is certified."""
    a, b = bodies
    for _ in range(200):
        report = session.update(frame, frame / 20, {a: np.eye(4), b: at(x_m)})
        if report.all_certified:
            return report
    raise AssertionError(report.reasons)


def test_a_local_session_answers_as_two_models_do(ball):
    session = nm.Session.local({"ball": ball.path}, contacts=True)
    bodies = two_balls(session)
    session.watch(*bodies)
    first = session.update(0, 0, {bodies[0]: np.eye(4), bodies[1]: at(1.9)})
    assert not first.all_certified and first.reasons[0]
    pair = nm.Pair(ball, ball)
    for frame, x_m in enumerate((1.9, 2.1, 0.7)):
        report = fly(session, bodies, x_m, frame)
        expected = pair.query(np.eye(4), at(x_m))[0]
        row = report.answers[report.find(bodies[1], bodies[0])]
        assert (row["status"], row["pairs"], row["digest"]) == (expected["status"], expected["pairs"], expected["digest"])
        np.testing.assert_array_equal(row["pose_b"], at(x_m))
        contacts = report.contacts(0)
        assert (contacts is not None) == (row["status"] == nm.Status.CONTACT)
        if contacts:
            np.testing.assert_array_equal(contacts.segments, pair.contacts(np.eye(4), at(x_m)).segments)
    assert session.stats["held_splits"] > 0 and session.stats["batch_bytes"] > 0
    np.testing.assert_array_equal(session.motion_of(bodies[1]).pose, at(0.7))


def test_contacts_keep_their_numbers_and_depth_leads_out(ball):
    session = nm.Session.local({"ball": ball.path}, depth=True)
    bodies = two_balls(session)
    session.watch(*bodies)
    fly(session, bodies, 1.9, 0)
    for frame in range(1, 20):  # detail for the depth comes
        report = fly(session, bodies, 1.9, frame)
    depth, ids = report.depth(0), report.contact_ids(0)
    assert len(ids) == 1 and depth.missing == 0 and 0 < depth.at_least_m <= depth.at_most_m < 0.11
    event, = report.contact_events
    assert (event["change"], event["id"], event["patch"]) == (nm.ContactChange.PERSIST, ids[0], 0)
    report = fly(session, bodies, 1.89, 20)
    assert report.contact_ids(0).tolist() == ids.tolist()
    report = fly(session, bodies, 2.2, 21)
    event, = report.contact_events
    assert (event["change"], event["id"]) == (nm.ContactChange.END, ids[0])
    assert report.depth(0) is None and len(report.contact_ids(0)) == 0


def test_threads_change_no_answer(ball):
    digests = []
    for threads in (1, 4):
        session = nm.Session.local({"ball": ball.path}, threads=threads)
        bodies = [session.add_body(f"b{i}", "ball", own=True) for i in range(6)]
        session.watch_all()
        motions = {body: nm.Motion(at(1.5 * body), (1, 0, 0)) for body in bodies}
        for frame in range(8):
            report = session.update(frame, frame / 20, motions, budget_s=10)
        assert report.all_certified
        digests.append((report.answers_digest, report.state_digest))
    assert digests[0] == digests[1]


def crowd(ball, **options):
    session = nm.Session.local({"ball": ball.path}, lookahead_s=0, **options)
    bodies = [session.add_body(f"b{i}", "ball", own=True) for i in range(6)]
    for i in bodies:
        for j in range(i):
            session.watch(j, i)
    return session, {body: nm.Motion(at(2.2 * body), (1, 0, 0)) for body in bodies}


def spread(kind):
    """A host's own ways to run jobs."""
    pool = concurrent.futures.ThreadPoolExecutor(3)
    kept = []
    return {
        "pool": lambda count, job: list(pool.map(job, range(count))),
        "backwards": lambda count, job: [job(i) for i in reversed(range(count))],
        "none": lambda count, job: None,
        "twice, and beyond": lambda count, job: [job(i) for i in [*range(count), *range(count), count, 10 ** 9]],
        "kept": lambda count, job: (kept.append(job), [earlier(0) for earlier in kept]),
    }[kind]


@pytest.mark.parametrize("kind", ["pool", "backwards", "none", "twice, and beyond", "kept"])
def test_jobs_on_a_pool_of_the_hosts_give_the_same(ball, kind):
    digests = []
    for options in {}, {"run_jobs": spread(kind)}:
        session, motions = crowd(ball, **options)
        for frame in range(8):
            report = session.update(frame, frame / 20, motions, 10)
        assert report.all_certified
        digests.append((report.answers_digest, report.state_digest))
    assert digests[0] == digests[1]


def test_what_jobs_raise_comes_out(ball):
    def fails(count, job):
        raise KeyError("mine")
    session, motions = crowd(ball, run_jobs=fails)
    with pytest.raises(KeyError, match="mine"):
        session.update(0, 0, motions)
    with pytest.raises(TypeError, match="function"):
        crowd(ball, run_jobs=3)


def test_what_jobs_raise_leaves_the_session_whole(ball):
    def fails_each_second_time(count, job, calls=[]):
        calls.append(count)
        if len(calls) % 2:
            raise KeyError("mine")
    alone, motions = crowd(ball)
    session, _ = crowd(ball, run_jobs=fails_each_second_time)
    certified = 0
    for frame in range(16):
        expected = alone.update(frame, frame / 20, motions, 10)
        try:
            report = session.update(frame, frame / 20, motions, 10)
        except KeyError:
            continue
        assert (report.answers_digest, report.state_digest) == (expected.answers_digest, expected.state_digest)
        certified += report.all_certified
    assert certified > 0


@pytest.mark.parametrize("call", [lambda s: s.watch_all(), lambda s: s.stats, lambda s: s.update(0, 0)])
def test_a_scheduler_that_calls_its_session_is_refused(ball, call):
    session, motions = crowd(ball, run_jobs=lambda count, job: call(session))
    with pytest.raises(nm.errors.ConflictError, match="in use"):
        session.update(0, 0, motions, 10)


@pytest.mark.parametrize("call", [lambda s: s.name_of(0), lambda s: s.motion_of(0), lambda s: s.heard_time_s, lambda s: s.stats,
                                  lambda s: s.readiness(0)])
def test_calls_on_one_session_wait_for_each_other(ball, call):
    threads, ended, were_early = [], threading.Event(), []

    def run(count, job):
        threads.append(threading.Thread(target=lambda: (call(session), ended.set())))
        threads[-1].start()
        were_early.append(ended.wait(0.1))
    session, motions = crowd(ball, run_jobs=run)
    session.update(0, 0, motions, 10)
    for thread in threads:
        thread.join(100)
    assert ended.is_set() and were_early and not were_early[0]


def test_without_more_threads_those_that_there_are_do_it_all(ball):
    # No thread finds room for such a stack.
    program = ("import sys, numpy as np, nearmesh as nm\n"
               "session = nm.Session.local({'ball': sys.argv[1]}, threads=4)\n"
               "bodies = [session.add_body(name, 'ball', own=True) for name in 'abc']\n"
               "session.watch(0, 1), session.watch(0, 2)\n"
               "assert session.wait_ready(0, 100, {body: np.eye(4) for body in bodies})[0] == 'certified'\n")

    def stack():
        resource.setrlimit(resource.RLIMIT_STACK, (2 ** 46, resource.getrlimit(resource.RLIMIT_STACK)[1]))
    if resource.getrlimit(resource.RLIMIT_STACK)[1] != resource.RLIM_INFINITY:
        pytest.skip("the stack is limited")
    run = subprocess.run([sys.executable, "-c", program, ball.path], preexec_fn=stack, capture_output=True, text=True, timeout=200,
                         check=False)
    assert run.returncode == 0, run.stderr


def test_a_budget_puts_pairs_off(ball):
    # Exact: what stays free by its bound takes no turn.
    session, motions = crowd(ball, clearance="exact")
    for frame in range(50):
        if session.update(frame, 0, motions, budget_s=100).all_certified:
            break
    for frame in range(50, 80):
        report = session.update(frame, 0, motions, budget_s=0)
        rows = report.answers
        assert rows["asked"].sum() == 1 and report.pairs_put_off == len(rows) - 1 == rows["put_off"].sum()
        assert not rows["certified"][rows["put_off"]].any() and not report.all_certified
        assert all(reason == "out of budget" for reason, row in zip(report.reasons, rows) if row["put_off"])
    known = rows[rows["put_off"] & (rows["last_status"] != 255)]
    assert len(known) == 14 and (known["last_status"] == nm.Status.FREE).any()
    assert (known["last_clearance_m"] > 0).all() and (known["last_safe_s"] > 0).all() and (known["last_age_s"] == 0).all()


def test_limits_of_an_answer(ball):
    for options, pairs in ({}, None), ({"any": True}, 1), ({"max_pairs": 2}, None), ({"max_tests": 5}, None):
        session = nm.Session.local({"ball": ball.path}, lookahead_s=0, max_sweep_tests=100, **options)
        bodies = two_balls(session)
        session.watch(*bodies)
        for frame in range(40):
            row = session.update(frame, 0, {bodies[0]: np.eye(4), bodies[1]: at(1.9)}, 10).answers[0]
        assert row["certified"] == (not row["exhausted"]) == ("max_tests" not in options)
        assert row["pairs"] == 1 if pairs == 1 else True


def test_the_time_ahead_is_answered(ball):
    session = nm.Session.local({"ball": ball.path}, sweep_s=1)
    bodies = two_balls(session)
    session.watch(*bodies)
    for speed_mps, status in ((-2, nm.Status.CONTACT), (2, nm.Status.FREE)):
        motions = {bodies[0]: np.eye(4), bodies[1]: nm.Motion(at(3), (speed_mps, 0, 0))}
        for frame in range(40):
            swept = session.update(frame, 0, motions, 10).swept[0]
        assert swept["status"] == status and not swept["exhausted"]
    assert swept["free_until_s"] == 1 and np.isinf(swept["hit_s"])
    assert session.update(0, 0, {bodies[1]: nm.Motion(at(3), (-2, 0, 0))}, 10).swept[0]["hit_s"] == pytest.approx(0.5, abs=0.01)
    assert nm.Session.local({}).update(0, 0).swept.shape == (0,)


def test_what_is_held_can_be_drawn(ball):
    session = nm.Session.local({"ball": ball.path})
    bodies = two_balls(session)
    with pytest.raises(LookupError):
        session.held_mesh(bodies[0])
    assert session.held_state(bodies[0]) == 0
    session.watch(*bodies)
    assert session.readiness(bodies[0])[0] == "waiting"
    fly(session, bodies, 1.9)
    assert session.readiness(bodies[0]) == ("certified", "")
    exact, coarse = session.held_mesh(bodies[0])
    assert exact.shape[1:] == coarse.shape[1:] == (3, 3) and len(exact) > 0 and len(coarse) > 0
    assert len(exact) + len(coarse) < ball.face_count
    np.testing.assert_allclose(np.linalg.norm(exact.reshape(-1, 3), axis=1), 1, atol=1e-5)
    state = session.held_state(bodies[0])
    assert state != 0 and session.held_state(bodies[0]) == state
    here, far = (0.99, -0.01, -0.01), (-0.1, -1.1, -0.1)
    resolved, uncertainty_m, reason = session.region_readiness(bodies[0], here, (1.01, 0.01, 0.01))
    assert resolved and uncertainty_m == 0 and reason == ""
    resolved, uncertainty_m, reason = session.region_readiness(bodies[0], far, (0.1, -0.9, 0.1))
    assert not resolved and uncertainty_m > 0 and reason


def test_a_body_is_as_it_was_declared(ball, tmp_path):
    session = nm.Session.local({"ball": ball.path}, cache_folder=str(tmp_path), promise_s=4, max_depth_tests=1000,
                               window_bytes=4096, audit_s=0)
    pinned = session.add_body("pinned", "ball", own=True, solid=True, content=ball.content, max_speed_mps=3)
    assert session.options_of(pinned) == {"name": "pinned", "model": "ball", "content": ball.content, "own": True,
                                          "solid": True, "group": 1, "mask": 0xFFFFFFFF, "max_speed_mps": 3}
    other = session.add_body("other", "ball", own=True)
    session.replace_model(other, "ball", ball.content)
    assert session.options_of(other)["content"] == ball.content
    with pytest.raises(nm.errors.ConflictError):
        session.add_body("more", "ball", content="0" * 31 + "1")
    with pytest.raises(ValueError):
        session.replace_model(other, "ball", "no digits")
    session.watch(pinned, other)
    fly(session, (pinned, other), 1.9)
    session.write_cache()
    assert any(tmp_path.iterdir())


def test_own_pairs_and_a_speed_that_is_kept(ball):
    session = nm.Session.local({"ball": ball.path})
    own = session.add_body("own", "ball", own=True, max_speed_mps=10)
    for name, x in (("left", -50), ("right", 50)):
        session.place_body(session.add_body(name, "ball"), at(x))
    session.watch_own()
    report = session.update(0, 0, {own: nm.Motion(at(0), (8, 0, 0))}, 10)
    assert report.free_by_bounds.pairs == 2 and report.all_certified
    with pytest.raises(ValueError, match="max_speed_mps"):
        session.update(1, 1, {own: nm.Motion(at(20), (8, 0, 0))}, 10)
    session.update(1, 1, {own: nm.Motion(at(8), (8, 0, 0))}, 10)


def test_links_of_a_robot_move_together(ball):
    session = nm.Session.local({"ball": ball.path})
    links = [session.add_body(name, "ball", own=True) for name in ("base", "arm", "box")]
    with pytest.raises(ValueError, match="found 1"):
        session.link_bodies(links[:1])
    session.link_bodies(links[:2])
    with pytest.raises(nm.errors.ConflictError, match="link base"):
        session.link_bodies(links[:2])
    with pytest.raises(ValueError, match="expected all"):
        session.update(0, 0, {links[0]: np.eye(4)})
    session.update(0, 0, {links[0]: np.eye(4), links[1]: at(3), links[2]: at(6)})
    session.remove_body(links[1])  # and so the robot
    with pytest.raises(LookupError):
        session.options_of(links[0])


def test_far_bodies_are_free_by_bounds_and_unknown_ones_are_not(ball):
    session = nm.Session.local({"ball": ball.path})
    bodies = [session.add_body(f"b{i}", "ball", own=True) for i in range(4)]
    session.watch_all()
    for frame in range(4):
        report = session.update(frame, frame / 20, {body: nm.Motion(at(100 * body), (8, 0, 0)) for body in bodies}, 10)
    assert len(report.answers) == 0 and report.free_by_bounds.pairs == 6 and report.all_certified
    assert 0 < report.free_by_bounds.clearance_m < 98 and report.free_by_bounds.horizon_s > 0
    stranger = session.add_body("stranger", "ball")
    report = session.update(5, 0.25, {})
    assert not report.all_certified and report.unknown_pairs == 4
    assert [body for body, _ in report.unknown] == [stranger]
    session.remove_body(stranger)
    assert session.update(6, 0.3, {}).all_certified


def test_wait_ready_waits(ball):
    session = nm.Session.local({"ball": ball.path})
    bodies = two_balls(session)
    session.watch(*bodies)
    stage, reason, report = session.wait_ready(bodies[0], 100, {bodies[0]: np.eye(4), bodies[1]: at(1.9)})
    assert (stage, reason) == ("certified", "") and report.all_certified
    session.add_body("c", "nobody serves this", own=True)
    session.watch(bodies[0], 2)
    stage, reason, _ = session.wait_ready(2, 0)
    assert stage == "waiting" and reason


@pytest.mark.parametrize("wrong, kind, text", [
    (lambda s: s.add_body("a", "ball"), nm.errors.ConflictError, "a"),
    (lambda s: s.add_body("", "ball"), ValueError, "name"),
    (lambda s: s.add_body("H\u00e4her", "ball"), ValueError, "printable ASCII"),
    (lambda s: s.add_body("x\0y", "ball"), ValueError, "printable ASCII"),
    (lambda s: s.watch(0, 0), ValueError, ""),
    (lambda s: s.watch(0, 7), LookupError, "7"),
    (lambda s: s.place_body(9, np.eye(4)), LookupError, "9"),
    (lambda s: s.update(0, np.nan), ValueError, "time"),
    (lambda s: s.wait_ready(0, np.nan), ValueError, "timeout_s"),
    (lambda s: s.update(0, 0, {0: np.eye(3)}), ValueError, r"body 0: expected an array \(4, 4\)"),
    (lambda s: s.update(0, 0, {0: "here"}), ValueError, "body 0"),
    (lambda s: s.update(0, 0, {0: at(np.inf)}), ValueError, "a"),
    (lambda s: s.update(0, 0, {-1: np.eye(4)}), ValueError, "number of a body: found -1"),
    (lambda s: s.hear({"a": (0, np.eye(4))}), ValueError, "number of a body: found 'a'"),
    (lambda s: nm.Session.local({}, max_held_splits=-1), ValueError, "max_held_splits: found -1"),
    (lambda s: nm.Session.local({}, contacts="yes"), ValueError, "contacts: found 'yes'"),
    (lambda s: nm.Session.local({"ball": "/nowhere/ball.spm"}), OSError, "/nowhere/ball.spm"),
    (lambda s: nm.Session.local({}, look_ahead=1), TypeError, "look_ahead"),
    (lambda s: nm.Session.dds(transport="pigeon"), ValueError, "pigeon"),
])
def test_what_is_wrong_is_told(ball, wrong, kind, text):
    session = nm.Session.local({"ball": ball.path})
    two_balls(session)
    with pytest.raises(kind, match=text):
        wrong(session)
    fly(session, (0, 1), 3)  # and nothing is broken by it


@pytest.mark.parametrize("number", [np.float32(1.5), np.float32(1), decimal.Decimal("1.5"), fractions.Fraction(3, 2)])
def test_what_counts_something_is_whole(ball, number):
    # Else body 1.5 is body 1, and 0.5 splits are no limit.
    for option in ("max_pairs", "max_tests", "max_held_splits", "threads"):
        with pytest.raises(ValueError, match=option):
            nm.Session.local({"ball": ball.path}, **{option: number})
    session = nm.Session.local({"ball": ball.path}, max_pairs=np.int64(3), max_tests=np.uint8(200))
    two_balls(session)
    with pytest.raises(ValueError, match="number of a body"):
        session.update(0, 0, {number: np.eye(4)})
    report = session.update(0, 0, {0: np.eye(4), 1: at(3)})
    for call in (
        lambda: session.name_of(number),
        lambda: session.watch(0, number),
        lambda: session.link_bodies([0, number]),
        lambda: session.update(number, 0),
        lambda: session.readiness(number),
        lambda: session.probe_points(number, [[0, 0, 0]]),
        lambda: session.add_body("c", "ball", group=number),
        lambda: report.find(0, number),
        lambda: report.contacts(number),
    ):
        with pytest.raises(TypeError):
            call()
    session.watch(np.int32(0), np.uint64(1))
    assert session.name_of(np.int16(1)) == "b"


def test_a_peer_on_dds(ball):
    program = os.path.join(os.environ["NEARMESH_BIN_DIR"], "nearmesh-publisher")
    prefix = f"python{os.getpid()}"
    publisher = subprocess.Popen([program, "serve", ball.path, "--domain", "93", "--interface", "127.0.0.1", "--prefix", prefix])
    try:
        session = nm.Session.dds(domain=93, interface="127.0.0.1", prefix=prefix, name="python", request_timeout_s=2)
        bodies = two_balls(session)
        session.watch(*bodies)
        motions = {bodies[0]: np.eye(4), bodies[1]: at(1.9)}
        # Other threads of Python run while this one waits.
        ticks = threading.Event()
        threading.Thread(target=ticks.set).start()
        stage, reason, report = session.wait_ready(bodies[0], 100, motions)
        assert ticks.is_set() and (stage, reason) == ("certified", "")
        expected = nm.Pair(ball, ball).query(np.eye(4), at(1.9))[0]
        assert report.answers[0]["digest"] == expected["digest"] and report.answers[0]["status"] == nm.Status.CONTACT
    finally:
        publisher.send_signal(signal.SIGINT)
        assert publisher.wait(100) == 0


# Fast DDS itself is told of a lease of a year: where the door does not end it, poses go to the killed peer for ever.
def test_a_peer_that_came_by_dlopen_has_a_door_which_ends_leases():
    if subprocess.run(["unshare", "-n", "true"], capture_output=True, check=False).returncode != 0:
        pytest.skip("a network namespace needs root")
    run = subprocess.run(["unshare", "-n", "sh", "-c", 'ip link set lo up && ip link set lo multicast on && exec "$@"', "sh",
                          sys.executable, str(pathlib.Path(__file__).with_name("lonely_peer.py")), "one"],
                         capture_output=True, text=True, timeout=500, check=False)
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["doors"] == {"one": True, "other": True}
    assert found["living"] > 0.5 and found["ended"] < 0.2, found
