"""A tab of the workbench's panel."""

from __future__ import annotations

from truepose.integrations.workbench.page import Page
from truepose.integrations.workbench.state import State


class Tab:
    """A tab of the panel."""

    def __init__(self, page: Page):
        self.page = page

    def follow(self, state: State) -> None:
        """Show the state, after a change from elsewhere."""

    def tick(self, now: float) -> None:
        """Advance the animation to the time `now`."""
