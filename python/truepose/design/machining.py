"""Machining tolerances as priced candidates of a design."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from typing import NamedTuple

from truepose.arguments import finite, positive
from truepose.exceptions import InputError, choose
from truepose.robot.robot import Robot
from truepose.robot.units import unit_of
from truepose.show.units import printed

#: Levels by their σ, m or rad, and the price of each.
Curve = Mapping[float, float]


class Level(NamedTuple):
    """A tolerance to which a group of parameters can be machined."""

    group: str  #: name or glob of the parameters
    sigma: float  #: m or rad
    price: float  #: above that of the level before
    information: dict[str, float]  #: added to each parameter's 1/σ²


def levels_of(robot: Robot, price_steps: Mapping[str, Curve] | None) -> list[list[Level]]:
    """Return the levels of each group, coarsest first; by default those of the file.

    Drops a level that costs no less than a finer one. Parameters with a smaller σ keep it.
    """
    if price_steps is None:
        price_steps = {
            group: {level.sigma: level.price for level in tolerance.price_steps}
            for group, tolerance in robot.spec.tolerances.items()
            if tolerance.price_steps
        }
    taken: dict[str, str] = {}
    found: list[list[Level]] = []
    for group, curve in price_steps.items():
        names = _uncertain(robot, group)
        if twice := [name for name in names if name in taken]:
            raise InputError(f"price_steps: {twice[0]}: in {taken[twice[0]]} and in {group}")
        taken |= dict.fromkeys(names, group)
        found.append(_levels(robot, group, names, curve))
    return found


def _uncertain(robot: Robot, group: str) -> list[str]:
    """Return the uncertain parameters of a group, all of one unit."""
    every = [name for name in robot.parameters if fnmatch.fnmatchcase(name, group)]
    own = robot.spec.tolerances.get(group)
    if own is not None:  # a file's entry: those to which it applies
        every = [name for name in every if robot.spec.tolerance(name) is own]
    if not every:
        raise InputError(f"price_steps: {choose('parameter', group, robot.parameters)}, or a glob")
    learnt = robot.spec.calibration
    if learnt is not None and not set(every).isdisjoint(learnt.parameters):
        raise InputError(f"price_steps: {group}: calibrated: the parts are machined already")
    uncertain = [name for name in every if robot.parameters[name].sigma > 0]
    if not uncertain:
        raise InputError(f"price_steps: {group}: is known exactly: its tolerance is 0")
    if len(units := {unit_of(robot, name) or "1" for name in uncertain}) > 1:
        raise InputError(
            f"price_steps: {group}: must be of one unit, is of {', '.join(sorted(units))}"
        )
    return uncertain


def _levels(robot: Robot, group: str, names: list[str], curve: Curve) -> list[Level]:
    if not curve:
        raise InputError(f"price_steps: {group}: no level")
    for sigma, price in curve.items():
        positive(f"price_steps: {group}: σ", sigma, " (m or rad)")
        finite(f"price_steps: {group}: price of {sigma:g}", price, 0)
    left = {name: robot.parameters[name].sigma for name in names}
    least, most = min(curve), max(left.values())
    if least >= most:
        unit = unit_of(robot, names[0])
        finest, own = (printed(sigma, unit, ".4g") for sigma in (least, most))
        raise InputError(f"price_steps: {group}: {finest}: must be less than its σ, {own}")
    found: list[Level] = []
    paid = 0.0
    for sigma, price in sorted(curve.items(), reverse=True):
        added = {n: 1 / sigma**2 - 1 / old**2 for n, old in left.items() if sigma < old}
        if added and all(other > price for finer, other in curve.items() if finer < sigma):
            left |= dict.fromkeys(added, sigma)
            found.append(Level(group, float(sigma), float(price - paid), added))
            paid = price
    return found
