#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Records the golden session anew, and what the tests expect of it: make_golden.py BIN_FOLDER

To be run when the wire version rises, or peers ask or publishers answer otherwise. BIN_FOLDER holds the programs of a build
(build/dev/bin; targets nearmesh-bench-session, nearmesh-subscriber, nearmesh-example-read-session). The session is simulated
without DDS, and the same build records the same samples each time. Read the difference before it is committed: only what
the change explains may have changed.
"""
import pathlib
import re
import sqlite3
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[3]
DATA = ROOT / "tests/data/session"
EXAMPLE = ROOT / "examples/read_session"


def output_of(program, *words):
    return subprocess.run([program, *words], check=True, stdout=subprocess.PIPE, text=True).stdout


def ask(session, statement):
    """As `sqlite3 -header` prints it."""
    with sqlite3.connect(session) as database:
        cursor = database.execute(statement)
        rows = [[column[0] for column in cursor.description], *cursor]
    return "".join("|".join("" if cell is None else str(cell) for cell in row) + "\n" for row in rows)


def main():
    programs = pathlib.Path(sys.argv[1]).resolve()
    subscriber, session = programs / "nearmesh-subscriber", DATA / "session_v1.db3"
    session.unlink(missing_ok=True)
    print(output_of(programs / "nearmesh-bench-session", "-o", session))
    (DATA / "info.txt").write_text(output_of(subscriber, "info", session))
    (DATA / "info.json").write_text(output_of(subscriber, "info", session, "--json"))
    (DATA / "verify.txt").write_text(output_of(subscriber, "verify", session))
    statements = re.findall(r"```sql\n(.*?)```", (ROOT / "docs/sessions.md").read_text(), re.DOTALL)
    (DATA / "questions.txt").write_text("".join(ask(session, s) + "\n" for s in statements))
    before, expected = EXAMPLE / "expected_output.txt", output_of(programs / "nearmesh-example-read-session", session)
    readme = EXAMPLE / "README.md"
    readme.write_text(readme.read_text().replace(before.read_text(), expected))
    before.write_text(expected)


if __name__ == "__main__":
    sys.exit(__doc__ if len(sys.argv) != 2 else main())
