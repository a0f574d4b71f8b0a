"""Pictures of results on the pages. `make pictures` draws them anew."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import truepose as tp
from truepose.robot.parts import COLOURS
from truepose.robot.workspace import workspace_grid
from truepose.show.charts import LAW_COLOURS
from truepose.show.table import as_csv

PICTURES = Path(__file__).parents[1] / "pictures"
DRAWN, REAL, CALIBRATED = "#5b6770", "#b3261e", "#1b7837"
JOINT, TEJ, CARTESIAN = (LAW_COLOURS[law] for law in ("joint", "tej", "cartesian"))
WIDE = 4.6  #: inches: readable on a phone


def _tools(axes, nominal: tp.Robot, real: tp.Robot, q: np.ndarray) -> np.ndarray:
    """Draw a five-bar, nominal and real, at the same motor angles; return its real tool."""
    for robot, colour, style in ((nominal, DRAWN, "--"), (real, REAL, "-")):
        tool = robot.fkm(q)
        for k, chain in enumerate(robot.spec.chain):
            base = np.array(chain.base[:2])
            elbow = base + chain.arm * np.array([np.cos(q[k]), np.sin(q[k])])
            axes.plot(*np.transpose([base, elbow, tool]), style, color=colour, lw=2)
            axes.plot(*elbow, "o", color=colour, ms=4)
            axes.plot(*base, "s", color="black", ms=9)
        axes.plot(*tool, "o", color=colour, ms=8, zorder=4)
    return tool


def five_bar() -> Figure:
    """Two motors read right, and the tool is elsewhere: one rod 30 mm too long, to be seen."""
    drawn = tp.load("five-bar")
    real = drawn.replace({"chain1.rod": drawn.parameters["chain1.rod"].value + 0.03})
    q = drawn.ikm(drawn.home)
    figure = Figure(figsize=(4.6, 3.6), layout="constrained")
    axes = figure.subplots()
    _tools(axes, drawn, real, q)
    axes.text(-0.005, 0.245, "where the model\nhas the tool", color=DRAWN, ha="center", va="top")
    axes.text(0.045, 0.325, "where it is", color=REAL)
    axes.text(-0.135, 0.265, "rod 1,\ntoo long", color=REAL, ha="right")
    axes.text(0, 0, "motors", ha="center", va="center")
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.margins(0.08)
    return figure


#: The five-bar with a draw-wire, and rods of a workshop; all assumed.
WIRED = """
based_on = "five-bar"
name = "five-bar with a draw-wire"
sensors = ["wire"]

[[sensor]]
name = "wire"
kind = "distance"
origin = [0.15, 0.45, 0]
resolution = 20e-6

[tolerances]
"chain*.rod" = { sigma = 0.0015 }
"""


def before_after() -> Figure:
    """A five-bar with one rod 3 mm too long, and its error before and after calibration."""
    with TemporaryDirectory() as folder:
        file = Path(folder, "wired.toml")
        file.write_text(WIRED, encoding="utf-8")
        nominal = tp.load(file)
    rod, box = nominal.parameters["chain1.rod"].value, nominal.spec.workspace
    real = nominal.replace({"chain1.rod": rod + 0.003})
    poses = np.random.default_rng(0).uniform(box.minimum, box.maximum, (40, 2))
    found = tp.calibrate(nominal, real.read(poses, seed=1)).robot
    figure = Figure(figsize=(5, 3), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.1))

    wire, q = np.array(nominal.spec.sensor[0].origin[:2]), nominal.ikm(nominal.home)
    longer = nominal.replace({"chain1.rod": rod + 0.03})
    tool = _tools(left, nominal, longer, q)
    left.plot(*np.transpose([wire, tool]), ":", color=COLOURS["sensor"], lw=2)
    left.plot(*wire, "o", color=COLOURS["sensor"], ms=6)
    left.text(0.12, 0.38, "sensor", color=COLOURS["sensor"])
    left.text(0, -0.04, "motors as commanded", ha="center", va="top")
    left.text(-0.02, 0.35, "real tool", color=REAL, ha="right")
    left.text(0.0, 0.225, "model", color=DRAWN, ha="center")
    left.set_title("One rod is too long\n(error drawn × 10)", fontsize=10)
    left.set_aspect("equal")
    left.set_axis_off()
    left.margins(0.02, 0.06)

    turn = np.linspace(0, 2 * np.pi, 181)
    circle = nominal.home + 0.045 * np.transpose([np.cos(turn), np.sin(turn)])
    runs = (("before", nominal, REAL, 2.15), ("calibrated", found, CALIBRATED, 0.35))
    for name, robot, colour, at in runs:
        error = 1e3 * np.linalg.norm(tp.steady_state(robot, real, circle, "joint") - circle, axis=1)
        right.plot(np.degrees(turn), error, color=colour, lw=2, label=name)
        rms = f"{np.sqrt((error**2).mean()):.2f} mm rms"
        right.text(
            180, at, f"{name}\n{rms}", color=colour, ha="center", va="bottom", linespacing=1.3
        )
    right.set_title("Error of the tool (mm)", fontsize=10)
    right.set_xlabel("place on a circle (°)")
    right.set_xticks(range(0, 361, 90))
    right.set_ylim(0)
    right.grid(color="0.92")
    return figure


def rest() -> Figure:
    """Where three laws come to rest: motors' error along j, and θ's."""
    h4, x_d = tp.load("h4"), np.array([0.05, 0.05, -0.40, 0.20])
    real = h4.replace({"chain3.rod": 0.483})
    j = h4.jacobian(x_d)[3]
    slope = np.linalg.norm(j)
    laws = {
        "joint": ("usual control:\nmotors right", JOINT, (-86, 4)),
        "tej": ("TEJ: nearest to 0", TEJ, (-108, 6)),
        "cartesian": ("Cartesian: θ right", CARTESIAN, (-108, -14)),
    }
    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes = figure.subplots()
    along = np.linspace(-0.8, 0.62, 2)
    for law, (name, colour, place) in laws.items():
        x = tp.steady_state(h4, real, x_d, law)
        e_q, e_theta = np.degrees((h4.ikm(x_d) - real.ikm(x)) @ j) / slope, np.degrees(x_d - x)[3]
        if law == "joint":
            axes.plot(along, slope * along, color=DRAWN, ls="--", lw=1.5)
            axes.plot(along, e_theta + slope * along, color="black", lw=1.5)
        if law == "tej":
            axes.plot([0, e_q], [0, e_theta], color=TEJ, lw=1.5)
        axes.plot(e_q, e_theta, "o", color=colour, ms=8, zorder=3)
        axes.annotate(name, (e_q, e_theta), place, textcoords="offset points", color=colour)
    axes.text(0.38, 1.0, "poses of\nthe model", color=DRAWN)
    axes.text(-0.36, 1.1, "poses of\nthe real robot", color="black", ha="right")
    axes.axhline(0, color="black", lw=0.6)
    axes.axvline(0, color="black", lw=0.6)
    axes.set_aspect("equal")
    axes.set_xlim(-1.7, 1.3)
    axes.set_ylim(-0.6, 2.2)
    axes.set_xlabel("error of the motors along j (degrees)")
    axes.set_ylabel("error of θ (degrees)")
    return figure


def over_table_2() -> Figure:
    """One robot sampled from its tolerances at the 625 poses: θ and position under three laws."""
    h4 = tp.load("h4")
    poses, true = workspace_grid(h4), h4.sample(seed=1)
    usual, tej = (tp.steady_state(h4, true, poses, law) for law in ("joint", "tej"))
    learnt = tp.calibrate(h4, true.extended_positions(usual)).robot
    found = tp.steady_state(learnt, true, poses, "cartesian")
    figure = Figure(figsize=(WIDE, 5.4), layout="constrained")
    left, right = figure.subplots(2, 1)
    share = 100 * np.arange(1, len(poses) + 1) / len(poses)
    runs = (("usual", usual, JOINT), ("TEJ", tej, TEJ), ("self-calibrated", found, "black"))
    for name, x, colour in runs:
        error = np.abs(x - poses)
        position = 1e3 * np.linalg.norm(error[:, :3], axis=1)
        left.semilogx(np.sort(np.degrees(error[:, 3])), share, color=colour, label=name)
        right.semilogx(np.sort(position), share, color=colour)
    left.set_xlabel("error of θ (degrees)")
    right.set_xlabel("error of the position (mm)")
    for axes in (left, right):
        axes.set_ylabel("share of poses below (%)")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.grid(color="0.92")
    left.legend(loc="upper left", fontsize=9, frameon=False)
    return figure


class Oblique:
    """Axes that draw points of space: x to the right, y to the back, z up."""

    def __init__(self, figure: Figure) -> None:
        self.axes = figure.add_axes((0, 0, 1, 1))
        self.view = np.array([[1, -0.3, 0], [-0.1, 0.48, 1]])

    def line(self, *points, **style) -> None:
        """Draw a line through points."""
        self.axes.plot(*(self.view @ np.transpose(points)), **style)

    def arrow(self, start, end, colour) -> None:
        """Draw an arrow between two points."""
        style = {"arrowstyle": "-|>", "mutation_scale": 17, "shrinkA": 0, "shrinkB": 0}
        style |= {"color": colour, "lw": 1.8}
        self.axes.annotate("", self.view @ end, self.view @ start, arrowprops=style, zorder=9)

    def arc(self, centre, start, end, radius, colour) -> None:
        """Draw the arc of the angle between two directions."""
        start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
        angle, share = np.arccos(start @ end), np.linspace(0, 1, 40)[:, None]
        way = np.sin((1 - share) * angle) * start + np.sin(share * angle) * end
        self.line(*(centre + radius * way / np.sin(angle)), color=colour, lw=1.6, zorder=8)

    def label(self, text, at, off=(0, 0), **style) -> None:
        """Write a text at a point, shifted by points of print."""
        style = {"ha": "center", "va": "center", "size": 18, "zorder": 12} | style
        self.axes.annotate(text, self.view @ at, off, textcoords="offset points", **style)


def chain() -> Figure:
    """Draw one chain of a Schoenflies robot with the symbols of the closure equation."""
    figure = Figure(figsize=(7.2, 5.3))
    draw = Oblique(figure)
    e, u, down = np.array([[1, 0, 0], [0, 1, 0], [0, 0, -1]])  # down: u×e
    q, theta, O, P, D = 0.42, 0.6, np.zeros(3), 0.2 * e, np.array([-0.16, 0, -0.45])
    forward = e * np.cos(q) + down * np.sin(q)
    B, c = P + 0.3 * forward, 0.2 * np.array([np.cos(theta), np.sin(theta), 0])
    A = D + c - 0.23 * u
    plane = A - B - u * (u @ (A - B))  # the rod in the plane of the arm
    parts = ("base", "motor", "arm", "rod", "lateral bar", "central bar", "tool")
    grey, motor, arm, rod, bar, platform, angle = (COLOURS[part] for part in parts)

    plate = [(-0.16, -0.12, 0), (0.26, -0.12, 0), (0.26, 0.2, 0), (-0.16, 0.2, 0)]
    draw.axes.fill(*(draw.view @ np.transpose(plate)), color=grey, alpha=0.2, lw=0)
    draw.line(P - 0.05 * u, P + 0.05 * u, color=motor, lw=15, solid_capstyle="round")
    draw.line(P, B, color=arm, lw=5)
    draw.line(B - 0.06 * u, B + 0.06 * u, color=arm, lw=3)
    draw.line(A - 0.06 * u, D + c, color=bar, lw=5)
    draw.line(D - c, D + c, color=platform, lw=8, solid_capstyle="round")
    for side in (-0.06, 0.06):
        draw.line(B + side * u, A + side * u, color=rod, lw=2.5)
    draw.line(B, A, color=rod, lw=1.2, ls="--")
    for start, way in ((B, 0.16 * forward), (B, 0.5 * plane), (D, 0.2 * e)):
        draw.line(start, start + way, color=grey, lw=1.2, ls="--")
    draw.arc(P, e, forward, 0.15, angle)
    draw.arc(B, forward, plane, 0.11, angle)
    draw.arc(B, plane, A - B, 0.22, angle)
    draw.arc(D, e, c, 0.13, angle)
    for start, way, colour in (
        *((O, 0.1 * axis, grey) for axis in (e, u, -down)),
        *((P, way, motor) for way in (0.17 * u, 0.22 * e)),
        *((D, c, "black"), (D + c, A - D - c, "black"), (O, D, platform)),
    ):
        draw.arrow(start, start + way, colour)
    for name, at, off in (("P", P, (-6, -24)), ("B", B, (18, 12)), ("A", A, (-20, -10))):
        draw.line(at, color="black", marker="o", ms=8, zorder=11)
        draw.label(name, at, off, weight="bold")
    draw.line(D, color="black", marker="o", ms=8, zorder=11)
    for name, at, off, colour in (
        *(("x", 0.12 * e, (0, 0), grey), ("y", 0.12 * u, (0, 0), grey)),
        *(("z", -0.12 * down, (0, 0), grey), ("O", O, (-12, -8), grey)),
        *(("u", P + 0.17 * u, (-4, 14), motor), ("e", P + 0.22 * e, (12, 4), motor)),
        *(("l", P + 0.25 * forward, (10, 14), arm), ("L", (A + B) / 2, (16, -40), rod)),
        *(("q", P + 0.175 * e, (-2, -18), angle), ("θ", D + 0.15 * e, (0, -16), angle)),
        *(("R c", D + 0.5 * c, (-4, 18), "black"), ("a", D + c - 0.1 * u, (14, 8), "black")),
    ):
        draw.label(name, at, off, color=colour, style="italic")
    for name, at, off, colour in (
        ("base", np.array([0.06, -0.09, 0]), (0, 0), grey),
        ("D = (x, y, z)", D / 2, (-62, 0), platform),
        ("moving platform", D - c, (62, -24), platform),
        ("rod_in_plane", B + 0.11 * forward, (-14, -56), angle),
        ("rod_lateral", B + 0.42 * plane, (-18, 28), angle),
    ):
        draw.label(name, at, off, color=colour, size=14)
    draw.axes.set_aspect("equal")
    draw.axes.set_axis_off()
    draw.axes.margins(0.07)
    return figure


DRAWN_BY = (chain, five_bar, before_after, rest, over_table_2)


def points(figure: Figure) -> Iterator[dict]:
    """Yield a record of each point of a figure's lines, but for those across a panel."""
    names: dict[str, str] = {}  # of series by colour, which names those without a label
    for panel, axes in enumerate(figure.axes, 1):
        name_y = axes.get_ylabel() or figure.axes[0].get_ylabel()
        for line in (line for line in axes.lines if line.get_transform() == axes.transData):
            label, colour = str(line.get_label()), to_hex(line.get_color())
            series = names.setdefault(colour, colour if label.startswith("_child") else label)
            place = {"panel": panel, "title": "", "kind": "line", "series": series}
            for x, y in line.get_xydata():
                shown = {axes.get_xlabel(): float(f"{x:.7g}"), name_y: float(f"{y:.7g}")}
                yield place | shown


def main() -> None:
    """Draw them all, with their points as CSV; the same files each time."""
    mpl.rcParams["svg.hashsalt"] = "truepose"
    PICTURES.mkdir(exist_ok=True)
    for draw in DRAWN_BY:
        file = PICTURES / f"{draw.__name__.replace('_', '-')}.svg"
        figure = draw()
        figure.savefig(file, metadata={"Date": None})
        if draw not in (chain, five_bar):  # drawings
            file.with_suffix(".csv").write_text(as_csv(points(figure)), encoding="utf-8")
        print(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file)


if __name__ == "__main__":
    main()
