#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Every command on a page is one that the programs take. Usage: check_commands.py ROOT BIN, or check_commands.py --self-test BIN.

Reads the code blocks of README.md, docs/ and examples/, and programs that are named within a sentence. Of each nearmesh-* command
program, verb and options are held against the program's own --help; of examples and of what is run by hand, which may not be built,
against their sources. So are the examples with which the --help of each verb ends. run_commands.py runs those of the pages.
Prints what was done, one line per fault, and exits with 1 when there is any.
"""
import functools
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

PROGRAMS = ("nearmesh-model", "nearmesh-publisher", "nearmesh-subscriber")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def pages(root):
    return [root / "README.md", *sorted((root / "docs").glob("*.md")), *sorted((root / "examples").rglob("*.md"))]


def blocks(text):
    """(number of the first line, lines) of each code block that may hold commands."""
    for match in FENCE.finditer(text):
        if match[1] in ("", "sh", "bash", "shell"):
            yield text.count("\n", 0, match.start(2)) + 1, match[2].splitlines()
    bare = FENCE.sub(lambda m: re.sub(r"[^\n]", "", m[0]), text).splitlines()
    for number, line in enumerate(bare, 1):
        if line.startswith("    ") and (number < 2 or not bare[number - 2].startswith("    ")):
            end = next((i for i in range(number, len(bare)) if not bare[i].startswith("    ")), len(bare))
            yield number, [one[4:] for one in bare[number - 1:end]]


def named(text):
    """(line, command) of each `nearmesh-* VERB ...` within a sentence."""
    text = FENCE.sub(lambda m: re.sub(r"[^\n]", "", m[0]), text)
    for match in re.finditer(r"`(nearmesh-[a-z-]+\s[^`]+)`", text):
        yield text.count("\n", 0, match.start()) + 1, " ".join(match[1].split())


def spans(text):
    """Those of them that are whole: with something for the program to work on."""
    for _, command in named(text):
        words = command.split()
        if words[0] in PROGRAMS and any(not word.startswith("-") for word in words[2:]):
            yield command


def commands(page):
    """(line, words) of each nearmesh-* command of a page, without what stands around it."""
    text = page.read_text()
    for line, command in named(text):
        yield line, command.split()
    for first, lines in blocks(text):
        number = first - 1
        while lines:
            number += 1
            line, used = lines.pop(0), 1
            while line.endswith("\\") and lines:
                line, used = line[:-1] + lines.pop(0), used + 1
            line = re.sub(r"^\$ ", "", line)
            try:
                lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
                lexer.wordchars += "$,=*:{}"
                words = list(lexer)
            except ValueError:
                words = []  # what a program prints
            command = []
            for word in words + [";"]:
                if set(word) <= set("();<>|&"):
                    if command:
                        yield number, command
                    command = None if set(word) <= set("<>") else []  # a file comes next
                elif command is None:
                    command = [] if word else None
                elif command or re.fullmatch(r"([\w./$]*/)?nearmesh-[a-z-]+", word):
                    if command or not words[:words.index(word)] or not is_prose(words[:words.index(word)]):
                        command.append(pathlib.PurePath(word).name if not command else word)
            number += used - 1


def is_prose(before):
    """A program's name within a line that is no command: what stands before it is neither a setting nor a way to start it."""
    for word in before:
        if set(word) <= set("();<>|&"):
            before = before[before.index(word) + 1:]
    return not all("=" in word or word in ("chrt", "-r", "2", "nice", "time") for word in before)


class Programs:
    def __init__(self, root, binaries):
        self.root, self.binaries = root, binaries

    @functools.lru_cache(maxsize=None)
    def help(self, program, verb):
        words = [self.binaries / program] + ([verb] if verb else []) + ["--help"]
        return subprocess.run(words, capture_output=True, text=True, timeout=60).stdout

    @functools.lru_cache(maxsize=None)
    def source(self, program):
        """Of the folder that makes a program."""
        for lists in [path for folder in ("tests", "examples") for path in sorted((self.root / folder).rglob("CMakeLists.txt"))]:
            if re.search(rf"\({re.escape(program)}[ )]", lists.read_text()):
                return "".join(path.read_text() for path in sorted(lists.parent.rglob("*.[ch]pp")))
        return None

    def verbs(self, program):
        return re.findall(r"^  ([a-z][a-z-]+) ", self.help(program, None).partition("\nSubcommands:")[2], re.MULTILINE)

    def faults_of_help(self, program, verb):
        """A verb's help ends with commands of that verb."""
        examples = self.help(program, verb).partition("\nExamples:\n")[2].splitlines()
        if not any(examples):
            return [f"{program} {verb} --help ends without an example"]
        faults = []
        for line in filter(None, examples):
            words = shlex.split(line.partition("&&")[0])
            faults += [f"expected {program} {verb}, found {line.strip()}"] if words[:2] != [program, verb] else self.faults(words)
        return [f"{program} {verb} --help: {fault}" for fault in faults]

    def faults(self, words):
        program, rest = words[0], words[1:]
        options = [re.match(r"-[\w-]*", word)[0] for word in rest if re.match(r"--?[a-z]", word)]
        if program not in PROGRAMS:  # some have no --help, and need not be built
            source = self.source(program)
            if source is None:
                return [f"there is no {program}"]
            return [f"{program} takes no {option}" for option in options if not re.search(rf'["\[ ,]{option}["\], =]', source)]
        verbs = self.verbs(program)
        verb = None
        if verbs and rest and not rest[0].startswith("-"):
            verb = rest[0]
            if re.fullmatch(r"[\d.]+", verb):
                return []  # what --version prints
            if verb not in verbs:
                return [f"{program} has no {verb}"]
        known = set(re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", "\n".join(
            line.split("  ")[1] if line.startswith("  -") else "" for line in self.help(program, verb).splitlines())))
        return [f"{program} {verb or ''} takes no {option}" for option in options if option not in known]


def main(root, binaries):
    programs = Programs(root, binaries)
    read = [(page, line, words) for page in pages(root) for line, words in commands(page)]
    faults = [f"{page.relative_to(root)}:{line}: {fault}" for page, line, words in read for fault in programs.faults(words)]
    helps = [(program, verb) for program in PROGRAMS for verb in programs.verbs(program)]
    faults += [fault for program, verb in helps for fault in programs.faults_of_help(program, verb)]
    print(f"{len(read)} commands and {len(helps)} helps read.")
    if len(helps) < 20:
        faults.append("fewer verbs than there were: are they still found?")
    return faults if len(read) > 90 else faults + ["fewer commands than there were: are they still found?"]


def self_test(binaries):
    """Every kind of fault is planted and must be found; the rest must pass."""
    planted = {
        "README.md": ("    nearmesh-model build a.obj -o a.spm  # good\n    nearmesh-model bake a.obj\n"
                      "    nearmesh-model build a.obj --colour red && nearmesh-gone a\n\n```cpp\nnearmesh-gone\n```\n"
                      "```\nX=1 nearmesh-subscriber watch --http 1 \\\n  --port 2\n$ nearmesh-model info --bad >nearmesh-gone\n```\n"
                      "    A line about nearmesh-gone\n\nSay `nearmesh-model info\n--deep` or `nearmesh-model info --deeper`, `nearmesh-gone`.\n", 6)}
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        (root / "README.md").write_text(planted["README.md"][0])
        programs = Programs(root, binaries)
        found = [fault for _, words in commands(root / "README.md") for fault in programs.faults(words)]
    if len(found) != planted["README.md"][1]:
        return [f"expected {planted['README.md'][1]} faults, found {found}"]
    good = "  --deep   Look closely\n\nExamples:\n    nearmesh-model info a.spm --deep\n"
    for said, count in ((good, 0), (good + "    nearmesh-model info a.spm --colour\n", 1), (good.partition("Examples")[0], 1),
                        (good + "    nearmesh-model query a.spm\n", 1), (good.replace("info a.spm", "$(info a.spm)"), 1)):
        programs = Programs(root, binaries)
        true_help = programs.help
        programs.help = lambda program, verb, said=said, true=true_help: said if verb == "info" else true(program, verb)
        found = programs.faults_of_help("nearmesh-model", "info")
        if len(found) != count:
            return [f"expected {count} faults of a help, found {found}: {said}"]
    return []


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[2]).resolve()
    result = self_test(folder) if sys.argv[1] == "--self-test" else main(pathlib.Path(sys.argv[1]).resolve(), folder)
    print("\n".join(result) if result else "Commands on pages are what the programs take.")
    sys.exit(1 if result else 0)
