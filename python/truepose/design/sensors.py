"""Sensor selection: accuracy against price, and the best set for a budget."""

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from truepose.arguments import Array, finite, positive
from truepose.design.criterion import USUAL, Criterion
from truepose.design.linear import LinearErrors
from truepose.design.search import Search, Set
from truepose.design.selection import STEPS, SensorSelection, SensorSet, printed_errors
from truepose.design.where import AS_BUILT, Known, Use, practice
from truepose.exceptions import InputError, choose
from truepose.robot import Robot, angles, knowledge, label, require_robot, summed

#: Poses of a self-calibration in states that were not asked for.
OTHERWISE = 10


def select_sensors(
    robot: Robot,
    prices: Mapping[str, float] | None = None,
    *,
    budget: float | None = None,
    target: float | None = None,
    target_angle: float | None = None,
    must: Sequence[str] = (),
    survives: bool = False,
    use: Use = AS_BUILT,
    criterion: Criterion = USUAL,
) -> SensorSelection:
    """Choose sensors by accuracy and cost.

    The criterion is by default the position error that 95 % of all robots within the tolerances
    keep, by the bound of :func:`truepose.accuracy` at the robot's highest level. A further sensor
    never raises it, so all affordable candidates together bound the sets among them: branch and
    bound proves the best set without comparing most sets.

    Parameters
    ----------
    robot : Robot
        Its sensors in use have no effect.
    prices : mapping, optional
        Prices of the candidate sensors by name, and of one-time steps, `reference_pose` and
        `self_calibration`; by default the file's keys `price` and its `[prices]`.
    budget : float, optional
        Largest total price; finds the most accurate set.
    target : float, optional
        Requested position error, m; finds the cheapest set.
    target_angle : float, optional
        Requested angle error, rad, beside `target`; the set keeps both.
    must : sequence of str
        Sensors that every set contains, at their price.
    survives : bool
        Use the accuracy after the worst failure of one sensor.
    use : Use
        Where the accuracy counts, and what is done with the robot once before.
    criterion : Criterion
        Share of the robots that keep the error; over the poses, or at the worst one.

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
    """
    require_robot(robot)
    knowledge.require_uncertain(robot)
    named, once = _priced(robot, prices)
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
    angle = None if target is None or target_angle is None else target / target_angle
    over, known = use.over(robot), use.known(robot)
    state = _State(
        robot, named, once, must, survives, over, criterion, budget, target, angle, known
    )
    best, bound = state.best()
    if best is None and (budget or target):
        raise InputError(state.refusal())
    exact = state.search.look_round()
    return SensorSelection(
        robot=robot,
        prices=named,
        front=[state.choice(own) for own in state.search.front()],
        best=None if best is None else state.choice(best),
        bound=bound,
        compared=len(state.search.known),
        over=over,
        use=use,
        budget=budget,
        target=target,
        target_angle=target_angle,
        criterion=criterion,
        state=use.state + ", any one sensor failed" * survives,
        exact=exact,
        steps={} if best is None else dict(state.further()),
    )


@dataclass(frozen=True)
class _State:
    """A selection in one state of the robot."""

    robot: Robot
    prices: dict[str, float]
    steps: dict[str, float]  #: prices of STEPS
    must: Sequence[str]
    survives: bool
    over: Array  #: (T, n)
    by: Criterion
    budget: float | None
    target: float | None
    angle: float | None  #: error of the position, m, that an angle error of 1 rad equals
    known: Known  #: poses that brought the robot into its state

    @functools.cached_property
    def errors(self) -> LinearErrors:
        return LinearErrors(self.robot, list(self.prices), self.over, self.known, self.angle)

    @functools.cached_property
    def search(self) -> Search:
        must = map(list(self.prices).index, self.must)
        prices = [*self.prices.values()]
        return Search(
            lambda own: max(self.errors.each(self.by, own)), prices, tuple(must), self.survives
        )

    @property
    def once(self) -> float | None:
        """Price of the steps that brought the robot there; None where one has none."""
        done = {*itertools.compress(STEPS, map(len, self.known[:2]))}
        if not done <= self.steps.keys():
            return None
        return float(sum(self.steps[name] for name in done))

    def best(self) -> tuple[Set | None, float]:
        """Return the best set, if there is one, and its bound: of the error, m, or the price."""
        search = self.search
        if self.budget is not None:
            room = self.budget - (self.once or 0.0)
            if search.spent(search.must) <= room:
                best, squared = search.most_accurate(room)
                return best, squared**0.5
        elif self.target and search.cost(range(len(search.prices))) <= self.target**2:
            return search.cheapest(self.target**2)
        return None, np.nan

    def choice(self, own: Set) -> SensorSet:
        sensors = tuple(name for k, name in enumerate(self.prices) if k in own)
        squared = [self.errors.each(self.by, left) for left in self.search.left(own)]
        error, *angle = (np.max(squared, axis=0) ** 0.5).tolist()
        turn = angle[0] / self.angle if angle and self.angle else None
        return SensorSet(sensors, self.search.spent(own), error, turn, self.once)

    def further(self) -> Iterator[tuple[str, SensorSet]]:
        """Yield states after further steps, and the best set there; none where none reaches it."""
        spread = practice(self.robot, OTHERWISE)
        steps = {
            "visited": (f"self-calibrated on {len(spread)} poses", spread),
            "touched": ("referenced at home", self.robot.home[None]),
        }
        left = [key for key in steps if not len(getattr(self.known, key))]
        for keys in [*([key] for key in reversed(left)), *[left] * (len(left) > 1)]:
            done: dict[str, Any] = {key: steps[key][1] for key in keys}
            state = replace(self, known=self.known._replace(**done))
            best, _ = state.best()
            if best is not None:
                yield " and ".join(steps[key][0] for key in keys), state.choice(best)

    def refusal(self) -> str:
        """Return a message: what must be paid for, or what all candidates together reach."""
        once = self.once or 0.0
        if self.target is None:
            needed = self.search.spent(self.search.must)
            costs = [f"{', '.join(self.must)} cost {needed:g}"] * bool(needed)
            costs += [f"one-time steps cost {once:g}"] * bool(once)
            return f"budget {self.budget:g}: too small: {', '.join(costs)}"
        names, reached = list(self.prices), self.choice((*range(len(self.prices)),))
        together, verb = f"all {len(names)} sensors together", "reach"
        if len(names) == 1:
            together, verb = names[0], "reaches"
        together += ", after the worst failure of one," * self.survives
        angle = None if self.angle is None else self.target / self.angle
        wanted, least = (
            printed_errors(self.robot, *sizes)
            for sizes in ((self.target, angle), (reached.error, reached.angle))
        )
        said = f"target {wanted}: {together} {verb} {least}"
        if angle is not None and reached.angle is not None:
            missed = reached.error > self.target, reached.angle > angle
            said += (
                f", limited by {' and '.join(itertools.compress(('position', 'angle'), missed))}"
            )
        # Those with an unknown price last.
        steps = [(one.total is None, one.total or one.price, k, one) for k, one in self.further()]
        if not steps:
            return f"{said}; truepose error-budget shows what limits it"
        *_, name, best = min(steps, key=lambda step: step[:2])
        own = f"{label(self.robot, best.sensors)} ({best.price:g})"
        if best.total is None or best.once is None:
            return f"{said}; cheapest step: {name} (no price given), with {own}"
        step = best.once - once
        return f"{said}; cheapest step: {name}: {step:g}; with {own} {best.total:g} together"


def _priced(
    robot: Robot, prices: Mapping[str, float] | None
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the prices of candidate sensors and of STEPS: those given, or all of the file."""
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
    if every.keys().isdisjoint(given):
        raise InputError(
            f"{robot.name}: no sensor to choose: none in its file, or none has a price"
        )
    sensors, once = ({k: float(given[k]) for k in x if k in given} for x in (every, STEPS))
    return sensors, steps | once
