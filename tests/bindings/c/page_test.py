#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The program of docs/embed.md's section "From C" compiles without a warning and prints what the page says it does.
Usage: page_test.py PAGE HEADER_FOLDER LIBRARY COMPILER FOLDER"""
import pathlib
import re
import subprocess
import sys

page, headers, library, compiler, folder = (pathlib.Path(argument).absolute() for argument in sys.argv[1:])
section = page.read_text().split("\n## From C\n")[1].split("\n## ")[0]
program, = (text for text in re.findall(r"```c\n(.*?)```", section, re.DOTALL) if "int main" in text)
expected = re.search(r"It prints.*?\n```\n(.*?)```", section, re.DOTALL)[1]
folder.mkdir(parents=True, exist_ok=True)
(folder / "page.c").write_text(program)
subprocess.run([compiler, "-std=c11", "-Wall", "-Wextra", "-pedantic", "-Werror", "-I", headers, folder / "page.c", "-o",
                folder / "page", library, f"-Wl,-rpath,{library.parent}"], check=True)
printed = subprocess.run([folder / "page"], cwd=folder, check=True, capture_output=True, text=True).stdout
if printed != expected:
    sys.exit(f"the page says\n{expected}\nbut it prints\n{printed}")
print(printed, end="")
