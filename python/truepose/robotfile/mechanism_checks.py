"""Checks that bodies, closures, motors and sensors of a mechanism fit together."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

from truepose import _core
from truepose.exceptions import choose
from truepose.robotfile.base import Problem
from truepose.robotfile.chains import check_drive
from truepose.robotfile.mechanism import freedoms, singles
from truepose.robotfile.mechanism_to_core import equations, freedoms_in_order, movers
from truepose.robotfile.schema import RobotFile
from truepose.robotfile.to_core import rod_axis

Path = tuple[str | int, ...]
#: Sections that are for chains, and kinds of sensors.
_OF_CHAINS = ("bar", "passive_axis", "platform", "compliance", "conditions")
_NO_KINDS = ("platform_angle", "axis_angle")


def misfits(spec: RobotFile) -> Iterator[Problem]:
    """Yield what is wrong with a mechanism, as far as its home does not matter."""
    for key in ["chain"] * bool(spec.chain) + spec.stated(*_OF_CHAINS):
        yield Problem((key,), f"{key}: not in a file of bodies and closures")
    for check in (_tree, _motors, _unknown, _parts):
        wrong = [*check(spec)]
        yield from wrong
        if wrong:  # what follows takes it as right
            return


def _tree(spec: RobotFile) -> Iterator[Problem]:
    """Yield names that are used twice, bodies that are missing or carried in a circle."""
    seen = {"base": "the base"}
    for at, part in spec.parts("body", "closure", "motor", "sensor"):
        if part.name in seen:
            text = f"{at[0]} {part.name}: {seen[part.name]} has this name"
            yield Problem((*at, "name"), text)
        seen[part.name] = f"a {at[0]}"
    on = {of.name: of.on for of in spec.body}
    if "platform" not in on:
        yield Problem(("body",), "body: one must be named platform; its frame is that of x")
    for at, part in spec.parts("body", "closure", "sensor"):
        for key in ("on", "anchor_body", "base_body", "body"):
            if (name := getattr(part, key, "base")) not in ("base", *on):
                text = f"{part.name}.{key}: {choose('body', name, ['base', *on])}"
                yield Problem((*at, key), text)
    for k, name in enumerate(on):
        circle = [name]
        while (up := on.get(circle[-1])) in on and up not in circle:
            circle.append(up)
        if up == name == min(circle):
            told = ", ".join(f"{of} is carried by {on[of]}" for of in circle)
            text = f"body {name}: {told}: a circle; every body must lead to the base"
            yield Problem(("body", k, "on"), text)


def _motors(spec: RobotFile) -> Iterator[Problem]:
    """Yield motors and freedoms whose names or keys do not fit what they move."""
    by = [((*at, "motor"), of.motor) for at, of in spec.parts("body", "closure") if of.motor]
    moved = {name: path for path, name in reversed(by)}
    legs = Counter(of.motor for of in spec.closure)
    for k, (motor, actuator) in enumerate(zip(spec.motor, spec.actuators, strict=True)):
        name = motor.name
        if name not in moved:
            text = f"motor {name}: no body or closure has motor = '{name}'"
            yield Problem(("motor", k, "name"), text)
        elif name != f"q{k + 1}":
            text = f"motor = '{name}': motors must be named q1 to q{len(moved)}"
            yield Problem(moved[name], text)
        elif legs[name] and sum(of == name for _, of in by) > 1:
            yield Problem(moved[name], f"motor = '{name}': moves a leg and something else")
        try:
            check_drive(motor, actuator)
        except ValueError as error:
            yield Problem(("motor", k), f"{name}: {error}")
    turns: dict[str, bool] = {}
    for single in singles(spec.body):
        path, name = ("body", spec.body.index(single.body), "freedom"), single.freedom
        if turns.setdefault(name, single.turns) != single.turns:
            yield Problem(path, f"freedom {name} is a hinge's and a slide's")
        if name in moved and not single.body.motor:
            yield Problem(
                path, f"{single.body.name}.freedom = '{name}': a motor's name: give motor"
            )


def _unknown(spec: RobotFile) -> Iterator[Problem]:
    """Yield names of freedoms, motors and closures that the file has not."""
    every, motors = freedoms(spec.body), [motor.name for motor in spec.motor]
    free = [name for name in every if name not in motors]
    x = [name for name, _ in spec.coordinate_units]
    hidden = [name for name in freedoms_in_order(spec) if name not in x]
    rows: list[tuple[Path, str, str, Any, list[str]]]
    rows = [(("coordinates",), "coordinates", "freedom", name, free) for name in spec.coordinates]
    for name in spec.start:
        rows.append((("start",), "start", "motor or freedom that follows", name, hidden))
    rods = [of.name for of in spec.closure if of.length or of.motor]
    turning = [of for of, how in zip(motors, spec.actuators, strict=True) if how == "revolute"]
    hinges, slides = ([of for of in every if every[of] == unit] for unit in ("rad", "m"))
    of_kind = {"joint_angle": ("hinge", hinges), "slide_position": ("slide", slides)}
    for at, sensor in spec.parts("sensor"):
        for key, (what, known) in {
            "freedom": of_kind.get(sensor.kind, ("", [])),
            "motor": ("motor that turns", turning),
            "closure": ("rod or leg", rods),
        }.items():
            if hasattr(sensor, key):
                where = f"sensor {sensor.name}: {key}"
                rows.append(((*at, key), where, what, getattr(sensor, key), known))
    for path, where, what, name, known in rows:
        if name not in known:
            yield Problem(path, f"{where}: {choose(what, name, known)}")


def _parts(spec: RobotFile) -> Iterator[Problem]:
    """Yield too many or too few parts, closures within a body, keys that a part cannot have."""
    x, m = [name for name, _ in spec.coordinate_units], spec.m
    if len(set(x)) < len(x):
        yield Problem(("coordinates",), f"coordinates: {', '.join(x)}: one is listed twice")
    if not 1 <= len(x) <= min(m, 3):
        text = f"coordinates: {', '.join(x)}: must be 1 to 3, and at most as many as motors, {m}"
        yield Problem(("coordinates",), f"{text}; the other freedoms follow from the closures")
    order = freedoms_in_order(spec)
    unknown = len(order) - min(m, len(x))
    joints = "slides and hinges (a joint of several freedoms counts each)"
    for key, count, what, most in (
        ("body", len([*singles(spec.body)]), joints, _core.max_bodies),
        ("closure", len(equations(spec)), "equations (a hinge is one)", _core.max_closures),
        ("motor", m, "motors", _core.max_motors),
        ("body", len(order), "freedoms", _core.max_freedoms),
        ("body", unknown, "unknown freedoms", _core.max_unknowns),
    ):
        if count > most:
            yield Problem((key,), f"{key}: {count} {what}, at most {most}")
    for at, of in spec.parts("closure"):
        if of.anchor_body == of.base_body:
            text = f"closure {of.name}: both ends are on {of.base_body}: nothing moves one"
            yield Problem(at, text)
        if of.working_mode and not (of.length and len(movers(spec, of)) == 1):
            text = f"{of.name}.working_mode: is for a rod whose base one motor moves"
            yield Problem((*at, "working_mode"), text)
    for at, sensor in spec.parts("sensor"):
        for key, text in _sensor(spec, sensor):
            yield Problem((*at, key), f"sensor {sensor.name}: {key}: {text}")


def _sensor(spec: RobotFile, sensor: Any) -> Iterator[tuple[str, str]]:
    """Yield keys that a mechanism's sensor cannot have, or lacks."""
    if sensor.kind in _NO_KINDS:
        yield "kind", f"{sensor.kind} is for chains: here joint_angle"
    for key in sensor.stated("chain", "bar", "rod"):
        yield key, "is for chains"
    if hasattr(sensor, "zero"):
        axis, zero = rod_axis(spec, sensor), sensor.zero
        if axis is None:
            yield "axis", "is missing: the closure has no hinge there"
        if zero is None:
            yield "zero", "is missing"
        elif axis and abs(sum(a * b for a, b in zip(axis, zero, strict=True))) > 1e-6:
            yield "zero", "must be normal to axis"
