"""Events of the life-cycle study: what changes of a robot, and what may be known of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from truepose.arguments import Array
from truepose.control.changes import (
    Change,
    Payload,
    payload,
    reading_offsets,
    warm_up_modes,
)
from truepose.control.effects import Effects
from truepose.exceptions import InputError
from truepose.robot import knowledge
from truepose.robot.robot import Robot
from truepose_life.rates import Life

Steps = dict[str, float]
#: Robots and the poses, (N, n), at which they are the true one.
There = list[tuple[Robot, Array]]
STEEL = "warm day, steel rods"


@dataclass(frozen=True)
class Event:
    """One state of one robot's life, as a change of the commissioned robot."""

    steps: Steps = field(default_factory=dict)  #: m or rad by parameter
    told: tuple[Change, ...] = ()  #: kind and size of the changes, which an observer may know
    load: Payload | None = None
    sides: Steps = field(default_factory=dict)  #: half a backlash: on either side at each pose
    exchanged: tuple[str, ...] = ()  #: sensors, of which the owner tells the calibrator
    factor: float = 1.0  #: σ of the sensors' readings over that of new ones

    @property
    def constant(self) -> bool:
        """Whether the true robot is the same at all poses."""
        return self.load is None and not self.sides and self.factor == 1

    def true_at(self, true: Robot, x: Array, rng: np.random.Generator, rest: bool) -> There:
        """Return the changed robots at poses x, (N, n).

        At rest readings are exact; of noisy sensors, all readings then have their noise.
        """
        if self.constant:
            return [(moved(true, self.steps), x)]
        steps: list[Steps] = [dict(self.steps) for _ in x]
        if self.load is not None:
            names = [f"chain{k + 1}.encoder_offset" for k in range(true.n)]
            for own, turns in zip(steps, self.load.roots(names, x)[..., 0], strict=True):
                _add(own, dict(zip(names, turns.tolist(), strict=True)))
        for own in steps:
            _add(own, {name: half * rng.choice((-1, 1)) for name, half in self.sides.items()})
        if self.factor != 1:
            offsets, sigma = reading_offsets(true), self.noise(true, rest)
            for own in steps:
                noise = sigma * rng.standard_normal(len(sigma))
                _add(own, dict(zip(offsets, noise.tolist(), strict=True)))
        return [(moved(true, own), pose[None]) for own, pose in zip(steps, x, strict=True)]

    def noise(self, true: Robot, rest: bool) -> Array:
        """Return the σ of noise added to the readings, (n + r,): counts are added by reading."""
        sigma = knowledge.reading_sigma(true)
        factors = np.array([1.0] * true.n + [self.factor] * true.r)
        if self.factor == 1:
            return np.zeros(len(sigma))
        return sigma * (factors if rest else np.sqrt(np.maximum(factors**2 - 1, 0)))


def moved(robot: Robot, steps: Steps) -> Robot:
    """Return the robot with some parameters stepped."""
    known = robot.parameters
    return robot.replace({name: known[name].value + step for name, step in steps.items()})


def together(events: Sequence[Event]) -> Event:
    """Return one event that is several at once."""
    steps: Steps = {}
    sides: Steps = {}
    for event in events:
        _add(steps, event.steps)
        sides |= event.sides
    loads = [event.load for event in events if event.load is not None]
    return Event(
        steps=steps,
        told=tuple(change for event in events for change in event.told),
        load=loads[-1] if loads else None,
        sides=sides,
        exchanged=tuple(sensor for event in events for sensor in event.exchanged),
        factor=math.prod(event.factor for event in events),
    )


def _add(steps: Steps, more: Steps) -> None:
    for name, step in more.items():
        steps[name] = steps.get(name, 0.0) + step


def known_effects(life: Life, scenario: str = "") -> Effects:
    """Return the effects that the owner knows of: materials, stiffness, a day's warm-up."""
    return Effects(
        warm_up=life.warm_up,
        base_expansion=life.base_expansion,
        arm_expansion=life.arm_expansion,
        rod_expansion=life.steel if scenario == STEEL else life.rod_expansion,
        arm_stiffness=life.arm_stiffness,
    )


def _told(name: str, modes: Sequence[Steps]) -> tuple[Change, ...]:
    kept = tuple(mode for mode in modes if any(mode.values()))
    return (Change(name, kept, 1.0),) if kept else ()


def _names(true: Robot, end: str, why: str) -> list[str]:
    """Return the uncertain parameters of a kind; raise where the robot has none."""
    found = [name for name in knowledge.uncertain(true) if name.endswith(end)]
    if not found:
        raise InputError(f"{true.name}: {why}: no parameter *{end} has a tolerance")
    return found


def _warm(true: Robot, life: Life, rng: np.random.Generator, scenario: str = "") -> Event:
    growth = known_effects(life, scenario).growth(true)
    gradient = life.gradient / life.warm_up if life.warm_up else 0.0
    steps: Steps = {}
    for mode in growth:
        for chain in sorted({name.partition(".")[0] for name in mode}):
            share = 1 + gradient * rng.standard_normal()
            steps |= {n: share * s for n, s in mode.items() if n.partition(".")[0] == chain}
    return Event(steps, _told("warm-up", warm_up_modes(growth, 0.0, gradient)))


def _wear(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    steps, modes = {}, []
    for name in knowledge.uncertain(true):
        if name.endswith(".rod"):
            steps[name] = rng.uniform(0, life.wear)
            modes.append({name: life.wear / math.sqrt(3)})  # rms of a uniform variable
        elif name.endswith(".encoder_offset"):
            steps[name] = life.drift * rng.standard_normal()
            modes.append({name: life.drift})
    return Event(steps, _told("wear", modes))


def _backlash(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    sides = {n: life.backlash / 2 for n in knowledge.uncertain(true) if n.endswith(".rod")}
    geared = [sensor.name for sensor in true.spec.used if sensor.geared]
    return Event(sides=sides | {f"{name}.offset": life.gear_backlash / 2 for name in geared})


def _collision(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    """Bend a rod: of a pair, one of the two."""
    rods = _names(true, ".rod", "collision")
    rod = str(rng.choice(rods))
    short, side = -life.collision * rng.uniform(0.5, 1.5), float(rng.choice((-1, 1)))
    steps, sizes = {rod: short}, [{name: life.collision} for name in rods]
    if (difference := f"{rod}_difference") in knowledge.uncertain(true):
        steps = {rod: short / 2, difference: side * short}
        sizes = [{name: life.collision / 2} for name in rods]
        sizes += [{f"{name}_difference": life.collision} for name in rods]
    return Event(steps, _told("collision", _one_of(sizes, len(rods))))


def _one_of(modes: Sequence[Steps], parts: int) -> list[Steps]:
    """Return modes with the covariance of a change of one of many parts."""
    return [{name: s / math.sqrt(parts) for name, s in mode.items()} for mode in modes]


def _exchanged(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    """Exchange a sensor: all that is known of its mounting is lost."""
    exchanged = str(rng.choice(true.sensors))
    known = true.with_calibration(None).parameters
    own = [n for n in knowledge.uncertain(true) if n.partition(".")[0] in true.sensors]
    names = [name for name in own if name.startswith(f"{exchanged}.")]
    new = {name: known[name].mean + known[name].sigma * rng.standard_normal() for name in names}
    steps = {name: value - true.parameters[name].value for name, value in new.items()}
    sizes = _one_of([{name: known[name].sigma} for name in own], true.r)
    return Event(steps, _told("sensor", sizes), exchanged=(exchanged,))


def _homed(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    offsets = _names(true, ".encoder_offset", "motor re-homed")
    step = {str(rng.choice(offsets)): life.homing * rng.standard_normal()}
    return Event(step, _told("home", _one_of([{n: life.homing} for n in offsets], len(offsets))))


def _payload(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    change = payload(true, known_effects(life), life.payload)
    if not (isinstance(change, Payload) and life.payload):
        return Event()
    return Event(told=(change,), load=change)


def _noisy(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    return Event(factor=life.ageing)


Happens = Callable[[Robot, Life, np.random.Generator], Event]
#: What happens to a robot, by name; `YEAR` is all of it.
SCENARIOS: dict[str, Happens] = {
    "unchanged": lambda true, life, rng: Event(),
    "warm day": _warm,
    STEEL: lambda true, life, rng: _warm(true, life, rng, STEEL),
    "wear": _wear,
    "backlash": _backlash,
    "collision": _collision,
    "sensor exchanged": _exchanged,
    "payload": _payload,
    "motor re-homed": _homed,
    "noisy sensors": _noisy,
    "a year": lambda true, life, rng: stages("a year", true, life, rng)[-1],
}
YEAR = "a year"
#: Order of the lasting events of a year. All days are warm; on the last there is a payload, too.
ORDER = ("collision", "motor re-homed", "sensor exchanged", "wear", "backlash")


def stages(scenario: str, true: Robot, life: Life, rng: np.random.Generator) -> list[Event]:
    """Return the states of a robot one after another: one, or those of a year."""
    if scenario != YEAR:
        return [SCENARIOS[scenario](true, life, rng)]
    lasting: list[Event] = []
    states = []
    for name in ORDER:
        lasting.append(SCENARIOS[name](true, life, rng))
        states.append(together([*lasting, _warm(true, life, rng)]))
    return [*states, together([states[-1], _payload(true, life, rng)])]
