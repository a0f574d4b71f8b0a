"""Checks that the parts of a robot file of the right form fit together."""

import fnmatch
import re
from collections.abc import Iterator

from truepose import _core
from truepose.exceptions import choose
from truepose.robotfile import mechanism_checks
from truepose.robotfile.base import NO_READING, Problem, not_degrees, not_millimetres
from truepose.robotfile.mechanism import freedoms
from truepose.robotfile.schema import RobotFile
from truepose.robotfile.to_core import units_in

#: Names reserved for logs and parameters.
_TAKEN = re.compile(
    r"(q|chain|bar|axis|motor_error|torque)\d+|(measured|desired|true|estimated)_.*"
    r"|time|pose|compliance|load_[xyz]|.*_tension|counted|near_singular|no_answer"
)

#: Kinds of sensors that only mechanisms of bodies and closures have.
_OF_MECHANISMS = ("joint_angle", "slide_position")
#: Mobilities that some kinds of sensors need.
_NEEDS = {"axis_angle": ("rotational",), "platform_angle": ("planar", "schoenflies")}


def taken(name: str) -> bool:
    """Return whether logs and parameters reserve a name; no sensor or axis can have it."""
    return _TAKEN.fullmatch(name) is not None


def misfits(spec: RobotFile) -> Iterator[Problem]:
    """Yield sizes and references that do not fit the other parts: there is no such mechanism."""
    if spec.mobility == "mechanism":
        wrong = [*mechanism_checks.misfits(spec)]
        yield from wrong or _poses(spec)
        return
    yield from _sizes(spec)
    yield from _references(spec)


def misnamed(spec: RobotFile, fits: bool) -> Iterator[Problem]:
    """Yield names that are unknown, reserved or used twice; if all parts fit, of parameters too."""
    yield from _names(spec)
    if fits:
        yield from _parameters(spec)


def _sizes(spec: RobotFile) -> Iterator[Problem]:
    """Yield another number of parts or coordinates than fits."""
    for key in spec.stated("body", "closure", "motor", "coordinates", "start"):
        text = "a file has either mobility and [[chain]], or [[body]] and [[closure]]"
        yield Problem((key,), f"{key}: is for mechanisms: {text}")
    n, rotational = spec.n, spec.mobility == "rotational"
    if rotational and not 1 <= n <= _core.max_axes:
        text = f"a rotational platform has 1 to {_core.max_axes}, a table [[passive_axis]] each"
        yield Problem(("passive_axis",), f"{n} passive axes: {text}")
        return
    if rotational and spec.bar:
        yield Problem(("bar",), "bar: a rotational platform has no lateral bars")
    if spec.passive_axis and not rotational:
        text = f"passive_axis: needs mobility rotational, not {spec.mobility}"
        yield Problem(("passive_axis",), text)
    if not n <= (count := len(spec.chain)) <= (most := _core.max_motors):
        wanted, why = str(n), f"{n - count} of the platform's freedoms would be unconstrained"
        if count > n:
            wanted = f"{n} to {most}"
            why = f"up to {most} motors drive a platform; describe each further leg or cable as a "
            why += "sensor of kind 'distance'"
        has = (
            f"a platform on {n} passive axes" if rotational else f"{spec.mobility} has {n} freedoms"
        )
        yield Problem(("mobility",), f"{has}: give {wanted} chains, not {count}; {why}")
    if len(spec.bar) > _core.max_bars:
        text = f"{len(spec.bar)} bars: a platform has at most {_core.max_bars} here"
        yield Problem(("bar", _core.max_bars), text)
    yield from _poses(spec)


def _poses(spec: RobotFile) -> Iterator[Problem]:
    """Yield another number of coordinates than fits, degrees for rad and mm for m."""
    n = spec.n
    poses: dict[tuple[str, ...], tuple[float, ...]] = {("home",): spec.home}
    for name in ("workspace", "fkm_region"):
        if box := getattr(spec, name):
            poses |= {(name, "minimum"): box.minimum, (name, "maximum"): box.maximum}
    for path, pose in poses.items():
        where = ".".join(path)
        if len(pose) != n:
            yield Problem(path, f"{where} needs {n} coordinates, has {len(pose)}")
            continue
        parts = {
            of: [v for v, (_, unit) in zip(pose, spec.coordinate_units, strict=True) if unit == of]
            for of in ("m", "rad")
        }
        try:
            not_degrees(parts["rad"], f"{where}: the platform's angle = ")
            not_millimetres(parts["m"], f"{where}: ")
        except ValueError as error:
            yield Problem(path, str(error))


def _references(spec: RobotFile) -> Iterator[Problem]:
    """Yield what chains and sensors need and the file has not: a mobility, or parts."""
    counts = {
        "chain": (len(spec.chain), "of {} chains"),
        "axis": (len(spec.passive_axis), "but the file has {} axes"),
        "bar": (len(spec.bar), "but the file has {} bars"),
    }
    for path, part in spec.parts("chain", "sensor"):
        kind = getattr(part, "kind", "")
        what = f"sensor {part.name}" if kind else f"chain {path[1] + 1}"
        if kind in _OF_MECHANISMS:
            text = f"{what}: {kind} is for mechanisms of [[body]] and [[closure]]"
            yield Problem((*path, "kind"), text)
            continue
        for key in part.stated("body", "motor", "closure", "axis", "zero") if kind else ():
            yield Problem((*path, key), f"{what}: {key} is for mechanisms of [[body]]")
        if kind and _core.sensor_kinds[kind].of_chain and part.chain is None:
            yield Problem((*path, "chain"), f"{what}: chain: is missing")
        if (needed := _NEEDS.get(kind)) and spec.mobility not in needed:
            text = f"{what}: {kind} needs mobility {' or '.join(needed)}, not {spec.mobility}"
            yield Problem((*path, "kind"), text)
            continue
        for key, (count, of) in counts.items():
            value = getattr(part, key, None)
            if isinstance(value, int) and value > count:
                yield Problem((*path, key), f"{what}: {key} = {value}, {of.format(count)}")


def _names(spec: RobotFile) -> Iterator[Problem]:
    """Yield names that are used twice or reserved, and unknown sensors in use."""
    for key, what, several in (("passive_axis", "axis", "axes"), ("sensor", "sensor", "sensors")):
        names: list[str] = []
        for at, part in spec.parts(key):
            path, name = (*at, "name"), part.name
            if name in names:
                yield Problem(path, f"two {several} have the same name: {name}")
            names.append(name)
            if taken(name) or (what == "axis" and name == "step"):
                text = f"{what} {name}: logs and parameters use this name for something else"
                yield Problem(path, text)
    motors = [motor.name for motor in spec.motor]
    for name in freedoms(spec.body):
        if name not in motors and (taken(name) or name == "step"):
            text = f"freedom {name}: logs and parameters use this name for something else"
            yield Problem(("body",), text)
    known = [sensor.name for sensor in spec.sensor]
    for number, name in enumerate(spec.sensors):
        if name not in known:
            yield Problem(("sensors", number), choose("sensor", name, known))
    if len(set(spec.sensors)) < len(spec.sensors):
        yield Problem(("sensors",), f"a sensor is used twice: {', '.join(spec.sensors)}")


def _parameters(spec: RobotFile) -> Iterator[Problem]:
    """Yield names and values that no parameter has in three tables of a file."""
    known, learnt = units_in(spec), spec.calibration
    values: list[tuple[tuple[str | int, ...], str, str, float]]
    values = [(("parameters", n), f"parameters.{n}", n, v) for n, v in spec.parameters.items()]
    for glob in spec.tolerances:
        if not fnmatch.filter(known, glob):
            yield Problem(("tolerances", glob), f"tolerances: {choose('parameter', glob, known)}")
    for name in spec.parameters:
        if name not in known:
            yield Problem(("parameters", name), f"parameters: {choose('parameter', name, known)}")
    for k, name in enumerate(learnt.parameters if learnt else ()):
        path, where = ("calibration", "parameters", k), "calibration.parameters"
        if name not in known:
            yield Problem(path, f"{where}: {choose('parameter', name, known)}")
        elif learnt and name in learnt.parameters[:k]:
            yield Problem(path, f"{where}: {name}: a parameter is listed twice")
        if learnt:
            what = f"calibration.mean of {name}"
            values.append((("calibration", "mean", k), what, name, learnt.mean[k]))
    for at, what, name, value in values:
        if wrong := wrong_value(name, value):
            yield Problem(at, f"{what} = {value}: {wrong}")


def wrong_value(name: str, value: float) -> str | None:
    """Return what is wrong with a parameter's value, if anything."""
    if name.endswith((".arm", ".rod", ".length", ".pivot", ".rod_spacing")) and value <= 0:
        return "must be greater than 0 (m)"
    if name.endswith(".gain") and value == 0:
        return NO_READING
    if ".eccentricity." in name and abs(value) >= 0.1:
        return "must be between -0.1 and 0.1 (rad)"
    return None
