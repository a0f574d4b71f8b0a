"""How does a robot file of one's own begin? As a shipped one, under another name."""

from __future__ import annotations

from pathlib import Path

import tomlkit

from truepose import robot_file
from truepose.exceptions import InputError, choose


def write(robot: str, out: Path) -> Path:
    """Write a commented starter file for a shipped kind of robot.

    Raises
    ------
    InputError
        No such robot; or `out` is there already, or cannot be written.
    """
    files = robot_file.shipped()
    if robot not in files:
        raise InputError(choose("robot", robot, files))
    document = tomlkit.parse(files[robot].read_text(encoding="utf-8"))
    document["name"] = out.stem
    text = (
        f"# A {robot} to start from: change its numbers to those of your drawings.\n"
        f"# `truepose check {out}` explains what is wrong with them,\n"
        f"# `truepose info {out}` shows what the robot can do.\n"
        "# Short form, for a few values that differ from the shipped robot's:\n"
        f'#     based_on = "{robot}"\n'
        '#     parameters = { "chain1.base.x" = 0.2 }\n#\n'
    )
    try:
        with out.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text + document.as_string())
    except FileExistsError:
        raise InputError(f"{out}: is there already and is not overwritten; choose -o") from None
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from None
    return out
