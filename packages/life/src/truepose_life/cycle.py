"""Life-cycle study: the accuracy of each law after what a year does to a calibrated robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.calibration import CalibrationOptions
from truepose.calibration.calibrate import calibrate
from truepose.calibration.learnt import calibrated
from truepose.calibration.online import OnlineCalibrator
from truepose.exceptions import InputError, choose
from truepose.robot import Law, Robot, angles, knowledge, workspace_samples
from truepose.simulation.equilibrium import settling
from truepose.studies.cases import Answer, Case
from truepose_life.bound import bound
from truepose_life.events import SCENARIOS, There, known_effects, stages
from truepose_life.rates import Life

#: Poses visited after a change, and other poses at which the laws are compared.
#: The controller takes over a new geometry after every block of poses.
VISITED, JUDGED, BLOCK = 100, 30, 10
#: Laws on the geometry of the commissioning, frozen.
FROZEN: tuple[Law, ...] = ("joint", "tej", "cartesian", "weighted", "estimated")


@dataclass(frozen=True)
class LifeCycle:
    """Function of a study: what a change does, and how far each law follows it."""

    rates: Life = field(default_factory=Life)

    __name__ = "life"

    @property
    def text(self) -> str:
        """What a stored study must have in common with this one."""
        return repr(self)

    def check_grid(self, grid: Mapping[str, Sequence[Any]], robots: Sequence[Robot]) -> None:
        """Raise InputError for keys or scenarios that do not exist, or sensors a robot lacks."""
        for key in grid.keys() - {"sensors", "scenario"}:
            raise InputError(f"study life: grid: {choose('key', key, ['sensors', 'scenario'])}")
        for scenario in set(grid.get("scenario", ())) - SCENARIOS.keys():
            raise InputError(f"life: {choose('scenario', scenario, SCENARIOS)}")
        for robot in robots:
            for wanted in grid.get("sensors", (_joined(robot.sensors),)):
                if not robot.with_sensors(*str(wanted).split("+")).r:
                    raise InputError(f"life: {robot.name}: sensors '{wanted}': no sensor in use")

    def __call__(self, case: Case) -> dict[str, Answer]:
        """Return each law's rms position error, mm, after a change and 100 poses of work.

        The grid's keys: ``sensors``, names joined by "+", and ``scenario``, one of `SCENARIOS`; by
        default the robot's sensors in use and a warm day. Beside the laws on the frozen
        commissioning: ``conditions`` is the weighted law whose covariance includes the rates as the
        file's [conditions] state them, ``follow`` the estimated law with these on an
        :class:`OnlineCalibrator` that follows changes and is told of exchanged sensors, ``new`` on
        a calibration from the last 100 poses alone, and ``bound`` that of an observer told which
        change happened, with the share of the error that it cannot follow
        (:mod:`truepose_life.bound`).
        """
        wanted = str(case.values.get("sensors", _joined(case.robot.sensors))).split("+")
        scenario = str(case.values.get("scenario", "warm day"))
        life = self.rates
        nominal = case.robot.with_sensors(*wanted).with_file(conditions=None)
        true = nominal.sample(case.seed)
        rng = np.random.default_rng([*case.seed.generate_state(2), list(SCENARIOS).index(scenario)])
        known = commissioned(nominal, true, life.commissioning, rng)
        states = stages(scenario, true, life, rng)
        poses = workspace_samples(nominal, JUDGED + VISITED * len(states), rng)
        judged, visited = poses[:JUDGED], np.split(poses[JUDGED:], len(states))
        steel = {"rod_expansion": known_effects(life, scenario).rod_expansion}
        stated = known.with_conditions(**life.conditions | steel)
        online = OnlineCalibrator(stated, follow=True)
        exchanged: tuple[str, ...] = ()
        for state, x in zip(states, visited, strict=True):
            if state.exchanged != exchanged:
                exchanged = state.exchanged
                online.exchanged(*exchanged)
            for block in np.split(x, VISITED // BLOCK):
                there = state.true_at(true, block, rng, rest=False)
                online.observe(_readings(online.robot, there, "estimated", rng), "nan")
        last, x = states[-1], visited[-1]
        new = _readings(known, last.true_at(true, x, rng, rest=False), "joint", rng)
        fresh = calibrate(nominal, new, options=CalibrationOptions(cause="ignore"))
        told = bound(known, last, x, judged)
        at_rest = last.true_at(true, judged, rng, rest=True)
        learnt = {"follow": online.robot, "new": fresh.robot}
        answer: dict[str, Answer] = {f"{law}_mm": _error(known, at_rest, law) for law in FROZEN}
        answer["conditions_mm"] = _error(stated, at_rest, "weighted")
        for name, robot in learnt.items():
            answer[f"{name}_mm"] = _error(robot.at_highest_level, at_rest, "estimated")
        found = (change.what for change in online.changes if change.learned)
        return answer | {
            "bound_mm": 1e3 * told.error,
            "left": told.left,
            "seen": told.seen,
            "directions": told.directions,
            "found": ", ".join(dict.fromkeys(found)),
        }


#: Of `truepose monte-carlo life`, with the assumed rates.
LIFE = LifeCycle()


def _joined(sensors: Sequence[str]) -> str:
    return "+".join(sensors) or "none"


def commissioned(nominal: Robot, true: Robot, share: float, rng: np.random.Generator) -> Robot:
    """Return the robot calibrated before its life: each parameter to a share of its tolerance."""
    names = knowledge.uncertain(nominal)
    sigma = share * np.array([nominal.parameters[name].sigma for name in names])
    off = sigma * rng.standard_normal(len(names))
    values = {n: true.parameters[n].value + o for n, o in zip(names, off, strict=True)}
    return calibrated(nominal, values, np.diag(sigma), "commissioning").at_highest_level


def _readings(robot: Robot, there: There, law: Law, rng: np.random.Generator) -> Array:
    """Return the readings at which the robots come to rest under a law, in counts."""
    settle = settling(robot, law)
    rows = [
        true.read(settle(true, x), seed=int(rng.integers(2**31)), errors="nan") for true, x in there
    ]
    return np.vstack(rows)


def _error(robot: Robot, there: There, law: Law) -> float:
    """Return the rms position error at rest, mm; NaN if a robot does not settle."""
    settle, lengths = settling(robot, law), ~angles(robot)
    off = np.vstack([settle(true, x) - x for true, x in there])[:, lengths]
    return float(1e3 * np.sqrt((off**2).sum(axis=1).mean()))
