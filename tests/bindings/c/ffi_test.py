#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A local session, flown from another language by dlopen. Usage: ffi_test.py LIBRARY FOLDER"""
import ctypes
import math
import os
import sys

import ffi


def fly(near, folder):
    model = os.path.join(folder, "ffi_sphere.spm")
    near.bake_sphere(model)
    session = near.local_session()
    near.call("session_add_model", session, b"sphere", model.encode())
    anvil = near.add_body(session, name=b"anvil", model=b"sphere", own=1)
    hammer = near.add_body(session, name=b"hammer", model=b"sphere", own=1)
    near.call("session_watch", session, anvil, hammer)
    seen = []
    for step in range(40):  # down, into the anvil
        height_m = 3 - 0.05 * step
        for _ in range(20):
            frame = near.update(session, step, 0.1 * step, [(anvil, ffi.at(0, 0, 0)), (hammer, ffi.at(0.01, 0.02, height_m))])
            pair = near.find(session, anvil, hammer)
            if frame.all_certified:
                break
        answer = pair.answer.contents
        assert frame.answer_count == 1 and answer.is_certified and pair.reason == b"", (step, pair.reason)
        if height_m > 2.001:
            # A half-space may tell the two apart by nothing; from afar their boxes are apart.
            least_m = 1e-9 if height_m > 2.5 else 0
            assert answer.status == ffi.FREE and least_m <= answer.clearance_m <= height_m - 1.9, (height_m, answer.clearance_m)
        if height_m < 1.9:
            assert answer.status == ffi.CONTACT and answer.pair_count > 0 and answer.pairs[0][1] < 1000
        seen.append(answer.status)
    print(f"{seen.count(ffi.FREE)} steps free, {seen.count(ffi.CONTACT)} in contact")

    # What is refused is an exception here, with the library's text.
    for bad, words in ((ffi.at(math.nan, 0, 0), "pose of anvil: translation_m[0] is nan"),
                       (ffi.Motion(), "pose of anvil")):
        try:
            near.update(session, 99, 9, [(anvil, bad)])
            raise AssertionError("expected a refusal")
        except ffi.Refused as refused:
            assert refused.status == 1 and words in str(refused), str(refused)
    readiness = ctypes.POINTER(ffi.Readiness)()
    near.call("session_readiness", session, anvil, ctypes.byref(readiness))
    assert readiness.contents.stage == ffi.CERTIFIED and readiness.contents.pairs == 1
    near.library.nearmesh_session_destroy(session)


def main():
    near = ffi.Nearmesh(sys.argv[1])
    print("nearmesh", near.library.nearmesh_version().decode())
    for _ in range(2):  # the second one as the first
        fly(near, sys.argv[2])


main()
