# SPDX-License-Identifier: Apache-2.0
"""A peer whose other is killed. Prints what `status` said of their doors, and how many packets a frame went to ports that nobody has:
beyond those that it sends when it is alone, while the other's lease runs, and after it has ended. In a network of its own."""
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np

import nearmesh as nm

BUS = {"domain": 94, "interface": "127.0.0.1"}
FRAME_S = 0.05
DEADLINE_S = 100


def packets_to_nobody():
    with open("/proc/net/snmp", encoding="ascii") as snmp:
        names, numbers = (line.split() for line in snmp if line.startswith("Udp:"))
    return int(numbers[names.index("NoPorts")])


class Peer:
    """Moves a body of its own name. The publisher of its model is not needed."""

    def __init__(self, name):
        self.session = nm.Session.dds(name=name, **BUS)
        self.body = self.session.add_body(name, "ball", own=True)
        self.frame = 0

    def fly(self, seconds):
        """Packets to nobody, a frame and a second."""
        first, before, start = self.frame, packets_to_nobody(), time.monotonic()
        while time.monotonic() - start < seconds:
            self.session.update(self.frame, self.frame * FRAME_S, {self.body: np.eye(4)})
            self.frame += 1
            time.sleep(FRAME_S)
        packets = packets_to_nobody() - before
        return packets / (self.frame - first), packets / (time.monotonic() - start)


def main(name):
    peer = Peer(name)
    if name == "other":
        peer.fly(1000)
    peer.fly(5)
    alone_hz = peer.fly(5)[1]
    other = subprocess.Popen([sys.executable, __file__, "other"])
    doors, begin = {}, time.monotonic()
    while len(doors) < 2 and time.monotonic() - begin < DEADLINE_S:
        with subprocess.Popen([os.environ["NEARMESH_BIN_DIR"] + "/nearmesh-subscriber", "status", "--json", "--seconds", "3",
                               "--domain", str(BUS["domain"]), "--interface", BUS["interface"]], stdout=subprocess.PIPE) as status:
            while status.poll() is None:
                peer.fly(0.2)
            doors = {one["name"]: one["has_door"] for one in json.loads(status.stdout.read())["peers"]}
    other.send_signal(signal.SIGKILL)
    other.wait()

    def beyond(seconds):
        per_frame, per_second = peer.fly(seconds)
        return per_frame * (1 - alone_hz / per_second) if per_second > 0 else 0

    living = beyond(10)
    peer.fly(10)  # a lease is 20 s, as the door counts, whose time stands still where it is held up
    ended, begin = beyond(5), time.monotonic()
    while ended >= 0.2 and time.monotonic() - begin < DEADLINE_S:
        ended = beyond(5)
    print(json.dumps({"doors": doors, "living": living, "ended": ended}))


if __name__ == "__main__":
    main(sys.argv[1])
