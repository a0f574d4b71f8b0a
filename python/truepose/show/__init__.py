"""Presentation: tables, pages, drawings, the terminal."""

from truepose.show.charts import lines, ranges
from truepose.show.results import Shown, ShownArray, figure_of
from truepose.show.table import Cell, Table, as_csv, fixed, number, tabled
from truepose.show.units import PRINT, measured, named, printed

__all__ = [
    "PRINT",
    "Cell",
    "Shown",
    "ShownArray",
    "Table",
    "as_csv",
    "figure_of",
    "fixed",
    "lines",
    "measured",
    "named",
    "number",
    "printed",
    "ranges",
    "tabled",
]
