#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The program of docs/embed.md's section "From C" compiles without a warning and prints what the page says it does; so it does with the
pool that the page shows.
Usage: page_test.py PAGE HEADER_FOLDER LIBRARY COMPILER FOLDER"""
import pathlib
import re
import subprocess
import sys

page, headers, library, compiler, folder = (pathlib.Path(argument).absolute() for argument in sys.argv[1:])
section = page.read_text().split("\n## From C\n")[1].split("\n## ")[0]
program, = (text for text in re.findall(r"```c\n(.*?)```", section, re.DOTALL) if "int main" in text)
expected = re.search(r"It prints.*?\n```\n(.*?)```", section, re.DOTALL)[1]
pool, = (text for text in re.findall(r"```c\n(.*?)```", page.read_text(), re.DOTALL) if "run_jobs" in text)
options = "  options.contacts = 1;\n"
assert options in program
with_pool = pool + "\n" + program.replace(options, options + "  use_my_threads(&options, &options);\n")
folder.mkdir(parents=True, exist_ok=True)
for name, text in ("page", program), ("page_with_pool", with_pool):
    (folder / f"{name}.c").write_text(text)
    subprocess.run([compiler, "-std=c11", "-Wall", "-Wextra", "-pedantic", "-Werror", "-pthread", "-I", headers,
                    folder / f"{name}.c", "-o", folder / name, library, f"-Wl,-rpath,{library.parent}"], check=True)
    printed = subprocess.run([folder / name], cwd=folder, check=True, capture_output=True, text=True).stdout
    if printed != expected:
        sys.exit(f"the page says\n{expected}\nbut {name} prints\n{printed}")
print(printed, end="")
