#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the commands of a page as they are written there. Usage: run_commands.py ROOT BUILD PAGE, or run_commands.py ROOT --names.

Each command line of PAGE is given to a shell, in a scratch folder with the files that the page's reader would have, in a network
namespace of its own: so all stays as written, domains, ports and the interface eth0 too. What goes on until Ctrl-C is started,
awaited until it says that it is ready, and ended with Ctrl-C; what belongs together runs together (`SCRIPTS`). A command must end
with exit code 0 and speak of no error. WORDS are what a reader puts in place; NOT_RUN says what is not run, and why.
A command that nobody runs and nobody excuses is a fault, as is an excuse for what no page has.
Exit codes: 0 as expected, 1 a fault, 77 no namespace can be made here.
"""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import zlib

import check_commands

# By page and pattern: what is not run here, and why.
HAND = "takes minutes and is run by hand; make_page.py holds its page against what it wrote"
NOT_RUN = [
    ("README.md", r"^\./(demo|test)$", "installs and builds; .ci/run and tests/platforms run it"),
    ("docs/concepts.md", r"^(cmake --build|build/dev/bin/nearmesh-draw)", "builds, and writes into docs/; run by hand"),
    ("docs/network.md", r"^(cmake --build|bin=|(chrt -r 2 )?\$bin/nearmesh-network|python3 .*(crowd|make_page)\.py)", HAND),
    ("docs/perf.md", r"^(cmake --build|bin=|\$bin/|python3 .*make_page\.py)", HAND + " (rules.perf_page)"),
    ("docs/results.md", r"^(cmake --build|build/dev/bin/nearmesh-chart)", HAND),
    ("docs/sites.md", r"^(cmake --build|build/dev/bin/nearmesh-plan-sites|python3 .*measure_discovery\.py)",
     "builds, measures for minutes, or writes into docs/; sites_tests holds the page against what they give"),
    ("docs/sites.md", r"^nearmesh-publisher discovery", "as in docs/operate.md, whose page runs it"),
    ("docs/stability.md", r"^(cmake --build|build/dev/bin/nearmesh-stability|python3)", HAND + " (rules.stability_page)"),
    ("docs/platforms.md", r"^tests/platforms/", "needs root, and installs a Debian"),
    ("docs/operate.md", r"^(systemctl|journalctl) ", "needs root and systemd"),
    ("docs/terrain.md", r"\.tif ", "needs GDAL"),
    ("examples/cyclone/README.md", r"^(cmake -S examples/cyclone|export CYCLONEDDS_URI=|nearmesh-(publisher|subscriber) )",
     "needs Cyclone DDS, which consumer builds it with and cyclone_test flies it with"),
    ("examples/world/README.md", r"^examples/world/fly$", "bakes and flies for a minute; --small does the same in seconds"),
    ("examples/flightgear/README.md", r"^cmake -S \. -B /tmp/flightgear", "needs the package; consumer builds the folder so"),
    ("docs/ros2.md", r"--ros2", "goes on until Ctrl-C beside programs of ROS 2; cyclone_test runs it"),
]
# What a page writes for what only its reader knows.
WORDS = {
    "docs/worlds.md": {"CONTENT": "8f1c42d0a97be35561d09f7c2e04ab83"},
    "docs/terrain.md": {"1201x1201": "17x17"},
    "docs/sessions.md": {"--peer 3f": "--peer {peer}"},
    "docs/scene.md": {"MODEL.spm ... --answers FILE ...": "terrain.spm aircraft.spm --answers answers.jsonl"},
    "docs/operate.md": {"ADDRESS": "127.0.0.1", "8f1c42d0a97be35561d09f7c2e04ab83": "{content}"},
}
STARTS = re.compile(r"(?:[A-Z_]+=\S+ )?(?:[\w./$-]*/)?(?:nearmesh-[a-z-]+|cmake|ctest|python3|ninja|scp|systemctl|journalctl|chrt|gdal\w+|"
                    r"export|\w+\.(?:sh|py)|demo|test|fly)(?= |$)|[a-z]+=\S")
ERROR = re.compile(r"error|fail|cannot|could not|refused [1-9]|wrong [1-9]|Traceback|\[warning\]|terminate|abort", re.IGNORECASE)

NO_ERROR = re.compile(r"rounding error|^errors\n  none$", re.MULTILINE)


def command_lines(text):
    """Each command line of a page: as a shell takes it, without what stands behind #."""
    for first, lines in check_commands.blocks(text):
        lines = "\n".join(lines).replace("\\\n", " ").splitlines()
        prompts = [line for line in lines if line.startswith("$ ")]
        for line in prompts or lines:
            line = re.sub(r"\s+", " ", re.sub(r"(^|\s)#.*", "", line.removeprefix("$ "))).strip()
            match = STARTS.match(line)
            if match and not re.fullmatch(r"nearmesh-[a-z-]+ [\d.]+", line):  # what --version prints
                yield line
    for span in check_commands.spans(text):
        yield span


class Running:
    def __init__(self, page, line, ready):
        self.line, self.name = line, page.scratch / f"said.{len(page.started)}"
        self.file = open(self.name, "w+")
        words = re.sub(r"\s*&$", "", page.fill(line))
        self.process = subprocess.Popen(["bash", "-c", words], cwd=page.folder, stdin=subprocess.DEVNULL, stdout=self.file,
                                        stderr=subprocess.STDOUT, env=page.environment, start_new_session=True)
        if ready:
            page.until(lambda: re.search(ready, self.said()) or self.process.poll() is not None, f"{line}: it never said {ready}", self)
            if self.process.poll() is not None:
                page.fault(self, f"ended with exit code {self.process.returncode}")

    def said(self):
        return self.name.read_text(errors="replace")


class Page:
    """A page's commands, and the folder in which they run."""

    def __init__(self, root, build, name, scratch):
        self.root, self.name, self.scratch, self.folder = root, name, scratch, scratch
        self.faults, self.ran, self.started, self.words = [], [], [], {}
        self.lines = list(command_lines((root / name).read_text()))
        for folder in ("examples", "tests"):
            (scratch / folder).symlink_to(root / folder)
        self.bin = scratch / "build/dev/bin"
        self.bin.mkdir(parents=True)
        for program in (build / "bin").glob("nearmesh-*"):
            (self.bin / program.name).symlink_to(program)
        (scratch / "build/dev/python").symlink_to(build / "python")
        shim = scratch / "python3"  # the one that tests run with
        shim.write_text(f'#!/bin/bash\nexec "{sys.executable}" -B "$@"\n')
        shim.chmod(0o755)
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith("NEARMESH_")}
        self.environment["PATH"] = f"{scratch}:{self.bin}:{os.environ['PATH']}"

    def fault(self, command, what):
        self.faults.append(f"{self.name}: {command.line}: {what}; it said:\n{command.said()}")

    def fill(self, line):
        for word, other in WORDS.get(self.name, {}).items():
            if word in line:
                line = line.replace(word, other.format(**self.words))
        return line

    def until(self, done, otherwise, command=None, seconds=100):
        end = time.monotonic() + seconds
        while not done():
            if time.monotonic() > end:
                self.faults.append(f"{self.name}: {otherwise}" + (f"; it said:\n{command.said()}" if command else ""))
                return
            time.sleep(0.02)

    def begin(self, line, ready=None):
        """Starts a command of the page, and waits until it says `ready`."""
        if line not in self.lines:
            self.faults.append(f"{self.name}: it has no command {line}: change the script in run_commands.py with the page")
        self.ran.append(line)
        command = Running(self, line, ready)
        self.started.append(command)
        return command

    def end(self, command, interrupt=True, expected=(0,), seconds=100):
        """Ctrl-C, or to its own end; what came out must be as expected."""
        if interrupt and command.process.poll() is None:
            os.killpg(command.process.pid, signal.SIGINT)
        try:
            code = command.process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(command.process.pid, signal.SIGKILL)
            command.process.wait()
            code = "none, it had to be killed"
        if code not in expected:
            self.fault(command, f"exit code {code}")
        found = ERROR.search(NO_ERROR.sub("", command.said()))
        if found and code == 0:
            self.fault(command, f"it spoke of '{found[0]}'")
        return command.said()

    def run(self, line, **how):
        return self.end(self.begin(line), interrupt=False, **how)

    def listen(self, line, *parts, seconds=100):
        """What listens for a time that is short and fixed, again until it has heard what is expected: a busy machine may say nothing in it."""
        end = time.monotonic() + seconds
        while True:
            command = self.begin(line)
            said = self.end(command, interrupt=False, expected=(0, 1))
            has_heard = command.process.returncode == 0 and all(re.search(part, said) for part in parts)
            if has_heard or time.monotonic() > end:
                break
        if not has_heard:
            self.fault(command, f"exit code {command.process.returncode}, expected 0 and {parts}")

    def verify(self, line):
        """Exit code 3: beside all other tests a recorder may miss one of many poses, and what rests on it is not proved. Nothing may be wrong."""
        self.expect(self.run(line, expected=(0, 3)), r"[1-9]\d* of \d+ answers proved, 0 different", r"free by bounds: .* 0 wrong")

    def expect(self, text, *parts):
        for part in parts:
            if not re.search(part, text):
                self.faults.append(f"{self.name}: expected {part} in:\n{text}")

    @contextlib.contextmanager
    def going_on(self, line, ready, **how):
        command = self.begin(line, ready)
        try:
            yield command
        finally:
            self.end(command, **how)

    def stop_all(self):
        for command in self.started:
            if command.process.poll() is None:
                os.killpg(command.process.pid, signal.SIGKILL)
                command.process.wait()

    def make(self, *words):
        done = subprocess.run(words, cwd=self.folder, env=self.environment, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(words)}: {done.stderr}")
        return done.stdout


# --- What readers have ---

def sheet_obj(cells=24, step_m=10):
    side = range(cells + 1)
    half = cells * step_m / 2
    rows = [f"v {x * step_m - half} {y * step_m - half} {(x * y) % 5}" for y in side for x in side]
    for y in range(cells):
        for x in range(cells):
            corner = y * (cells + 1) + x + 1
            rows += [f"f {corner} {corner + 1} {corner + cells + 2}", f"f {corner} {corner + cells + 2} {corner + cells + 1}"]
    return "\n".join(rows) + "\n"


def make_models(page):
    (page.folder / "terrain.obj").write_text(sheet_obj())
    page.make("nearmesh-model", "generate", "aircraft", "--size", "400", "-o", "aircraft.ply")
    for name in ("terrain.obj", "aircraft.ply"):
        page.make("nearmesh-model", "build", name, "-o", name[:-3] + "spm")


def make_scene(page, ground="ground", craft="craft", rows=100, times=1, rests=16, more=""):
    """An aircraft that comes down onto the ground so many times, rests there for so many rows, and leaves it, at 20 rows a second."""
    (page.folder / "scene.yaml").write_text(
        f"bodies:\n  - {{name: {ground}, model: terrain, pose: {{translation: [0, 0, 0]}}}}\n  - {{name: {craft}, model: aircraft}}\n"
        f"moves:\n  - {{body: {craft}, trajectory: flight.csv}}\npairs: all\nframe_rate_hz: 20\nbudget_ms: 50\nlookahead_s: 1\n{more}")
    heights = [max(abs(row % (rows / times) - rows / times / 2) - rests / 2, 0) * 0.8 for row in range(rows)]
    (page.folder / "flight.csv").write_text(
        "QW,QX,QY,QZ,T0,T1,T2\n" + "".join(f"1,0,0,0,{row / 10},0,{height}\n" for row, height in enumerate(heights)))


def make_onlooker(page, name, ground="ground", craft="craft"):
    """A scene that moves nothing: the craft is what is played."""
    (page.folder / name).write_text(f"bodies:\n  - {{name: {ground}, model: terrain, pose: {{translation: [0, 0, 0]}}}}\n"
                                    f"  - {{name: {craft}, model: aircraft}}\npairs: all\n")


def make_poses(page, height_m):
    turn = ["1,0,0,0,1,0,0,0,1,0,0,"] * 2
    columns = [f"{body}_{name}{k}" for body in "AB" for name, ks in (("R", ("00", "01", "02", "10", "11", "12", "20", "21", "22")), ("T", "012"))
               for k in ks]
    (page.folder / "poses.csv").write_text("id," + ",".join(columns) + f"\n0,{turn[0]}0,{turn[1]}{height_m}\n")


def make_elevations(page):
    posts = [(x * y) % 40 + 5 * x for y in range(17) for x in range(17)]
    for name in ("N00E010.hgt", "N00E011.hgt"):
        (page.folder / name).write_bytes(struct.pack(f">{len(posts)}h", *posts))
    (page.folder / "jacksboro_fault_dem.pgm").write_bytes(b"P5 17 17 255\n" + bytes(post % 256 for post in posts))
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 8, 8, 8, 2, 0, 0, 0)),
              (b"IDAT", zlib.compress(b"".join(b"\0" + bytes((1, 134, x) [k] for x in range(8) for k in range(3)) for _ in range(8)))),
              (b"IEND", b"")]
    (page.folder / "terrain_rgb.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks))


# --- How the commands of a page belong together ---

def readme(page):
    make_models(page)
    make_scene(page, rows=300, times=3)  # its replay shall last longer than an onlooker takes to join on a busy machine
    page.run("nearmesh-model build terrain.obj -o terrain.spm")
    with page.going_on("nearmesh-subscriber record -o flight.db3", "recording domain"):
        with page.going_on("nearmesh-publisher serve terrain.spm aircraft.spm", "ready on domain"), \
                page.going_on("nearmesh-subscriber watch --http 8642", r"http://127\.0\.0\.1:8642/"), \
                page.going_on("nearmesh-subscriber status --watch", "publishers") as watching:
            flight = page.begin("nearmesh-subscriber run scene.yaml")
            page.listen("nearmesh-subscriber status --regions", "model terrain", "region ground and craft|region craft and ground")
            # Of 300: few where the machine is busy, else none.
            page.expect(page.end(flight, interrupt=False), "answers", r"[1-9]\d* contact", r" [12]?\d uncertain")
            page.listen("nearmesh-subscriber doctor", "publisher")
            page.until(lambda: "model terrain" in watching.said(), "status --watch never told of the terrain", watching)
    page.verify("nearmesh-subscriber verify flight.db3")
    page.run("nearmesh-subscriber report flight.db3 -o report")
    page.expect((page.folder / "report/index.html").read_text()[:200], "<!doctype html>|<!DOCTYPE html>")
    make_onlooker(page, "scene.yaml")
    with page.going_on("nearmesh-subscriber run scene.yaml", "joined domain") as onlooker:
        page.run("nearmesh-publisher replay flight.db3 --rate 2")
    page.expect(onlooker.said(), r"[1-9]\d* (free|contact)")
    (page.folder / "A.spm").symlink_to("terrain.spm")
    (page.folder / "B.spm").symlink_to("aircraft.spm")
    make_poses(page, 0)
    page.expect(page.run("nearmesh-model query A.spm B.spm --poses poses.csv --method certified"), "contact")


def operate(page):
    make_models(page)
    make_scene(page)
    (page.folder / "publisher.yaml").write_text("models: [terrain.spm, aircraft.spm]\ntransport: thin\n")
    page.expect(page.run("NEARMESH_PREFIX=site nearmesh-publisher serve --config publisher.yaml --lease-s 20 --print-config"),
                r'(?m)^prefix: "site" +# environment NEARMESH_PREFIX$', r"(?m)^lease_s: 20.0 +# flag --lease-s$",
                r"(?m)^announcement_s: 3.0 +# preset thin$")
    page.expect(page.run("nearmesh-subscriber --version"), "wire version")
    with page.going_on("nearmesh-publisher serve terrain.spm aircraft.spm --interface eth0 --metrics 9464", "ready on domain"):
        with page.going_on("nearmesh-subscriber watch --http 8642", r"http://127\.0\.0\.1:8642/"), \
                page.going_on("nearmesh-subscriber status --watch --interface eth0", "model terrain"):
            page.listen("nearmesh-subscriber doctor --interface eth0", "publisher")
    with page.going_on('nearmesh-publisher serve terrain.spm --name "terrain server"', "ready on domain"):
        page.words["content"] = re.search(r"content: (\w+)", page.make("nearmesh-model", "info", "terrain.spm"))[1]
        (page.folder / "new").mkdir()
        page.make("nearmesh-model", "build", "aircraft.ply", "-o", "new/terrain.spm")
        with page.going_on("nearmesh-publisher serve new/terrain.spm --replaces terrain=8f1c42d0a97be35561d09f7c2e04ab83", "ready on domain"):
            pass
    with page.going_on("nearmesh-publisher discovery --listen ADDRESS", "discovery server"):
        pass


def security(page):
    make_models(page)
    make_scene(page, more="duration_s: 2\nstart_timeout_s: 30\n")
    (page.folder / "scene.yaml").write_text("bodies:\n  - {name: one, model: terrain}\n  - {name: two, model: terrain}\nmoves:\n"
                                            "  - {body: one, trajectory: flight.csv}\n  - {body: two, trajectory: flight.csv}\npairs: all\n")
    # Other machines are folders: what is copied to one is there.
    scp = page.scratch / "scp"
    scp.write_text('#!/bin/bash\nset -e\nto=${@: -1}\nmkdir -p "hosts/${to%%:*}"\nexec cp ${@:1:$#-1} "hosts/${to%%:*}/${to#*:}"\n')
    scp.chmod(0o755)
    page.run("nearmesh-publisher make-security keys --domain 7 --publisher server1 --subscriber alice bob --recorder archive")
    page.run("scp -r keys/server1 server1:nearmesh-key")
    page.make("scp", "-r", "keys/alice", "alice:nearmesh-key")
    home = page.folder
    for host in ("server1", "alice"):
        for name in ("terrain.spm", "scene.yaml", "flight.csv"):
            shutil.copy(home / name, home / "hosts" / host / name)
    page.folder = home / "hosts/server1"
    page.run("nearmesh-publisher check-security nearmesh-key --domain 7")
    with page.going_on("nearmesh-publisher serve terrain.spm --domain 7 --security nearmesh-key", "ready on domain"):
        page.folder = home / "hosts/alice"
        page.expect(page.run("nearmesh-subscriber run scene.yaml --domain 7 --security nearmesh-key"), r"[1-9]\d* contact", " 0 uncertain")
    page.folder = home
    page.run("nearmesh-publisher make-security keys --domain 7 --subscriber sim1 sim2 --topic flight_sim/state 'flight_sim/events/*'")
    page.run("nearmesh-publisher make-security keys --domain 7 --revoke alice")
    page.run("scp keys/server1/identity_crl.pem server1:nearmesh-key/")


def sessions(page):
    make_models(page)
    make_scene(page, "quay", "hull", rows=260, rests=120)  # who looks on has to join while it is played, at twice the speed
    (page.folder / "models").mkdir()
    for name in ("terrain.spm", "aircraft.spm"):
        (page.folder / "models" / name).symlink_to(f"../{name}")
    with page.going_on("nearmesh-subscriber record -o flight.db3", "recording domain"):
        server = Running(page, "nearmesh-publisher serve terrain.spm aircraft.spm", "ready on domain")
        page.make("nearmesh-subscriber", "run", "scene.yaml", "--wait-recorder", "--answers", "answers.jsonl")
        page.end(server)
    page.expect(page.run("nearmesh-subscriber info flight.db3"), "contact")
    page.words["peer"] = json.loads(page.make("nearmesh-subscriber", "info", "--json", "flight.db3"))["peers"][0][:2]
    page.verify("nearmesh-subscriber verify flight.db3")
    page.verify("nearmesh-subscriber verify flight.db3 --models models/")
    page.run("nearmesh-subscriber report flight.db3 -o report")
    for kind in ("mcap", "glb"):
        page.run(f"nearmesh-subscriber export flight.db3 -o flight.{kind}")
    page.run("nearmesh-subscriber export flight.db3 --time 12.5 --peer 3f --body hull --other quay -o hull.glb")
    make_onlooker(page, "looks.yaml", "quay", "hull")
    onlooker = Running(page, "nearmesh-subscriber run looks.yaml", "joined domain")
    page.run("nearmesh-publisher replay flight.db3 --rate 2")
    page.run("nearmesh-publisher replay flight.db3 --rate 2 --start 10")
    page.expect(page.end(onlooker), r"[1-9]\d* contact")


def example_world(page):
    said = page.run("examples/world/fly --small", seconds=300)  # it bakes, too
    page.expect(said, r"peer1: .*[1-9]\d* pairs free by bounds; answers: .*[1-9]\d* contact", r"peer2: ")


def example_embed(page):
    page.folder = page.bin
    for line in ("./nearmesh-model generate sphere --size 64 -o sphere.ply", "./nearmesh-model build sphere.ply -o sphere.spm"):
        page.run(line)
    with page.going_on("./nearmesh-publisher serve sphere.spm --domain 7 --interface 127.0.0.1", "ready on domain"):
        page.expect(page.run("./nearmesh-example-embed 7 127.0.0.1"), r"height 1\.00 m: contact, 256 touching face pairs")


def example_flight_sim(page):
    page.folder = page.bin
    for line in [line for line in page.lines if line.startswith("./nearmesh-model")]:
        page.run(line)
    with page.going_on("./nearmesh-publisher serve terrain.spm aircraft.spm --domain 7 --interface 127.0.0.1", "ready on domain"):
        page.expect(page.run(next(line for line in page.lines if "nearmesh-example-flight-sim" in line)), "flight_sim alpha: 2000 steps")
    shutil.rmtree(page.folder / "keys", ignore_errors=True)
    page.run("./nearmesh-publisher make-security keys --domain 7 --publisher server1 --subscriber alpha --topic flight_sim/state")
    with page.going_on("./nearmesh-publisher serve terrain.spm aircraft.spm --domain 7 --interface 127.0.0.1 --security keys/server1", "ready on domain"):
        page.expect(page.run(next(line for line in page.lines if "--security keys/alpha" in line)), r"flight_sim alpha: 2000 steps, .*[1-9]\d* free")


def example_flightgear(page):
    page.folder = page.bin
    for line in [line for line in page.lines if line.startswith("./nearmesh-model")]:
        page.run(line)
    with page.going_on("./nearmesh-publisher serve terrain.spm aircraft.spm --domain 7 --interface 127.0.0.1", "ready on domain"), \
            page.going_on(next(line for line in page.lines if "nearmesh-example-flightgear" in line), "states at UDP port"):
        time.sleep(1)  # FlightGear itself: tests/system/flightgear


def example_python(page):
    page.run("export PYTHONPATH=build/dev/python")
    page.environment["PYTHONPATH"] = "build/dev/python"
    page.run("nearmesh-model generate sphere -o ball.ply && nearmesh-model build ball.ply -o ball.spm")
    chart = "python3 examples/python/chart.py ball.spm ball.spm chart.svg"
    if subprocess.run(["python3", "-c", "import matplotlib"], env=page.environment, stderr=subprocess.DEVNULL).returncode == 0:
        page.run(chart)
    else:
        print(f"not run without python3-matplotlib: {chart}")
        page.ran.append(chart)
    with page.going_on("nearmesh-publisher serve ball.spm &", "ready on domain"):
        page.expect(page.run("python3 examples/python/peer.py ball"), r"1\.00 m: CONTACT, certified")


def scene(page):
    make_models(page)
    make_scene(page)
    server = Running(page, "nearmesh-publisher serve terrain.spm aircraft.spm", "ready on domain")
    page.make("nearmesh-subscriber", "run", "scene.yaml", "--answers", "answers.jsonl")
    page.end(server)
    page.expect(page.run("nearmesh-model check MODEL.spm ... --answers FILE ..."), "wrong 0")
    page.run("nearmesh-model generate terrain --floor-m -3000 -o terrain.ply")


def in_order(*makers):
    """Each command that can be run, one after the other."""
    def script(page):
        for make in makers:
            make(page)
        for line in page.lines:
            if not excuse(page.name, line):
                page.run(line)
    return script


def make_ball(page):
    page.make("nearmesh-model", "generate", "sphere", "-o", "MESH.ply")
    (page.folder / "MESH").symlink_to("MESH.ply")


def worlds(page):
    make_elevations(page)
    make_flown_world(page)
    make_scene(page)
    scene = (page.folder / "scene.yaml").read_text()
    (page.folder / "world.yaml").write_text(scene.replace("model: terrain", "model: WORLD").replace("pairs: all", "pairs: [[ground, craft]]"))
    server = None
    for line in page.lines:
        if line == "nearmesh-publisher serve WORLD aircraft.spm":
            server = page.begin(line, "ready on domain")
        elif "--replaces" in line:
            page.end(server)
            server = page.begin(line, "ready on domain")
        elif not excuse(page.name, line):
            said = page.run(line)
            if "--answers" in line and " check " in line:
                page.expect(said, "wrong 0", r"certified [1-9]")
    page.end(server)


def make_flown_world(page):
    make_models(page)
    make_poses(page, 30)
    (page.folder / "rays.csv").write_text("x,y,z\n100,100,5000\n-100,50,5000\n")


# By page: its script, and whether that needs a bus.
SCRIPTS = {
    "README.md": (readme, True),
    "docs/import.md": (in_order(make_ball), False),
    "docs/operate.md": (operate, True),
    "docs/scene.md": (scene, True),
    "docs/security.md": (security, True),
    "docs/sessions.md": (sessions, True),
    "docs/terrain.md": (in_order(make_elevations), False),
    "docs/worlds.md": (worlds, True),
    "examples/embed/README.md": (example_embed, True),
    "examples/world/README.md": (example_world, True),
    "examples/flight_sim/README.md": (example_flight_sim, True),
    "examples/flightgear/README.md": (example_flightgear, True),
    "examples/python/README.md": (example_python, True),
    "examples/read_session/README.md": (in_order(), False),
}


def excuse(name, line):
    return next((entry for entry in NOT_RUN if entry[0] == name and re.search(entry[1], line)), None)


def check_accounts(root):
    """Every page with commands has a script or an excuse for each, and every excuse has its commands."""
    faults, used = [], set()
    for page in check_commands.pages(root):
        name = str(page.relative_to(root))
        for line in command_lines(page.read_text()):
            found = excuse(name, line)
            used.add(found)
            if not found and name not in SCRIPTS:
                faults.append(f"{name}: nobody runs {line}")
    faults += [f"{entry[0]}: no command is excused by {entry[1]}" for entry in NOT_RUN if entry not in used]
    return faults + [f"{name}: a script for no page" for name in SCRIPTS if not (root / name).is_file()]


def enter_namespace():
    """This process again, alone on a network with loopback and eth0; returns where it is."""
    if os.environ.get("NEARMESH_PAGES_NAMESPACE"):
        subprocess.run(["bash", "-ec", "ip link set lo up; ip link set lo multicast on; ip link add eth0 type veth peer name eth1; "
                        "ip addr add 192.0.2.1/24 dev eth0; ip link set eth0 up; ip link set eth1 up; ip route add 224.0.0.0/4 dev lo; "
                        "until ip link show eth0 | grep -q 'state UP'; do sleep 0.05; done"], check=True, timeout=60)
        return True
    options = ["-n"] if os.geteuid() == 0 else ["-r", "-n"]
    if subprocess.run(["unshare", *options, "true"], stderr=subprocess.DEVNULL).returncode != 0:
        return False
    os.environ["NEARMESH_PAGES_NAMESPACE"] = "1"
    os.execvp("unshare", ["unshare", *options, sys.executable, *sys.argv])


def main(root, build, name):
    script, needs_bus = SCRIPTS[name]
    if needs_bus and not enter_namespace():
        print("no network namespace can be made here (needs root, or user namespaces)")
        return 77
    with tempfile.TemporaryDirectory(prefix="nearmesh_pages_") as folder:
        page = Page(root, build, name, pathlib.Path(folder))
        try:
            script(page)
        except Exception as error:  # what the page's reader would have could not be made
            page.faults.append(f"{name}: {type(error).__name__}: {error}")
        finally:
            page.stop_all()
        page.faults += [f"{name}: nobody runs {line}" for line in page.lines if line not in page.ran and not excuse(name, line)]
    print("\n".join(page.faults) or f"{name}: {len(page.ran)} commands do what the page says, "
                                    f"{sum(excuse(name, line) is not None for line in page.lines)} are not run.")
    return 1 if page.faults else 0


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[2] == "--accounts":
        result = check_accounts(pathlib.Path(sys.argv[1]).resolve())
        print("\n".join(result) or "Each command of a page is run or excused.")
        sys.exit(1 if result else 0)
    if len(sys.argv) == 3 and sys.argv[2] == "--names":
        print(";".join(f"{name}:{'dds' if needs_bus else 'rules'}" for name, (_, needs_bus) in SCRIPTS.items()))
        sys.exit(0)
    if len(sys.argv) != 4 or sys.argv[3] not in SCRIPTS:
        sys.exit(__doc__)
    sys.exit(main(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve(), sys.argv[3]))
