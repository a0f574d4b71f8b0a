"""Checks that bodies, closures, motors and sensors of a mechanism fit together."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

from truepose import _core
from truepose.exceptions import choose
from truepose.robotfile.base import Problem, not_degrees, not_millimetres
from truepose.robotfile.mechanism import FREE, Body, actuators, freedoms, singles
from truepose.robotfile.mechanism_to_core import equations, freedoms_in_order, motor_of
from truepose.robotfile.schema import RobotFile
from truepose.robotfile.to_core import rod_axis

#: Sections that are for chains.
_OF_CHAINS = ("chain", "bar", "passive_axis", "platform", "compliance", "conditions")
#: Keys of sensors that are for chains, and those that are for mechanisms.
CHAIN_KEYS = {"chain": None, "bar": None, "rod": "+"}
MECHANISM_KEYS = ("closure", "axis", "zero")
#: Kinds of sensors that no mechanism of bodies and closures has.
_NO_KINDS = {"platform_angle": "joint_angle", "axis_angle": "joint_angle"}


def misfits(spec: RobotFile) -> Iterator[Problem]:
    """Yield what is wrong with a mechanism, as far as its home does not matter."""
    for key in _OF_CHAINS:
        if getattr(spec, key) != type(spec).model_fields[key].default and getattr(spec, key):
            yield Problem((key,), f"{key}: not in a file of bodies and closures")
    tree = [*_tree(spec)]
    yield from tree
    if tree:
        return
    motors = [*_motors(spec), *_coordinates(spec)]
    yield from motors or _capacity(spec)
    if not motors:
        yield from _closures(spec)


def _tree(spec: RobotFile) -> Iterator[Problem]:
    """Yield names that are used twice, bodies that are missing or carried in a circle."""
    parts = ("body", "closure", "motor", "sensor")
    every = [(top, k, part.name) for top in parts for k, part in enumerate(getattr(spec, top))]
    seen = {"base": "the base"}
    for top, k, name in every:
        if name in seen:
            yield Problem((top, k, "name"), f"{top} {name}: {seen[name]} has this name")
        seen[name] = f"a {top}"
    known = ["base", *(of.name for of in spec.body)]
    if "platform" not in known:
        yield Problem(("body",), "body: one must be named platform; its frame is that of x")
    ends: list[tuple[str, int, Any, tuple[str, ...]]]
    ends = [("body", k, of, ("on",)) for k, of in enumerate(spec.body)]
    ends += [("closure", k, of, ("anchor_body", "base_body")) for k, of in enumerate(spec.closure)]
    ends += [
        ("sensor", k, of, ("body",)) for k, of in enumerate(spec.sensor) if hasattr(of, "body")
    ]
    for top, k, part, keys in ends:
        for key in keys:
            if (name := getattr(part, key)) not in known:
                yield Problem((top, k, key), f"{part.name}.{key}: {choose('body', name, known)}")
    reached = {single.body.name for single in singles(spec.body)} | {"base"}
    on = {of.name: of.on for of in spec.body}
    for k, of in enumerate(spec.body):
        circle = [of.name]
        while (up := on.get(circle[-1])) in on and up not in circle and up not in reached:
            circle.append(up)
        if up == of.name and of.name == min(circle):
            told = ", ".join(f"{name} is carried by {on[name]}" for name in circle)
            text = f"body {of.name}: {told}: a circle; every body must lead to the base"
            yield Problem(("body", k, "on"), text)


def _motors(spec: RobotFile) -> Iterator[Problem]:
    """Yield motors and freedoms whose names or keys do not fit what they move."""
    moved = actuators(spec.body, spec.closure)
    legs = Counter(of.motor for of in spec.closure if of.motor)
    for k, motor in enumerate(spec.motor):
        name, path = motor.name, ("motor", k, "name")
        if name not in moved:
            yield Problem(path, f"motor {name}: no body or closure has motor = '{name}'")
        elif name != f"q{k + 1}":
            text = f"motor = '{name}': motors must be named q1 to q{len(moved)}"
            yield Problem(_motor_path(spec, name), text)
        elif legs[name] and (legs[name] > 1 or any(of.motor == name for of in spec.body)):
            yield Problem(
                _motor_path(spec, name), f"motor = '{name}': moves a leg and something else"
            )
        yield from _drive(motor, moved.get(name, ""), ("motor", k))
    units: dict[str, bool] = {}
    for single in singles(spec.body):
        if units.setdefault(single.freedom, single.turns) != single.turns:
            path = ("body", spec.body.index(single.body), "freedom")
            yield Problem(path, f"freedom {single.freedom} is a hinge's and a slide's")
    for k, body in enumerate(spec.body):
        if body.joint == "hinge":
            try:
                not_degrees(body.zero)
            except ValueError as error:
                yield Problem(("body", k, "zero"), f"{body.name}.zero = {error}")
        if body.freedom and body.freedom in moved:
            text = f"{body.name}.freedom = '{body.freedom}': a motor's name: give motor"
            yield Problem(("body", k, "freedom"), text)


def _motor_path(spec: RobotFile, name: str) -> tuple[str | int, ...]:
    """Return where a motor is first named."""
    every: list[tuple[str, int, Any]] = [("body", k, of) for k, of in enumerate(spec.body)]
    every += [("closure", k, of) for k, of in enumerate(spec.closure)]
    return next((top, k, "motor") for top, k, of in every if of.motor == name)


def _drive(motor: Any, actuator: str, path: tuple[str | int, ...]) -> Iterator[Problem]:
    turns, name = actuator == "revolute", motor.name
    if any(motor.eccentricity) and not turns:
        yield Problem((*path, "eccentricity"), f"{name}: eccentricity is for motors that turn")
    if motor.spool_buildup and turns:
        yield Problem((*path, "spool_buildup"), f"{name}: spool_buildup is for slides and legs")
    try:
        (not_degrees if turns else not_millimetres)(motor.limits or ())
    except ValueError as error:
        yield Problem((*path, "limits"), f"{name}: limits = {error}")


def _coordinates(spec: RobotFile) -> Iterator[Problem]:
    """Yield what is wrong with the choice of coordinates, and with where closing starts."""
    names = [name for name, _ in spec.coordinate_units]
    motors = [motor.name for motor in spec.motor]
    free = [name for name in freedoms(spec.body) if name not in motors]
    for k, name in enumerate(spec.coordinates):
        if name in motors:
            yield Problem(
                ("coordinates", k), f"coordinates: {name} is a motor; x are other freedoms"
            )
        elif name not in free:
            yield Problem(("coordinates", k), f"coordinates: {choose('freedom', name, free)}")
        elif name in names[:k]:
            yield Problem(("coordinates", k), f"coordinates: {name} is listed twice")
    if not 1 <= spec.n <= 3:
        own = ", ".join(names) or "none"
        text = f"coordinates: {own}: give 1 to 3 of {', '.join(free) or 'the freedoms'}"
        yield Problem(("coordinates",), f"{text}; the others follow from the closures")
    elif spec.m < spec.n:
        text = f"coordinates: {spec.n} ({', '.join(names)}), but {spec.m} motors"
        yield Problem(("coordinates",), f"{text}: give as many motors or more")
    known = [name for name in freedoms_in_order(spec) if name not in names]
    for name in spec.start:
        if name not in known:
            text = f"start: {choose('motor or freedom that follows', name, known)}"
            yield Problem(("start", name), text)


def _capacity(spec: RobotFile) -> Iterator[Problem]:
    """Yield what exceeds the core's arrays: which, and how much."""
    order, hidden = freedoms_in_order(spec), len(freedoms_in_order(spec)) - spec.m - spec.n
    unknown = hidden + max(spec.m, spec.n)
    of_joints = "a joint of several freedoms counts each"
    for key, count, what, most in (
        ("body", len([*singles(spec.body)]), f"slides and hinges ({of_joints})", _core.max_bodies),
        ("closure", len(equations(spec)), "equations (a hinge is one)", _core.max_closures),
        ("motor", spec.m, "motors", _core.max_motors),
        ("body", len(order), "freedoms", _core.max_freedoms),
        ("body", unknown, f"unknown freedoms ({hidden} that follow)", _core.max_unknowns),
    ):
        if count > most:
            yield Problem((key,), f"{key}: {count} {what}, at most {most}")


def _closures(spec: RobotFile) -> Iterator[Problem]:
    """Yield closures within a body, working modes of rods that have none, unfit sensors."""
    for k, of in enumerate(spec.closure):
        if of.anchor_body == of.base_body:
            text = f"closure {of.name}: both ends are on {of.base_body}: nothing moves one"
            yield Problem(("closure", k), text)
        if of.working_mode and not (of.length and motor_of(spec, of.base_body)):
            text = f"{of.name}.working_mode: is for a rod whose base one motor moves"
            yield Problem(("closure", k, "working_mode"), text)
    for k, sensor in enumerate(spec.sensor):
        for key, text in _sensor(spec, sensor):
            yield Problem(("sensor", k, key), f"sensor {sensor.name}: {text}")


def _sensor(spec: RobotFile, sensor: Any) -> Iterator[tuple[str, str]]:
    if other := _NO_KINDS.get(sensor.kind):
        yield "kind", f"{sensor.kind} is for chains: here {other}"
        return
    for key, usual in CHAIN_KEYS.items():
        if getattr(sensor, key, usual) != usual:
            yield key, f"{key} is for chains"
    if getattr(sensor, "closure", "") != "":
        yield from _on_rod(spec, sensor)
    free, moved = freedoms(spec.body), actuators(spec.body, spec.closure)
    if name := getattr(sensor, "freedom", None):
        turns = sensor.kind == "joint_angle"
        fit = [of for of, unit in free.items() if unit == ("rad" if turns else "m")]
        if name not in fit:
            yield "freedom", f"freedom: {choose('hinge' if turns else 'slide', name, fit)}"
    elif sensor.kind == "motor_encoder":
        fit = [of for of, actuator in moved.items() if actuator == "revolute"]
        if sensor.motor not in fit:
            yield "motor", f"motor: {choose('motor that turns', sensor.motor, fit)}"


def _on_rod(spec: RobotFile, sensor: Any) -> Iterator[tuple[str, str]]:
    """Yield what a sensor of a rod lacks: its closure, or axes of its joint."""
    rods = [of.name for of in spec.closure if of.length or of.motor]
    if sensor.closure not in rods:
        yield "closure", f"closure: {choose('rod or leg', sensor.closure, rods)}"
    elif hasattr(sensor, "zero"):
        axis = rod_axis(spec, sensor)
        if axis is None:
            yield "axis", "axis: is missing: the closure has no hinge there"
        if sensor.zero is None:
            yield "zero", "zero: is missing"
        elif axis and abs(sum(a * b for a, b in zip(axis, sensor.zero, strict=True))) > 1e-6:
            yield "zero", "zero: must be normal to axis"


def named_freedoms(spec: RobotFile) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield the freedoms that a file names, motors aside, and where."""
    place: dict[str, Body] = {
        single.freedom: single.body for single in singles(spec.body) if not single.body.motor
    }
    for name, body in place.items():
        key = "name" if body.joint in FREE or not body.freedom else "freedom"
        yield ("body", spec.body.index(body), key), name
