"""The workbench's answers as small HTML tables."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from truepose.exceptions import one_line
from truepose.robot import Law, Robot, in_print, summed
from truepose.robot.kinematics import Conditioning
from truepose.show import PRINT, number, printed
from truepose_workbench.answers import Rest
from truepose_workbench.state import State

#: Style of all parts, on the page once. On narrow screens viser's panel has unused space beside it
#: and little height: make it as wide as the screen and half as high.
STYLE = """<style>
.answer { padding: 0.2em 0.9em; font-size: 0.82em; line-height: 1.45 }
.answer table { width: 100%; border-collapse: collapse }
.answer :is(td, th) { padding: 0 0.45em 0 0; text-align: right; font-variant-numeric: tabular-nums }
.answer :is(td, th):first-child { text-align: left }
.answer td { font-weight: 400 }
.answer th { font-weight: 600 }
.answer div { margin-top: 0.3em; opacity: 0.8 }
.answer div.wrong { color: #d55e00; opacity: 1 }
.answer i { display: inline-block; width: 0.7em; height: 0.7em; border: 2px solid;
  border-radius: 50%; margin-right: 0.4em }
.answer svg { width: 100%; height: auto; display: block; margin-top: 0.4em }
.answer svg text { fill: currentColor; font-size: 10px }
.answer .bar { display: inline-block; height: 0.7em; background: #0072b2 }
.answer .bars td { text-align: left; white-space: nowrap }
.answer .bars td:first-child { width: 1px; padding-right: 0.6em }
.answer .scale { height: 0.8em; opacity: 1 }
.answer .ends { display: flex; justify-content: space-between }
@media (max-width: 40em) {
  .mantine-Paper-root[style*='bottom: 0px'] { width: 100% !important; max-height: 50% !important }
  .mantine-Paper-root[style*='bottom: 0px'] .mantine-ScrollArea-content > div {
    width: 100% !important }
}
</style>"""


def page(*parts: str) -> str:
    """Stack parts, as wide as the panel."""
    return f'<div class="answer">{"".join(parts)}</div>'


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out rows of HTML cells; the first column is text."""
    lines = [("th", header), *(("td", row) for row in rows)]
    parts = ["".join(f"<{tag}>{cell}</{tag}>" for cell in cells) for tag, cells in lines]
    return f"<table><tr>{'</tr><tr>'.join(parts)}</tr></table>"


def verdict(robot: Robot, law: str, errors: tuple[float, float, float], over: int, on: int) -> str:
    """Compare the error before and after a calibration with the bound predicted beforehand."""
    total = summed(robot)
    factor, unit = PRINT[total.unit]
    cells = [f"<b>{number(factor * error)}</b>" for error in errors]
    header = [f"{total.name} error ({unit})", "before", "after", "predicted"]
    about = f"rms over {over} poses, law {law}; calibrated on {on} poses; predicted: bound, 1 σ"
    return table(header, [["calibration", *cells]]) + note(about)


def dot(colour: str, hollow: bool = False) -> str:
    """Draw a disc, or a ring."""
    inside = "transparent" if hollow else colour
    return f'<i style="background: {inside}; border-color: {colour}"></i>'


def note(text: str | Exception, wrong: bool = False) -> str:
    """Write a line of text; errors stand out."""
    if isinstance(text, Exception):
        text, wrong = one_line(text, 300), True
    return f'<div class="{"wrong" if wrong else "note"}">{escape(text)}</div>'


def line(text: str | Exception) -> str:
    """Write a line alone, as wide as the panel."""
    return page(note(text))


def laws(found: Mapping[Law, Rest], colours: Mapping[str, str]) -> str:
    """Return position and orientation error of each law at steady state."""
    rows, failed = [], []
    for law, rest in found.items():
        name = dot(colours[law], rest.x is None) + escape(law)
        if rest.x is None:
            rows.append([name, "–", "–"])
            failed.append(note(rest.why))
        else:
            off = 1e3 * float(np.linalg.norm(rest.off))
            rows.append([name, number(off, 3), number(float(np.degrees(rest.turn)), 3)])
    # Show one reason only: the others are equal or similar.
    return table(["steady state", "off (mm)", "turned (°)"], rows) + "".join(failed[:1])


def conditioning(at: Conditioning) -> str:
    """Return the conditioning of the nacelle and of the worst chain."""
    worst = int(np.argmin(at.serial))
    return note(
        f"Conditioning {float(at.parallel):.2f}, of chain {worst + 1} "
        f"{float(at.serial[worst]):.2f} (0 singular)"
    )


def pose(state: State, magnified: float) -> str:
    """Return the nacelle's target."""
    words = [
        f"{name} {printed(value, unit, '.1f')}"
        for value, (name, unit) in zip(state.x_d, state.robot.coordinates, strict=True)
    ]
    drawn = f"; errors shown × {magnified:g}" if magnified != 1 and state.errors else ""
    return note(f"Target {', '.join(words)}{drawn}")


def errors(state: State, most: int = 6) -> str:
    """List the parameters that differ from nominal."""
    found = state.errors
    if not found:
        return note("The true robot is nominal.")
    words = []
    for name, value in list(found.items())[:most]:
        factor, unit = in_print(state.drawn, name)
        words.append(f"{name} {factor * value:+.3f}{unit}")
    more = f", … {len(found) - most} more" if len(found) > most else ""
    return note(f"{len(found)} off: {', '.join(words)}{more}")
