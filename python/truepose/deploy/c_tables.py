"""Constant tables of a robot for C: description, knowledge, control and fault-monitor settings."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable, Sequence
from importlib.metadata import version

import numpy as np

from truepose import _core, files
from truepose.control import delays
from truepose.control.controller import Controller
from truepose.exceptions import InputError
from truepose.faults.monitor import FaultMonitor
from truepose.robot.knowledge import knowledge, uncertain
from truepose.robot.robot import Robot

#: Kind of file, for :func:`truepose.files.mark`.
KIND = "C tables"
#: Numbers per line.
_WIDE = 6
#: Assumed control cycle without a controller, s, for multirate and delayed sensors.
_PERIOD = 1e-3

Listed = list[tuple[str, float | list[float]]]


def identifier(name: str) -> str:
    """Return a C identifier for a robot's name."""
    word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_").lower()
    plain = word[:1].isalpha() and not keyword.iskeyword(word) and word not in _RESERVED.split()
    return word if plain else f"robot_{word}"


#: Keywords of C and C++ that are not Python's.
_RESERVED = """
    auto bool case catch char class const default delete do double enum explicit export
    extern float friend goto inline int long main mutable namespace new operator private
    protected public register short signed sizeof static struct switch template this throw
    typedef union unsigned using virtual void volatile
    """


def named(robot: Robot, name: str | None) -> str:
    """Return the prefix of a robot's tables: `name`, a C identifier, by default of the robot's."""
    made = identifier(robot.name if name is None else name)
    if name not in (None, made):
        raise InputError(
            f"--name {name}: must be a C identifier in lower case, such as {made}: it is the "
            "tables' prefix"
        )
    return made


def to_c(
    robot: Robot,
    controller: Controller | None,
    monitor: FaultMonitor | None,
    name: str | None = None,
) -> str:
    """Write a header of constant tables for ``truepose/truepose.h``, in C99 and in C++.

    Below its highest level a robot has a second description, ``NAME_finest``, for weighted laws and
    fault monitor. The controller's gains are placed at home. Multirate and delayed sensors make a
    ``NAME_multirate``. Raises InputError for an invalid name.
    """
    name = named(robot, name)
    finest = robot.at_highest_level
    two = robot.r > 0 and finest.level != robot.level
    parts = [_description(name, robot)]
    parts += [_description(f"{name}_finest", finest)] if two else []
    parts += [_knowledge(name, robot)] if robot.r else []
    if controller is not None:
        control = _core.c_control(controller.settings(robot, robot.home))
        about = "size, law, gains, feed_forward, sigma_scale"
        parts.append(_settings(name, "control", about, *control))
        if robot.r and monitor is not None:
            setup = monitor.setup(robot, controller)
            about = "size, refresh, coast, decide, spikes, within"
            parts.append(_settings(name, "fault_monitor", about, *_core.c_fault_monitor(setup)))
    period = controller.period if controller else _PERIOD
    late = delays.settings(robot, period)
    parts += [_multirate(name, late, period)] if late else []
    guard = f"TRUEPOSE_TABLES_{name.upper()}_H"
    weighs = f"&{name}_finest" if two else f"&{name}"
    used = f"weighted laws and the fault monitor need {weighs}" if robot.r else "no sensors"
    without = " * Without masses: no control, no fault monitor.\n" if controller is None else ""
    head = (
        f"/* {robot.name}, for truepose/truepose.h; {used}.\n{without}"
        f" * By `truepose export c` of truepose {version('truepose')}; {files.mark(KIND)}.\n"
        " * m, rad, kg, s, N, N·m. */\n"
        f"#ifndef {guard}\n#define {guard}\n\n"
        '#include <math.h>\n\n#include "truepose/truepose.h"\n\n'
        f"#if TRUEPOSE_ABI != {_core.c_abi}\n"
        f"#error These tables are of version {_core.c_abi} of truepose.h\n#endif\n\n"
    )
    return head + "\n".join(parts) + "\n#endif\n"


def _number(value: float) -> str:
    return repr(float(value)).replace("inf", "INFINITY")


def _numbers(values: Iterable[float], indent: str = "    ") -> str:
    """Return an initializer, over several lines if needed; trailing zeros are left out."""
    texts = [_number(value) for value in values]
    while len(texts) > 1 and texts[-1] == "0.0":
        texts.pop()
    lines = [", ".join(texts[k : k + _WIDE]) for k in range(0, len(texts), _WIDE)]
    return "{" + f",\n{indent} ".join(lines) + "}"


def _rows(listed: Listed, indent: str) -> str:
    shown = ((n, _numbers(v, indent) if isinstance(v, list) else _number(v)) for n, v in listed)
    return "\n".join(f"{indent}{text}, /* {name} */" for name, text in shown)


def _whole(values: Sequence[int]) -> str:
    return ", ".join(map(str, values))


def _parts(rows: Iterable[tuple[str, str]]) -> str:
    """Return an array of structures, each given by its comment and its contents."""
    shown = ",\n".join(f"  {{ /* {comment} */\n{contents}\n  }}" for comment, contents in rows)
    return "  {" + shown.lstrip() + "}"


def _description(name: str, robot: Robot) -> str:
    tables, parts = _core.c_description(robot.core), []
    for kind in ("chain", "sensor", "body"):
        names = [*robot.sensors, "none"] if kind == "sensor" else range(1, len(tables[kind]) + 1)
        rows = [
            (f"{kind} {part}", f"    {_whole(counts)},\n{_rows(listed, '    ')}")
            for part, (counts, listed) in zip(names, tables[kind], strict=False)
        ]
        parts.append(_parts(rows))
    axes = zip(robot.spec.passive_axis, tables["axis"], strict=True)
    shown = [(f"axis {axis.name}", _rows(listed, "    ")) for axis, (_, listed) in axes]
    parts.append(_parts(shown or [("axis none", "    {0.0}, {0.0}, 0.0, 0.0,")]))
    counts, listed = tables["head"]
    return (
        f"static const truepose_description {name} = {{\n"
        f"  TRUEPOSE_ABI, sizeof(truepose_description),\n"
        f"  {_whole(counts)}, /* mobility, chains, motors, sensors, bodies, bar_joint, "
        "level */\n"
        f"{_rows(listed, '  ')}\n" + ",\n".join(parts) + "\n};\n"
    )


def _knowledge(name: str, robot: Robot) -> str:
    columns, root, sigma = _core.c_knowledge(knowledge(robot).core)
    count = len(columns)
    if not count:  # C has no arrays of nothing
        columns, root = [0], np.zeros((1, 1))
    values = _numbers(np.asarray(root).ravel().tolist(), "   ")
    return (
        f"/* Uncertain parameters: {', '.join(uncertain(robot)) or 'none'}. */\n"
        f"static const int32_t {name}_column[] = {{{_whole(columns)}}};\n"
        f"static const truepose_real {name}_root[{count or 1} * {count or 1}] =\n   {values};\n"
        f"static const truepose_knowledge {name}_knowledge = {{\n"
        f"  {count}, 0, {name}_column, {name}_root,\n  {_numbers(sigma)} /* sigma */\n}};\n"
    )


def _settings(name: str, kind: str, about: str, counts: Sequence[int], listed: Listed) -> str:
    return (
        f"static const truepose_{kind}_settings {name}_{kind} = {{\n"
        f"  sizeof(truepose_{kind}_settings), {_whole(counts[1:])}, /* {about} */\n"
        f"{_rows(listed, '  ')}\n}};\n"
    )


def _multirate(name: str, late: _core.MultirateSettings, period: float) -> str:
    sensitivity = ",\n   ".join(map(_numbers, late.sensitivity))
    return (
        f"static const truepose_multirate_settings {name}_multirate = {{\n"
        f"  sizeof(truepose_multirate_settings), 0, /* size, stamped */\n"
        f"  {{{_whole(late.every)}}}, /* every */\n  {{{_whole(late.age)}}}, /* age */\n"
        f"  {_number(period)}, /* period */\n  {{{sensitivity}}} /* sensitivity */\n}};\n"
    )
