"""Options of predictions: where accuracy counts, conditions, what is done before, the criterion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from typer import Option

from truepose.arguments import Array
from truepose.commands import options
from truepose.design.criterion import Criterion, Measure
from truepose.design.where import Use, practice, volume_poses
from truepose.exceptions import InputError, choose
from truepose.logs.reading import read_poses
from truepose.robot import Robot, reading_units

#: Largest number of poses of a self-calibration.
MOST = 10_000

ConditionsOption = Annotated[
    str | None,
    Option(
        "--conditions",
        metavar="payload=0..2kg,temperature=15..35degC",
        help="Uncertain conditions at work: payload, payload_sigma, payload_centre_sigma, "
        "temperature, warm_up, gradient, wear; backlash of the motors; or none.",
        show_default="the file's",
    ),
]
#: SI unit by key; backlash has that of the motors.
_UNITS = {
    "payload": "kg",
    "payload_sigma": "kg",
    "payload_centre_sigma": "m",
    "temperature": "degC",
    "warm_up": "K",
    "gradient": "K",
    "wear": "m",
}
_RANGES = ("payload", "temperature")


def under(robot: Robot, text: str | None) -> Robot:
    """Return the robot under the conditions of the option."""
    if text == "none":
        return robot.with_file(conditions=None)
    given: dict[str, Any] = {}
    units = _UNITS | {"backlash": reading_units(robot)[0]}
    for part in map(str.strip, text.split(",") if text else ()):
        key, _, value = part.partition("=")
        if key not in units:
            raise InputError(f"--conditions: {choose('condition', key, units)}")
        numbers, unit, factor = options.with_unit(value)
        ends = [factor * options.number_of(end) for end in numbers.split("..")]
        ranged = key in _RANGES
        if len(ends) != 1 + ranged or unit != units[key] or not np.isfinite(ends).all():
            form = f"{key}={'LOW..HIGH' if ranged else 'NUMBER'} with a unit"
            known = options.written(units[key])
            raise InputError(f"--conditions {part}: must be {form}: {known}")
        if min(ends) < 0 and key != "temperature":
            raise InputError(f"--conditions {part}: must be 0 or greater")
        options.add(given, key, tuple(ends) if ranged else ends[0], f"--conditions {key}")
    changed = robot.with_conditions(**given) if given else robot
    section = changed.spec.conditions
    if given.get("payload_centre_sigma") and section and not section.heaviest:
        raise InputError("--conditions payload_centre_sigma: needs a payload, as payload=0..2kg")
    return changed


@dataclass(frozen=True, kw_only=True)
class Where:
    """Options that state where accuracy counts, and the reference pose."""

    poses: Annotated[
        Path | None,
        Option(
            help="CSV file of the poses where accuracy counts.", show_default="over the workspace"
        ),
    ] = None
    volume: Annotated[
        str | None,
        Option(
            metavar="z=-450mm..-0.4m,…",
            help="Instead: 32 poses of this part of the workspace, all of which the robot must "
            "reach.",
        ),
    ] = None

    reference_pose: options.ReferencePose = None

    def use(self, robot: Robot) -> Use:
        """Return the use that these options state."""
        pose = options.parse_pose(robot, self.reference_pose, "--reference-pose")
        return Use(poses=self._over(robot), reference_pose=pose)

    def _over(self, robot: Robot) -> Array | None:
        if self.poses is not None and self.volume is not None:
            raise InputError("--poses, --volume: name one of them")
        if self.volume is not None:
            units = dict(robot.coordinates)
            return volume_poses(robot, parse_ranges(self.volume.split(","), "--volume", units))
        return None if self.poses is None else read_poses(robot, self.poses, reached=True)


@dataclass(frozen=True, kw_only=True)
class UseOptions(Where):
    """Options of a :class:`Use`."""

    calibrated: Annotated[
        str | None,
        Option(metavar="N|CSV", help="After self-calibration on N poses, or those of a CSV file."),
    ] = None

    def use(self, robot: Robot) -> Use:
        """Return the use that these options state."""
        use = super().use(robot)
        if self.calibrated is None:
            return use
        given = options.count_or_file(self.calibrated, "--calibrated", MOST)
        if isinstance(given, int):
            return replace(use, calibrated_on=practice(robot, given))
        return replace(use, calibrated_on=read_poses(robot, given, reached=True))


@dataclass(frozen=True, kw_only=True)
class CriterionOptions:
    """Options of a :class:`Criterion`."""

    confidence: Annotated[
        str, Option(metavar="PERCENT|sigma", help="Share of the robots that keep the error; or σ.")
    ] = "95%"
    measure: Annotated[
        Measure,
        Option(
            help="Over the poses; at the worst pose; pose accuracy or repeatability (ISO 9283)."
        ),
    ] = "rms"

    def criterion(self) -> Criterion:
        """Return the criterion: of a share of robots, "95%", or "sigma"."""
        if self.confidence == "sigma":
            return Criterion(self.measure, None)
        share = options.number_of(self.confidence.removesuffix("%")) / 100
        if not self.confidence.endswith("%") or not 0.5 <= share < 1:
            raise InputError(
                f"--confidence {self.confidence}: must be 50% to less than 100%, or sigma"
            )
        return Criterion(self.measure, share)


def parse_ranges(
    texts: Sequence[str], option: str, units: Mapping[str, str]
) -> dict[str, tuple[float, float]]:
    """Parse ranges of coordinates, NAME=LOW..HIGH, with units by name; m without one."""
    result: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, box = text.partition("=")
        if box and units and name.strip() not in units:
            raise InputError(f"{option}: {choose('coordinate', name.strip(), units)}")
        unit = units.get(name.strip(), "m")
        ends = map(options.with_unit, box.partition("..")[::2])
        low, high = (
            factor * options.number_of(number) if of in ("", unit) else np.nan
            for number, of, factor in ends
        )
        if not low <= high < np.inf or low == -np.inf:
            example = "-200mm..0.1m" if unit == "m" else "-30deg..30deg"
            raise InputError(f"{option} {text}: must be COORDINATE=LOW..HIGH, as {example}")
        options.add(result, name.strip(), (low, high), f"{option} {name.strip()}")
    return result
