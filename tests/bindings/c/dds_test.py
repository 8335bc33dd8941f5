#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A session on DDS, made from another language, beside a publisher. Usage: dds_test.py LIBRARY PUBLISHER FOLDER"""
import os
import subprocess
import sys
import time

import ffi

DOMAIN, PREFIX, DEADLINE_S = 141, b"nearmesh_c_%d" % os.getpid(), 40


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
