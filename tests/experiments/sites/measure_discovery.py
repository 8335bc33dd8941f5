#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What participants of one domain cost each other: bytes and processor time of joining, and of staying. Needs root.

  measure_discovery.py -o docs/sites/discovery.csv
  measure_discovery.py -o docs/sites/discovery-server.csv --server --rates 1     # through nearmesh-publisher discovery

One publisher and 1 to 29 peers, real programs in a network namespace of their own, on one link with multicast. They are started
one after the other, so this is the cost of joining in turn: many at once cost more (docs/network.md). Each peer moves one body, far
from all others, and hears all others'. A row for each number of participants, at two rates of frames:
participants, rate_hz: when the row was measured; a discovery server is none of them, but its processor time counts.
join_unicast_bytes, join_multicast_bytes, join_cpu_s: from the start of the first until all are settled, without what staying took.
stay_unicast_bytes, stay_multicast_bytes, stay_cpu_s: a second, then. A multicast byte is counted once, a unicast byte once for each
who gets it. Bytes are those of interface counters, with link headers.
"""
import argparse
import csv
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

TREE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))
TICK_S = 1 / os.sysconf("SC_CLK_TCK")
COLUMNS = ["participants", "rate_hz", "join_unicast_bytes", "join_multicast_bytes", "join_cpu_s", "stay_unicast_bytes",
           "stay_multicast_bytes", "stay_cpu_s"]
SCENE = """bodies:
  - {{name: body{me}, model: body}}
moves:
  - {{body: body{me}, trajectory: {folder}/flight{me}.csv}}
pairs: all
frame_rate_hz: {rate}
"""


def cpu_s(pid):
    with open(f"/proc/{pid}/stat") as stat:
        fields = stat.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) * TICK_S


def bytes_of(interface, which):
    """Of this network namespace; /sys may show another."""
    with open("/proc/net/dev") as counts:
        fields = next(line.split(":")[1].split() for line in counts if line.strip().startswith(interface + ":"))
    return int(fields[{"rx": 0, "tx": 8}[which]])


class Bus:
    """What is sent to one's own address goes over loopback, what is multicast over the link."""

    def __init__(self, options, rate):
        self.o, self.rate = options, rate
        self.folder = tempfile.mkdtemp(prefix="nearmesh_sites_")
        self.processes, self.server = [], []
        if options.server:
            with open(f"{self.folder}/server.err", "w") as err:
                self.server.append(subprocess.Popen([f"{options.bin}/nearmesh-publisher", "discovery", "--listen", options.address],
                                                    stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=err))
            time.sleep(1)
        subprocess.run([f"{options.bin}/nearmesh-model", "generate", "sphere", "-o", f"{self.folder}/body.ply"],
                       check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        subprocess.run([f"{options.bin}/nearmesh-model", "build", f"{self.folder}/body.ply", "-o", f"{self.folder}/body.spm"],
                       check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def start(self, words):
        with open(f"{self.folder}/{len(self.processes)}.err", "w") as err:
            more = ["--discovery-server", self.o.address] if self.server else []
            self.processes.append(subprocess.Popen([*words, "--interface", self.o.address, "--log", "warning", *more],
                                                   stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=err))

    def join(self):
        me = len(self.processes)
        if me == 0:
            return self.start([f"{self.o.bin}/nearmesh-publisher", "serve", f"{self.folder}/body.spm"])
        with open(f"{self.folder}/flight{me}.csv", "w") as out:
            out.write("R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n")
            for frame in range(int(3600 * self.rate)):
                out.write(f"1,0,0,0,1,0,0,0,1,{1000 * me},{frame / self.rate},0\n")
        with open(f"{self.folder}/scene{me}.yaml", "w") as out:
            out.write(SCENE.format(me=me, folder=self.folder, rate=self.rate))
        return self.start([f"{self.o.bin}/nearmesh-subscriber", "run", f"{self.folder}/scene{me}.yaml"])

    def now(self):
        """Unicast bytes, multicast bytes, processor seconds, and when."""
        for number, process in enumerate(self.processes):
            if process.poll() is not None:
                with open(f"{self.folder}/{number}.err") as err:
                    raise SystemExit(f"program {number} ended: {err.read()[-500:]}")
        return (bytes_of("lo", "rx"), bytes_of("e0", "tx"), sum(cpu_s(p.pid) for p in self.processes + self.server), time.monotonic())

    def end(self):
        for process in self.processes + self.server:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self.processes + self.server:
            process.wait(timeout=60)
        shutil.rmtree(self.folder)


def measure(options, rate, out):
    bus = Bus(options, rate)
    try:
        look(options, rate, bus, out)
    finally:
        bus.end()


def look(options, rate, bus, out):
    began, stay, joined = bus.now(), [0, 0, 0], [0.0, 0.0, 0.0]
    for count in options.participants:
        while len(bus.processes) < count:
            bus.join()
            time.sleep(options.apart)
        time.sleep(options.settle)
        before = bus.now()
        time.sleep(options.seconds)
        after = bus.now()
        seconds = after[3] - before[3]
        last, stay = stay, [(after[i] - before[i]) / seconds for i in range(3)]
        # While some joined, staying took something between what it took before and what it takes now.
        for i in range(3):
            joined[i] += before[i] - began[i] - (last[i] + stay[i]) / 2 * (before[3] - began[3])
        began = after
        row = [count, rate, *(round(joined[i]) for i in range(2)), f"{joined[2]:.2f}", *(round(stay[i]) for i in range(2)),
               f"{stay[2]:.4f}"]
        print(row, flush=True)
        out.writerow(row)


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("-o", "--output", required=True)
    words.add_argument("--participants", type=lambda text: [int(n) for n in text.split(",")], default=[2, 5, 10, 15, 20, 25, 30])
    words.add_argument("--rates", type=lambda text: [float(n) for n in text.split(",")], default=[1.0, 10.0])
    words.add_argument("--server", action="store_true", help="others are found through a discovery server alone")
    words.add_argument("--seconds", type=float, default=8, help="how long staying is looked at")
    words.add_argument("--settle", type=float, default=4, help="how long the last are waited for")
    words.add_argument("--apart", type=float, default=0.7, help="between two that start")
    words.add_argument("--bin", default=f"{TREE}/build/dev/bin")
    options = words.parse_args()
    options.address = "127.0.0.1" if options.server else "10.77.0.1"  # a server and its clients of one machine: loopback
    if os.environ.get("NEARMESH_SITES_INSIDE") != "1":
        os.environ["NEARMESH_SITES_INSIDE"] = "1"
        os.execvp("unshare", ["unshare", "-n", sys.executable, *sys.argv])
    for command in ("ip link set lo up", "ip link add e0 type veth peer name e1", "ip link set e1 up",
                    "ip addr add 10.77.0.1/24 dev e0", "ip link set e0 up multicast on", "ip route add 239.0.0.0/8 dev e0"):
        subprocess.run(command.split(), check=True)
    with open(options.output, "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(COLUMNS)
        for rate in options.rates:
            measure(options, rate, out)


if __name__ == "__main__":
    main()
