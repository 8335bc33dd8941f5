#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Man page and bash completion of a program, from its own --help. Usage: make_pages.py PROGRAM PAGE COMPLETION."""
import pathlib
import re
import subprocess
import sys

COLUMN = 30  # where CLI11 starts descriptions


def help_of(program, *words):
    return subprocess.run([program, *words, "--help"], check=True, capture_output=True, text=True).stdout


def parse(text):
    """(what it does, usage, [(heading, [(item, description)])], what follows, examples)."""
    text, _, examples = text.partition("\nExamples:\n")
    lines = text.splitlines()
    intro, usage, sections, rest = [], "", [], []
    for line in lines:
        if line.startswith("Usage: "):
            usage = line.removeprefix("Usage: ")
        elif re.fullmatch(r"\S.*:", line):
            sections.append((line[:-1], []))
        elif line.startswith("  ") and sections:
            items = sections[-1][1]
            if line[2] == " ":  # goes on
                name, said = items[-1]
                items[-1] = (name, (said + " " + line.strip()).strip())
            elif len(line) > COLUMN and line[COLUMN - 1] == " " and line[COLUMN] != " ":
                items.append((line[2:COLUMN].strip(), line[COLUMN:].strip()))
            else:
                items.append((line.strip(), ""))
        elif line.strip():
            (rest if usage else intro).append(line.strip())
    return " ".join(intro), usage, sections, " ".join(rest), [line.strip() for line in examples.splitlines() if line]


def roff(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text.startswith((".", "'")) else text


def write_section(out, heading, items, level):
    out.append(f'.{level} "{roff(heading)}"')
    for name, said in items:
        out += [".TP", f"\\fB{roff(name)}\\fR", roff(said)]


def options_of(sections):
    return [flag for heading, items in sections if heading != "Subcommands" for name, _ in items
            for flag in re.findall(r"(?:^|,)(--?[a-z][a-z0-9-]*)", name.split(" ")[0])]


def main(program, page, completion):
    name = pathlib.Path(program).name
    intro, usage, sections, rest, _ = parse(help_of(program))
    said = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout
    version = re.search(r"\d+\.\d+\.\d+", said)[0]
    what = intro.rstrip(".")
    out = [f'.TH {name.upper()} 1 "" "nearmesh {version}" "User Commands"', ".SH NAME",
           f"{roff(name)} \\- {roff(what[0].lower() + what[1:])}", ".SH SYNOPSIS", roff(usage)]
    commands = {}
    for heading, items in sections:
        if heading == "Subcommands":
            commands = dict(items)
        else:
            write_section(out, heading.upper(), items, "SH")
    words = {"": options_of(sections) + list(commands)}
    if commands:
        out.append(".SH COMMANDS")
    for command in commands:
        said, how, parts, after, examples = parse(help_of(program, command))
        out += [f'.SS "{roff(how)}"', roff(said)]
        for heading, items in parts:
            out += [".PP", f"\\fI{roff(heading)}\\fR"]
            for item, about in items:
                out += [".TP", f"\\fB{roff(item)}\\fR", roff(about)]
        if after:
            out += [".PP", roff(after)]
        if examples:
            out += [".PP", "Examples:", ".PP", ".nf"] + [roff("    " + line) for line in examples] + [".fi"]
        words[command] = options_of(parts)
    if rest:
        out += [".SH EXIT STATUS", roff(rest)]
    out += [".SH SEE ALSO", "/usr/share/doc/nearmesh\\-tools/README.md"]
    pathlib.Path(page).write_text("\n".join(line for line in out if line) + "\n")

    function = "_" + name.replace("-", "_")
    cases = "".join(f"    {command}) words='{' '.join(flags)}' ;;\n" for command, flags in words.items() if command)
    pathlib.Path(completion).write_text(f"""# bash completion of {name}, made from its --help
{function}() {{
  local words='{' '.join(words[''])}'
  local i
  for ((i = 1; i < COMP_CWORD; ++i)); do
    case ${{COMP_WORDS[i]}} in
{cases}    *) continue ;;
    esac
    break
  done
  COMPREPLY=()
  if [[ ${{COMP_WORDS[COMP_CWORD]}} == -* || $COMP_CWORD -eq 1 ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "${{COMP_WORDS[COMP_CWORD]}}")
  fi
}}
complete -o default -F {function} {name}
""" if cases else f"""# bash completion of {name}, made from its --help
complete -o default -W '{' '.join(words[''])}' {name}
""")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
