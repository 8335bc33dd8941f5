# SPDX-License-Identifier: Apache-2.0
"""The package itself: what it names, its types, its documentation, its examples."""
import ast
import inspect
import os
import pathlib
import re
import subprocess
import sys

import pytest

import nearmesh as nm

PACKAGE = pathlib.Path(nm.__file__).parent
EXAMPLES = pathlib.Path(os.environ["NEARMESH_EXAMPLES"])


def public(names):
    return {name for name in names if not name.startswith("_")}


def test_types_name_what_there_is():
    tree = ast.parse((PACKAGE / "__init__.pyi").read_text())
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert set(classes) | functions | {"Error", "errors", "__version__"} == set(nm.__all__)
    for name, node in classes.items():
        members = {n.name for n in node.body if isinstance(n, ast.FunctionDef)} | \
            {n.targets[0].id for n in node.body if isinstance(n, ast.Assign)}
        there = public(vars(getattr(nm, name)))
        assert public(members) == there, name


def test_options_and_arguments_of_the_types_are_taken(ball):
    tree = ast.parse((PACKAGE / "__init__.pyi").read_text())
    for node in tree.body:
        if not isinstance(node, ast.ClassDef):
            continue
        for method in node.body:
            if not isinstance(method, ast.FunctionDef) or method.name == "__init__" or method.decorator_list:
                continue
            text = inspect.getdoc(getattr(getattr(nm, node.name), method.name)) or ""
            for argument in method.args.args[1:] + method.args.kwonlyargs:
                assert argument.arg + ":" in text, f"{node.name}.{method.name}: {argument.arg}"


def test_everything_is_documented():
    for name in nm.__all__:
        if not name.startswith("__"):
            assert inspect.getdoc(getattr(nm, name)), name


def test_the_page_about_embedding_runs(tmp_path):
    page = (EXAMPLES / ".." / ".." / "docs" / "embed.md").read_text()
    snippets = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    assert len(snippets) == 2  # the second goes on where the first ends
    run = subprocess.run([sys.executable, "-c", "".join(snippets)], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    first, second = run.stdout.splitlines()[0], run.stdout.splitlines()[1]
    assert first.startswith("[ True  True  True] [ True False False] [0. ")
    assert second.startswith("[") and "['']" in second


def test_the_chart_example_draws(ball, tmp_path):
    pytest.importorskip("matplotlib", reason="python3-matplotlib is not there")
    run = subprocess.run([sys.executable, EXAMPLES / "chart.py", ball.path, ball.path, tmp_path / "chart.svg"],
                         capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "certified" in run.stdout and "<svg" in (tmp_path / "chart.svg").read_text()


def test_the_peer_example_flies(ball):
    bus = ["--domain", "94", "--interface", "127.0.0.1"]
    program = os.path.join(os.environ["NEARMESH_BIN_DIR"], "nearmesh-publisher")
    publisher = subprocess.Popen([program, "serve", ball.path, *bus])
    try:
        run = subprocess.run([sys.executable, EXAMPLES / "peer.py", "ball", "94", "127.0.0.1"],
                             capture_output=True, text=True, timeout=500)
        assert run.returncode == 0, run.stderr
        assert run.stdout.count("certified") == 4 and "CONTACT" in run.stdout
    finally:
        publisher.terminate()
        publisher.wait(20)
