"""Data of a figure as records."""

from collections.abc import Iterator
from typing import Any

from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure


def plotted(figure: Figure) -> list[dict[str, object]]:
    """Return one record per point of a plane figure's lines, bars and outlines of areas."""
    names: dict[str, str] = {}  # of series by color, which names those without a label
    records: list[dict[str, object]] = []
    for panel, axes in enumerate((axes for axes in figure.axes if axes.name != "3d"), 1):
        beside = axes.get_shared_x_axes().get_siblings(axes)
        name_x = axes.get_xlabel() or max(each.get_xlabel() for each in beside) or "x"
        beside = axes.get_shared_y_axes().get_siblings(axes)
        name_y = axes.get_ylabel() or max(each.get_ylabel() for each in beside) or "y"
        for kind, label, colour, points in _series(axes):
            series = to_hex(colour)
            if not label.startswith(("_child", "_container", "_nolegend")):
                names.setdefault(series, label.lstrip("_"))
                series = label.lstrip("_")
            place = {"panel": panel, "title": axes.get_title(), "kind": kind, "series": series}
            records += [place | {name_x: float(x), name_y: float(y)} for x, y in points]
    return [record | {"series": names.get(str(s := record["series"]), s)} for record in records]


def _series(axes: Any) -> Iterator[tuple[str, str, Any, Any]]:
    """Yield kind, label, colour and points; lines across a panel are left out."""
    for line in (line for line in axes.lines if line.get_transform() == axes.transData):
        yield "line", str(line.get_label()), line.get_color(), line.get_xydata()
    for area in (area for area in axes.collections if isinstance(area, PolyCollection)):
        yield "area", str(area.get_label()), area.get_facecolor()[0], area.get_paths()[0].vertices
    for bars in (bars for bars in axes.containers if hasattr(bars, "patches")):
        tops = [(bar.get_x() + bar.get_width() / 2, bar.get_height()) for bar in bars]
        yield "bar", bars.get_label(), bars[0].get_facecolor(), tops
