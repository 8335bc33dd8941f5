#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks who includes whom. Usage: check_includes.py ROOT, or check_includes.py --self-test.

The law is the table of rooms in ARCHITECTURE.md: what a room may include, beside itself, and which headers of others. A
room is a folder: core/query and core/include/nearmesh/core/query are both the room core/query. Beside the table:
  * a header that is installed (in include/) includes installed ones alone; what lies in a folder `detail` is needed by
    some header that does not;
  * headers that bring Fast DDS along are for rooms that may include it;
  * arrows do not run in a circle;
  * examples include what is installed and not in `detail`; the one of tests only reads, so tests are not checked.
Prints one line per violation (file:line: what) and exits with 1 when there is any.
"""
import pathlib
import re

from rule import main

WINGS = ("core", "idl", "publisher", "subscriber")
ROW = re.compile(r"^\| `([a-z]+/[a-z]+)` \|[^|]*\| ([^|]*) \| ([^|]*) \|$", re.MULTILINE)
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]')
TABLE = "ARCHITECTURE.md"
DDS = "fastdds/"
DDS_HEADERS = ("fastdds/", "fastrtps/", "fastcdr/", "nearmesh/idl/nearmesh")


def read_law(text):
    """{room: (rooms that it may include, headers of others that it may include)}."""
    def words(cell):
        return set() if cell.strip() == "-" else set(cell.split())
    return {room: (words(rooms), words(headers)) for room, rooms, headers in ROW.findall(text)}


def is_installed(path):
    return path.parts[1] == "include"


def room_of(path):
    """core/query/walk.cpp and core/include/nearmesh/core/query/query.hpp: core/query; core/include/nearmesh/eigen.hpp: core/eigen."""
    parts = path.parts
    if is_installed(path) and len(parts) == 4:
        return f"{parts[0]}/{path.stem}"
    return "/".join((parts[0], parts[4] if is_installed(path) else parts[1]))


def includes_of(text):
    for number, line in enumerate(text.splitlines(), 1):
        if match := INCLUDE.match(line):
            yield number, match[1]


def resolve(path, name, files):
    """The file that an #include in `path` names, or None where it is none of the project's."""
    parts = name.split("/")
    if parts[0] == "nearmesh" and len(parts) == 2:
        return pathlib.Path("core", "include", *parts)
    if parts[0] == "nearmesh" and len(parts) > 3:
        return pathlib.Path(parts[1], "include", *parts)
    beside = path.parent / name
    if "/" not in name and (beside in files or name.endswith(".hpp")):
        return beside
    return pathlib.Path(name) if parts[0] in WINGS + ("tests",) else None


def find_circle(law):
    """Rooms that include each other in a circle, or nothing."""
    left = {room: set(rooms) for room, (rooms, _) in law.items()}
    while free := [room for room, rooms in left.items() if not rooms & left.keys()]:
        for room in free:
            del left[room]
    return sorted(left)


def find_bringing_dds(files):
    """Headers that bring Fast DDS along, directly or through others."""
    found = set()
    while True:
        more = {path for path, text in files.items() if path.suffix == ".hpp" and path not in found and
                any(name.startswith(DDS_HEADERS) or resolve(path, name, files) in found for _, name in includes_of(text))}
        if not more:
            return found
        found |= more


def check_example(path, files):
    for number, name in includes_of(files[path]):
        if name.startswith("nearmesh/") and "/detail/" in name or name.split("/")[0] in WINGS:
            yield f"{path}:{number}: not for users: {name}"


def check_file(path, files, law, bringing_dds):
    room = room_of(path)
    if room not in law:
        yield f"{path}: room '{room}' is not in the table of {TABLE}"
        return
    rooms, others = law[room]
    reserved = set().union(*(headers for _, headers in law.values())) | set(DDS_HEADERS)
    for number, name in includes_of(files[path]):
        def line(what, number=number, name=name):
            return f"{path}:{number}: {what}: {name}"
        target = resolve(path, name, files)
        if target is None:
            may = others | set(DDS_HEADERS) if DDS in others else others
            if any(name.startswith(prefix) for prefix in reserved) and not any(name.startswith(p) for p in may):
                yield line(f"not in {room}'s row of the table of {TABLE}")
        elif target not in files:
            yield line("no such file; name a header from its public folder, from the root, or plainly beside the file")
        elif target.parts[0] == "tests":
            yield line("a test's")
        else:
            if room_of(target) not in rooms | {room}:
                yield line(f"{room} may not include {room_of(target)}")
            if is_installed(path) and not is_installed(target):
                yield line("is not installed, but this header is")
            if target in bringing_dds and DDS not in others:
                yield line(f"brings Fast DDS into {room}")


def find_idle_details(files):
    """Headers in `detail` that no installed header outside needs."""
    installed = [path for path in files if is_installed(path)]
    needed, open_ = set(), [path for path in installed if "detail" not in path.parts]
    while open_:
        path = open_.pop()
        if path not in needed and path in files:
            needed.add(path)
            open_ += [target for _, name in includes_of(files[path]) if (target := resolve(path, name, files))]
    return [path for path in installed if path not in needed]


def check(root):
    law = read_law((root / TABLE).read_text())
    found = {path.relative_to(root): path.read_text() for folder in WINGS + ("examples",)
             for path in sorted((root / folder).rglob("*.?pp"))}
    files = {path: text for path, text in found.items() if path.parts[0] in WINGS}
    bringing_dds = find_bringing_dds(files)
    violations = [line for path in files for line in check_file(path, files, law, bringing_dds)]
    violations += [line for path in found if path not in files for line in check_example(path, found)]
    violations += [f"{path}: in detail/, but no installed header outside needs it" for path in find_idle_details(files)]
    violations += [f"{room}: may not be in the table of {TABLE}, there is no such folder"
                   for room in law if not (root / room).is_dir() and
                   not any(room_of(path) == room for path in files)]
    if circle := find_circle(law):
        violations.append(f"{TABLE}: rooms include each other in a circle: {' '.join(circle)}")
    return violations


def planted():
    """Every kind of violation, which must be found, and what must pass."""
    table = ("| `core/base` | x | - | - |\n| `core/spm` | x | core/base | sqlite3.h |\n| `core/query` | x | core/spm | hwy/ |\n"
             "| `idl/dds` | x | core/base | fastdds/ |\n| `publisher/serve` | x | idl/dds | - |\n"
             "| `publisher/gone` | x | - | - |\n"
             "| `subscriber/peer` | x | subscriber/dds | - |\n| `subscriber/dds` | x | subscriber/peer | - |\n")
    return {
        "core/include/nearmesh/core/base/status.hpp": ('#include <vector>\n#include "nearmesh/core/base/detail/ids.hpp"', 0),
        "core/include/nearmesh/core/base/detail/ids.hpp": ("", 0),
        "core/include/nearmesh/core/base/detail/idle.hpp": ("", 1),
        "core/include/nearmesh/core/spm/file.hpp": ('#include "core/spm/bits.hpp"', 1),
        "core/spm/bits.hpp": ('#include "nearmesh/core/base/status.hpp"', 0),
        "core/spm/bits.cpp": ('#include "bits.hpp"\n#include <sqlite3.h>', 0),
        "core/spm/codec.cpp": ('#include "gone.hpp"\n#include <hwy/highway.h>\n#include "core/query/walk.hpp"', 3),
        "core/query/walk.hpp": ('#include "core/spm/bits.hpp"', 0),
        "core/query/walk.cpp": ('#  include "core/base/hash.hpp"\n#include "tests/support/a.hpp"', 2),
        "core/base/hash.hpp": ("", 0),
        "core/attic/old.cpp": ("", 1),
        "idl/dds/qos.hpp": ("#include <fastdds/dds/topic/Topic.hpp>", 0),
        "idl/dds/indirect.hpp": ('#include "qos.hpp"\n#include <fastrtps/a.h>', 0),
        "idl/dds/plain.hpp": ("", 0),
        "publisher/serve/service.cpp": ('#include "idl/dds/indirect.hpp"\n#include "idl/dds/plain.hpp"', 1),
        "publisher/serve/b.cpp": ("#include <fastrtps/utils/IPLocator.h>", 1),
        "subscriber/peer/a.cpp": ("", 0),
        "subscriber/dds/a.cpp": ("", 0),
        "examples/tour/main.cpp": ('#include "nearmesh/core/spm/file.hpp"\n#include "nearmesh/core/base/detail/ids.hpp"\n'
                                   '#include "core/base/hash.hpp"', 2),
        TABLE: (table, 1),  # the circle
        "publisher/gone": (None, 1),
    }


if __name__ == "__main__":
    main(__doc__, check, planted(), "Include rules hold.")
