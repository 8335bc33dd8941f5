#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks every file of the project. Usage: check_files.py ROOT, or check_files.py --self-test.

Code names its licence in one of its first lines, no text names a folder of the machine it was written on, the
libraries call no function of the mathematical library whose last bit differs between platforms, and no comment
of C++ or IDL goes beyond column 100 (clang-format breaks code there, and leaves comments alone).
Prints one line per violation and exits with 1 when there is any.
"""
import pathlib
import re

from rule import main

LICENCE = "SPDX-License-Identifier: Apache-2.0"
CODE = {".cpp", ".hpp", ".h", ".idl", ".js", ".py", ".sh"}
WIDTH_COUNTS = {".cpp", ".hpp", ".h", ".idl"}
COLUMNS = 100  # as in .clang-format
COMMENT = re.compile(r"(?<![:\"])//")  # not of an address, nor first in a text
SKIPPED = {".git", ".cache", "out"}  # and build*
MACHINE_FOLDERS = ["/" + folder + "/" for folder in ("work", "root")]
# Answers must be the same bits everywhere; sqrt, floor, ldexp and the like are exact by IEEE 754 or by definition.
LIBRARIES = {"core", "idl", "publisher", "subscriber"}
INEXACT = re.compile(r"(?:\bstd::|(?<![\w:])::|(?<![\w.:>]))(a?(?:sin|cos|tan)h?|atan2|sincos|pow|exp2|expm1|hypot|"
                     r"cbrt|log(?:2|10|1p)|erfc?|[tl]gamma|(?<=::)(?:log|exp|fma))[fl]?\(")


def check(root):
    violations = []
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root)
        if not path.is_file() or name.parts[0] in SKIPPED or name.parts[0].startswith("build"):
            continue
        try:
            text = path.read_text()
        except UnicodeDecodeError:
            continue  # binary
        if path.suffix in CODE and not any(LICENCE in line for line in text.splitlines()[:3]):
            violations.append(f"{name}:1: no line '{LICENCE}'")
        for number, line in enumerate(text.splitlines(), 1):
            violations += [f"{name}:{number}: names {folder}" for folder in MACHINE_FOLDERS if folder in line]
            if path.suffix in (".cpp", ".hpp") and name.parts[0] in LIBRARIES:
                violations += [f"{name}:{number}: {match[1]} differs between platforms"
                               for match in INEXACT.finditer(line.split("//")[0])]
            if path.suffix in WIDTH_COUNTS and len(line) > COLUMNS and COMMENT.search(line):
                violations.append(f"{name}:{number}: a comment beyond column {COLUMNS}")
    return violations


def planted():
    """Every kind of violation, which must be found, and what must pass."""
    return {
        "core/good.cpp": ("// " + LICENCE + "\n", 0),
        "core/bad.cpp": ("#pragma once\n", 1),
        "core/inexact.cpp": ("// " + LICENCE + "\ndouble x = std::pow(2, y) + ::sinf(z);  // not cos(y)\n", 2),
        "core/exact.cpp": ("// " + LICENCE + "\ndouble x = std::ldexp(std::sqrt(y), 2) + my_pow(2);\n", 0),
        "tests/inexact.cpp": ("// " + LICENCE + "\ndouble x = std::pow(2, y);\n", 0),
        "tests/wide.hpp": ("// " + LICENCE + "\n// " + 97 * "x" + "\n// " + 98 * "x" + "\n", 1),
        "tests/text.cpp": ("// " + LICENCE + "\nconst char* kPage = \"https://" + 99 * "x" + "\";\n", 0),
        "docs/page.md": ("see " + MACHINE_FOLDERS[0] + "main\n", 1),
        "build/generated.cpp": ("", 0),
    }


if __name__ == "__main__":
    main(__doc__, check, planted(), "File rules hold.")
