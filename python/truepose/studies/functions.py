"""Functions that a study evaluates: shipped ones and those of a file."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truepose import files, moved
from truepose.arguments import Array, whole
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.calibration.options import CalibrationOptions
from truepose.exceptions import InputError, choose
from truepose.plugins import plugins
from truepose.robot import LAWS, Law, Robot, angles, workspace_samples
from truepose.simulation.equilibrium import steady_state
from truepose.studies.cases import Answer, Asked, Case

#: Poses of a built-in function: for its results, and by default for calibration.
ASKED, LEARNT = 25, 40


def rest(case: Case) -> dict[str, Answer]:
    """Return the rms steady-state error over 25 poses: by law, or of the grid's key `law`."""
    robot, true = case.robot, case.true
    poses = workspace_samples(robot, ASKED, case.rng)
    laws: tuple[Law, ...] = ("joint", "tej", "weighted", "estimated")
    asked = [case.values["law"]] if "law" in case.values else laws if robot.r else laws[:1]
    answer: dict[str, Answer] = {}
    for law in asked:
        of = "rest" if "law" in case.values else law
        answer |= _rms(robot, steady_state(robot, true, poses, law) - poses, of)
    return answer


def calibration(case: Case) -> dict[str, Answer]:
    """Return error and bound over 25 poses after a calibration at 40, or the grid's `poses`."""
    robot, true, rng = case.robot, case.true, case.rng
    others, noise = workspace_samples(robot, ASKED, rng), rng.integers(2**31, size=2)
    learnt = workspace_samples(robot, case.values.get("poses", LEARNT), rng)
    options = CalibrationOptions(cause="ignore")
    fit = calibrate(robot, true.read(learnt, int(noise[0])), options=options)
    found = fit.robot.estimate(true.read(others, int(noise[1]))).x
    bound = accuracy(robot, others, calibrated_on=learnt)
    answer = _rms(robot, found - others, "calibrated")
    return answer | _rms(robot, np.sqrt(np.einsum("kii->ki", bound)), "bound")


READY: dict[str, Asked] = {"calibration": calibration, "rest": rest}


def require_keys(
    function: Asked, grid: Mapping[str, Sequence[object]], robots: Sequence[Robot]
) -> None:
    """Raise InputError for a grid key, or a value, that a function of a name cannot use.

    Those of packages check it themselves, by a method ``check_grid(grid, robots)``.
    """
    if check := getattr(function, "check_grid", None):
        check(grid, robots)
    keys: dict[Asked, str] = {calibration: "poses", rest: "law"}
    if (known := keys.get(function)) is None:
        return
    where = f"study {function.__name__}: grid"
    for key, value in ((key, value) for key, values in grid.items() for value in values):
        if key != known:
            raise InputError(f"{where}: {choose('key', key, [known])}")
        if key == "law" and not callable(value) and value not in LAWS:
            raise InputError(f"{where}: {choose('law', value, LAWS)}")
        if key == "poses":
            whole(f"{where}: poses", value, 1)


def _rms(robot: Robot, off: Array, of: str) -> dict[str, Answer]:
    turns, mean = angles(robot), (off**2).mean(axis=0)
    return {
        f"{of}_{unit}": float(factor * np.sqrt(mean[which].sum()))
        for which, factor, unit in ((~turns, 1e3, "mm"), (turns, 180 / np.pi, "deg"))
        if which.any()
    }


@dataclass(frozen=True)
class OfFile:
    """A function of a Python file. Workers get its text and need no such file."""

    path: str
    name: str
    text: str

    @property
    def __name__(self) -> str:
        return f"{self.path}:{self.name}"

    def __call__(self, case: Case) -> dict[str, Answer]:
        """Evaluate one case."""
        return dict(_compiled(self)(case))


@functools.cache
def _compiled(of: OfFile) -> Asked:
    space: dict[str, object] = {"__name__": "truepose_study", "__file__": of.path}
    try:
        exec(compile(of.text, of.path, "exec"), space)
    except Exception as error:
        raise InputError(f"{of.path}: {type(error).__name__}: {error}") from error
    found = space.get(of.name)
    if not callable(found):
        names = [n for n, v in space.items() if callable(v) and not n.startswith("_")]
        raise InputError(f"{of.path}: {choose('function', of.name, names)}")
    return found


def function_of(word: str) -> Asked:
    """Return a function by its name, built in or of a package, or that of "file.py:name"."""
    path, colon, name = word.rpartition(":")
    if not colon:
        if word in READY:
            return READY[word]
        found = plugins("studies")
        if word in moved.STUDIES and word not in found:
            raise InputError(moved.where(f"study {word}", moved.STUDIES[word]))
        if word not in found:
            raise InputError(f"{choose('function', word, [*READY, *found])}, or file.py:function")
        return found[word].load()
    asked = OfFile(path, name, files.text(Path(path)))
    _compiled(asked)  # fail before the study starts
    return asked
