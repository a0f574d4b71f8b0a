"""Events of the life-cycle study: what changes of a robot, and what may be known of it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from truepose.arguments import Array
from truepose.control.effects import Effects
from truepose.exceptions import InputError
from truepose.robot import Robot, knowledge
from truepose.robot.conditions import reading_offsets
from truepose_life.changes import Change, Payload, Steps, payload, warm_up_modes
from truepose_life.rates import Life

#: Robots and the poses, (N, n), at which they are the true one.
There = list[tuple[Robot, Array]]
STEEL, YEAR = "warm day, steel rods", "a year"


@dataclass(frozen=True)
class Event:
    """One state of one robot's life, as a change of the commissioned robot."""

    steps: Steps = field(default_factory=dict)  #: m or rad by parameter
    told: tuple[Change, ...] = ()  #: kind and size of the changes, which an observer may know
    load: Payload | None = None
    sides: Steps = field(default_factory=dict)  #: half a backlash: on either side at each pose
    exchanged: tuple[str, ...] = ()  #: sensors, of which the owner tells the calibrator
    factor: float = 1.0  #: σ of the sensors' readings over that of new ones

    def true_at(self, true: Robot, x: Array, rng: np.random.Generator, rest: bool) -> There:
        """Return the changed robots at poses x, (N, n).

        At rest readings are exact; of noisy sensors, all readings then have their noise.
        """
        if self.load is None and not self.sides and self.factor == 1:
            return [(moved(true, self.steps), x)]
        offsets = reading_offsets(true)
        added = np.zeros((len(x), len(offsets)))
        if self.load is not None:
            added += self.load.roots(offsets, x)[..., 0]
        if self.factor != 1:  # counts are added by reading
            factors = np.array([1.0] * true.m + [self.factor] * true.r)
            factors = factors if rest else np.sqrt(np.maximum(factors**2 - 1, 0))
            added += factors * knowledge.reading_sigma(true) * rng.standard_normal(added.shape)
        found = []
        for row, pose in zip(added.tolist(), x, strict=True):
            sides = {name: half * rng.choice((-1, 1)) for name, half in self.sides.items()}
            steps = total([self.steps, dict(zip(offsets, row, strict=True)), sides])
            found.append((moved(true, steps), pose[None]))
        return found


def moved(robot: Robot, steps: Steps) -> Robot:
    """Return the robot with some parameters stepped."""
    known = robot.parameters
    return robot.replace({name: known[name].value + step for name, step in steps.items()})


def together(events: Sequence[Event]) -> Event:
    """Return one event that is several at once, with new sensors."""
    return Event(
        steps=total([event.steps for event in events]),
        told=tuple(change for event in events for change in event.told),
        load=next((event.load for event in events if event.load is not None), None),
        sides=total([event.sides for event in events]),
        exchanged=tuple(sensor for event in events for sensor in event.exchanged),
    )


def total(steps: Sequence[Steps]) -> Steps:
    """Return the sum of steps by parameter."""
    found: Steps = {}
    for each in steps:
        found |= {name: found.get(name, 0.0) + step for name, step in each.items()}
    return found


def known_effects(life: Life, scenario: str = "") -> Effects:
    """Return the effects that the owner knows of: materials, stiffness, a day's warm-up."""
    return Effects(
        warm_up=life.warm_up,
        base_expansion=life.base_expansion,
        arm_expansion=life.arm_expansion,
        rod_expansion=life.steel if scenario == STEEL else life.rod_expansion,
        arm_stiffness=life.arm_stiffness,
    )


def _told(name: str, sizes: Steps, parts: int = 1) -> tuple[Change, ...]:
    """Return the change of each parameter by itself, or of one of many parts, as sizes state it."""
    modes = tuple({n: size / math.sqrt(parts)} for n, size in sizes.items() if size)
    return (Change(name, modes),) if modes else ()


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
        chains = sorted({name.partition(".")[0] for name in mode})
        share = {chain: 1 + gradient * rng.standard_normal() for chain in chains}
        steps |= {name: share[name.partition(".")[0]] * step for name, step in mode.items()}
    modes = tuple(warm_up_modes(growth, gradient))
    return Event(steps, (Change("warm-up", modes),) if modes else ())


def _wear(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    steps, sizes = {}, {}
    for name in knowledge.uncertain(true):
        if name.endswith(".rod"):
            steps[name] = rng.uniform(0, life.wear)
            sizes[name] = life.wear / math.sqrt(3)  # rms of a uniform variable
        elif name.endswith(".encoder_offset"):
            steps[name] = life.drift * rng.standard_normal()
            sizes[name] = life.drift
    return Event(steps, _told("wear", sizes))


def _backlash(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    sides = {n: life.backlash / 2 for n in knowledge.uncertain(true) if n.endswith(".rod")}
    geared = [sensor.name for sensor in true.spec.used if sensor.geared]
    return Event(sides=sides | {f"{name}.offset": life.gear_backlash / 2 for name in geared})


def _collision(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    """Bend a rod: of a pair, one of the two."""
    rods = _names(true, ".rod", "collision")
    rod = rng.choice(rods)
    short, side = -life.collision * rng.uniform(0.5, 1.5), rng.choice((-1, 1))
    steps, sizes = {rod: short}, dict.fromkeys(rods, life.collision)
    if (difference := f"{rod}_difference") in knowledge.uncertain(true):
        steps = {rod: short / 2, difference: side * short}
        sizes = dict.fromkeys(rods, life.collision / 2)
        sizes |= {f"{name}_difference": life.collision for name in rods}
    return Event(steps, _told("collision", sizes, len(rods)))


def _exchanged(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    """Exchange a sensor: all that is known of its mounting is lost."""
    exchanged = rng.choice(true.sensors)
    known = true.with_calibration(None).parameters
    own = [n for n in knowledge.uncertain(true) if n.partition(".")[0] in true.sensors]
    names = [name for name in own if name.startswith(f"{exchanged}.")]
    new = {name: known[name].mean + known[name].sigma * rng.standard_normal() for name in names}
    steps = {name: value - true.parameters[name].value for name, value in new.items()}
    told = _told("sensor", {name: known[name].sigma for name in own}, true.r)
    return Event(steps, told, exchanged=(exchanged,))


def _homed(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    offsets = _names(true, ".encoder_offset", "motor re-homed")
    step = {rng.choice(offsets): life.homing * rng.standard_normal()}
    return Event(step, _told("home", dict.fromkeys(offsets, life.homing), len(offsets)))


def _payload(true: Robot, life: Life, rng: np.random.Generator) -> Event:
    change = payload(true, known_effects(life), life.payload)
    if not (isinstance(change, Payload) and life.payload):
        return Event()
    return Event(told=(change,), load=change)


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
    "noisy sensors": lambda true, life, rng: Event(factor=life.ageing),
    YEAR: lambda true, life, rng: stages(YEAR, true, life, rng)[-1],
}
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
