"""Explanations of why given bodies and closures form no mechanism at home."""

from truepose import _core
from truepose.robotfile.mechanism import freedoms
from truepose.robotfile.mechanism_to_core import equations, freedoms_in_order
from truepose.robotfile.schema import RobotFile


def of_mechanism(robot: _core.Robot, spec: RobotFile) -> str | None:
    """Return in one line what is wrong with a mechanism, with the key; None: nothing."""
    flaw, part, amount, gaps = robot.check_mechanism()
    kind, every, names = _core.Flaw(flaw), equations(spec), freedoms_in_order(spec)
    if kind == _core.Flaw.idle:
        return f"motor {names[part]} moves nothing: no closure depends on it"
    if kind == _core.Flaw.loose:
        free, count = names[part], len(names) - spec.m
        return (
            f"closure: {len(every)} equations hold {count - int(amount)} of the {count} freedoms "
            f"without a motor: {free} moves while the motors stand still"
        )
    if kind == _core.Flaw.open:
        open_ = [f"{_named(every, k)} {_gap(every[k].kind, gap)}" for k, gap in enumerate(gaps)]
        return (
            f"home = {list(spec.home)}: the closures stay open; start = {{ … }} or home? "
            + ", ".join(open_)
        )
    told = _named(every, part)
    if kind == _core.Flaw.no_length:
        return f"{told}: must be greater than 0 (m)"
    if kind == _core.Flaw.unmoved:
        of = every[part].of
        return f"closure {told}: nothing moves {of.anchor_body} against {of.base_body} along it"
    if kind == _core.Flaw.dependent:
        return (
            f"closure {told}: follows from the other closures at home: {int(amount)} of "
            f"{len(every)} equations is dependent; remove it, or describe the joint it replaces"
        )
    return None


def _named(every: list, part: int) -> str:
    """Name an equation by its closure, and by its key where the closure has several."""
    described, of, kind = every[part]
    several = sum(other.described == described for other in every) > 1
    return f"{of.name}.{kind}" if several and kind.endswith("hinge") else of.name


def _gap(kind: str, gap: float) -> str:
    text = f"{1e3 * abs(gap):.3g} mm"
    if abs(gap) < 1e-9:
        return "0 mm"
    if kind.endswith("hinge"):
        return f"{text} off its plane"
    return text + (" too short" if gap > 0 else " too long")


def at_home(robot: _core.Robot, spec: RobotFile, status: int, part: int) -> str:
    """Explain in one line why a closed mechanism does not work at home (status, part)."""
    words = f"home = {list(spec.home)}: "
    if 0 <= part < len(every := equations(spec)):
        of = every[part].of
        if of.working_mode and status != _core.singular:
            other = f"working_mode = {-of.working_mode}, or another start"
            return f"{of.name}.working_mode: closes in mode {-of.working_mode} at home: {other}"
        return f"{words}{_core.describe(status)}, {of.name}"
    if status == _core.singular:
        hidden = [name for name in freedoms(spec.body) if not name.startswith("q")]
        return f"{words}its motors do not determine {', '.join(hidden)}"
    return words + _core.describe(status)


def part(spec: RobotFile, status: int, k: int) -> str:
    """Name the part in an outcome: a motor at its limit, else a closure."""
    if status == _core.joint_limit:
        return spec.motor[k].name
    every = equations(spec)
    return _named(every, k) if k < len(every) else spec.motor[min(k, spec.m - 1)].name
