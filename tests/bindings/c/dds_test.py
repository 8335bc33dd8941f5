#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A session on DDS, made from another language, beside a publisher. Usage: dds_test.py LIBRARY PUBLISHER FOLDER"""
import ctypes
import os
import subprocess
import sys
import time

import ffi

DOMAIN, PREFIX, DEADLINE_S = 141, b"nearmesh_c_%d" % os.getpid(), 100


def main():
    near = ffi.Nearmesh(sys.argv[1])
    model = os.path.join(sys.argv[3], "ball.spm")
    near.bake_sphere(model)
    publisher = subprocess.Popen([sys.argv[2], "serve", model, "--domain", str(DOMAIN), "--interface",
                                  "127.0.0.1", "--prefix", PREFIX.decode()], stdout=subprocess.DEVNULL)
    try:
        bus = {"domain": DOMAIN, "network_interface": b"127.0.0.1", "prefix": PREFIX}
        flyer = near.dds_session(name=b"flyer", **bus)
        watcher = near.dds_session(name=b"watcher", **bus)
        sessions = []
        for session, own in ((flyer, (1, 0)), (watcher, (0, 1))):
            left = near.add_body(session, name=b"left", model=b"ball", own=own[0])
            right = near.add_body(session, name=b"right", model=b"ball", own=own[1])
            near.call("session_watch", session, left, right)
            sessions.append((session, left, right, left if own[0] else right))
        for distance_m, expected in ((2.5, ffi.FREE), (1.95, ffi.CONTACT)):
            certified, end = set(), time.monotonic() + DEADLINE_S
            time_s = 0.0
            while len(certified) < 2 and time.monotonic() < end:
                time_s += 0.01
                certified.clear()
                for session, left, right, own in sessions:
                    where = ffi.at(0, 0, 0) if own is left else ffi.at(distance_m, 0.01, 0.02)
                    near.update(session, int(time_s * 100), time_s, [(own, where)], 0.002)
                    pair = near.find(session, left, right)
                    if pair.answer.contents.is_certified and pair.answer.contents.status == expected:
                        certified.add(session.value)
                time.sleep(0.002)
            assert len(certified) == 2, (expected, pair.reason, pair.awaited)
            print(f"both peers certify {'a contact' if expected else 'free'} at {distance_m} m")
        # One that declares nothing learns from the others which bodies there are, and when one goes.
        looker = near.dds_session(name=b"looker", **bus)
        near.call("session_watch_all", looker)
        near.call("session_discover_bodies", looker)
        flyers = [(session, own, ffi.at(0 if own is left else 1.95, 0, 0)) for session, left, _, own in sessions]
        came, went, is_removed, end = {}, [], False, time.monotonic() + DEADLINE_S
        while not went and time.monotonic() < end:
            time_s += 0.01
            for session, own, where in flyers:
                motions = [] if is_removed and session is flyer else [(own, where)]
                near.update(session, int(time_s * 100), time_s, motions, 0.002)
            frame = near.update(looker, int(time_s * 100), time_s, [], 0.002)
            for i in range(frame.came_count):
                body = near.library.nearmesh_session_came(looker, ctypes.c_size_t(i))
                facts = ctypes.POINTER(ffi.BodyFacts)()
                near.call("session_body_facts", looker, ffi.BODY(body), ctypes.byref(facts))
                assert facts.contents.model == b"ball" and not facts.contents.own
                came[body] = facts.contents.name
            went += [near.library.nearmesh_session_went(looker, ctypes.c_size_t(i)) for i in range(frame.went_count)]
            pair = near.find(looker, *map(ffi.BODY, came)) if len(came) == 2 and not is_removed else None
            if pair and pair.answer.contents.status == ffi.CONTACT:
                near.call("session_remove_body", flyer, flyers[0][1])
                is_removed = True
            time.sleep(0.002)
        assert sorted(came.values()) == [b"left", b"right"] and [came[body] for body in went] == [b"left"], (came, went)
        print("a third one discovers both, and sees one go")
        near.library.nearmesh_session_destroy(looker)
        # What files are for is not for a session on DDS.
        try:
            near.call("session_add_model", flyer, b"more", model.encode())
            raise AssertionError("expected a refusal")
        except ffi.Refused as refused:
            assert refused.status == 4 and "on DDS" in str(refused), str(refused)
        for session, _, _, _ in sessions:
            near.library.nearmesh_session_destroy(session)
    finally:
        publisher.terminate()
        publisher.wait()


main()
