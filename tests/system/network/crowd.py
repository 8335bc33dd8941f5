#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Join storms: many peers started at once, in a network namespace of their own. Needs root.

  crowd.py --peers 100                        # the demo's scene, each peer with an aircraft of its own
  crowd.py --peers 60 --server                # discovery through nearmesh-publisher discovery
  crowd.py --peers 30 --churn 10              # joining and leaving at random for ten minutes
  crowd.py --peers 40 --cores 0.6 --rounds 6  # a slow machine (cgroup cpu, version 1)

One line a round: when the peers had their first certified answer (seconds from the moment in which all were started; median and
worst), how many had one, processor seconds a peer until the last of them had it and per other peer, packets received, who ended
otherwise than told. Beside it the machine's load before the round.
"""
import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

TREE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))
CGROUP = "/sys/fs/cgroup/cpu"
TICK_S = 1 / os.sysconf("SC_CLK_TCK")
CERTIFIED = ("free", "contact", "contained")

# The demo's, in couples: peer 2k and peer 2k + 1 fly at each other.
SCENE = """bodies:
  - {{name: terrain, model: terrain, pose: {{translation: [0, 0, 0]}}}}
  - {{name: aircraft{me}, model: aircraft}}
  - {{name: aircraft{other}, model: aircraft}}
moves:
  - {{body: aircraft{me}, trajectory: {folder}/flight{side}.csv}}
pairs:
  - [terrain, aircraft{me}]
  - [aircraft{a}, aircraft{b}]
frame_rate_hz: {rate}
budget_ms: 10
lookahead_s: 0.3
start_timeout_s: {timeout}
"""


def cpu_s(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            fields = stat.read().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) * TICK_S


def resident_kb(pid):
    try:
        with open(f"/proc/{pid}/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))
    except (OSError, StopIteration):
        return 0


def udp_datagrams():
    with open("/proc/net/snmp") as snmp:
        rows = [line.split() for line in snmp if line.startswith("Udp:")]
    counts = dict(zip(rows[0], rows[1]))
    return int(counts["InDatagrams"]), int(counts["RcvbufErrors"])


class Round:
    def __init__(self, options, number):
        self.o = options
        self.folder = tempfile.mkdtemp(prefix="nearmesh_crowd_")
        self.bus = ["--domain", str(options.domain + number % 50), "--interface", options.interface]
        if options.server:
            self.bus += ["--discovery-server", f"{options.address}:11811"]
        self.bus += options.extra
        self.processes, self.files = {}, []
        self.faults = []

    def start(self, name, words, program="nearmesh-subscriber", gate=None):
        """Beyond a gate a program begins when that is opened."""
        out = open(f"{self.folder}/{name}.out", "w")
        err = open(f"{self.folder}/{name}.err", "w")
        def enter():
            if self.o.cores:
                with open(f"{CGROUP}/nearmesh_crowd/tasks", "w") as tasks:
                    tasks.write(str(os.getpid()))
        command = [f"{self.o.bin}/{program}", *words]
        if gate is not None:
            command = ["sh", "-c", 'read gate; exec "$@" </dev/null', "sh", *command]
        process = subprocess.Popen(command, stdin=gate if gate is not None else subprocess.DEVNULL, stdout=out, stderr=err,
                                   preexec_fn=enter if self.o.cores else None)
        out.close(), err.close()
        self.processes[name] = process
        return process

    def said(self, name):
        with open(f"{self.folder}/{name}.err", errors="replace") as err:
            return err.read()

    def peer(self, name, i, gate):
        side, base = i % 2 + 1, i - i % 2
        scene = SCENE.format(me=i, other=i ^ 1, a=base, b=base + 1, side=side, folder=self.folder, rate=self.o.rate,
                             timeout=self.o.seconds + 60)
        with open(f"{self.folder}/{name}.yaml", "w") as out:
            out.write(scene)
        self.start(name, ["run", f"{self.folder}/{name}.yaml", "--answers", f"{self.folder}/{name}.jsonl", *self.bus],
                   gate=gate)

    def first_certified(self, name, seen):
        """Has the peer a certified answer? Reads what came since the last look."""
        try:
            with open(f"{self.folder}/{name}.jsonl") as answers:
                answers.seek(seen.get(name, 0))
                text = answers.read()
        except OSError:
            return False
        whole = text.rfind("\n") + 1
        seen[name] = seen.get(name, 0) + whole
        return any(json.loads(line).get("status") in CERTIFIED for line in text[:whole].splitlines())

    def run(self):
        o = self.o
        for side in (1, 2):
            shutil.copy(f"{o.models}/flight{side}.csv", self.folder)
        if o.server:
            self.start("server", ["discovery", "--listen", o.address, "--domain", self.bus[1]], "nearmesh-publisher")
        for i in range(o.publishers):
            self.start(f"publisher{i}", ["serve", f"{o.models}/terrain.spm", f"{o.models}/aircraft.spm", *self.bus],
                       "nearmesh-publisher")
        deadline = time.time() + 30
        while "ready on domain" not in self.said("publisher0"):
            if time.time() > deadline:
                raise SystemExit("no publisher: " + self.said("publisher0"))
            time.sleep(0.05)
        time.sleep(1)
        load = os.getloadavg()[0]
        names = [f"peer{i}" for i in range(o.peers)]
        before = udp_datagrams()
        others_cpu = {n: cpu_s(p.pid) for n, p in self.processes.items()}
        gate, handle = os.pipe()
        for i, name in enumerate(names):
            self.peer(name, i, gate)
        os.close(gate)
        time.sleep(1)
        began = time.monotonic()
        os.close(handle)
        firsts, seen, dead = {}, {}, {}
        spent = 0.0
        while time.monotonic() - began < o.seconds and len(firsts) + len(dead) < o.peers:
            time.sleep(0.1)
            now = time.monotonic() - began
            for name in names:
                if name in firsts or name in dead:
                    continue
                if self.first_certified(name, seen):
                    firsts[name] = now
                elif self.processes[name].poll() is not None:
                    dead[name] = self.processes[name].returncode
        spent = sum(cpu_s(self.processes[n].pid) for n in names)
        serving = sum(cpu_s(p.pid) - others_cpu[n] for n, p in self.processes.items() if n in others_cpu)
        wall = time.monotonic() - began
        packets = [now - then for now, then in zip(udp_datagrams(), before)]
        cpu = {n: cpu_s(p.pid) for n, p in self.processes.items()}
        steady_began = time.monotonic()
        time.sleep(o.steady)
        steady = sum(cpu_s(p.pid) - cpu[n] for n, p in self.processes.items()) / max(time.monotonic() - steady_began, 1e-9)
        ends = self.end()
        times = sorted(firsts.values())
        at = lambda share: times[min(len(times) - 1, int(share * len(times)))] if times else float("nan")
        print(f"peers {o.peers}: certified {len(firsts)}, first answer p50 {at(0.5):.2f} worst {times[-1] if times else float('nan'):.2f} s "
              f"from the start of all; CPU {spent / o.peers:.3f} s a peer, {1000 * spent / o.peers / max(o.peers - 1, 1):.2f} ms "
              f"for each other, publisher {serving:.2f} s, in {wall:.1f} s; datagrams {packets[0]}, lost in sockets {packets[1]}; "
              f"then {steady:.2f} cores; load before {load:.1f}; ended otherwise: {ends or 'none'}", flush=True)
        if o.keep:
            print(self.folder)
        else:
            shutil.rmtree(self.folder)
        return len(firsts) == o.peers and not ends

    def churn(self):
        """Peers join, leave (SIGINT) and are killed at random, from their first moment on. Out: who ended otherwise."""
        o = self.o
        dice = random.Random(o.seed)
        for side in (1, 2):
            shutil.copy(f"{o.models}/flight{side}.csv", self.folder)
        self.start("publisher0", ["serve", f"{o.models}/terrain.spm", f"{o.models}/aircraft.spm", *self.bus], "nearmesh-publisher")
        self.start("watcher", ["status", "--watch", "--json", *self.bus])
        lives, told, joined, faults = {}, {}, 0, []
        stays = ("publisher0", "watcher")
        memory = []
        deadline = time.monotonic() + 60 * o.churn
        while time.monotonic() < deadline:
            time.sleep(dice.uniform(0, 2 * o.pause))
            place = dice.randrange(o.peers)
            name = f"peer{place}"
            if name in lives and told.get(name) is None:
                told[name] = dice.choice((signal.SIGINT, signal.SIGINT, signal.SIGKILL))
                lives[name].send_signal(told[name])
            elif name not in lives:
                self.peer(name, place, None)
                lives[name] = self.processes.pop(name)
                joined += 1
            for name in [n for n, p in lives.items() if p.poll() is not None]:
                code, word = lives.pop(name).returncode, told.pop(name, None)
                # Before main() nobody can take a signal.
                if not (code == 0 or (word is not None and code == -word and (word == signal.SIGKILL or not self.said(name)))):
                    faults.append(f"{name} {code} after {word} {self.said(name)[-300:]}")
            faults += [f"{n} ended: {self.said(n)[-300:]}" for n in stays if self.processes[n].poll() is not None]
            if not memory or time.monotonic() - memory[-1][0] > 30:
                memory.append((time.monotonic(), [resident_kb(self.processes[n].pid) for n in stays]))
        for process in lives.values():
            process.send_signal(signal.SIGKILL)
            process.wait()
        minutes = (memory[-1][0] - memory[0][0]) / 60
        print(f"{joined} joined in {o.churn} min, {len(faults)} ended otherwise than told {faults[:5]}; resident kB of publisher and "
              f"watcher each 30 s: {[m for _, m in memory]} ({minutes:.1f} min)", flush=True)
        faults += self.end()
        return not faults

    def end(self):
        """All are told to end. Out: who ended before, or otherwise."""
        ends = []
        early = {n for n, p in self.processes.items() if p.poll() is not None and p.returncode != 0}
        for process in self.processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + 60
        for name, process in self.processes.items():
            try:
                code = process.wait(max(0.1, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                code = "hung"
            if name in early or code != 0:
                last = (self.said(name).strip().splitlines() or [""])[-1]
                ends.append(f"{name} {'early ' if name in early else ''}{code} {last[:200]}")
        return ends


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--peers", type=int, default=100)
    words.add_argument("--publishers", type=int, default=1)
    words.add_argument("--rate", type=float, default=2, help="frames a second of each")
    words.add_argument("--seconds", type=float, default=90, help="how long first answers are waited for")
    words.add_argument("--steady", type=float, default=5, help="how long the bus is looked at afterwards")
    words.add_argument("--rounds", type=int, default=1)
    words.add_argument("--cores", type=float, default=0, help="share of the machine that all have together; 0: all")
    words.add_argument("--churn", type=float, default=0, help="minutes in which peers join and leave at random, instead of rounds")
    words.add_argument("--pause", type=float, default=0.3, help="mean seconds between two events of that")
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--server", action="store_true", help="discovery through nearmesh-publisher discovery")
    words.add_argument("--link", action="store_true", help="on a link of its own instead of loopback")
    words.add_argument("--domain", type=int, default=50)
    words.add_argument("--bin", default=f"{TREE}/build/dev/bin")
    words.add_argument("--models", default=f"{TREE}/out/demo", help="where ./demo left terrain.spm, aircraft.spm, flight1.csv, flight2.csv")
    words.add_argument("--keep", action="store_true", help="keep what the programs wrote")
    words.add_argument("extra", nargs="*", help="further words of every program, behind --")
    options = words.parse_args()
    if os.environ.get("NEARMESH_CROWD_INSIDE") != "1":
        os.environ["NEARMESH_CROWD_INSIDE"] = "1"
        os.execvp("unshare", ["unshare", "-n", sys.executable, *sys.argv])
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    options.interface = options.address = "127.0.0.1"
    if options.link:
        for command in ("ip link add e0 type dummy", "ip addr add 10.77.0.1/24 dev e0", "ip link set e0 up multicast on",
                        "ip route add 239.0.0.0/8 dev e0"):
            subprocess.run(command.split(), check=True)
        options.interface = options.address = "10.77.0.1"
    group = f"{CGROUP}/nearmesh_crowd"
    if options.cores:
        os.makedirs(group, exist_ok=True)
        for name, value in (("cpu.cfs_period_us", 100000), ("cpu.cfs_quota_us", int(100000 * options.cores))):
            with open(f"{group}/{name}", "w") as out:
                out.write(str(value))
    well = True
    try:
        for number in range(options.rounds):
            well = (Round(options, number).churn() if options.churn else Round(options, number).run()) and well
    finally:
        if options.cores:
            os.rmdir(group)
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
