"""Options that several commands share, and the messages they print."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument, Context, Option

from truepose import _core, files
from truepose.arguments import Array, Level, selected
from truepose.control.effects import Effects
from truepose.exceptions import InputError, PoseError, choose
from truepose.faults.disturbance import Disturbance
from truepose.faults.fault import FAULT_KINDS, Fault
from truepose.logs import writing
from truepose.robot import Robot, list_robots, load, summed
from truepose.robot.assumptions import exact_readings, told_exact
from truepose.robotfile import path_of, to_toml
from truepose.show import terminal
from truepose.show.terminal import Printing, say
from truepose.show.units import WRITTEN

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def completing(choices: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return a shell completion over the choices; without a match the shell offers files."""
    return lambda incomplete: [each for each in choices() if each.startswith(incomplete)]


RobotName = Annotated[
    str,
    Argument(
        metavar="ROBOT",
        help="A shipped robot's name, or a robot file.",
        autocompletion=completing(list_robots),
    ),
]
Seed = Annotated[
    int, Option(min=0, help="Seed of all random numbers; the same seed repeats a run.")
]
TrueRobot = Annotated[
    str,
    Option(
        help="True robot: sampled from the file's tolerances, nominal, or a robot's name or file.",
        autocompletion=completing(lambda: ("sampled", "nominal", *list_robots())),
    ),
]
SensorsOption = Annotated[
    str | None,
    Option(metavar="A,B*", help="Sensors in use: names or globs.", show_default="the file's"),
]
Columns = Annotated[
    str | None,
    Option(
        metavar="FORMULAS",
        help="Columns of the log with other names or units: 'q1 = A_steps * 0.005 mm, "
        "roll = imu * deg'.",
        show_default="q1 … qn and each sensor's name; SI",
    ),
]
Euler = Annotated[
    str | None,
    Option(
        metavar="ORDER",
        help="Order of the columns measured_roll, measured_pitch, measured_yaw (rad): ZYX is "
        "R_z(yaw) R_y(pitch) R_x(roll), as is xyz (about fixed axes).",
        show_default="ZYX",
    ),
]
ModelLevel = Annotated[
    Level | None,
    Option(
        help="ideal: one rod per chain; full: every rod separately.",
        show_default="full where it exists",
    ),
]
Poses = Annotated[
    Path | None,
    Option(
        help="CSV file of the poses to evaluate: a column for each coordinate, m and rad.",
        show_default="a grid over the workspace",
    ),
]
ReferencePose = Annotated[
    str | None,
    Option(metavar="X,Y,…", help="Once referenced at this externally known pose; m and rad."),
]
CalibratedFile = Annotated[
    Path | None, Option("-o", "--out", help="Calibrated robot file to write.")
]
Lean = Annotated[
    str | None,
    Option(
        metavar="ANGLE[,ANGLE]",
        help="σ of the base's (shank's) lean, and of each posture's: 1deg,0.2deg; with columns "
        "base_lean_x and base_lean_y, of the base IMU's bias.",
        show_default="1deg for flat postures, 0.2deg with base_lean_…, else 0",
    ),
]
wrote = terminal.wrote
Force = Annotated[bool, Option("--force", help="Replace an existing file.")]


def plot_option(what: str, hidden: bool = False) -> Any:
    """Return the option of a picture of `what`."""
    return Option(None, help=f"Also draw {what} (PNG, SVG, PDF).", hidden=hidden)


def effects_option(default: str, text: str, known: Sequence[str] = Effects.groups()) -> Any:
    """Return the option that :func:`effects_of` parses."""
    return Option(default, help=text, autocompletion=completing(lambda: ("all", "none", *known)))


def _fitting_kinds(incomplete: str) -> list[str]:
    """Complete READING:KIND; bash ends a word at the colon."""
    reading, colon, kind = incomplete.rpartition(":")
    return [f"{reading}:{known}" for known in FAULT_KINDS if colon and known.startswith(kind)]


_FAULT = "READING:KIND[=SIZE][@TIME[..END]]"
Faults = Annotated[
    list[str] | None,
    Option(
        "--fault",
        metavar=_FAULT,
        help="A fault that begins at TIME, s: theta:stuck@0.1. Kinds with a size: bias, "
        "jump, spike (rad or m), drift (rad/s or m/s), gain (a factor), delay (s), swap (the other "
        "reading), noise (rad or m), coarse (a factor), hold (s); without: stuck, dropout, sign, "
        "loose (contact). frame:stuck freezes all. "
        "Repeatable; isolation assumes a single fault.",
        autocompletion=_fitting_kinds,
    ),
]

_DISTURBANCE = "[MOTOR:]KIND=SIZE[@TIME[..END]]"
Disturbances = Annotated[
    list[str] | None,
    Option(
        "--disturbance",
        metavar=_DISTURBANCE,
        help="A disturbance of the true robot from TIME on, s: payload=2@0.1 (kg), "
        "q1:friction=3 (N·m or N), contact=300,0,0,0@0.1..0.12 (force on every coordinate, N and "
        "N·m). Repeatable.",
    ),
]


def given(context: Context) -> list[str]:
    """Return the long names of the options on the command line."""
    asked = (
        parameter.opts[-1]
        for parameter in context.command.params
        if (source := context.get_parameter_source(str(parameter.name)))
        and source.name == "COMMANDLINE"
    )
    return [name for name in asked if name.startswith("--")]


def refuse(given: Sequence[str], wrong: Collection[str], why: str) -> None:
    """Raise InputError if options were given that the command would ignore."""
    if extra := [name for name in given if name in wrong]:
        raise InputError(f"{', '.join(extra)}: {why}")


#: Kind of file and option, by the keyword of :meth:`Output.check`.
_OUTPUTS = {
    "log": ("log", ""),
    "plot": ("picture", "--plot"),
    "report": ("report", "--report"),
    "plan": ("plan", "-o"),
    "robot": ("robot file", "-o"),
    "truth": ("true robot", "--truth"),
}


@dataclass(kw_only=True)
class Output(Printing):
    """Options of a command that prints tables and writes files."""

    force: Force = False

    def check(self, inputs: Iterable[str | Path | None], **outputs: Path | None) -> None:
        """Check that files may be written."""
        self._read = paths(inputs)
        self._asked = {
            key: files.Output(path, *_OUTPUTS[key])
            for key, path in outputs.items()
            if path is not None
        }
        files.check(self._asked.values(), self._read, self.force)
        if log := outputs.get("log"):
            writing.require_ending(log)

    def write(self, **contents: Callable[[], str | list[writing.Column] | Figure]) -> None:
        """Write the files that :meth:`check` has a path of, each by its function."""
        made = {self._asked[key]: make() for key, make in contents.items() if key in self._asked}
        encoded = {output: _encoded(one, output.path) for output, one in made.items()}
        files.write(encoded, self._read, self.force)
        self.written = [output.path for output in made]


def _encoded(contents: str | list[writing.Column] | Figure, path: Path) -> str | bytes:
    if isinstance(contents, list):
        return writing.encoded(path, contents)
    return contents if isinstance(contents, str) else files.picture(contents, path.suffix)


def file_text(robot: Robot) -> str:
    """Return the robot file of a robot with its present parameters."""
    return to_toml(robot.spec, {name: p.value for name, p in robot.parameters.items()})


def paths(inputs: Iterable[str | Path | None]) -> list[Path]:
    """Return the paths of files and shipped robots that a command reads."""
    return [path_of(str(name)) for name in inputs if name is not None]


def over(poses: Array, file: Path | None, left_out: int) -> str:
    """Describe the poses of a prediction, of a file or a grid."""
    gone = f", {left_out} that are unreachable or singular left out" if left_out else ""
    return f"{len(poses)} poses of {file or 'a grid over the workspace'}{gone}"


def number_of(text: str) -> float:
    """Return the number in a text; NaN without one."""
    try:
        return float(text)
    except ValueError:
        return np.nan


def numbers_of(text: str) -> Array:
    """Return numbers separated by commas; NaN for other text."""
    return np.array([number_of(part) for part in text.split(",")])


def add(given: dict[Any, Any], key: Any, value: Any, said: str) -> None:
    """Add what an option states; raise InputError for a key that is there already."""
    if key in given:
        raise InputError(f"{said}: is given twice: give it once")
    given[key] = value


def count_or_file(text: str, option: str, most: int) -> int | Path:
    """Parse a number of poses, or else the name of a CSV file."""
    number = number_of(text)
    if np.isnan(number):
        return Path(text)
    if not text.isdigit() or not 1 <= number <= most:
        raise InputError(f"{option} {text}: must be a whole number from 1 to {most}, or a CSV file")
    return int(text)


def parse_set(robot: Robot, text: str) -> tuple[str, ...]:
    """Parse a sensor set: names or globs separated by commas, "none", or "all"."""
    names = [sensor.name for sensor in robot.spec.sensor]
    if not names and text not in ("all", "none"):
        raise InputError(f"{text}: {robot.name} has no sensor in its file")
    return selected("sensor", [part.strip() for part in text.split(",")], names)


def parse_pose(robot: Robot, text: str | None, name: str, reached: bool = True) -> Array | None:
    """Parse a pose, m and rad separated by commas; check by default that the robot reaches it."""
    if text is None:
        return None
    pose = numbers_of(text)
    if len(pose) != robot.n or not np.isfinite(pose).all():
        names = ",".join(c for c, _ in robot.coordinates)
        raise InputError(f"{name} {text}: must be {robot.n} numbers, {names} (m, rad)")
    if reached:
        try:
            robot.expected().ikm(pose)
        except PoseError as error:
            raise PoseError(f"{name} {text}: {error}") from None
    return pose


#: Units that options are written with: SI unit and factor.
UNITS = {"": ("", 1.0), **WRITTEN, "kg": ("kg", 1.0), "g": ("kg", 1e-3)}
UNITS |= {"degC": ("degC", 1.0), "°C": ("degC", 1.0), "K": ("K", 1.0)}


def with_unit(text: str) -> tuple[str, str, float]:
    """Split a text into its number, its SI unit and the factor into that; NaN if it is unknown."""
    number, unit = re.fullmatch(r"\s*(.*?)\s*([a-zA-Zµ°]*)\s*", text, re.DOTALL).groups()  # type: ignore[union-attr]
    return number, *UNITS.get(unit, ("", np.nan))


def written(*units: str) -> str:
    """Return how these SI units are written, separated by commas."""
    return ", ".join(name for name, (unit, _) in UNITS.items() if name and unit in units)


#: Descriptions of valid sizes, by their units.
_SIZES = {
    ("m", "rad"): "a length and an angle greater than 0 with units, as 0.02mm,0.01deg",
    ("m",): "a length greater than 0 with its unit, as 0.1mm",
    ("rad",): "an angle greater than 0 with its unit, as 0.1deg",
    ("",): "a number greater than 0",
}


def _sizes(text: str | None, option: str, units: tuple[str, ...]) -> dict[str, float]:
    result: dict[str, float] = {}
    for part in () if text is None else text.split(","):
        number, unit, factor = with_unit(part)
        value = factor * number_of(number)
        if unit not in units or not (0 < value < np.inf) or unit in result:
            known = f" (units: {written(*units)})" if units != ("",) else ""
            raise InputError(f"{option} {text}: must be {_SIZES[units]}{known}")
        result[unit] = value
    return result


def parse_sigmas(robot: Robot, text: str | None, option: str) -> tuple[float | None, float | None]:
    """Parse σ of measured lengths and angles, "0.02mm,0.01deg" or one of them, with units."""
    units = {unit for _, unit in robot.coordinates}
    result = _sizes(text, option, ("m", "rad"))
    if result.keys() - units:
        raise InputError(f"{option} {text}: {robot.name}'s coordinates are in {min(units)}")
    return result.get("m"), result.get("rad")


def parse_each(
    text: str | None, option: str, units: Sequence[str], whose: str
) -> list[float] | None:
    """Parse a length, an angle or both, as the units need; return the value for each unit."""
    if text is None:
        return None
    by = _sizes(text, option, ("m", "rad"))
    if by.keys() != set(units):
        every = " and ".join(sorted(set(units)))
        raise InputError(f"{option} {text}: {whose} {every}; give a value in {every}")
    return [by[unit] for unit in units]


def parse_size(text: str, option: str, unit: str) -> float:
    """Parse a length, "0.1mm", an angle, "0.1deg", or a plain number of another unit."""
    (value,) = _sizes(text, option, (unit if unit in ("m", "rad") else "",)).values()
    return value


def parse_lean(text: str | None) -> list[float] | None:
    """Parse σ of a lean, "1deg", or "1deg,0.2deg" with that of each posture; 0 needs no unit."""
    if text is None:
        return None
    parts = [part.strip() for part in text.split(",")]
    if len(parts) > 2:
        raise InputError(f"--lean {text}: must be one angle, or two (common, of each posture)")
    return [0.0 if number_of(part) == 0 else parse_size(part, "--lean", "rad") for part in parts]


def parse_target(robot: Robot, text: str | None) -> float | None:
    """Parse a target σ: a length, "0.1mm", or the angle of a rotational platform."""
    return None if text is None else parse_size(text, "--target", summed(robot).unit)


def load_with(robot: str, sensors: str | None) -> Robot:
    """Load a robot with these sensors of its file in use; None: those that the file uses."""
    loaded = load(robot)
    loaded = loaded if sensors is None else loaded.with_sensors(*parse_set(loaded, sensors))
    tell_exact(loaded, loaded.sensors)
    return loaded


def tell_exact(robot: Robot, sensors: Iterable[str]) -> None:
    """Print which motors and which of these sensors are taken as exact, if any."""
    names = {*robot.readings[: robot.m], *sensors}
    if exact := [one for one in exact_readings(robot, every=True) if one in names]:
        say(f"{robot.name}: {told_exact(exact)}", err=True)


def effects_of(text: str, known: Sequence[str] = Effects.groups()) -> Effects:
    """Parse effects: all, none, or names separated by commas."""
    words = {"all": known, "none": ()}
    names = words.get(text, [name.strip() for name in text.split(",")])
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"--effects: {choose('effect', unknown[0], ['all', 'none', *known])}")
    return Effects().only(*names)


_EVENT = re.compile(r"(?:([^:]+):)?([^:=@]+)(?:=([^@]*))?(?:@(.*?)(?:\.\.(.*))?)?")


def _event(
    option: str, form: str, text: str, needed: int, words: Collection[str] = ()
) -> tuple[str, str, list[Any], dict[str, Any]]:
    """Parse [WHO:]KIND[=SIZE][@TIME[..END]]; the size of kinds in `words` is a text."""
    found = _EVENT.fullmatch(text)
    if found is None or found[needed] is None:
        raise InputError(f"{option} {text}: must be {form}")
    who, kind, size, at, until = found.groups()
    many = [] if size is None else size.split(",") if kind == "contact" else [size]
    sizes = many if kind in words else [number_of(each) for each in many]
    times = {"at": number_of(at or "0"), "until": None if until is None else number_of(until)}
    if np.isnan([v for v in (*sizes, *times.values()) if isinstance(v, float)]).any():
        raise InputError(f"{option} {text}: size and times must be numbers: {form}")
    return who, kind, sizes, times


def faults_of(texts: Sequence[str] | None) -> list[Fault]:
    """Parse faults in the notation that :class:`Fault` prints."""
    pairs = [kind for kind, row in _core.fault_kinds.items() if row.pair]
    faults = []
    for text in texts or ():
        reading, kind, sizes, times = _event("--fault", _FAULT, text, 1, pairs)
        size = dict(zip(["other" if kind in pairs else "size"], sizes, strict=False))
        faults.append(Fault(reading, kind, **times, **size))  # type: ignore[arg-type]  # Fault checks it
    return faults


def disturbances_of(texts: Sequence[str] | None) -> list[Disturbance]:
    """Parse disturbances in the notation that :class:`Disturbance` prints."""
    disturbances = []
    for text in texts or ():
        motor, kind, sizes, times = _event("--disturbance", _DISTURBANCE, text, 3)
        size = {"force": tuple(sizes)} if kind == "contact" else {"size": sizes[0]}
        disturbances.append(Disturbance(kind, motor=motor, **times, **size))  # type: ignore[arg-type]
    return disturbances


def true_robot(robot: Robot, text: str, seed: int) -> Robot:
    """Return the true robot: sampled from the tolerances, nominal, or of a robot file."""
    if text == "nominal":
        return robot
    if text == "drawn":
        raise InputError("--true drawn: is called sampled since 0.6")
    if text != "sampled":
        return load(text).with_sensors(*robot.sensors)
    if not any(parameter.sigma for parameter in robot.parameters.values()):
        say(f"{robot.name}: the file has no tolerances; the true robot is nominal", err=True)
    return robot.sample(seed)


def of_log(error: InputError) -> str:
    """Return an error about readings as the command line says it after the log's name."""
    said = str(error).removeprefix("readings: ").replace("measured_sigma,", "--measured-sigma,")
    return re.sub(r"cause='(\w+)'", r"--cause \1", said)
