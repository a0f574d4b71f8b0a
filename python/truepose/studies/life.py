"""Life-cycle study: the accuracy of each law after what a year does to a calibrated robot."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.calibration.learnt import calibrated
from truepose.calibration.online import OnlineCalibrator
from truepose.control.adaptive import AdaptiveCalibrator, changes
from truepose.control.effects import Effects
from truepose.exceptions import InputError, choose
from truepose.files import contents
from truepose.robot import knowledge
from truepose.robot.laws import Law
from truepose.robot.robot import Robot
from truepose.robot.units import angles
from truepose.robot.workspace import workspace_samples
from truepose.simulation.equilibrium import steady_state
from truepose.studies.cases import Answer, Case

#: SI value of each unit, by the unit of the model.
UNITS = {
    "m": {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "um": 1e-6},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180},
    "K": {"K": 1.0},
    "1/K": {"1/K": 1.0, "ppm/K": 1e-6},
    "N": {"N": 1.0},
    "": {"": 1.0},
}
#: Poses visited after a change, and other poses at which the laws are compared.
#: The controller takes over a new geometry after every block of poses.
VISITED, JUDGED, BLOCK = 100, 30, 10
#: Laws on the geometry of the commissioning, frozen.
STEEL = "warm day, steel rods"
FROZEN: tuple[Law, ...] = ("joint", "tej", "cartesian", "weighted", "estimated")


def _rate(default: float, unit: str, what: str) -> Any:
    return field(default=default, metadata={"unit": unit, "what": what})


@dataclass(frozen=True, kw_only=True)
class Life:
    """What a year does to a robot. Every number is assumed; a file can change each."""

    commissioning: float = _rate(0.003, "", "σ of the first calibration over the tolerances' σ")
    warm_up: float = _rate(20.0, "K", "daily rise of temperature of base, arms and rods")
    gradient: float = _rate(3.0, "K", "σ of each part's temperature about that")
    base_expansion: float = _rate(23e-6, "1/K", "of the base: aluminium")
    arm_expansion: float = _rate(23e-6, "1/K", "of the arms: aluminium")
    rod_expansion: float = _rate(1e-6, "1/K", "of the rods: carbon fibre along its layers")
    steel: float = _rate(11.5e-6, "1/K", "of the rods in the day with steel rods")
    wear: float = _rate(50e-6, "m", "largest wear of a rod's joints in a year")
    drift: float = _rate(math.radians(0.005), "rad", "σ of each motor encoder's drift in a year")
    play: float = _rate(20e-6, "m", "play of each rod's joints after a year, either side at random")
    collision: float = _rate(1e-3, "m", "mean shortening of the rod that is bent")
    homing: float = _rate(math.radians(0.1), "rad", "σ of a motor that is homed anew")
    payload: float = _rate(20.0, "N", "weight picked up")
    arm_stiffness: float = _rate(2e4, "", "of an arm at its root, N·m/rad")
    ageing: float = _rate(5.0, "", "σ of an aged sensor's readings over that of a new one")

    @classmethod
    def read(cls, path: str | Path) -> Life:
        """Return the rates of a TOML file: numbers with units, ``warm_up = "15 K"``.

        Raises
        ------
        InputError
            Unknown keys, rates without their unit, or values that are not positive numbers.
        """
        try:
            told = tomllib.loads(contents(Path(path)).decode())
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read: {error}") from None
        return cls(**{key: cls._value(f"{path}: {key}", key, v) for key, v in told.items()})

    @classmethod
    def _value(cls, where: str, key: str, told: object) -> float:
        known = {f.name: f.metadata["unit"] for f in fields(cls)}
        if key not in known:
            raise InputError(f"{where.rpartition(':')[0]}: {choose('key', key, known)}")
        units = UNITS[known[key]]
        found = re.fullmatch(r"\s*([-+.\deE]+)\s*(\S*)\s*", str(told))
        if not found or found[2] not in units:
            usual = " or ".join(filter(None, units)) or "no unit"
            raise InputError(f"{where} = {told!r}: must be a number with its unit: {usual}")
        value = float(found[1]) * units[found[2]]
        if not (math.isfinite(value) and value >= 0):
            raise InputError(f"{where} = {told!r}: must be at least 0")
        return value


Steps = dict[str, float]


@dataclass(frozen=True)
class Event:
    """One change of one robot."""

    steps: Steps  #: m or rad by parameter
    at: Callable[[Array], Robot] | None = None  #: true robot at a pose, where that matters

    def parts(self, true: Robot, poses: Array) -> Iterator[tuple[Robot, Array]]:
        """Yield the changed robot and the poses at which it is that, (N, n)."""
        if self.at is None:
            yield moved(true, self.steps), poses
        else:
            yield from ((self.at(x), x[None]) for x in poses)


def moved(robot: Robot, steps: Mapping[str, float]) -> Robot:
    """Return the robot with some parameters stepped."""
    known = robot.parameters
    return robot.replace({name: known[name].value + step for name, step in steps.items()})


def _effects(life: Life, scenario: str) -> Effects:
    """Return the effects that the owner knows of: materials, stiffness, a day's warm-up."""
    return Effects(
        warm_up=life.warm_up,
        base_expansion=life.base_expansion,
        arm_expansion=life.arm_expansion,
        rod_expansion=life.steel if scenario == STEEL else life.rod_expansion,
        arm_stiffness=life.arm_stiffness,
    )


def _warm(true: Robot, life: Life, rng: np.random.Generator, scenario: str = "") -> Event:
    steps: Steps = {}
    for mode in _effects(life, scenario).growth(true):
        for chain in sorted({name.partition(".")[0] for name in mode}):
            share = 1 + life.gradient / life.warm_up * rng.standard_normal()
            steps |= {n: share * s for n, s in mode.items() if n.partition(".")[0] == chain}
    return Event(steps)


def _wear(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    steps = {}
    for name in true.parameters:
        if name.endswith(".rod"):
            steps[name] = rng.uniform(0, life.wear)
        elif name.endswith(".encoder_offset"):
            steps[name] = life.drift * rng.standard_normal()
    return Event(steps)


def _play(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    rods = [name for name in true.parameters if name.endswith(".rod")]
    half = life.play / 2
    return Event({}, lambda _: moved(true, {name: half * rng.choice((-1, 1)) for name in rods}))


def _collision(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    rods = [name for name in true.parameters if name.endswith(".rod")]
    return Event({str(rng.choice(rods)): -life.collision * rng.uniform(0.5, 1.5)})


def _exchanged(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    offset = f"{true.sensors[0]}.offset"
    return Event({offset: true.parameters[offset].sigma * rng.standard_normal()})


def _homed(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    offsets = [name for name in true.parameters if name.endswith(".encoder_offset")]
    return Event({str(rng.choice(offsets)): life.homing * rng.standard_normal()})


def _payload(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    force = np.zeros(3)
    force[2] = -life.payload

    def at(x: Array) -> Robot:
        turns = true.motor_torque(x, [*force, *[0.0] * (true.n - 3)]) / life.arm_stiffness
        return moved(true, {f"chain{k + 1}.encoder_offset": t for k, t in enumerate(turns)})

    return Event({}, at)


def _noisy(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    sigma = dict(zip(true.readings, knowledge.reading_sigma(true), strict=True))
    more = math.sqrt(max(life.ageing**2 - 1, 0))
    names = [name for name in true.sensors if f"{name}.offset" in true.parameters]

    def at(_: Array) -> Robot:
        noise = {f"{n}.offset": more * sigma[n] * rng.standard_normal() for n in names}
        return moved(true, noise)

    return Event({}, at)


Happens = Callable[[Robot, Life, np.random.Generator], Event]
SCENARIOS: dict[str, Happens] = {
    "unchanged": lambda true, life, rng: Event({}),
    "warm day": _warm,
    STEEL: lambda true, life, rng: _warm(true, life, rng, STEEL),
    "wear": _wear,
    "play": _play,
    "collision": _collision,
    "sensor exchanged": _exchanged,
    "payload": _payload,
    "motor re-homed": _homed,
    "noisy sensors": _noisy,
}


@dataclass(frozen=True)
class LifeCycle:
    """Function of a study: what a change does, and how far each law follows it."""

    rates: Life = Life()

    __name__ = "life"

    @property
    def text(self) -> str:
        """What a stored study must have in common with this one."""
        return repr(self)

    def __call__(self, case: Case) -> dict[str, Answer]:
        """Return each law's rms position error, mm, after a change and 100 poses of work.

        The grid's keys: ``sensors``, names joined by "+", and ``scenario``, one of `SCENARIOS`.
        Beside the laws on the frozen commissioning: ``allowed`` is the weighted law whose
        covariance allows for a warm-up, ``online`` the estimated law on
        :class:`OnlineCalibrator` with the growth of a warm-up, ``adaptive`` on
        :class:`AdaptiveCalibrator`, ``new`` on a calibration from the 100 poses alone, and
        ``bound`` the Cramér–Rao bound of an observer that is told which change happened.
        """
        wanted = str(case.values["sensors"]).split("+")
        scenario = str(case.values["scenario"])
        if scenario not in SCENARIOS:
            raise InputError(f"life: {choose('scenario', scenario, SCENARIOS)}")
        life = self.rates
        nominal = case.robot.with_sensors(*wanted)
        true = nominal.sample(case.seed).at_highest_level
        rng = np.random.default_rng([*case.seed.generate_state(2), list(SCENARIOS).index(scenario)])
        known = _commissioned(nominal, true, life.commissioning, rng)
        event = SCENARIOS[scenario](true, life, rng)
        poses = workspace_samples(nominal, VISITED + JUDGED, rng)
        visited, judged = poses[:VISITED], poses[VISITED:]
        answer: dict[str, Answer] = {}
        for law in FROZEN:
            answer |= {f"{law}_mm": _error(known, event, true, judged, law)}
        effects = _effects(life, scenario)
        growth = effects.growth(true)
        answer["allowed_mm"] = _error(_allowing(known, growth), event, true, judged, "weighted")
        drift = [{n: s / math.sqrt(VISITED) for n, s in mode.items()} for mode in growth]
        online = OnlineCalibrator(known, drift)
        adaptive = AdaptiveCalibrator(known, kinds=changes(known, effects))
        for block in np.split(visited, VISITED // BLOCK):
            online.observe(_readings(online.robot, event, true, block, "estimated", rng), "nan")
            adaptive.observe(_readings(adaptive.robot, event, true, block, "estimated", rng), "nan")
        rows = _readings(known, event, true, visited, "joint", rng)
        answer["online_mm"] = _error(
            online.robot.at_highest_level, event, true, judged, "estimated"
        )
        answer["adaptive_mm"] = _error(adaptive.robot, event, true, judged, "estimated")
        fresh = calibrate(nominal, rows).robot.at_highest_level
        answer["new_mm"] = _error(fresh, event, true, judged, "estimated")
        if event.at is None:
            answer["bound_mm"] = _bound(known, event.steps, visited, judged)
        answer["found"] = ", ".join(
            dict.fromkeys(c for w in adaptive.windows if w.learned for c in w.changed)
        )
        return answer


def _commissioned(nominal: Robot, true: Robot, share: float, rng: np.random.Generator) -> Robot:
    """Return the robot calibrated before its life: each parameter to a share of its tolerance."""
    names = knowledge.uncertain(nominal)
    sigma = share * np.array([nominal.parameters[name].sigma for name in names])
    off = sigma * rng.standard_normal(len(names))
    values = {n: true.parameters[n].value + o for n, o in zip(names, off, strict=True)}
    return calibrated(nominal, values, np.diag(sigma), "commissioning").at_highest_level


def _allowing(known: Robot, growth: list[Steps]) -> Robot:
    """Return the commissioned robot whose covariance allows for a warm-up."""
    names = knowledge.uncertain(known)
    modes = np.array([[mode.get(name, 0.0) for mode in growth] for name in names])
    root = knowledge.triangular(np.hstack([knowledge.root(known, names), modes]))
    values = {name: known.parameters[name].mean for name in names}
    learnt = calibrated(known, values, root, "commissioning, warm-up allowed")
    return learnt.at_highest_level


def _readings(
    robot: Robot, event: Event, true: Robot, x_d: Array, law: Law, rng: np.random.Generator
) -> Array:
    rows = []
    for there, poses in event.parts(true, x_d):
        x = np.asarray(steady_state(robot, there, poses, law, errors="nan"))
        rows.append(there.read(x, seed=int(rng.integers(2**31)), errors="nan"))
    return np.vstack(rows)


def _error(robot: Robot, event: Event, true: Robot, x_d: Array, law: Law) -> float:
    parts = event.parts(true, x_d)
    reached = [np.asarray(steady_state(robot, there, x, law, errors="nan")) for there, x in parts]
    return _rms(robot, np.vstack(reached) - x_d)


def _rms(robot: Robot, off: Array) -> float:
    lengths = ~angles(robot)
    return float(1e3 * np.sqrt((off[:, lengths] ** 2).sum(axis=1).mean()))


def _bound(known: Robot, steps: Steps, visited: Array, judged: Array) -> float:
    """Return the bound, mm, of who knows the direction of the change, not its size.

    Of the geometry alone: the laws are compared at rest, where readings are not quantized.
    """
    names = knowledge.uncertain(known)
    own = knowledge.root(known, names)
    step = np.array([[steps.get(name, 0.0)] for name in names])
    values = {name: known.parameters[name].mean for name in names}

    def bound(root: Array) -> float:
        told = calibrated(known, values, root, "told")
        return accuracy(told, judged, calibrated_on=visited).rms

    exact = bound(1e-3 * own)
    told = bound(knowledge.triangular(np.hstack([own, step])))
    return 1e3 * math.sqrt(max(told**2 - exact**2, 0.0))
