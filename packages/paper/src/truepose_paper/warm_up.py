"""A calibrated robot that warms up, under frozen and online calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.calibration.learnt import calibrated
from truepose.calibration.online import OnlineCalibrator
from truepose.control.effects import Effects
from truepose.robot import knowledge
from truepose.robot.laws import Law
from truepose.robot.robot import Robot
from truepose.simulation.equilibrium import steady_state
from truepose_paper import article, sensor_sets
from truepose_paper.experiment import Progress, of_every_kind, position_rms

Method = Literal["frozen", "tej", "weighted", "online"]

#: Law of each method. All use the cold geometry. `weighted` also has priors of the thermal growth;
#: `online` calibrates at every steady-state pose, with the rate of growth as process noise.
METHODS: dict[Method, Law] = {
    "frozen": "joint",
    "tej": "tej",
    "weighted": "weighted",
    "online": "estimated",
}
#: Labels of the methods.
NAMES: dict[Method, str] = {
    "frozen": "frozen calibration",
    "tej": "with the paper's TEJ",
    "weighted": "with the weighted TEJ",
    "online": "online self-calibration",
}
SETS = {"θ": ("theta",), "θ + z telemeter": ("theta", "z_telemeter")}
WARM = 20  #: at most, of :func:`warm`
ROBOTS = 6  #: at most, per sensor set
STEPS, POSES = 36, 50  #: over one and a half warm-ups; poses of Table 2 visited in each step
PERFECT = 1e-3  #: σ of each parameter after the cold calibration over its tolerance's


@dataclass(frozen=True)
class WarmUp:
    """Steady-state position errors over time, with one sensor set."""

    sensors: str
    hours: Array  #: (T,)
    rms: dict[Method, Array]  #: (robots, T) over the poses visited in each step, mm
    estimated: Array  #: (robots, T) of x̂ − x under `online`, from quantized readings, mm
    bound: Array  #: (robots, T) bound of `estimated`, by the covariance of `online`, mm

    def over_bound(self) -> Array:
        """Return the rms over the robots of `estimated` divided by that of `bound`, (T,)."""
        return np.sqrt((self.estimated**2).mean(axis=0) / (self.bound**2).mean(axis=0))


@dataclass(frozen=True)
class Warm:
    """Steady-state position errors of warm robots with one sensor set, mm."""

    sensors: str
    each: dict[Method, Array]  #: rms over the poses of every robot, (robots,)


def warm(
    robot: Robot, robots: int, seed: int, progress: Progress = lambda done, total: None
) -> list[Warm]:
    """Compute the errors of robots that were perfectly calibrated when cold and are warm now.

    The methods are those of `METHODS` without online calibration; the sets those of
    :data:`truepose_paper.sensor_sets.SETS`. Exact statics at every sixth pose of Table 2.
    `progress` is called after each robot of each set.
    """
    effects = Effects().only("thermal", "quantization")
    poses = article.table2()[:: sensor_sets.EVERY]

    def one(label: str, source: np.random.SeedSequence) -> list[float]:
        drawn = robot.with_sensors(*sensor_sets.SETS[label])
        cold = drawn.sample(source)
        true = effects.geometry(cold, effects.warm_up_time)
        models = _models(drawn, cold, effects)
        return [
            position_rms(steady_state(models[method], true, poses, METHODS[method]) - poses)
            for method in models
        ]

    sources = np.random.SeedSequence(seed).spawn(robots)
    return [
        Warm(label, dict(zip(METHODS, np.array(found).T, strict=False)))
        for label, found in of_every_kind(one, sensor_sets.SETS, sources, progress)
    ]


def study(
    robot: Robot,
    robots: int,
    seed: int,
    effects: Effects | None = None,
    progress: Progress = lambda done, total: None,
) -> list[WarmUp]:
    """Warm up robots that were perfectly calibrated when cold; compare the methods' errors.

    Exact statics with the thermal effect only. Its three temperatures rise together and linearly,
    then stay constant for half as long.

    `robot` is the H4 with the sensors of `SETS` in its file; at most `ROBOTS` of `robots` true ones
    per set are sampled from its tolerances. `effects` have size and rate of the warm-up, default
    20 K in 2 h. `progress` is called after each robot.
    """
    effects = (Effects() if effects is None else effects).only("thermal", "quantization")
    times = np.linspace(0, 1.5 * effects.warm_up_time, STEPS + 1)

    def one(label: str, number: int) -> Array:
        source = np.random.SeedSequence(seed, spawn_key=(number,))
        return _one(robot.with_sensors(*SETS[label]), source, effects, times)

    results = []
    numbers = range(min(robots, ROBOTS))
    for label, found in of_every_kind(one, SETS, numbers, progress):
        *rms, estimated, bound = np.moveaxis(np.array(found), -1, 0)
        of_methods = dict(zip(METHODS, rms, strict=True))
        results.append(WarmUp(label, times / 3600, of_methods, estimated, bound))
    return results


def _one(drawn: Robot, source: np.random.SeedSequence, effects: Effects, times: Array) -> Array:
    """Return one robot's rms errors, (T, 6): per method, of `online`'s estimates; their bound."""
    cold = drawn.sample(source)
    growth = effects.growth(cold)
    believed = _models(drawn, cold, effects)
    known = believed["frozen"]
    lines = POSES * effects.warm_up_time / (times[1] - times[0])
    online = OnlineCalibrator(
        known, [{name: g / np.sqrt(lines) for name, g in gain.items()} for gain in growth]
    )
    rng = np.random.default_rng(source.spawn(1)[0])
    table = article.table2()
    rows = []
    for time in times:
        true = effects.geometry(cold, time)
        poses = article.offset(table[rng.choice(len(table), POSES, replace=False)], rng)
        believed["online"] = learnt = online.robot
        row = []
        for method, law in METHODS.items():
            x = steady_state(believed[method], true, poses, law)
            row.append(position_rms(x - poses))
        readings = true.read(x, seed=int(rng.integers(2**32)))
        P = accuracy(learnt, poses)
        bound = 1e3 * np.sqrt(np.trace(P[:, :3, :3], axis1=1, axis2=2).mean())
        rows.append([*row, position_rms(learnt.estimate(readings).x - x), bound])
        online.observe(readings)
    return np.array(rows)


def _models(drawn: Robot, cold: Robot, effects: Effects) -> dict[Method, Robot]:
    """Return the controller's robot under each method that does not calibrate online."""
    names = knowledge.uncertain(drawn)
    growth = effects.growth(cold)
    modes = np.array([[gain.get(name, 0.0) for name in names] for gain in growth])
    known = _calibrated(drawn, cold, np.zeros((0, 0)))
    return {"frozen": known, "tej": known, "weighted": _calibrated(drawn, cold, modes)}


def _calibrated(drawn: Robot, cold: Robot, modes: Array) -> Robot:
    """Return the robot calibrated perfectly when cold, with the growth modes as uncertainty."""
    names = knowledge.uncertain(drawn)
    sigma = np.array([drawn.parameters[name].sigma for name in names])
    root = PERFECT * np.diag(sigma)
    if modes.size:
        root = knowledge.triangular(np.hstack([root, modes.T]))
    values = {name: cold.parameters[name].value for name in names}
    learnt = calibrated(drawn, values, root, "perfect, cold")
    return learnt.with_level(drawn.highest_level)
