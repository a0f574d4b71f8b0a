"""The most useful next readings: heights of the bed, distances on a print.

Candidates are heights over the whole bed and distances between possible pillars. Selected are those
that minimise the σ of the nozzle over the bed with the estimate's assumptions and results.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from truepose.design.candidates import CandidatePoses, reachable
from truepose.design.pose_plan import PosePlan
from truepose.design.poses import plan_poses
from truepose.exceptions import InputError
from truepose.integrations.klipper.assessment import Assessment, drawn_of, fitting
from truepose.integrations.klipper.config import Config
from truepose.integrations.klipper.criterion import adjusted
from truepose.integrations.klipper.estimate import (
    Assumed,
    Estimate,
    Prior,
    differences,
    estimate,
    prior,
)
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.printer import MM, NO_READINGS, Printer, printer_of
from truepose.integrations.klipper.prints import disc
from truepose.integrations.klipper.review import assumptions, mm
from truepose.show.table import Cell, Table, fixed

#: Labels of the plan's candidates, and Klipper's names.
_WHAT, _STABLE = {"plane": "height", "distances": "distance"}, ("pos1", "pos2")
#: Shortest useful distance on a print, m.
_SHORTEST = 20 * MM


def next_readings(found: Assessment, count: int) -> Table:
    """Return the next readings to take."""
    planned = _planned(found.printer, found.prior, found.estimate.assumed, count, found.estimate)
    return _table([planned], found.model, found.printer, "What to read next")


def first_readings(config: Config, count: int, arm: float | None = None) -> tuple[Table, list[str]]:
    """Return the readings to take first, and the assumptions; InputError for an invalid file."""
    printer = printer_of(config, unread=True)
    assumed, model = Assumed(), drawn_of(printer)
    with fitting(config, "", arm):
        known = prior(model, printer, assumed, arm)
    enough = len(adjusted(printer.kinematics, extended=False)) + 1
    plans = [_planned(printer, known, assumed, min(count, enough), heights_only=True)]
    if count > enough:
        touched = np.concatenate([step.poses for step in plans[0].steps])
        steps, names = model.steps(known.mean, touched), tuple(map(str, range(enough)))
        read = replace(NO_READINGS, heights=touched[:, 2], height_steps=steps, height_names=names)
        then = estimate(model, read, known, assumed)  # σ does not depend on their values
        plans.append(_planned(printer, known, assumed, count - enough, then))
    table = _table(plans, model, printer, "What to read first")
    before = (
        f"Heights come first, {enough} of them, one more than Klipper adjusts parameters by: "
        "before that nothing can be printed"
    )
    return table, [before, *assumptions(known, assumed)]


def points_text(planned: Table | None, found: Assessment | None) -> str:
    """Return the planned heights as DELTA_CALIBRATE's points, with the probed ones before.

    DELTA_CALIBRATE replaces the heights that it probed earlier, but none read by hand.
    """
    before = np.zeros((0, 3))
    if found is not None and (probed := found.printer.readings.probed):
        steps = found.printer.readings.height_steps[-probed:]
        before = found.model.positions(found.printer.values, steps)
    rows = () if planned is None else planned.rows
    new = [row[2:4] for row in rows if row[1] == _WHAT["plane"]]
    at = (before[:, :2] / MM).round().astype(int).tolist()
    points = [f"    {x}, {y}" for x, y in at]
    points += [f"    {x}, {y}" for x, y in new]
    lines = [
        "# For Klipper: include this file in printer.cfg, then DELTA_CALIBRATE and SAVE_CONFIG.",
        f"# {len(before)} points as probed before, and {len(new)} that tell most beside them.",
        "[delta_calibrate]",
        "points:",
        *points,
    ]
    return "\n".join(lines) + "\n"


def _table(plans: list[PosePlan], model: Model, printer: Printer, title: str) -> Table:
    """Return one row per reading, the most useful first; data has Klipper's stable positions."""
    rows = []
    promises = [plans[0].sigma[0], *(sigma for planned in plans for sigma in planned.sigma[1:])]
    steps = [None, *(step for planned in plans for step in planned.steps)]
    for k, (step, sigma) in enumerate(zip(steps, promises, strict=True)):
        ends = np.zeros((0, 3)) if step is None else step.poses
        what = "" if step is None else _WHAT[step.what]
        stable = ["", ""]
        for end, at in enumerate(model.steps(printer.values, ends)):
            stable[end] = ",".join(f"{value:.3f}" for value in at)
        name = Cell(what or "before", {"reading": what} | dict(zip(_STABLE, stable, strict=True)))
        cells = [fixed(round(value / MM) + 0.0, 0) for value in ends[:, :2].ravel().tolist()]
        cells += [Cell("", None)] * (4 - len(cells))
        promised = (np.hypot(sigma[0], sigma[1]), sigma[2])
        rows.append([Cell(str(k), k), name, *cells, *map(mm, promised)])
    header = ["step", "reading", "x (mm)", "y (mm)", "to x (mm)", "to y (mm)"]
    header += ["σ in x, y (mm)", "σ in z (mm)"]
    return Table("next", f"{title}, and the σ of the nozzle over the bed then", header, rows)


def _planned(
    printer: Printer,
    known: Prior,
    assumed: Assumed,
    count: int,
    found: Estimate | None = None,
    heights_only: bool = False,
) -> PosePlan:
    """Search for readings at reachable positions only."""
    robot = known.robot if found is None else found.fit.robot
    probed, pillars = printer.radius * disc(4), printer.radius * 0.9 * disc(2)
    poses, pairs = probed, np.zeros((0, 2), dtype=int)
    if not heights_only:
        pairs = np.array(list(itertools.combinations(range(len(pillars)), 2)))
        apart = np.linalg.norm(pillars[pairs[:, 0]] - pillars[pairs[:, 1]], axis=1)
        poses, pairs = np.concatenate([probed, pillars]), len(probed) + pairs[apart > _SHORTEST]
    over = printer.radius * disc()
    over = over[reachable(robot, over, "ideal")]
    if not len(over):
        raise InputError(f"{printer.config.path}: the nozzle cannot be over the bed")
    measured = differences(assumed, np.zeros(len(probed)), pairs)
    try:
        return plan_poses(
            robot,
            count,
            candidates=CandidatePoses(poses=poses, differences=measured),
            after=None if found is None else found.fit,
            poses=over,
            level="ideal",
            model_error=False,
        )
    except InputError as error:
        raise InputError(f"{printer.config.path}: --plan {count}: {error}") from None
