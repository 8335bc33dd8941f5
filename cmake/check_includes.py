#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks who includes whom. Usage: check_includes.py ROOT, or check_includes.py --self-test.

Rooms are folders; the table below is the whole law. Examples may include all that is public; tests are not checked.
Prints one line per violation (file:line: what) and exits with 1 when there is any.
"""
import pathlib
import re
import sys
import tempfile

# Room: the rooms it may include, beside itself.
ARROWS = {
    "base": "",
    "geometry": "base",
    "mesh": "base geometry",
    "meshio": "base mesh",
    "simplify": "base geometry mesh",
    "spm": "base geometry mesh",
    "bake": "base geometry mesh simplify spm demand",  # coding tables are trained on demand walks
    "refine": "base geometry mesh spm",
    "demand": "base geometry spm",
    "abtree": "base geometry refine",
    "query": "base geometry refine abtree",
    "session": "base",
    "wire": "base geometry spm",
    "program": "base wire",
    "publisher": "base geometry spm demand refine session wire program",
    "subscriber": "base geometry spm demand refine abtree query session wire program",
    "tools": "base geometry mesh meshio simplify spm bake refine demand abtree query session",
    "examples": "base geometry mesh meshio simplify spm bake refine demand abtree query session wire"
                " publisher subscriber",
}
# Third-party headers: first part of the path, and the files (as a pattern) that may include them.
DDS_FILES = r"(idl/(?!program/)|(publisher|subscriber)/src/dds_[^/]*$|examples/)"
RESERVED = [
    (re.compile(r"(fastdds|fastrtps|fastcdr|nearmesh/idl)/"), re.compile(DDS_FILES), "Fast DDS"),
    (re.compile(r"sqlite3\.h"), re.compile(r"core/src/session/"), "SQLite"),
    (re.compile(r"(openssl/|tinyxml2)"), re.compile(r"idl/src/.*security_"), "OpenSSL and TinyXML2"),
    (re.compile(r"assimp/"), re.compile(r"core/src/meshio/"), "assimp"),
    (re.compile(r"spdlog/"), re.compile(r"(publisher|subscriber|examples|idl/program)/"),
     "spdlog (core returns reports)"),
    (re.compile(r"prometheus/"), re.compile(r"idl/program/"), "Prometheus"),
]
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
FOLDERS = ("core", "idl", "publisher", "subscriber", "examples")


def room_of(path):
    """The room of a file, by its path from the root."""
    parts = path.parts
    if parts[:2] == ("idl", "program"):
        return "program"
    if parts[0] != "core":
        return "wire" if parts[0] == "idl" else parts[0]
    return parts[1] if parts[1] == "tools" else parts[4 if parts[1] == "include" else 2]


def room_of_include(name):
    """The room that an #include names, or None where it is none of ours."""
    parts = name.split("/")
    if parts[0] == ".." and len(parts) == 3 and name.endswith("_kernels.hpp"):
        return parts[1]  # what is inlined into another room's loops
    if parts[0] != "nearmesh" or len(parts) < 3:
        return None
    return parts[2] if parts[1] == "core" else "wire" if parts[1] == "idl" else parts[1]


def includes_of(text):
    for number, line in enumerate(text.splitlines(), 1):
        if match := INCLUDE.match(line):
            yield number, match[1], match[2]


def find_dds_headers(files):
    """Wire headers that bring Fast DDS along, directly or through others, as they are spelled in an #include."""
    headers = {str(path).split("include/", 1)[1]: list(includes_of(text))
               for path, text in files.items() if str(path).startswith("idl/include/")}
    found = set()
    while True:
        more = {name for name, lines in headers.items() if name not in found
                and any(RESERVED[0][0].match(i) or i in found for _, _, i in lines)}
        if not more:
            return found
        found |= more


def check(root):
    files = {path.relative_to(root): path.read_text() for folder in FOLDERS
             for path in sorted((root / folder).rglob("*.?pp"))}
    dds_headers = find_dds_headers(files)
    violations = []
    for path, text in files.items():
        room = room_of(path)
        if room not in ARROWS:
            violations.append(f"{path}: room '{room}' is not in the table of cmake/check_includes.py")
            continue
        for number, quote, name in includes_of(text):
            def report(what):
                violations.append(f"{path}:{number}: {what}: {name}")
            target = room_of_include(name)
            if target not in (None, room) and target not in ARROWS[room].split():
                report(f"{room} may not include {target}")
            is_ours = "/" in name or name.endswith(".hpp")  # not generated
            if target is None and quote == '"' and is_ours and path.parent / name not in files:
                report("name a header from its public folder, or plainly beside the file")
            if name in dds_headers and not re.match(DDS_FILES, str(path)):
                report("brings Fast DDS into a file that is not dds_*.cpp")
            for pattern, may, what in RESERVED:
                if pattern.match(name) and not may.match(str(path)):
                    report(f"{what} is not for this file")
    return violations


def self_test():
    """Every kind of violation is planted and must be found; the rest must pass."""
    planted = {
        "core/include/nearmesh/core/base/hash.hpp": ("#include <vector>", 0),
        "core/src/spm/codec.cpp": ('#include "nearmesh/core/base/hash.hpp"\n#include "bits.hpp"', 0),
        "core/src/spm/bits.hpp": ("", 0),
        "core/src/geometry/bits.cpp": ('#include "bits.hpp"', 1),
        "core/src/query/walk.cpp": ('#include "../geometry/box_kernels.hpp"', 0),
        "core/src/geometry/walk.cpp": ('#include "../query/walk_kernels.hpp"', 1),
        "core/src/query/query.cpp": ('#include "nearmesh/core/abtree/tree.hpp"', 0),
        "core/src/base/hash.cpp": ('#include "nearmesh/core/spm/types.hpp"', 1),
        "core/src/demand/collect.cpp": ('#  include "nearmesh/core/refine/replica.hpp"', 1),
        "core/src/mesh/clean.cpp": ("#include <assimp/scene.h>", 1),
        "core/src/mesh/log.cpp": ("#include <spdlog/spdlog.h>", 1),
        "core/src/bake/keep.cpp": ("#include <sqlite3.h>", 1),
        "core/src/session/keep.cpp": ("#include <sqlite3.h>", 0),
        "core/src/mesh/far.cpp": ('#include "../spm/bits.hpp"', 1),
        "core/src/attic/old.cpp": ("", 1),
        "idl/include/nearmesh/wire/qos.hpp": ("#include <fastdds/dds/topic/Topic.hpp>", 0),
        "idl/include/nearmesh/wire/indirect.hpp": ('#include "nearmesh/wire/qos.hpp"', 0),
        "publisher/src/dds_channel.cpp": ('#include "nearmesh/wire/indirect.hpp"', 0),
        "publisher/src/service.cpp": ('#include "nearmesh/wire/indirect.hpp"', 1),
        "publisher/src/main.cpp": ('#include "nearmesh/subscriber/session.hpp"', 1),
        "subscriber/src/session.cpp": ("#include <fastrtps/utils/IPLocator.h>", 1),
        "subscriber/src/predict.cpp": ('#include "nearmesh/publisher/service.hpp"', 1),
        "idl/program/src/metrics.cpp": ("#include <prometheus/exposer.h>\n#include <spdlog/spdlog.h>", 0),
        "idl/program/src/log.cpp": ("#include <fastdds/dds/topic/Topic.hpp>", 1),
        "subscriber/src/run_command.cpp": ("#include <prometheus/exposer.h>", 1),
        "examples/tour/main.cpp": ('#include "nearmesh/subscriber/session.hpp"', 0),
    }
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, (text, _) in planted.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text + "\n")
        violations = check(root)
    wrong = [f"{name}: expected {count} violations, found {found}"
             for name, (_, count) in planted.items()
             if (found := sum(v.startswith(name) for v in violations)) != count]
    return wrong


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    found = self_test() if sys.argv[1] == "--self-test" else check(pathlib.Path(sys.argv[1]))
    print("\n".join(found) if found else "Include rules hold.")
    sys.exit(1 if found else 0)
