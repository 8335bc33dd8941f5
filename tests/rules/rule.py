# SPDX-License-Identifier: Apache-2.0
"""What rules share: each is held against the project, or, for its self-test, against a tree in which every kind of violation is
planted."""
import pathlib
import sys
import tempfile


def self_test(check, planted):
    """What `check` misses or finds too much of. In: {file: (its text, or None for no such file; how many violations it has)}."""
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, (text, _) in planted.items():
            if text is not None:
                (root / name).parent.mkdir(parents=True, exist_ok=True)
                (root / name).write_text(text)
        violations = check(root)
    return [f"{name}: expected {count} violations, found {found}: {violations}"
            for name, (_, count) in planted.items()
            if (found := sum(v.startswith(name + ":") for v in violations)) != count]


def main(doc, check, planted, holds):
    """The program of a rule: ROOT or --self-test. Ends it with 1 where something is found, else says what holds."""
    if len(sys.argv) != 2:
        sys.exit(doc)
    found = self_test(check, planted) if sys.argv[1] == "--self-test" else check(pathlib.Path(sys.argv[1]))
    print("\n".join(found) if found else holds)
    sys.exit(1 if found else 0)
