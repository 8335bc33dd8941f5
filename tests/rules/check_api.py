#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the public wall. Usage: check_api.py ROOT, or check_api.py --self-test.

docs/api.md is the list of headers that users include: those that are installed and not in a folder `detail`, each marked as
such, and no others. In a row of its tables a plain file name lies in the folder of the header before it.
Prints one line per violation and exits with 1 when there is any.
"""
import pathlib
import re

from rule import main

PAGE = "docs/api.md"
MARK = "// API (docs/api.md)."
ROW = re.compile(r"^\|([^|]*)\|", re.MULTILINE)
HEADER = re.compile(r"`([a-z_/]+\.hpp)`")


def read_page(text):
    """The headers that the page names, from nearmesh/ on."""
    for row in ROW.findall(text):
        folder = ""
        for name in HEADER.findall(row):
            if "/" in name:
                folder = name.rpartition("/")[0]
            yield name if "/" in name or not folder else f"{folder}/{name}"


def check(root):
    named = list(read_page((root / PAGE).read_text()))
    headers = {path.relative_to(wing / "include/nearmesh").as_posix(): path
               for wing in sorted(root.iterdir()) for path in sorted((wing / "include/nearmesh").rglob("*.hpp"))}
    api = {name for name in headers if "detail" not in name.split("/")}
    violations = [f"{PAGE}: does not name {name}" for name in sorted(api - set(named))]
    violations += [f"{PAGE}: names {name}, which users cannot include" for name in named if name not in api]
    violations += [f"{PAGE}: names {name} twice" for name in sorted(set(named)) if named.count(name) > 1]
    for name, path in headers.items():
        if (MARK in path.read_text().splitlines()) != (name in api):
            violations.append(f"{path.relative_to(root)}: " + (f"no line '{MARK}'" if name in api else "marked as API"))
    return violations


def planted():
    """Every kind of violation, which must be found, and what must pass."""
    page = ("| header | for |\n|---|---|\n| `core/query/query.hpp`, `sweep.hpp` | a `word.hpp` |\n"
            "| `core/spm/gone.hpp` | x |\n| `core/base/detail/ids.hpp` | x |\n| `core/query/query.hpp` | x |\n"
            "| `idl/dds/plain.hpp` | x |\n\nsee `core/query/text.hpp`\n")
    include = "core/include/nearmesh/core/"
    return {
        include + "query/query.hpp": (MARK + "\n", 0),
        include + "query/sweep.hpp": (MARK + "\n", 0),
        include + "query/text.hpp": (MARK + "\n", 0),  # the page: not in a table
        include + "base/detail/ids.hpp": ("", 0),
        include + "base/detail/proud.hpp": (MARK + "\n", 1),
        "idl/include/nearmesh/idl/dds/plain.hpp": ("// " + MARK + "\n", 1),
        "core/query/walk.hpp": ("", 0),
        PAGE: (page, 4),
    }


if __name__ == "__main__":
    main(__doc__, check, planted(), "The API is what its page says.")
