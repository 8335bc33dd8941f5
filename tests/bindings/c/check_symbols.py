#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks what libnearmesh exports: the functions that its header declares, all of them and nothing else.
Usage: check_symbols.py HEADER LIBRARY"""
import pathlib
import re
import subprocess
import sys

header, library = sys.argv[1:]
declared = set(re.findall(r"NEARMESH_API [^;]*?\b(nearmesh_[a-z_]+)\(", pathlib.Path(header).read_text()))
symbols = [line.split() for line in subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True,
                                                   check=True).stdout.splitlines()]
exported = {name.split("@")[0]: kind for _, kind, name in symbols if kind != "A"}  # A: the version's name
faults = [f"declared, not exported: {name}" for name in sorted(declared - exported.keys())]
faults += [f"exported, not declared: {name}" for name in sorted(exported.keys() - declared)]
faults += [f"no function: {name} ({kind})" for name, kind in exported.items() if kind != "T"]
names = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
if not re.search(r"SONAME.*\[libnearmesh\.so\.0\]", names):
    faults.append("its name is not libnearmesh.so.0")
print("\n".join(faults) if faults else f"{len(exported)} functions, all declared")
sys.exit(1 if faults or len(declared) < 40 else 0)
