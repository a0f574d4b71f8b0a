"""Constant tables of a robot for C: description, knowledge, control and fault-monitor settings."""

import keyword
import re
from collections.abc import Iterable
from importlib.metadata import version
from itertools import groupby
from typing import Any

import numpy as np

from truepose import _core, files
from truepose.arguments import Array
from truepose.calibration.changes import Expected, changes, drift
from truepose.control import delays
from truepose.control.controller import Controller
from truepose.exceptions import InputError
from truepose.faults.monitor import FaultMonitor
from truepose.robot import Robot
from truepose.robot.knowledge import in_control, knowledge
from truepose.robotfile.to_core import columns

#: Kind of file, for :func:`truepose.files.mark`.
KIND = "C tables"
#: Numbers per line.
_WIDE = 6
#: Assumed control cycle without a controller, s, for multirate and delayed sensors.
_PERIOD = 1e-3


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
    fault monitor. Where the file states conditions, calibrations begin with a ``NAME_prior``. The
    controller's gains are placed at home. Multirate and delayed sensors make a
    ``NAME_multirate``. Raises InputError for an invalid name.
    """
    robot.require_chains("C tables")
    name = named(robot, name)
    finest = robot.at_highest_level
    two = robot.r > 0 and finest.level != robot.level
    parts = [_description(name, robot)]
    parts += [_description(f"{name}_finest", finest)] if two else []
    parts += [_knowledge(robot, name, in_control(robot), "_knowledge")] if robot.r else []
    if robot.r and robot.spec.conditions:
        parts.append(_knowledge(robot, f"{name}_prior", knowledge(robot).core))
        parts.append(_changes(robot, name))
    if controller is not None:
        parts.append(_settings(name, "control", controller.settings(robot, robot.home)))
        if robot.r and monitor is not None:
            setup = monitor.setup(robot, controller)
            parts.append(_settings(name, "fault_monitor", setup.monitor))
    period = controller.period if controller else _PERIOD
    late = delays.settings(robot, period)
    parts += [_settings(name, "multirate", late)] if late else []
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
        f"#if TRUEPOSE_ABI != {robot.core.abi}\n"
        f"#error These tables are of version {robot.core.abi} of truepose.h\n#endif\n\n"
    )
    return head + "\n".join(parts) + "\n#endif\n"


def _numbers(values: Array, indent: str = "    ") -> str:
    """Return an initializer, over several lines if needed; trailing zeros are left out."""
    if values.ndim == 0:
        return repr(float(values)).replace("inf", "INFINITY")
    if values.ndim > 1:
        return "{" + f",\n{indent} ".join(_numbers(row, indent) for row in values) + "}"
    texts = [repr(value).replace("inf", "INFINITY") for value in values.tolist()]
    while len(texts) > 1 and texts[-1] in ("0", "0.0"):
        texts.pop()
    lines = [", ".join(texts[k : k + _WIDE]) for k in range(0, len(texts), _WIDE)]
    return "{" + f",\n{indent} ".join(lines) + "}"


def _members(struct: Any, kind: str, indent: str) -> str:
    """Return the members of one of the core's structs, whole numbers on one line."""
    own = {"abi": "TRUEPOSE_ABI", "size": f"sizeof(truepose_{kind})", "unused": "0"}
    if not isinstance(struct, np.record):
        struct = {name: getattr(struct, name) for name in struct.fields}
    names = struct.keys() if isinstance(struct, dict) else struct.dtype.names
    members = [(name, own.get(name, struct[name])) for name in names]
    members = [member for member in members if not isinstance(member[1], np.recarray)]
    lines = []
    for whole, of in groupby(members, lambda member: isinstance(member[1], (int, np.integer, str))):
        rows = [(name, str(v) if whole else _numbers(np.array(v), indent)) for name, v in of]
        if whole:
            names, values = zip(*rows, strict=True)
            rows = [(", ".join(names), ", ".join(values))]
        lines += [f"{indent}{text}, /* {name} */" for name, text in rows]
    return "\n".join(lines)


def _parts(kind: str, parts: Iterable[tuple[object, Any]]) -> str:
    """Return an array of structures, each with its name."""
    shown = ",\n".join(
        f"  {{ /* {kind} {name} */\n{_members(part, kind, '    ')}\n  }}" for name, part in parts
    )
    return "  {" + shown.lstrip() + "}"


def _description(name: str, robot: Robot) -> str:
    core = robot.core
    parts = [
        _parts(kind, zip(names, getattr(core, kind), strict=False))
        for kind, names in {
            "chain": range(1, core.chains + 1),
            "sensor": [*robot.sensors] or ["none"],
            "body": range(1, max(core.bodies, 1) + 1),
            "axis": [axis.name for axis in robot.spec.passive_axis] or ["none"],
        }.items()
    ]
    return (
        f"static const truepose_description {name} = {{\n"
        f"{_members(core, 'description', '  ')}\n" + ",\n".join(parts) + "\n};\n"
    )


def _knowledge(robot: Robot, name: str, known: _core.Knowledge, suffix: str = "") -> str:
    count, column, root = len(known.column), known.column, known.root
    named = {at: parameter for parameter, at in columns(robot.spec)}
    names = [named[at] for at in column]
    if not count:  # C has no arrays of nothing
        column, root = np.zeros(1, dtype=int), np.zeros((1, 1))
    values = _numbers(root.ravel(), "   ")
    return (
        f"/* Uncertain parameters: {', '.join(names) or 'none'}. */\n"
        f"static const int32_t {name}_column[] = {_numbers(column)};\n"
        f"static const truepose_real {name}_root[{count or 1} * {count or 1}] =\n   {values};\n"
        f"static const truepose_knowledge {name}{suffix} = {{\n"
        f"  {count}, {name}_column, {name}_root,\n  {_numbers(known.sigma)} /* sigma */\n}};\n"
    )


def _changes(robot: Robot, name: str) -> str:
    expected, walk = Expected.of(robot, changes(robot)), drift(robot)
    arrays = {"step": expected.step, "log_odds": expected.log_odds, "drift": walk}
    texts = [
        f"static const truepose_real {name}_{key}[{values.size or 1}] =\n"
        f"   {_numbers(values.ravel() if values.size else np.zeros(1), '   ')};\n"
        for key, values in arrays.items()
    ]
    end = _numbers(expected.end if len(expected.end) else np.zeros(1, dtype=int))
    return (
        "/* What a calibrator at work follows. */\n"
        + "".join(texts)
        + f"static const int32_t {name}_end[] = {end};\n"
        f"static const truepose_changes {name}_changes = {{\n"
        f"  {len(expected.step)}, {len(expected.end)}, {len(walk)}, {expected.load},\n"
        f"  {name}_step, {name}_end, {name}_log_odds, {name}_drift,\n"
        f"  {_numbers(expected.force)},\n  {_numbers(expected.compliance)}\n}};\n"
    )


def _settings(name: str, kind: str, settings: Any) -> str:
    return (
        f"static const truepose_{kind}_settings {name}_{kind} = {{\n"
        f"{_members(settings, f'{kind}_settings', '  ')}\n}};\n"
    )
