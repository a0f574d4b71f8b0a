"""Causes that explain a log: a wrong part, a mistake in its columns or rows."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from truepose.arguments import Array
from truepose.show import Cell, Shown, Table

Verdict = Literal["none", "decisive", "undecided", "unexplained"]


class Cause(NamedTuple):
    """One explanation of a log."""

    kind: str  #: of the table of causes; two where one mistake alone does not explain the log
    text: str  #: what is wrong, with its size
    log_odds: float  #: natural logarithm of its odds against no mistake
    consistent: bool  #: whether the log agrees with the robot if this is so
    size: float | None = None  #: of the last mistake: m, rad or a factor, where it has one
    sigma: float | None = None  #: of the size


@dataclass(frozen=True, repr=False)
class Causes(Shown):
    """What explains a log best, most probable first.

    A set that the log cannot tell apart, but that gives the same poses, is one explanation.
    """

    verdict: Verdict
    found: tuple[Cause, ...] = ()
    alike: int = 0  #: number of the first causes that give the same poses
    near: int = 0  #: number of the first causes whose odds are too near to decide
    separating: Array | None = None  #: (n,) pose that separates the first two explanations best

    @property
    def text(self) -> str:
        """The finding in one line; empty where there is none."""
        if self.verdict == "none":
            return ""
        first = " or ".join(cause.text for cause in self.found[: max(self.alike, 1)][:4])
        if self.verdict == "unexplained":
            likely = bool(first) and self.found[0].log_odds > 0
            return "no known cause explains the readings" + f"; nearest: {first}" * likely
        odds = self.found[0].log_odds / np.log(10)
        said = f"{first} (odds 10^{odds:.0f} against no mistake)"
        if self.verdict == "decisive":
            return said
        others = " or ".join(cause.text for cause in self.found[self.alike : self.near][:3])
        said = f"{said}, or {others}"
        if self.separating is None:
            return said
        pose = ", ".join(f"{v:.3g}" for v in self.separating)
        return f"{said}; readings at pose ({pose}) separate them"

    def __repr__(self) -> str:
        return self.text or "no cause: readings and robot agree"

    def table(self) -> Table:
        """Return every cause with its size and odds."""
        rows = [
            [
                cause.text,
                cause.kind,
                Cell(f"{cause.log_odds / np.log(10):.1f}", cause.log_odds),
                "yes" if cause.consistent else "no",
            ]
            for cause in self.found
        ]
        header = ["what is wrong", "cause", "log10 odds", "explains the log"]
        return Table("causes", "Causes that explain the readings", header, rows)


NO_CAUSE = Causes("none")
