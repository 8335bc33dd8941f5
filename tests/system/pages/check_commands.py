#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Every command on a page is one that the programs take. Usage: check_commands.py ROOT BIN, or check_commands.py --self-test BIN.

Reads the code blocks of README.md, docs/ and examples/. Of each nearmesh-* command line in them, program, verb and options are held
against the program's own --help; of examples and of what is run by hand, which may not be built, against their sources. What can
run on generated data within seconds is run, in the order of its page, in a scratch folder. RUN says which verbs these are; the
others need a bus, a browser, or minutes, and are only read.
Prints what was done, one line per fault, and exits with 1 when there is any.
"""
import functools
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

# What needs neither a bus nor minutes.
RUN = {"nearmesh-model": {"generate", "build", "info", "check", "query", "probe", "formats"},
       "nearmesh-publisher": {"make-security", "check-security", "--version"},
       "nearmesh-subscriber": {"info", "verify", "report", "export", "--version"}}
# What only the reader has: bodies by name, real elevations of which one takes half a minute to bake, worlds of them, other machines'
# models, colours, and identities that are carried to other machines under other names.
NOT_HERE = re.compile(r"\.hgt|WORLD|terrain_rgb|bigtujunga|basin|degrees|models/|nearmesh-key|MODEL|DATA|--body|--size (708|512|1024)")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(text):
    """(number of the first line, lines) of each code block that may hold commands."""
    for match in FENCE.finditer(text):
        if match[1] in ("", "sh", "bash", "shell"):
            yield text.count("\n", 0, match.start(2)) + 1, match[2].splitlines()
    bare = FENCE.sub(lambda m: re.sub(r"[^\n]", "", m[0]), text).splitlines()
    for number, line in enumerate(bare, 1):
        if line.startswith("    ") and (number < 2 or not bare[number - 2].startswith("    ")):
            end = next((i for i in range(number, len(bare)) if not bare[i].startswith("    ")), len(bare))
            yield number, [one[4:] for one in bare[number - 1:end]]


def commands(page):
    """(line, words) of each nearmesh-* command of a page, without what stands around it."""
    for first, lines in blocks(page.read_text()):
        number = first - 1
        while lines:
            number += 1
            line, used = lines.pop(0), 1
            while line.endswith("\\") and lines:
                line, used = line[:-1] + lines.pop(0), used + 1
            line = re.sub(r"^\$ ", "", line)
            try:
                lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
                lexer.wordchars += "$,=*:{}"
                words = list(lexer)
            except ValueError:
                words = []  # what a program prints
            command = []
            for word in words + [";"]:
                if set(word) <= set("();<>|&"):
                    if command:
                        yield number, command
                    command = None if set(word) <= set("<>") else []  # a file comes next
                elif command is None:
                    command = [] if word else None
                elif command or re.fullmatch(r"([\w./$]*/)?nearmesh-[a-z-]+", word):
                    if command or not words[:words.index(word)] or not is_prose(words[:words.index(word)]):
                        command.append(pathlib.PurePath(word).name if not command else word)
            number += used - 1


def is_prose(before):
    """A program's name within a line that is no command: what stands before it is neither a setting nor a way to start it."""
    for word in before:
        if set(word) <= set("();<>|&"):
            before = before[before.index(word) + 1:]
    return not all("=" in word or word in ("chrt", "-r", "2", "nice", "time") for word in before)


class Programs:
    def __init__(self, root, binaries):
        self.root, self.binaries = root, binaries

    @functools.lru_cache(maxsize=None)
    def help(self, program, verb):
        words = [self.binaries / program] + ([verb] if verb else []) + ["--help"]
        return subprocess.run(words, capture_output=True, text=True, timeout=60).stdout

    @functools.lru_cache(maxsize=None)
    def source(self, program):
        """Of the folder that makes a program."""
        for lists in [path for folder in ("tests", "examples") for path in sorted((self.root / folder).rglob("CMakeLists.txt"))]:
            if re.search(rf"\({re.escape(program)}[ )]", lists.read_text()):
                return "".join(path.read_text() for path in sorted(lists.parent.rglob("*.[ch]pp")))
        return None

    def faults(self, words):
        program, rest = words[0], words[1:]
        options = [re.match(r"-[\w-]*", word)[0] for word in rest if re.match(r"--?[a-z]", word)]
        if program not in RUN:  # some have no --help, and need not be built
            source = self.source(program)
            if source is None:
                return [f"there is no {program}"]
            return [f"{program} takes no {option}" for option in options if not re.search(rf'["\[ ,]{option}["\], =]', source)]
        verbs = re.findall(r"^  ([a-z][a-z-]+) ", self.help(program, None).partition("\nSubcommands:")[2], re.MULTILINE)
        verb = None
        if verbs and rest and not rest[0].startswith("-"):
            verb = rest[0]
            if re.fullmatch(r"[\d.]+", verb):
                return []  # what --version prints
            if verb not in verbs:
                return [f"{program} has no {verb}"]
        known = set(re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", "\n".join(
            line.split("  ")[1] if line.startswith("  -") else "" for line in self.help(program, verb).splitlines())))
        return [f"{program} {verb or ''} takes no {option}" for option in options if option not in known]


def prepare(scratch, root, binaries):
    """Small models, poses, grids and a session under the names that pages use."""
    def run(*words):
        subprocess.run([binaries / words[0], *words[1:]], cwd=scratch, check=True, capture_output=True)

    for name, size in (("terrain", "32"), ("aircraft", "400"), ("sphere", "16")):
        run("nearmesh-model", "generate", name, "--size", size, "-o", name + ".ply")
        run("nearmesh-model", "build", name + ".ply", "-o", name + ".spm")
    (scratch / "terrain.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    shutil.copy(scratch / "terrain.spm", scratch / "A.spm")
    shutil.copy(scratch / "aircraft.spm", scratch / "B.spm")
    (scratch / "poses.csv").write_text("R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n1,0,0,0,1,0,0,0,1,0,0,3000\n")
    shutil.copy(root / "tests/data/session/session_v1.db3", scratch / "flight.db3")
    (scratch / "jacksboro_fault_dem.pgm").write_bytes(b"P5 8 8 255\n" + bytes(range(64)))


def main(root, binaries):
    pages = [root / "README.md", *sorted((root / "docs").glob("*.md")), *sorted((root / "examples").rglob("*.md"))]
    programs = Programs(root, binaries)
    faults, read, ran = [], 0, 0
    for page in pages:
        with tempfile.TemporaryDirectory(prefix="nearmesh_pages_") as folder:
            scratch = pathlib.Path(folder)
            is_prepared = False
            for line, words in commands(page):
                where = f"{page.relative_to(root)}:{line}"
                read += 1
                found = programs.faults(words)
                faults += [f"{where}: {fault}" for fault in found]
                if found or words[1:2] == [] or words[1] not in RUN.get(words[0], ()) or NOT_HERE.search(" ".join(words)):
                    continue
                if not is_prepared:
                    prepare(scratch, root, binaries)
                    is_prepared = True
                done = subprocess.run([binaries / words[0], *words[1:]], cwd=scratch, capture_output=True, text=True, timeout=120,
                                      env={**os.environ, "PATH": f"{binaries}:{os.environ['PATH']}"})
                ran += 1
                if done.returncode != 0:
                    faults.append(f"{where}: {' '.join(words)}: exit code {done.returncode}: {done.stderr.strip()}")
    print(f"{read} commands read, {ran} of them run.")
    return faults if read > 60 and ran > 8 else faults + ["fewer commands than there were: are they still found?"]


def self_test(binaries):
    """Every kind of fault is planted and must be found; the rest must pass."""
    planted = {
        "README.md": ("    nearmesh-model build a.obj -o a.spm  # good\n    nearmesh-model bake a.obj\n"
                      "    nearmesh-model build a.obj --colour red && nearmesh-gone a\n\n```cpp\nnearmesh-gone\n```\n"
                      "```\nX=1 nearmesh-subscriber watch --http 1 \\\n  --port 2\n$ nearmesh-model info --bad >nearmesh-gone\n```\n"
                      "    A line about nearmesh-gone\n", 5)}
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        (root / "README.md").write_text(planted["README.md"][0])
        programs = Programs(root, binaries)
        found = [fault for _, words in commands(root / "README.md") for fault in programs.faults(words)]
    return [] if len(found) == planted["README.md"][1] else [f"expected {planted['README.md'][1]} faults, found {found}"]


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[2]).resolve()
    result = self_test(folder) if sys.argv[1] == "--self-test" else main(pathlib.Path(sys.argv[1]).resolve(), folder)
    print("\n".join(result) if result else "Commands on pages are what the programs take.")
    sys.exit(1 if result else 0)
