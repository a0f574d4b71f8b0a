"""A delta printer from its file: parameters, step distances, saved readings.

Units are m and rad. A *stable position*, Klipper's term, is the number of steps of each motor down
from its endstop; it identifies a pose of the machine for any parameters.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.exceptions import InputError, choose
from truepose.integrations.klipper.config import Config

MM, DEGREE = 1e-3, math.pi / 180
TOWERS = "abc"
KINEMATICS = ("delta", "rotary_delta")
#: Klipper's default angles of a linear delta's towers, degrees.
_ANGLES = (210.0, 330.0, 90.0)
#: Sections of devices that may probe the bed, with offsets.
_PROBES = ("probe", "bltouch", "smart_effector", "probe_eddy_current", "beacon", "cartographer")
#: Largest plausible difference between arms, m.
_APART = 5 * MM
_MOST = 999  #: most readings of each kind in Klipper
#: Prefixes of the readings' names, before their number.
HEIGHTS = ("manual_height", "height")
STEMS = (*HEIGHTS, "distance")
#: How to remove a reading: Klipper stops at the first missing number.
TAKE_OUT = "take it out and number those behind it on"


class Option(NamedTuple):
    """Place and unit of a parameter in the file."""

    section: str
    option: str
    unit: str  #: "m" or "rad", of this package
    scale: float  #: of the file's unit


def options(kinematics: str) -> dict[str, Option]:
    """Return the parameters of a kind of printer by their names in Klipper's log.

    Examples
    --------
    >>> from truepose.integrations.klipper.printer import options
    >>> options("delta")["arm_b"][:3]
    ('stepper_b', 'arm_length', 'm')
    """
    shared, arms = {"radius": "delta_radius"}, ["arm"]
    if kinematics != "delta":
        shared = {name: name for name in ("shoulder_radius", "shoulder_height")}
        arms = ["upper_arm", "lower_arm"]
    own = {"angle": "angle", **{arm: f"{arm}_length" for arm in arms}}
    own["endstop"] = "position_endstop"
    result = {name: Option("printer", option, "m", MM) for name, option in shared.items()}
    for name, option in own.items():
        unit, scale = ("rad", DEGREE) if name == "angle" else ("m", MM)
        for tower in TOWERS:
            result[f"{name}_{tower}"] = Option(f"stepper_{tower}", option, unit, scale)
    return result


@dataclass(frozen=True)
class Readings:
    """Measurements: H heights of the bed, D distances on a print."""

    heights: Array  #: (H,) of the nozzle above the bed at contact, m
    height_steps: Array  #: (H, 3) stable positions
    height_names: tuple[str, ...]  #: in the file
    probed: int  #: number of heights by probe; the others are manual
    distances: Array  #: (D,) m
    distance_steps: Array  #: (D, 2, 3)
    distance_names: tuple[str, ...]

    @property
    def steps(self) -> Array:
        """Stable positions of the heights, then of both ends of every distance, (H + 2 D, 3)."""
        return np.concatenate([self.height_steps, self.distance_steps.reshape(-1, 3)])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of heights and distances."""
        return self.height_names + self.distance_names

    def without(self, heights: Collection[int] = (), distances: Collection[int] = ()) -> Readings:
        """Return the readings without some of them."""
        h = [k for k in range(len(self.heights)) if k not in heights]
        d = [k for k in range(len(self.distances)) if k not in distances]
        by_hand = len(self.heights) - self.probed
        return Readings(
            self.heights[h],
            self.height_steps[h],
            tuple(self.height_names[k] for k in h),
            sum(k >= by_hand for k in h),
            self.distances[d],
            self.distance_steps[d],
            tuple(self.distance_names[k] for k in d),
        )

    def heights_only(self) -> Readings:
        """Return the heights without the distances."""
        return self.without(distances=range(len(self.distances)))


NO_READINGS = Readings(
    *(np.zeros(0), np.zeros((0, 3)), (), 0), *(np.zeros(0), np.zeros((0, 2, 3)), ())
)


@dataclass(frozen=True)
class Printer:
    """A printer as described by its file."""

    config: Config
    kinematics: str
    parameters: dict[str, float]  #: Klipper's, of :func:`options`; m, rad
    step: Array  #: (3,) motion of carriage or arm per step, m or rad
    readings: Readings
    radius: float  #: of the printed or probed bed, m
    notes: tuple[str, ...]  #: findings in the file

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(self.parameters)

    @property
    def values(self) -> Array:
        """Parameters in the order of their names."""
        return np.array(list(self.parameters.values()))

    @property
    def step_unit(self) -> float:
        """Display unit of a step: mm, or degrees of an arm."""
        return MM if self.kinematics == "delta" else DEGREE


def printer_of(config: Config, unread: bool = False) -> Printer:
    """Return the printer of a file; InputError names section, option, value and what is allowed.

    `unread`: readings are not needed.
    """
    kinematics = config.word("printer", "kinematics")
    if kinematics not in KINEMATICS:
        text = choose("kinematics", kinematics, KINEMATICS)
        raise InputError(f"{config.path}: [printer] kinematics: {text}")
    parameters = {
        name: option.scale * value
        for name, option in options(kinematics).items()
        for value in [_parameter(config, kinematics, name, option)]
    }
    _longer_than_the_radius(config, kinematics, parameters)
    step = [_step_distance(config, f"stepper_{t}", kinematics != "delta") for t in TOWERS]
    scale = MM if kinematics == "delta" else 1.0
    readings = NO_READINGS if unread else _readings(config, parameters)
    return Printer(
        config,
        kinematics,
        parameters,
        scale * np.array(step),
        readings,
        _radius(config, kinematics, parameters),
        tuple(_notes(config, kinematics)),
    )


def _parameter(config: Config, kinematics: str, name: str, option: Option) -> float:
    """Return one of Klipper's parameters in the file's unit, or its default."""
    section, key = option.section, option.option
    default = None
    if key == "angle" and kinematics == "delta":
        default = _ANGLES[TOWERS.index(name[-1])]
    elif key == "angle" and not config.has(section, key):
        text = "is missing (Klipper takes 30, 150, 270 for the three): write it"
        raise config.error(section, key, text)
    elif section in ("stepper_b", "stepper_c") and config.has("stepper_a", key):
        default = config.number("stepper_a", key)
    return config.number(section, key, default, above=None if key == "angle" else 0.0)


def _longer_than_the_radius(config: Config, kinematics: str, values: dict[str, float]) -> None:
    """Raise InputError for arms that do not reach the centre, as Klipper does."""
    for tower in TOWERS if kinematics == "delta" else ():
        arm, radius = values[f"arm_{tower}"] / MM, values["radius"] / MM
        if arm <= radius:
            own = config.has(f"stepper_{tower}", "arm_length")
            text = f"an arm of {arm:g} mm must be longer than delta_radius = {radius:g} mm"
            section = f"stepper_{tower}" if own else "stepper_a"
            raise config.error(section, "arm_length", f"{text}; are both mm?")


def _step_distance(config: Config, section: str, rotary: bool) -> float:
    """Return the motion of one step: mm, or rad of a rotary delta's arm."""
    geared = config.has(section, "gear_ratio")
    if config.has(section, "step_distance") and not (
        geared or config.has(section, "rotation_distance")
    ):
        return config.number(section, "step_distance", above=0)  # Klipper before 2021
    turn = 2 * math.pi if rotary else config.number(section, "rotation_distance", above=0)
    if rotary and not geared:
        config.word(section, "gear_ratio")
    steps = 1.0
    for option, default in (("full_steps_per_rotation", 200.0), ("microsteps", None)):
        count = config.number(section, option, default, above=0)
        if count != int(count):
            raise config.error(section, option, "must be a whole number")
        steps *= count
    return turn / (steps * (config.ratio(section, "gear_ratio") if geared else 1.0))


def _radius(config: Config, kinematics: str, values: dict[str, float]) -> float:
    """Return the radius of the bed: Klipper's probed one, else the printed one, else a guess."""
    for section, option in (("delta_calibrate", "radius"), ("printer", "print_radius")):
        if config.has(section, option):
            return MM * config.number(section, option, above=0)
    return 0.8 * values["radius"] if kinematics == "delta" else values["upper_arm_a"] / 2


def _readings(config: Config, parameters: dict[str, float]) -> Readings:
    section = "delta_calibrate"
    by_hand = list(_listed(config, "manual_height", ("",)))
    probed = list(_listed(config, "height", ("",)))
    distances = list(_listed(config, "distance", ("1", "2")))
    if not (by_hand or probed):
        what = "distances, but no heights" if distances else "no saved readings"
        odd = [*gaps(config, HEIGHTS), *filter(None, [unlike_arms(parameters)])]
        said = [f"{what}; DELTA_CALIBRATE and SAVE_CONFIG write them", *odd]
        raise InputError(f"{config.path}: [{section}]: {'. And '.join(said)}")
    heights = by_hand + probed
    readings = Readings(
        np.array([value for _, value, _ in heights]),
        np.array([at for _, _, at in heights])[:, 0],
        tuple(name for name, _, _ in heights),
        len(probed),
        np.array([value for _, value, _ in distances]),
        np.array([at for _, _, at in distances]).reshape(-1, 2, 3),
        tuple(name for name, _, _ in distances),
    )
    _repeated(config, readings)
    return readings


def has_readings(config: Config) -> bool:
    """Return whether a file has readings of any kind."""
    return any(_numbers(config, stem) for stem in STEMS)


def _listed(
    config: Config, stem: str, ends: tuple[str, ...]
) -> Iterator[tuple[str, float, list[tuple[float, ...]]]]:
    """Yield readings of a kind, numbered from 0 without a gap, as Klipper reads them."""
    section = "delta_calibrate"
    names = (f"{stem}{number}" for number in range(_MOST))
    for name in itertools.takewhile(lambda name: config.has(section, name), names):
        value = MM * config.number(section, name, above=0.0 if stem == "distance" else None)
        yield name, value, [config.numbers(section, f"{name}_pos{end}", 3) for end in ends]


def _repeated(config: Config, readings: Readings) -> None:
    """Raise InputError for a repeated stable position, which would count twice."""
    seen: dict[tuple, str] = {}
    for name, at in zip(
        readings.names, [*readings.height_steps, *readings.distance_steps], strict=True
    ):
        ends, text = sorted(map(tuple, at.reshape(-1, 3).tolist())), ""
        if len(ends) == 2 and ends[0] == ends[1]:
            text = "from a point to itself"
        elif (other := seen.setdefault(tuple(ends), name)) != name:
            text = f"at the same place as {other}, digit for digit"
        if text:
            raise InputError(f"{config.path}: [delta_calibrate] {name}: {text}: {TAKE_OUT}")


def _notes(config: Config, kinematics: str) -> Iterator[str]:
    """Yield notes on the file."""
    if config.included:
        shown = ", ".join(config.included[:5]) + ", …" * (len(config.included) > 5)
        yield f"included files are not read: {shown}"
    if config.broken:
        yield (
            f"line {config.broken} stands in what SAVE_CONFIG wrote and is no part of it: Klipper "
            "reads none of that block then"
        )
    relevant = [(option.section, option.option) for option in options(kinematics).values()]
    relevant += [("delta_calibrate", name) for name in config.values.get("delta_calibrate", {})]
    for section, option in dict.fromkeys(relevant):
        if (saved := config.twice(section, option)) is not None:
            counts = config.word(section, option)
            yield (
                f"[{section}] {option} stands twice: {counts} counts, as in Klipper, and not the "
                f"saved {saved}"
            )
    yield from gaps(config)


def _numbers(config: Config, stem: str) -> set[int]:
    """Return the numbers of a kind's readings in the file, even those that Klipper ignores."""
    names = config.values.get("delta_calibrate", {})
    return {int(n[1]) for name in names if (n := re.fullmatch(rf"{stem}(\d{{1,3}})", name))}


def gaps(config: Config, stems: tuple[str, ...] = STEMS) -> Iterator[str]:
    """Yield each missing number among the readings of a kind."""
    for stem in stems:
        found = _numbers(config, stem)
        gap = next(k for k in range(len(found) + 1) if k not in found)
        if any(k > gap for k in found):
            last = stem + str(max(found))
            yield f"{stem}{gap} is missing: as in Klipper none behind it counts, {last} neither"


def unlike_arms(parameters: dict[str, float]) -> str | None:
    """Return a message if the arms differ implausibly, else None.

    Examples
    --------
    >>> from truepose.integrations.klipper.printer import unlike_arms
    >>> unlike_arms({"arm_a": 0.2880, "arm_b": 0.2884, "arm_c": 0.2879})
    >>> unlike_arms({"arm_a": 0.214, "arm_b": 0.391, "arm_c": 0.288})[:50]
    'arms of 214.0, 391.0, 288.0 mm differ by 177 mm: n'
    """
    lengths = [value for name, value in parameters.items() if name.startswith(("arm_", "lower_"))]
    apart = max(lengths) - min(lengths)
    if apart <= _APART:
        return None
    listed = ", ".join(f"{value / MM:.1f}" for value in lengths)
    return (
        f"arms of {listed} mm differ by {apart / MM:.0f} mm: no printer's rods do. They are where "
        "a criterion went along what its readings do not see"
    )


def probe_offset(config: Config) -> tuple[str, tuple[float, float, float]] | None:
    """Return the probe's section and its offset from the nozzle, m; None without a probe."""
    for section in _PROBES:
        if section in config.values:
            x, y, z = (MM * config.number(section, f"{axis}_offset", 0.0) for axis in "xyz")
            return section, (x, y, z)
    return None
