#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that every header of the product stands alone. Usage: check_headers.py ROOT BUILD

A header that is the first that some source file of its own room includes was shown to stand alone by the build. Of the
others each is compiled here by itself, with the options of its room and -fsyntax-only. Prints the compiler's errors and
exits with 1 when there are any.
"""
import concurrent.futures
import os
import pathlib
import re
import shlex
import subprocess
import sys

from compile_commands import compile_commands

WINGS = ("core", "idl", "publisher", "subscriber")
FIRST = re.compile(r'^#include "([^"]+)"', re.MULTILINE)


def spelled(header):
    """The header as an #include names it: from its public folder, or from the root."""
    parts = header.parts
    return "/".join(parts[2:] if parts[1] == "include" else parts)


def room_of(path):
    """core/query/walk.cpp and core/include/nearmesh/core/query/query.hpp: core/query. subscriber/bindings/c/world.cpp:
    subscriber/bindings/c, as each binding has options of its own."""
    parts = path.parts
    if parts[1] == "include" and len(parts) == 4:  # core/include/nearmesh/eigen.hpp
        return f"{parts[0]}/{path.stem}"
    if parts[1] == "bindings":
        return "/".join(parts[:3])
    return "/".join((parts[0], parts[4] if parts[1] == "include" else parts[1]))


def find_unshown(root, sources):
    """Headers by room, but those that a source file of the room includes first."""
    shown = set()
    for source in sources:
        if first := FIRST.search((root / source).read_text()):
            shown |= {first[1], f"{source.parent}/{first[1]}"}
    unshown = {}
    for wing in WINGS:
        for path in sorted((root / wing).rglob("*.hpp")):
            header = path.relative_to(root)
            if spelled(header) not in shown and not header.name.endswith("_kernels.hpp"):
                unshown.setdefault(room_of(header), []).append(spelled(header))
    return unshown


def compile_text(text, command):
    """Errors of a text, compiled with the options of a command of the build; empty when there are none."""
    options = [word for word in shlex.split(command["command"])]
    # Neither what it compiles nor where to.
    options = options[:options.index("-o")]
    done = subprocess.run(options + ["-fsyntax-only", "-x", "c++", "-"], input=text, text=True, cwd=command["directory"],
                          capture_output=True, check=False)
    return done.stderr if done.returncode else ""


def main(root, build):
    commands = {}
    sources = []
    for command, compiled in compile_commands(build):
        of_wings = [path.relative_to(root) for path in compiled
                    if path.is_relative_to(root) and path.relative_to(root).parts[0] in WINGS]
        sources += of_wings[:1]  # before the others that a build has joined with it something else stands
        for source in of_wings:
            commands.setdefault(room_of(source), command)
    unshown = find_unshown(root, sources)
    to_compile = [(header, commands[room]) for room, headers in unshown.items() if room in commands  # else not of this build
                  for header in headers]
    os.nice(19)  # for tests beside it
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        errors = list(filter(None, pool.map(lambda pair: compile_text(f'#include "{pair[0]}"\n', pair[1]), to_compile)))
    for error in errors:
        print(error)
    print(f"{len(to_compile)} headers compiled alone")
    return len(errors)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(1 if main(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()) else 0)
