"""The most useful next readings: heights of the bed, distances on a print.

Candidates are heights over the whole bed and distances between possible pillars. Selected are those
that minimise the σ of the nozzle over the bed with the estimate's assumptions and results.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truepose.arguments import Array
from truepose.calibration.differences import DistanceMeasurements, PlaneContacts
from truepose.design.candidates import CandidatePoses, reachable
from truepose.design.pose_plan import PosePlan
from truepose.design.poses import plan_poses
from truepose.exceptions import InputError
from truepose.integrations.klipper.assessment import Assessment, drawn_of, fitting
from truepose.integrations.klipper.config import Config
from truepose.integrations.klipper.criterion import adjusted
from truepose.integrations.klipper.estimate import Assumed, Estimate, Prior, estimate, prior
from truepose.integrations.klipper.model import Model
from truepose.integrations.klipper.printer import MM, NO_READINGS, Printer, printer_of
from truepose.integrations.klipper.prints import disc
from truepose.integrations.klipper.review import assumptions
from truepose.show.table import Cell, Table, fixed

#: Radii of probed rings and of pillars' rings, relative to the bed's.
PROBED, PILLARS = (0.25, 0.5, 0.75, 1.0), (0.45, 0.9)
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
        rows.append([Cell(str(k), k), name, *cells, *(_mm(v) for v in promised)])
    header = ["step", "reading", "x (mm)", "y (mm)", "to x (mm)", "to y (mm)"]
    header += ["σ in x, y (mm)", "σ in z (mm)"]
    return Table("next", f"{title}, and the σ of the nozzle over the bed then", header, rows)


def _mm(value: float) -> Cell:
    return fixed(value / MM, 3)


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
    points = np.concatenate([_rings(PROBED), _rings(PILLARS)]) * printer.radius
    probed, pillars = np.split(np.arange(len(points)), [len(_rings(PROBED))])
    pairs = np.array([(i, j) for i in pillars for j in pillars if i < j])
    apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    pairs = pairs[apart > _SHORTEST]
    over = printer.radius * disc()
    over = over[reachable(robot, over, "ideal")]
    if not len(over):
        raise InputError(f"{printer.config.path}: the nozzle cannot be over the bed")
    heights = PlaneContacts(lines=probed, sigma=assumed.height, height=(0.0, 0.0))
    distances = DistanceMeasurements(
        pairs=pairs,
        measured=np.ones(len(pairs)),
        sigma=assumed.distance,
        scale=(0.0, assumed.shrinkage),
        width=(0.0, assumed.width),
    )
    candidates = (
        CandidatePoses(poses=points[probed], differences=[heights])
        if heights_only
        else CandidatePoses(poses=points, differences=[heights, distances])
    )
    after = None if found is None else found.fit
    try:
        return plan_poses(
            robot,
            count,
            candidates=candidates,
            after=after,
            poses=over,
            level="ideal",
            model_error=False,
        )
    except InputError as error:
        raise InputError(f"{printer.config.path}: --plan {count}: {error}") from None


def _rings(radii: tuple[float, ...]) -> Array:
    """Return the centre and evenly spread rings around it, (N, 3)."""
    parts = [np.zeros((1, 3))]
    for radius in radii:
        turn = np.arange(0, 2 * np.pi - 1e-9, np.pi / 3 * radii[0] / radius)
        parts.append(radius * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn]))
    return np.concatenate(parts)
