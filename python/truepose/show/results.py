"""Results that show themselves: as text, as an HTML table, as a figure."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from truepose.show.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_of(draw: Callable[[Any], object]) -> Figure:
    """Return a figure into which this has drawn."""
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained")
    draw(figure)
    return figure


class Shown:
    """Base of results: each has a table and a figure; the texts follow from the table."""

    def table(self) -> Table:
        """Return the figures that matter; pandas and polars make a DataFrame of it."""
        raise NotImplementedError

    def plot(self) -> Figure:
        """Draw the result."""
        return figure_of(self._draw)

    def _draw(self, figure: Any) -> None:
        raise NotImplementedError

    def __repr__(self) -> str:
        from truepose.show.terminal import laid_out

        return "\n".join(laid_out(self.table(), 100))

    def _repr_html_(self) -> str | None:
        from truepose.show.page import table_html

        return table_html(self.table())


class ShownArray(Shown, np.ndarray):
    """An array that shows itself; results of arithmetic and indexing are plain arrays."""

    def __new__(cls, values: np.ndarray, **about: Any) -> Self:  # noqa: D102
        array = np.asarray(values).view(cls)
        array.__dict__.update(about)
        return array

    def __getitem__(self, key: Any) -> Any:
        return np.asarray(self)[key]

    def __array_wrap__(self, array: np.ndarray, *_: Any) -> Any:
        return np.asarray(array)[()]

    def __repr__(self) -> str:
        return repr(np.asarray(self))

    def _repr_html_(self) -> str | None:
        return super()._repr_html_() if self.__dict__ else None  # a view of it is an array only
