"""Sensor selection: accuracy against price, and the best set for a budget."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arguments import Array, finite, positive, require
from truepose.design.criterion import USUAL, Criterion
from truepose.design.search import Search, Set
from truepose.design.selection import STEPS, SensorSelection, SensorSet, printed_errors
from truepose.design.where import AS_BUILT, Known, Use, practice
from truepose.design.worth import Worth
from truepose.exceptions import InputError, choose
from truepose.robot import knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import angles, label, summed

#: Poses of a self-calibration in states that were not asked for.
OTHERWISE = 10
#: Whether self-calibrated, and whether referenced.
_STATES = tuple(itertools.product((False, True), repeat=2))


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
    require(robot, Robot, "robot", "truepose.load(name)")
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
    over = use.over(robot)
    asked = _Asked(robot, named, once, must, survives, over, criterion, budget, target, angle)
    known = use.known(robot)
    state = asked.state(known)
    best, bound = state.best()
    if best is None and budget is not None:
        raise InputError(_too_small(state, budget))
    if best is None and target is not None:
        raise InputError(_unreached(state, known, target))
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
        steps={} if best is None else dict(asked.further(known)),
    )


@dataclass(frozen=True)
class _Asked:
    """A selection's question, for any state of the robot."""

    robot: Robot
    prices: dict[str, float]
    once: dict[str, float]  #: prices of STEPS
    must: Sequence[str]
    survives: bool
    over: Array  #: (T, c)
    by: Criterion
    budget: float | None
    target: float | None
    angle: float | None  #: error of the position, m, that an angle error of 1 rad equals

    def state(self, known: Known) -> _State:
        names = list(self.prices)
        worth = Worth(self.robot, names, self.over, known, self.angle)
        needed = tuple(names.index(name) for name in self.must)
        cost = functools.partial(worth.squared, by=self.by)
        search = Search(cost, [*self.prices.values()], needed, self.survives)
        done = list(itertools.compress(STEPS, (len(known.visited), len(known.touched))))
        missing = not self.once.keys() >= set(done)
        once = None if missing else float(sum(self.once[name] for name in done))
        return _State(self, worth, search, once)

    def further(self, known: Known) -> Iterator[tuple[str, SensorSet]]:
        """Yield states after further steps, and the best set there; none where none reaches it."""
        for calibrated, referenced in _STATES:
            done = (calibrated and len(known.visited)) or (referenced and len(known.touched))
            if done or not (calibrated or referenced):
                continue
            more, said = known, []
            if calibrated:
                more = more._replace(visited=practice(self.robot, OTHERWISE))
                said.append(f"self-calibrated on {len(more.visited)} poses")
            if referenced:
                more = more._replace(touched=self.robot.home[None])
                said.append("referenced at home")
            state = self.state(more)
            best, _ = state.best()
            if best is not None:
                yield " and ".join(said), state.choice(best)


@dataclass(frozen=True)
class _State:
    """The sets in one state of the robot."""

    asked: _Asked
    worth: Worth
    search: Search
    once: float | None  #: price of the steps that brought the robot there; None where one has none

    def best(self) -> tuple[Set | None, float]:
        """Return the best set, if there is one, and its bound: of the error, m, or the price."""
        asked, search = self.asked, self.search
        if asked.budget is not None:
            room = asked.budget - (self.once or 0.0)
            if search.spent(search.must) <= room:
                best, squared = search.most_accurate(room)
                return best, squared**0.5
        elif asked.target and search.cost(range(len(search.prices))) <= asked.target**2:
            return search.cheapest(asked.target**2)
        return None, np.nan

    def choice(self, own: Set) -> SensorSet:
        asked = self.asked
        sensors = tuple(name for k, name in enumerate(asked.prices) if k in own)
        squared = [self.worth.each(left, asked.by) for left in self.search.left(own)]
        error, *angle = (np.max(squared, axis=0) ** 0.5).tolist()
        turn = angle[0] / asked.angle if angle and asked.angle else None
        return SensorSet(sensors, self.search.spent(own), error, turn, self.once)


def _too_small(state: _State, budget: float) -> str:
    """Return a message: what one-time steps and `must` cost."""
    once, needed = state.once or 0.0, state.search.spent(state.search.must)
    costs = [f"{', '.join(state.asked.must)} cost {needed:g}"] * bool(needed)
    costs += [f"one-time steps cost {once:g}"] * bool(once)
    return f"budget {budget:g}: too small: {', '.join(costs)}"


def _unreached(state: _State, known: Known, target: float) -> str:
    """Return a message: what all candidates together reach, and the cheapest step that helps."""
    asked, names = state.asked, list(state.asked.prices)
    together, verb = f"all {len(names)} sensors together", "reach"
    if len(names) == 1:
        together, verb = names[0], "reaches"
    together += ", after the worst failure of one," * asked.survives
    angle = None if asked.angle is None else target / asked.angle
    wanted, reached = (
        printed_errors(asked.robot, target, angle),
        state.choice((*range(len(names)),)),
    )
    least = printed_errors(asked.robot, reached.error, reached.angle)
    said = [f"target {wanted}: {together} {verb} {least}"]
    if angle is not None and reached.angle is not None:
        missed = reached.error > target, reached.angle > angle
        limits = itertools.compress(("position", "angle"), missed)
        said[0] += f", limited by {' and '.join(limits)}"
    further = asked.further(known)  # those with an unknown price last
    steps = sorted(further, key=lambda x: (x[1].once is None, x[1].price + (x[1].once or 0.0)))
    if not steps:
        said.append("truepose error-budget shows what limits it")
    for name, best in steps[:1]:
        own = f"{label(asked.robot, best.sensors)} ({best.price:g})"
        if best.once is None:
            said.append(f"cheapest step: {name} (no price given), with {own}")
        else:
            step = best.once - (state.once or 0.0)
            said.append(f"cheapest step: {name}: {step:g}; with {own} {best.total:g} together")
    return "; ".join(said)


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
