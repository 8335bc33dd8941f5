#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs clang-tidy (.clang-tidy) over the sources of core. Usage: check_tidy.py ROOT BUILD

Most of its time goes into headers, so the sources of a room are looked at as one file, kept in BUILD/tidy. Highway compiles
some files once for each instruction set: those are looked at alone. Prints what was found, and exits with 1 if there was any.
"""
import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys

from compile_commands import compile_commands


def one_file_a_room(root, build):
    """The texts to look at, by name: a room's sources, and the command of the build that fits them."""
    rooms, alone = {}, {}
    for command, sources in compile_commands(build):
        for source in sources:
            if not source.is_relative_to(root / "core"):
                continue
            spelled = str(source.relative_to(root))
            if "foreach_target" in source.read_text():
                alone[spelled.replace("/", "_")] = ([spelled], command)
            else:
                rooms.setdefault(source.parent.name, ([], command))[0].append(spelled)
    return {f"{room}.cpp": found for room, found in rooms.items()} | alone


def look_at(root, folder, name):
    done = subprocess.run(["clang-tidy-14", "--quiet", "-p", str(folder), "--config-file", str(root / ".clang-tidy"),
                           "--checks=-bugprone-suspicious-include",  # that of our own file
                           "--header-filter", "/(core|idl|publisher|subscriber)/[a-z_0-9/]+[.][ch]pp$", str(folder / name)],
                          capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + (done.stderr if done.returncode else "")


def main(root, build):
    folder = build / "tidy"
    folder.mkdir(exist_ok=True)
    files = one_file_a_room(root, build)
    commands = []
    for name, (sources, command) in files.items():
        (folder / name).write_text("".join(f'#include "{source}"\n' for source in sources))
        commands.append({"directory": str(root), "file": str(folder / name),
                         "command": command["command"].replace(command["file"], str(folder / name)) + f" -I{root}"})
    (folder / "compile_commands.json").write_text(json.dumps(commands))
    # The longest first.
    names = sorted((pathlib.Path(command["file"]).name for command in commands), key=lambda name: -(folder / name).stat().st_size)
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lambda name: look_at(root, folder, name), names))
    for code, text in found:
        if code:
            print(text)
    print(f"{len(names)} files looked at, for {sum(len(sources) for sources, _ in files.values())} sources")
    return any(code for code, _ in found)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(1 if main(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()) else 0)
