# SPDX-License-Identifier: Apache-2.0
"""What a build compiles, for rules that look at sources as it does."""
import json
import pathlib
import re


def compile_commands(build):
    """Each command of the build with the sources that it compiles, in their order: one, or all that the build has joined into
    a file of its own (CMAKE_UNITY_BUILD)."""
    commands = []
    for command in json.loads((build / "compile_commands.json").read_text()):
        file = pathlib.Path(command["file"])
        joined = re.findall(r'^#include "(.*)"', file.read_text(), re.MULTILINE) if file.parent.name == "Unity" else [file]
        commands.append((command, [pathlib.Path(source) for source in joined]))
    return commands
