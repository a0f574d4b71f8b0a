"""What is one case of a study? A robot as drawn, a true one, and a point of the grid."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from truepose.exceptions import InputError, TrueposeError
from truepose.robot.robot import Robot
from truepose.simulation.true_robots import with_tolerance_errors

#: What a function may answer with for one name.
Answer = float | int | str | bool
Asked = Callable[["Case"], Mapping[str, Answer]]
#: Columns that every study has beside those of its grid and of its function.
OWN = ("robot", "number", "error")


@dataclass(frozen=True)
class Case:
    """One robot to be asked. Everything random of it comes from its seed."""

    robot: Robot  #: as drawn
    number: int  #: of the true robot, from 0
    values: Mapping[str, Any]  #: of the grid
    seed: np.random.SeedSequence  #: the same at every point of the grid: like is compared with like

    @property
    def true(self) -> Robot:
        """The robot as it is: drawn from its file's tolerances."""
        return with_tolerance_errors(self.robot, self.seed.spawn(1)[0])

    @property
    def rng(self) -> np.random.Generator:
        """For whatever else is random: poses, noise. Anew at every call."""
        return np.random.default_rng(self.seed)


@dataclass(frozen=True)
class Cases:
    """All cases of a study, each by its index: true robots of a kind follow one another last."""

    robots: tuple[Robot, ...]
    grid: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.robots:
            raise InputError("study: no robots")
        for name, values in self.grid.items():
            if name in OWN:
                raise InputError(f"study: grid: '{name}' is the name of a column of every study")
            if not len(values):
                raise InputError(f"study: grid: {name}: no values")

    @property
    def each(self) -> int:
        """How many cases there are for one true robot of each kind."""
        return len(self.robots) * int(np.prod([len(v) for v in self.grid.values()], dtype=int))

    def __getitem__(self, index: int) -> Case:
        number, rest = divmod(index, self.each)
        kind, point = divmod(rest, self.each // len(self.robots))
        points = itertools.product(*self.grid.values())
        values = dict(zip(self.grid, next(itertools.islice(points, point, None)), strict=True))
        seed = np.random.SeedSequence(self.seed, spawn_key=(kind, number))
        return Case(self.robots[kind], number, values, seed)

    def ask(self, function: Asked, start: int, stop: int) -> list[dict[str, Answer]]:
        """Ask about some cases. What a robot refuses is a row, too; what else fails names the case.

        Raises
        ------
        InputError
            The function fails otherwise, or answers with anything but names and numbers.
        """
        return [self._row(function, self[index], index) for index in range(start, stop)]

    def _row(self, function: Asked, case: Case, index: int) -> dict[str, Answer]:
        row: dict[str, Answer] = {"robot": case.robot.name, "number": case.number, **case.values}
        where = f"study: case {index} ({', '.join(f'{k} {v}' for k, v in row.items())})"
        try:
            answer = function(case)
        except TrueposeError as error:
            return {**row, "error": str(error)}
        except Exception as error:
            raise InputError(f"{where}: {type(error).__name__}: {error}") from error
        if not isinstance(answer, Mapping):
            raise InputError(f"{where}: answer {answer!r}: must be a mapping of names to numbers")
        for name, value in answer.items():
            if name in row or name in OWN:
                raise InputError(f"{where}: '{name}' is the name of another column")
            if not isinstance(value, Answer | np.generic):
                raise InputError(f"{where}: {name} = {value!r}: must be a number or a word")
        plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in answer.items()}
        return {**row, **plain, "error": ""}
