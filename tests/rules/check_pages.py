#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks what pages point at. Usage: check_pages.py ROOT, or check_pages.py --self-test.

In every page (*.md): each relative link leads to a file or folder of the project, each anchor to a heading of that page, each
picture is there, says in words what it shows, and has a title if it is an SVG. Every page of docs/ is in the index,
docs/README.md. A page that is named anywhere in the project, in code and in help too, is there. Needs no network: links to
other places are not followed.
Prints one line per violation and exits with 1 when there is any.
"""
import pathlib
import re
import urllib.parse

from rule import main

SKIPPED = {".git", ".cache", "out"}  # and build*
INDEX = "docs/README.md"
RULES = pathlib.Path("tests/rules")  # they plant names of pages that are not there
TEXT = {".cpp", ".hpp", ".h", ".md", ".py", ".sh", ".cmake", ".txt", ".js", ".html", ".yaml", ".idl", ".in", ""}
CODE_BLOCK = re.compile(r"^(```|~~~).*?^\1[^\n]*$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?:(?<=\n\n)|\A)(?: {4}[^\n]*\n|\n(?= {4}))+")
CODE_SPAN = re.compile(r"(`+)(?!`).+?(?<!`)\1(?!`)", re.DOTALL)
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(\s*<?([^)\s>]+)>?[^)]*\)", re.DOTALL)
HEADING = re.compile(r"^#{1,6} +(.*?)(?: +#+)?$", re.MULTILINE)
NAMED = re.compile(r"(?<![\w./-])((?:docs|core|idl|publisher|subscriber|tests|examples)/[\w/.-]*?[\w-]\.md)\b(?:#([\w-]+))?")


def blank(match):
    """Lines stay lines, so that places stay true."""
    return re.sub(r"[^\n]", " ", match[0])


def prose(text):
    """A page without its code, at the same places."""
    return CODE_SPAN.sub(blank, INDENTED.sub(blank, CODE_BLOCK.sub(blank, text)))


def anchors(text):
    """What GitHub makes of the headings: words of letters, digits, - and _ in lower case; the second of a name gets -1."""
    seen = {}
    for heading in HEADING.findall(CODE_BLOCK.sub(blank, text)):
        words = LINK.sub(lambda link: link[2], heading).lower()
        name = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        count = seen.get(name, 0)
        seen[name] = count + 1
        yield f"{name}-{count}" if count else name


def files(root):
    for path in sorted(root.rglob("*")):
        first = path.relative_to(root).parts[0]
        if path.is_file() and first not in SKIPPED and not first.startswith("build"):
            yield path


def check(root):
    violations = []
    paths = list(files(root))
    known = {}

    def anchors_of(page):
        if page not in known:
            known[page] = set(anchors(page.read_text()))
        return known[page]

    def fault_of(path, target):
        place, _, anchor = target.partition("#")
        where = (path.parent / urllib.parse.unquote(place)).resolve() if place else path.resolve()
        if not where.is_relative_to(root.resolve()):
            return "leads out of the project"
        if not where.exists():
            return "is not there"
        if anchor and (where.suffix != ".md" or anchor not in anchors_of(where)):
            return "has no such heading"
        return None

    linked = set()
    for path in paths:
        name = path.relative_to(root)
        if path.suffix not in TEXT:
            continue
        try:
            text = path.read_text()
        except UnicodeDecodeError:
            continue
        for match in NAMED.finditer(text) if name.parent != RULES else ():
            page = root / match[1]
            line = text.count("\n", 0, match.start()) + 1
            # A page's own folder may have folders of these names too: a link is looked at below.
            if not page.is_file() and not (path.parent / match[1]).is_file():
                violations.append(f"{name}:{line}: names {match[1]}, which is not there")
            elif match[2] and page.is_file() and match[2] not in anchors_of(page):
                violations.append(f"{name}:{line}: names {match[0]}, which has no such heading")
        if path.suffix != ".md":
            continue
        said = prose(text)
        for match in LINK.finditer(said):
            picture, words, target = match.groups()
            line = text.count("\n", 0, match.start()) + 1
            inner = LINK.search(words)  # a picture that is a link
            for is_picture, alt, to in [(picture, words, target)] + ([inner.groups()] if inner else []):
                if re.match(r"[a-z]+:", to):
                    continue
                fault = fault_of(path, to)
                if fault:
                    violations.append(f"{name}:{line}: {to} {fault}")
                    continue
                if name.as_posix() == INDEX:
                    linked.add((path.parent / to.partition("#")[0]).resolve())
                if is_picture and not alt.strip():
                    violations.append(f"{name}:{line}: {to} is not told in words")
                if is_picture and to.endswith(".svg") and not re.search(
                        r"<title>\s*\S|<text[ >]|<!-- \S", (path.parent / to).read_text()):
                    violations.append(f"{name}:{line}: {to} has no title")
    if (root / INDEX).is_file():
        violations += [f"{INDEX}: does not name {path.name}" for path in paths
                       if path.parent == root / "docs" and path.suffix == ".md" and path != root / INDEX
                       and path.resolve() not in linked]
    else:
        violations.append(f"{INDEX}: is not there")
    return violations


def planted():
    """Every kind of violation, which must be found, and what must pass."""
    good = ("# A page\n\n## What `x` is, and [why](b.md)\n\n## Twice\n\n## Twice\n\n[b](b.md), [c](#twice-1), [d](../core),\n"
            "[e](b.md#what-x-is-and-why), `[no link](gone.md)`, [far](https://example.org/gone.md), [split\nlink](b.md)\n\n"
            "    [code](gone.md)\n\n```\n[code](gone.md)\n# no heading\n```\n\n![a picture](p.svg) [![both](p.svg)](b.md)\n")
    return {
        INDEX: ("[a](a.md) [b](b.md#twice)", 1),  # c.md is not named
        "docs/a.md": (good, 0),
        "docs/b.md": ("## What x is, and why\n\n## Twice\n", 0),
        "docs/c.md": ("[1](gone.md) [2](b.md#gone) [3](../../x) ![](p.svg) ![4](gone.png) ![5](bare.svg)\n"
                      "[![6](gone.svg)](b.md) [7](#no-heading)\n", 8),
        "docs/p.svg": ("<svg><title>p</title></svg>", 0),
        "docs/bare.svg": ("<svg><path/></svg>", 0),
        "core/help.cpp": ("// docs/a.md and docs/b.md#twice\n", 0),
        "core/stale.cpp": ("// docs/gone.md, docs/b.md#gone\n", 2),
        "build/x.md": ("[1](gone.md)", 0),
    }


if __name__ == "__main__":
    main(__doc__, check, planted(), "Pages lead where they say.")
