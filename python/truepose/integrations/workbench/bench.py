"""The interface between the workbench's page and its tabs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Protocol

from truepose.arguments import Array
from truepose.integrations.workbench.state import State
from truepose.robot.laws import Law


class Shown(Protocol):
    """The scene, for what moves by itself."""

    def show_robot(self, state: State, x: Array | None, magnified: float, coloured: bool) -> None:
        """Draw the true robot at x beside its ghost."""

    def show_rests(self, state: State, found: dict, magnified: float) -> None:
        """Mark where laws take the nacelle."""

    def show_gizmos(self, wanted: bool) -> None:
        """Show what is dragged."""


class Bench(Protocol):
    """The page: a state that hands change, one change at a time."""

    state: State
    law: Law
    magnified: float
    how: str | None
    coloured: bool
    mapped: bool
    moving: bool

    @property
    def scene(self) -> Shown:
        """What is drawn."""

    def when(self, handle: Any, do: Callable[[Any], None]) -> Any:
        """Do something with a handle's value whenever a hand changes it."""

    def pressed(self, handle: Any, do: Callable[[], None]) -> None:
        """Do something whenever a button is pressed."""

    def doing(self) -> AbstractContextManager[None]:
        """Change something, alone, and show it."""

    def send(self, state: State) -> None:
        """Take over a state in which the nacelle was sent elsewhere."""

    def show(self) -> None:
        """Show the state."""

    def dress(self, dark: bool) -> None:
        """Choose a dark page or a light one."""


class Tab:
    """A tab of the panel."""

    def __init__(self, page: Bench):
        self.page = page

    def follow(self, state: State) -> None:
        """Show the state; a hand did not do it."""

    def tick(self, now: float) -> None:
        """Take a step of what moves by itself."""
