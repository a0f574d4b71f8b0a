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
from truepose.design.candidates import drawn, given_poses, reachable
from truepose.design.criterion import SIGMA, Criterion, Measure
from truepose.design.machining import Curve, Level, levels_of
from truepose.design.relaxation import Relaxation
from truepose.design.search import Search, Set
from truepose.design.selection import Alone, SensorSelection, SensorSet, described
from truepose.design.worth import Worth
from truepose.exceptions import InputError, choose
from truepose.robot import knowledge
from truepose.robot.robot import Robot
from truepose.robot.units import summed
from truepose.robot.workspace import workspace_samples
from truepose.show.units import printed

#: Default number of workspace poses over which sets are compared.
POSES = 32
#: Poses of a self-calibration in states that were not asked for.
OTHERWISE = 10


def select_sensors(
    robot: Robot,
    prices: Mapping[str, float] | None = None,
    *,
    price_steps: Mapping[str, Curve] | None = None,
    budget: float | None = None,
    target: float | None = None,
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
        Prices of the candidate sensors by name; by default the file's keys `price`.
    price_steps : mapping, optional
        Machining tolerances by names of parameters or globs: σ (m or rad, about the expected value)
        and its price for the group; by default the file's keys `price_steps`.
    budget : float, optional
        Largest total price; finds the most accurate set.
    target : float, optional
        Requested position error, m; finds the cheapest set.
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
        A candidate has no price; the budget is below every price or that of `must`; all candidates
        together do not reach the target.

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
    named = _priced(robot, prices, bool(ladders))
    names = list(named)
    if unknown := [name for name in must if name not in named]:
        raise InputError(f"must: {choose('sensor', unknown[0], names)}")
    if budget is not None and target is not None:
        raise InputError("budget and target: give one of them")
    for what, value in (("budget", budget), ("target", target)):
        if value is not None:
            positive(what, value)
    asked = _Asked(
        robot, named, ladders, must, survives, asked_poses(robot, poses),
        Criterion(measure, confidence), reference_sigmas(robot, reference_sigma), budget, target,
    )  # fmt: skip
    visited = given_poses(robot, calibrated_on, "calibrated_on")
    touched = given_poses(robot, reference_pose, "reference_pose", one=True)
    search = asked.search(visited, touched)
    best, bound = None, np.nan
    if budget is not None:
        _fits(search, budget, names, must)
        best, squared = search.most_accurate(budget)
        bound = squared**0.5
    elif target is not None:
        if search.cost(range(len(search.prices))) > target**2:
            raise InputError(_unreached(asked, search, visited, touched))
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
        front=[asked.choice(search, own) for own in search.front()],
        best=None if best is None else asked.choice(search, best),
        bound=bound,
        compared=len(search.known),
        over=asked.over,
        budget=budget,
        target=target,
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
    ladders: list[list[Level]]
    must: Sequence[str]
    survives: bool
    over: Array  #: (T, c)
    by: Criterion
    reference_sigma: Sequence[float]
    budget: float | None
    target: float | None

    @property
    def levels(self) -> list[Level]:
        return [level for own in self.ladders for level in own]

    @property
    def every(self) -> list[tuple[str, float | None]]:
        """Every candidate: a sensor, or parameters and their σ."""
        return [(name, None) for name in self.prices] + [(x.group, x.sigma) for x in self.levels]

    def search(self, visited: Array, touched: Array) -> Search:
        names, finer = list(self.prices), [level.information for level in self.levels]
        sigma = self.reference_sigma
        worth = Worth(self.robot, names, self.over, visited, touched, sigma, finer)
        needed = [names.index(name) for name in self.must]
        prices = [*self.prices.values()]
        return searched(worth, prices, self.ladders, needed, self.survives, self.by)

    def choice(self, search: Search, own: Set) -> SensorSet:
        sensors = tuple(name for k, name in enumerate(self.prices) if k in own)
        levels = enumerate(self.levels, len(self.prices))
        machined = tuple({x.group: x.sigma for k, x in levels if k in own}.items())
        return SensorSet(sensors, search.spent(own), search.cost(own) ** 0.5, machined)

    def further(self, visited: Array, touched: Array) -> Iterator[tuple[str, SensorSet]]:
        """Yield states after further steps, and the best set there; none where none reaches it."""
        poses, home = practice(self.robot, OTHERWISE), self.robot.home[None]
        for calibrated, referenced in itertools.product((False, True), repeat=2):
            done = (calibrated and len(visited)) or (referenced and len(touched))
            if done or not (calibrated or referenced):
                continue
            said = [f"self-calibrated on {len(poses)} poses"] * calibrated
            said += ["referenced at home"] * referenced
            own = poses if calibrated else visited, home if referenced else touched
            search, squared = self.search(*own), (self.target or 0.0) ** 2
            if self.budget is not None:
                best, _ = search.most_accurate(self.budget)
            elif search.cost(range(len(search.prices))) <= squared:
                best, _ = search.cheapest(squared)
            else:
                continue
            yield " and ".join(said), self.choice(search, best)


def practice(robot: Robot, count: int) -> Array:
    """Return poses of a self-calibration, spread over the workspace."""
    x = drawn(robot, 4 * count, 0)
    return x[reachable(robot.with_sensors(), x, robot.highest_level)][:count]


def in_other_states(
    found: SensorSelection, calibrated_on: Array, reference_pose: Array
) -> dict[str, Array]:
    """Return the front's errors (m) as built, referenced at a pose, self-calibrated, and both."""
    robot, names = found.robot, list(found.prices)
    levels = [level for own in found.levels for level in own]
    sets = []
    for choice in found.front:
        least = dict(choice.machined)
        own = [k for k, x in enumerate(levels, len(names)) if x.sigma >= least.get(x.group, np.inf)]
        sets.append([*map(names.index, choice.sensors), *own])
    states, result = ("as built", "referenced", "self-calibrated", "both"), {}
    sigma, finer = reference_sigmas(robot, 0.0), [level.information for level in levels]
    cases = itertools.product((calibrated_on[:0], calibrated_on), (0, 1))
    for state, (visited, count) in zip(states, cases, strict=True):
        worth = Worth(robot, names, found.over, visited, reference_pose[None][:count], sigma, finer)
        result[state] = np.sqrt([worth.squared(own, found.criterion) for own in sets])
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


def _fits(search: Search, budget: float, names: Sequence[str], must: Sequence[str]) -> None:
    """Raise InputError where a budget is too small for `must` or any candidate."""
    needed, least = search.spent(search.must), min(search.prices)
    if needed > budget:
        raise InputError(f"budget {budget:g}: {', '.join(must)} cost {needed:g}")
    if not must and least > budget:
        what = dict(enumerate(names)).get(search.prices.index(least), "machining")
        raise InputError(f"budget {budget:g}: too small: the cheapest, {what}, costs {least:g}")


def _unreached(asked: _Asked, search: Search, visited: Array, touched: Array) -> str:
    """Return a message: what all candidates together reach, and the cheapest step that helps."""
    names, survives = asked.prices, asked.survives
    together = f"all {len(names)} sensors together" if names else "all levels"
    added = ["all parts machined to the smallest σ"] * bool(names and asked.levels)
    added += ["after the worst failure of one"] * bool(names and survives)
    together += f", {', '.join(added)}," if added else ""
    errors = asked.target, search.cost(range(len(search.prices))) ** 0.5
    wanted, least = (printed(value or 0.0, summed(asked.robot).unit, ".4g") for value in errors)
    steps = sorted(asked.further(visited, touched), key=lambda step: step[1].price)
    helps = [
        f"{described(asked.robot, best)} ({best.price:g}) would, once {state}"
        for state, best in steps
    ]
    return "; ".join([f"target {wanted}: {together} reach {least}", *helps[:1]])


def _priced(
    robot: Robot, prices: Mapping[str, float] | None, machined: bool = False
) -> dict[str, float]:
    """Return the price of each candidate sensor: those given, or all of the file."""
    every = {sensor.name: sensor.price for sensor in robot.spec.sensor}
    given = every if prices is None else {**prices}
    for name, price in given.items():
        if name not in every:
            raise InputError(f"prices: {choose('sensor', name, every)}")
        if price is None:
            raise InputError(
                f"{robot.name}: sensor {name}: has no price (the file's key price, --price, prices)"
            )
        finite(f"prices: {name}", price, 0)
    if not given and not machined:
        none = "no sensor in its file" if prices is None else "neither sensors nor levels to choose"
        raise InputError(f"{robot.name}: {none}")
    return {name: float(given[name] or 0.0) for name in every if name in given}


def asked_poses(robot: Robot, poses: ArrayLike | None) -> Array:
    """Return the given poses; by default poses sampled over the workspace."""
    if poses is not None:
        return given_poses(robot, poses, "poses")
    x = workspace_samples(robot, 4 * POSES, np.random.default_rng(0))
    good = x[reachable(robot.with_sensors(), x, robot.highest_level)][:POSES]
    if not len(good):
        raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
    return good
