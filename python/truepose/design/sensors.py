"""Sensor selection: accuracy against price, and the best set for a budget."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array, finite, positive, require
from truepose.calibration.bound import reference_sigmas, state_of
from truepose.design.candidates import given_poses
from truepose.design.criterion import SIGMA, Criterion, Measure
from truepose.design.machining import Curve, Level, levels_of
from truepose.design.relaxation import Relaxation
from truepose.design.search import Search, Set
from truepose.design.selection import (
    STEPS,
    Alone,
    SensorSelection,
    SensorSet,
    described,
    printed_errors,
)
from truepose.design.where import asked_poses, practice
from truepose.design.worth import Worth
from truepose.exceptions import InputError, choose
from truepose.robot import knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import angles, summed

#: Poses of a self-calibration in states that were not asked for.
OTHERWISE = 10
#: Whether self-calibrated, and whether referenced.
_STATES = tuple(itertools.product((False, True), repeat=2))


def select_sensors(
    robot: Robot,
    prices: Mapping[str, float] | None = None,
    *,
    price_steps: Mapping[str, Curve] | None = None,
    budget: float | None = None,
    target: float | None = None,
    target_angle: float | None = None,
    confidence: float | None = 0.95,
    measure: Measure = "rms",
    must: Sequence[str] = (),
    calibrated_on: ArrayLike | None = None,
    reference_pose: ArrayLike | None = None,
    reference_sigma: ArrayLike | float = 0.0,
    poses: ArrayLike | None = None,
    survives: bool = False,
) -> SensorSelection:
    """Choose sensors and tolerances by accuracy and cost.

    The criterion is the position error that a share of all robots within the tolerances keeps, by
    the bound of :func:`truepose.accuracy` at the robot's highest level. A further sensor never
    raises it, so all affordable candidates together bound the sets among them: branch
    and bound proves the best set without comparing most sets. With too many candidates a convex
    relaxation bounds the possible improvement.

    Parameters
    ----------
    robot : Robot
        Its sensors in use have no effect.
    prices : mapping, optional
        Prices of the candidate sensors by name, and of one-time steps, `reference_pose` and
        `self_calibration`; by default the file's keys `price` and its `[prices]`.
    price_steps : mapping, optional
        Machining tolerances by names of parameters or globs: σ (m or rad, about the expected value)
        and its price for the group; by default the file's keys `price_steps`.
    budget : float, optional
        Largest total price; finds the most accurate set.
    target : float, optional
        Requested position error, m; finds the cheapest set.
    target_angle : float, optional
        Requested angle error, rad, beside `target`; the set keeps both.
    confidence : float, optional
        Share of the robots that keep the error; None: σ, the rms of all robots.
    measure : {"rms", "worst", "AP", "RP"}
        Over the poses; at the worst pose; there the pose accuracy or repeatability of ISO 9283.
    must : sequence of str
        Sensors that every set contains, at their price.
    calibrated_on, reference_pose, reference_sigma
        As for :func:`truepose.accuracy`.
    poses : array_like, shape (T, c), optional
        Poses where the accuracy counts; by default 32 over the workspace.
    survives : bool
        Use the accuracy after the worst failure of one sensor.

    Returns
    -------
    SensorSelection

    Raises
    ------
    InputError
        A candidate has no price; the budget is below the price of `must` and one-time steps; all
        candidates together do not reach the target.

    Examples
    --------
    >>> import truepose as tp
    >>> prices = {"theta": 90, "z_telemeter": 400, "wire1": 250, "wire2": 250, "wire3": 250}
    >>> found = tp.select_sensors(tp.load("h4"), prices, budget=600)
    >>> found.best.sensors, found.proven
    (('theta', 'wire1', 'wire2'), True)
    >>> machining = {"chain*.rod": {1e-3: 300, 1e-4: 700}, "chain*.encoder_offset": {2e-4: 80}}
    >>> found = tp.select_sensors(tp.load("h4"), prices, price_steps=machining, budget=600)
    >>> found.best.sensors, found.best.machined
    (('wire1',), (('chain*.rod', 0.001),))
    """
    require(robot, Robot, "robot", "truepose.load(name)")
    knowledge.require_uncertain(robot)
    ladders = levels_of(robot, price_steps)
    named, once = _priced(robot, prices, bool(ladders) or target is not None)
    names = list(named)
    if unknown := [name for name in must if name not in named]:
        if unknown[0] in [sensor.name for sensor in robot.spec.sensor]:
            raise InputError(f"must: sensor {unknown[0]} has no price (--price, prices)")
        raise InputError(f"must: {choose('sensor', unknown[0], names)}")
    if budget is not None and target is not None:
        raise InputError("budget and target: give one of them")
    if target_angle is not None and target is None:
        raise InputError("target_angle: needs a target of the position too")
    for what, value in (("budget", budget), ("target", target), ("target_angle", target_angle)):
        if value is not None:
            positive(what, value)
    if target_angle is not None and (angles(robot).all() or not angles(robot).any()):
        unit = summed(robot).unit
        raise InputError(f"target_angle: {robot.name}'s coordinates are all in {unit}")
    asked = _Asked(
        robot, named, once, ladders, must, survives, asked_poses(robot, poses),
        Criterion(measure, confidence), reference_sigmas(robot, reference_sigma), budget, target,
        target / target_angle if target is not None and target_angle is not None else None,
    )  # fmt: skip
    visited = given_poses(robot, calibrated_on, "calibrated_on")
    touched = given_poses(robot, reference_pose, "reference_pose", one=True)
    state = asked.state(visited, touched)
    search, best, bound = state.search, None, np.nan
    if budget is not None:
        _fits(state, budget)
        best, squared = search.most_accurate(budget - (state.once or 0.0))
        bound = squared**0.5
    elif target is not None:
        if search.cost(range(len(search.prices))) > target**2:
            raise InputError(_unreached(state, visited, touched))
        best, bound = search.cheapest(target**2)
    exact = search.look_round()

    def alone(k: int) -> Alone:
        own = [j for j in search.with_one([], k) if j not in search.must or j == k]
        sets = search.with_one(search.must, k), search.without_one(range(len(asked.every)), k)
        error, without = (search.cost(of) ** 0.5 for of in sets)
        return Alone(*asked.every[k], search.spent(own), error, without)

    return SensorSelection(
        robot=robot,
        prices=named,
        front=[state.choice(own) for own in search.front()],
        best=None if best is None else state.choice(best),
        bound=bound,
        compared=len(search.known),
        over=asked.over,
        budget=budget,
        target=target,
        target_angle=target_angle,
        criterion=asked.by,
        state=state_of(calibrated_on, reference_pose, survives),
        levels=ladders,
        alone=[alone(k) for k in range(len(asked.every))],
        exact=exact,
        steps={} if best is None else dict(asked.further(visited, touched)),
    )


@dataclass(frozen=True)
class _Asked:
    """A selection's question, for any state of the robot."""

    robot: Robot
    prices: dict[str, float]
    once: dict[str, float]  #: prices of STEPS
    ladders: list[list[Level]]
    must: Sequence[str]
    survives: bool
    over: Array  #: (T, c)
    by: Criterion
    reference_sigma: Sequence[float]
    budget: float | None
    target: float | None
    angle: float | None  #: error of the position, m, that an angle error of 1 rad equals

    @property
    def levels(self) -> list[Level]:
        return [level for own in self.ladders for level in own]

    @property
    def every(self) -> list[tuple[str, float | None]]:
        """Every candidate: a sensor, or parameters and their σ."""
        return [(name, None) for name in self.prices] + [(x.group, x.sigma) for x in self.levels]

    def state(self, visited: Array, touched: Array) -> _State:
        names, finer = list(self.prices), [level.information for level in self.levels]
        sigma = self.reference_sigma
        worth = Worth(self.robot, names, self.over, visited, touched, sigma, finer, self.angle)
        needed = [names.index(name) for name in self.must]
        prices = [*self.prices.values()]
        search = searched(worth, prices, self.ladders, needed, self.survives, self.by)
        done = [name for name, x in zip(STEPS, (visited, touched), strict=True) if len(x)]
        missing = not self.once.keys() >= set(done)
        once = None if missing else float(sum(self.once[name] for name in done))
        return _State(self, worth, search, once)

    def further(self, visited: Array, touched: Array) -> Iterator[tuple[str, SensorSet]]:
        """Yield states after further steps, and the best set there; none where none reaches it."""
        for calibrated, referenced in _STATES:
            done = (calibrated and len(visited)) or (referenced and len(touched))
            if done or not (calibrated or referenced):
                continue
            poses = practice(self.robot, OTHERWISE) if calibrated else visited
            state = self.state(poses, self.robot.home[None] if referenced else touched)
            said = [f"self-calibrated on {len(poses)} poses"] * calibrated
            said += ["referenced at home"] * referenced
            search, squared = state.search, (self.target or 0.0) ** 2
            room = np.inf if self.budget is None else self.budget - (state.once or 0.0)
            if search.spent(search.must) > room:
                continue
            if self.budget is not None:
                best, _ = search.most_accurate(room)
            elif search.cost(range(len(search.prices))) <= squared:
                best, _ = search.cheapest(squared)
            else:
                continue
            yield " and ".join(said), state.choice(best)


@dataclass(frozen=True)
class _State:
    """The sets in one state of the robot."""

    asked: _Asked
    worth: Worth
    search: Search
    once: float | None  #: price of the steps that brought the robot there; None where one has none

    def choice(self, own: Set) -> SensorSet:
        asked = self.asked
        sensors = tuple(name for k, name in enumerate(asked.prices) if k in own)
        levels = enumerate(asked.levels, len(asked.prices))
        machined = tuple({x.group: x.sigma for k, x in levels if k in own}.items())
        squared = [self.worth.each(left, asked.by) for left in self.search.left(own)]
        error, *angle = (np.max(squared, axis=0) ** 0.5).tolist()
        turn = angle[0] / asked.angle if angle and asked.angle else None
        return SensorSet(sensors, self.search.spent(own), error, machined, turn, self.once)


def in_other_states(
    found: SensorSelection, calibrated_on: Array, reference_pose: Array
) -> dict[str, Array]:
    """Return the front's errors (m) as built, referenced at a pose, self-calibrated, and both."""
    asked = _Asked(
        found.robot, found.prices, {}, found.levels, (), False, found.over, found.criterion,
        reference_sigmas(found.robot, 0.0), None, None, found.angle,
    )  # fmt: skip
    sets = []
    for choice in found.front:
        least = dict(choice.machined)
        fits = [
            name in choice.sensors if sigma is None else sigma >= least.get(name, np.inf)
            for name, sigma in asked.every
        ]
        sets.append(tuple(np.flatnonzero(fits).tolist()))
    result = {}
    names = ("as built", "referenced", "self-calibrated", "both")
    for name, (calibrated, referenced) in zip(names, _STATES, strict=True):
        state = asked.state(calibrated_on[: calibrated * len(calibrated_on)],
                            reference_pose[None][:referenced])  # fmt: skip
        result[name] = np.sqrt([state.search.cost(own) for own in sets])
    return result


def searched(
    worth: Worth,
    prices: Sequence[float],
    ladders: Sequence[Sequence[Level]] = (),
    must: Sequence[int] = (),
    survives: bool = False,
    by: Criterion = SIGMA,
) -> Search:
    """Return the search over sensors 0, 1, …, followed by the levels of tolerances."""
    whole, numbered = list(prices), []
    for own in ladders:
        numbered.append(range(len(whole), len(whole) + len(own)))
        whole += [level.price for level in own]
    fail = range(len(prices)) if survives else ()
    relaxation = Relaxation(worth.relaxed, whole, must, numbered, fail) if by.convex else None
    cost = functools.partial(worth.squared, by=by)
    return Search(cost, whole, tuple(must), survives, numbered, relaxation)


def _fits(state: _State, budget: float) -> None:
    """Raise InputError where a budget is too small for one-time steps and `must`."""
    once, needed = state.once or 0.0, state.search.spent(state.search.must)
    if needed + once > budget:
        costs = [f"{', '.join(state.asked.must)} cost {needed:g}"] * bool(needed)
        costs += [f"one-time steps cost {once:g}"] * bool(once)
        raise InputError(f"budget {budget:g}: too small: {', '.join(costs)}")


def _unreached(state: _State, visited: Array, touched: Array) -> str:
    """Return a message: what all candidates together reach, and the cheapest step that helps."""
    asked, names = state.asked, state.asked.prices
    together = f"all {len(names)} sensors together" if len(names) > 1 else "".join(names)
    together, verb = together or "motors alone", "reaches" if len(names) == 1 else "reach"
    added = ["all parts machined to the smallest σ"] * bool(asked.levels)
    added += ["after the worst failure of one"] * bool(names and asked.survives)
    together += f", {', '.join(added)}," if added else ""
    target, every = asked.target or 0.0, tuple(range(len(asked.every)))
    angle = None if asked.angle is None else target / asked.angle
    wanted, reached = printed_errors(asked.robot, target, angle), state.choice(every)
    least = printed_errors(asked.robot, reached.error, reached.angle)
    said = [f"target {wanted}: {together} {verb} {least}"]
    if angle is not None and reached.angle is not None:
        missed = reached.error > target, reached.angle > angle
        limits = itertools.compress(("position", "angle"), missed)
        said[0] += f", limited by {' and '.join(limits)}"
    further = asked.further(visited, touched)  # those with an unknown price last
    steps = sorted(further, key=lambda x: (x[1].once is None, x[1].price + (x[1].once or 0.0)))
    if not steps:
        said.append("truepose error-budget without --target shows what limits it")
        said += ["no tolerance has a price (--price-steps)"] * (not asked.levels)
    for name, best in steps[:1]:
        own = f"{described(asked.robot, best)} ({best.price:g})"
        if best.once is None:
            said.append(f"cheapest step: {name} (no price given), with {own}")
        else:
            step = best.once - (state.once or 0.0)
            said.append(f"cheapest step: {name}: {step:g}; with {own} {best.total:g} together")
    return "; ".join(said)


def _priced(
    robot: Robot, prices: Mapping[str, float] | None, otherwise: bool = False
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the prices of candidate sensors and of STEPS: those given, or all of the file.

    Raise InputError where it has no sensor, unless there are levels or a target `otherwise`.
    """
    every = {sensor.name: sensor.price for sensor in robot.spec.sensor}
    steps = robot.spec.prices.model_dump(exclude_none=True) if robot.spec.prices else {}
    given = every | steps if prices is None else {**prices}
    for name, price in given.items():
        if name not in every and name not in STEPS:
            raise InputError(f"prices: {choose('sensor', name, [*every, *STEPS])}")
        if price is None:
            raise InputError(
                f"{robot.name}: sensor {name}: has no price (the file's key price, --price, prices)"
            )
        finite(f"prices: {name}", price, 0)
    if every.keys().isdisjoint(given) and not otherwise:
        none = "no sensor in its file" if prices is None else "neither sensors nor levels to choose"
        raise InputError(f"{robot.name}: {none}")
    sensors, once = ({k: float(given[k]) for k in x if k in given} for x in (every, STEPS))
    return sensors, steps | once
