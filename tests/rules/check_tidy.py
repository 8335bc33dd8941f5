#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs clang-tidy (.clang-tidy) over the sources of core, as BUILD compiles them. Usage: check_tidy.py ROOT BUILD

Most of its time goes into headers: where a build joins the sources of a room (preset joined) it takes a tenth of what it takes
where each source stands alone. Prints what was found, and exits with 1 if there was any.
"""
import concurrent.futures
import os
import pathlib
import subprocess
import sys

from compile_commands import compile_commands


def look_at(root, build, file):
    done = subprocess.run(["clang-tidy-14", "--quiet", "-p", str(build), "--config-file", str(root / ".clang-tidy"),
                           "--checks=-bugprone-suspicious-include",  # that of joined files
                           "--header-filter", "/(core|idl|publisher|subscriber)/[a-z_0-9/]+[.][ch]pp$", file],
                          capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + (done.stderr if done.returncode else "")


def main(root, build):
    files = {command["file"]: sources for command, sources in compile_commands(build)
             if sources[0].is_relative_to(root / "core")}
    longest_first = sorted(files, key=lambda file: -sum(source.stat().st_size for source in files[file]))
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lambda file: look_at(root, build, file), longest_first))
    for code, text in found:
        if code:
            print(text)
    print(f"{len(files)} files looked at, for {sum(map(len, files.values()))} sources")
    return any(code for code, _ in found)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(1 if main(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()) else 0)
