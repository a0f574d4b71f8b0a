"""Functions that a study evaluates: shipped ones and those of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.exceptions import InputError, choose
from truepose.files import contents
from truepose.robot.laws import LAWS, Law
from truepose.robot.robot import Robot
from truepose.robot.workspace import workspace
from truepose.simulation.equilibrium import steady_state
from truepose.studies.cases import Answer, Asked, Case

#: Poses of a built-in function: for its results, and by default for calibration.
ASKED, LEARNT = 25, 40


def rest(case: Case) -> dict[str, Answer]:
    """Return the steady-state error of a true robot: rms over 25 poses of its workspace.

    Under each built-in law, or under the law of the grid's key `law`, a name or a function.
    """
    robot, true = case.robot, case.true
    poses = _poses(robot, ASKED, case.rng)
    laws: tuple[Law, ...] = ("joint", "tej", "weighted", "estimated")
    asked = [case.values["law"]] if "law" in case.values else laws if robot.r else laws[:1]
    answer: dict[str, Answer] = {}
    for law in asked:
        of = "rest" if "law" in case.values else law
        answer |= _rms(robot, steady_state(robot, true, poses, law) - poses, of)
    return answer


def calibration(case: Case) -> dict[str, Answer]:
    """Return the error after a calibration at 40 poses, rms over 25 others, and its bound.

    The grid's key `poses` sets another number of calibration poses; the 25 others stay the same.
    """
    robot, true, rng = case.robot, case.true, case.rng
    others, noise = _poses(robot, ASKED, rng), rng.integers(2**31, size=2)
    learnt = _poses(robot, case.values.get("poses", LEARNT), rng)
    fit = calibrate(robot, true.read(learnt, int(noise[0])))
    found = fit.robot.estimate(true.read(others, int(noise[1]))).x
    bound = accuracy(robot, others, calibrated_on=learnt)
    answer = _rms(robot, found - others, "calibrated")
    return answer | _rms(robot, np.sqrt(np.einsum("kii->ki", bound)), "bound")


READY: dict[str, Asked] = {"calibration": calibration, "rest": rest}
#: Grid keys of the built-in functions, and each key's least whole number.
KEYS: dict[str, dict[str, int]] = {"calibration": {"poses": 1}, "rest": {"law": 0}}


def require_keys(function: Asked, grid: Mapping[str, Sequence[object]]) -> None:
    """Raise InputError for a grid key, or a value, that a built-in function cannot use.

    Examples
    --------
    >>> require_keys(calibration, {"banana": [1]})
    Traceback (most recent call last):
        ...
    truepose.exceptions.InputError: study calibration: grid: unknown key 'banana' (choices: poses)
    """
    name = next((name for name, ready in READY.items() if ready is function), "")
    if name not in KEYS:
        return
    known = KEYS[name]
    for key, values in grid.items():
        if key not in known:
            raise InputError(f"study {name}: grid: {choose('key', key, known)}")
        for value in values if key == "law" else ():
            if not callable(value) and value not in LAWS:
                raise InputError(f"study {name}: grid: {choose('law', value, LAWS)}")
        for value in values if key != "law" else ():
            if not isinstance(value, int | np.integer) or value < known[key]:
                raise InputError(
                    f"study {name}: grid: {key} = {value}: must be a whole number of at least "
                    f"{known[key]}"
                )


def _poses(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    box = workspace(robot)
    return rng.uniform(box.minimum, box.maximum, (count, robot.n))


def _rms(robot: Robot, off: Array, of: str) -> dict[str, Answer]:
    angles = np.array([unit == "rad" for _, unit in robot.coordinates])
    answer: dict[str, Answer] = {}
    for which, factor, unit in ((~angles, 1e3, "mm"), (angles, 180 / np.pi, "deg")):
        if which.any():
            square = (off[:, which] ** 2).sum(axis=1).mean()
            answer[f"{of}_{unit}"] = float(factor * np.sqrt(square))
    return answer


@dataclass(frozen=True)
class OfFile:
    """A function of a Python file. Workers get its text and need no such file."""

    path: str
    name: str
    text: str

    @property
    def __name__(self) -> str:
        return f"{self.path}:{self.name}"

    @cached_property
    def _function(self) -> Asked:
        space: dict[str, object] = {"__name__": "truepose_study", "__file__": self.path}
        try:
            exec(compile(self.text, self.path, "exec"), space)
        except Exception as error:
            raise InputError(f"{self.path}: {type(error).__name__}: {error}") from error
        found = space.get(self.name)
        if not callable(found):
            names = [n for n, v in space.items() if callable(v) and not n.startswith("_")]
            raise InputError(f"{self.path}: {choose('function', self.name, names)}")
        return found

    def __call__(self, case: Case) -> dict[str, Answer]:
        """Evaluate one case."""
        return dict(self._function(case))

    def __getstate__(self) -> dict[str, str]:
        return {"path": self.path, "name": self.name, "text": self.text}

    def __setstate__(self, state: dict[str, str]) -> None:
        self.__dict__.update(state)


def function_of(word: str) -> Asked:
    """Return a built-in function by its name, or the function of "file.py:name"."""
    path, colon, name = word.rpartition(":")
    if not colon:
        if word not in READY:
            raise InputError(f"{choose('function', word, READY)}, or file.py:function")
        return READY[word]
    try:
        asked = OfFile(path, name, contents(Path(path)).decode())
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "no text"
        raise InputError(f"{path}: cannot be read: {why}") from None
    _ = asked._function  # fail before the study starts
    return asked
