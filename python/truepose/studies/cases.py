"""Cases of a study: a nominal robot, a true one, a point of the grid."""

import math
from collections import UserDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from truepose.control.controller import law_name
from truepose.exceptions import InputError, TrueposeError
from truepose.robot import Robot

#: Value that a function may return for one name.
Answer = float | int | str | bool
Asked = Callable[["Case"], Mapping[str, Answer]]
#: Columns of every study, beside those of its grid and of its function.
OWN = ("case", "robot", "number", "error")


class Values(UserDict[str, Any]):
    """One point of a grid; records which keys were read."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self.read: set[str] = set()

    def __getitem__(self, key: str) -> Any:
        self.read.add(key)
        return self.data[key]


@dataclass(frozen=True)
class Case:
    """One robot of a study; its seed determines everything random."""

    robot: Robot  #: nominal
    number: int  #: of the true robot, from 0
    values: Mapping[str, Any]  #: of the grid
    seed: np.random.SeedSequence  #: the same at every point of the grid, for paired comparison

    @cached_property
    def true(self) -> Robot:
        """True robot, sampled from its file's tolerances: the same at each access."""
        key = (*self.seed.spawn_key, 0)
        return self.robot.sample(np.random.SeedSequence(self.seed.entropy, spawn_key=key))

    @cached_property
    def rng(self) -> np.random.Generator:
        """Random generator of the case, for poses and noise; it continues at each access."""
        return np.random.default_rng(self.seed)


@dataclass(frozen=True)
class Cases:
    """All cases of a study by index; points of the grid vary fastest, true robots slowest."""

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
        """Number of cases for one true robot of each kind."""
        return len(self.robots) * math.prod(map(len, self.grid.values()))

    def __getitem__(self, index: int) -> Case:
        shape = (len(self.robots), *(len(values) for values in self.grid.values()))
        number, rest = divmod(index, self.each)
        kind, *places = map(int, np.unravel_index(rest, shape))
        chosen = zip(self.grid.items(), places, strict=True)
        values = {name: choices[k] for (name, choices), k in chosen}
        # The first child is the true robot's own: `case.seed.spawn` begins with the second.
        seed = np.random.SeedSequence(self.seed, spawn_key=(kind, number), n_children_spawned=1)
        return Case(self.robots[kind], number, values, seed)

    def ask(self, function: Asked, start: int, stop: int) -> list[dict[str, Answer]]:
        """Evaluate some cases; an error of truepose is a row, any other an InputError."""
        return [self._row(function, index) for index in range(start, stop)]

    def _row(self, function: Asked, index: int) -> dict[str, Answer]:
        case = self[index]
        row: dict[str, Answer] = {"robot": case.robot.name, "number": case.number}
        row |= {k: law_name(v) if callable(v) else v for k, v in case.values.items()}
        read = Values(case.values)
        where = f"study: case {index} ({', '.join(f'{k} {v}' for k, v in row.items())})"
        try:
            answer = function(replace(case, values=read))
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
        if unread := [key for key in case.values if key not in read.read]:
            used = ", ".join(key for key in case.values if key in read.read) or "none"
            raise InputError(
                f"{where}: grid: unknown key '{unread[0]}': the function reads {used} of "
                "case.values; leave the key out, or read it in every case"
            )
        plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in answer.items()}
        return {**row, **plain, "error": ""}
