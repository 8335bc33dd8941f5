# SPDX-License-Identifier: Apache-2.0
"""A peer in thirty lines: lowers one body onto another and says what touches. See README.md in this folder.

    nearmesh-publisher serve ball.spm &
    python3 peer.py ball [DOMAIN [INTERFACE]]
"""
import sys
import time

import numpy as np

import nearmesh as nm

model, domain, interface = (sys.argv[1:] + ["0", ""][len(sys.argv) - 2:])[:3]
session = nm.Session.dds(domain=int(domain), interface=interface)
anvil = session.add_body("anvil", model, own=True)
hammer = session.add_body("hammer", model, own=True)
session.watch(anvil, hammer)

for frame, height_m in enumerate((3.0, 2.5, 1.95, 1.0)):
    above = np.eye(4)
    above[:3, 3] = 0.01, 0.02, height_m
    while True:  # a simulator would simply go on with its next frame
        report = session.update(frame, frame / 20, {anvil: np.eye(4), hammer: above})
        if report.all_certified:
            break
        time.sleep(0.005)
    answer = report.answers[0]
    print(f"{height_m:.2f} m: {nm.Status(answer['status']).name}, certified, {answer['pairs']} pairs of faces touch, "
          f"clearance at least {answer['clearance_m']:.2f} m")
