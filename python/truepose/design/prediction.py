"""Predicted errors of sensor sets: as built under each control law, and self-calibrated."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, Level, numbers_of
from truepose.calibration.bound import accuracy, state_of
from truepose.exceptions import InputError
from truepose.robot import Robot, conditions, knowledge, label, summed, workspace_grid
from truepose.show import PRINT, Cell, Table, number

#: Compared laws of a robot as built, and numbers of self-calibration poses.
LAWS, POSES = ("joint", "tej", "estimated"), (10, 40, 160)
#: Column of a robot referenced at a known pose.
REFERENCED = "referenced"


@dataclass(frozen=True)
class Prediction:
    """Predicted σ, rms over P poses, m and rad; one row per sensor set, NaN where it fails."""

    robot: Robot
    sets: list[tuple[str, ...]]
    poses: Array  #: (P, n)
    left_out: int  #: poses of the workspace's grid that cannot be reached or are singular
    sigma: dict[str, Array]  #: by state: (sets, n + 1), coordinates and position norm
    reference_pose: ArrayLike | None = None  #: (n,)


def sensor_sets(robot: Robot) -> list[tuple[str, ...]]:
    """Return sets to compare: none, those in use, these with each other one, each group, all.

    A group has all other sensors of one kind, because elbow sensors are seldom bought singly.
    """
    spare = {s.name: s.kind for s in robot.spec.sensor if s.name not in robot.sensors}
    kinds = dict.fromkeys(spare.values())
    groups = [tuple(name for name in spare if spare[name] == kind) for kind in kinds]
    added = [(), *((name,) for name in spare), *groups, tuple(spare)]
    most = min(_core.max_sensors, _core.max_readings - robot.m)
    sets = [(), *(robot.sensors + names for names in added)]
    return list(dict.fromkeys(names for names in sets if len(names) <= most))


def predict(
    robot: Robot,
    sets: Sequence[Sequence[str]] | None = None,
    poses: ArrayLike | None = None,
    *,
    calibrated: bool = False,
    reference_pose: ArrayLike | None = None,
    level: Level | None = None,
) -> Prediction:
    """Predict the bound of several sensor sets over the same poses, (P, n).

    By default of :func:`sensor_sets`, at the poses of :func:`workspace_grid` that the readings of
    every set determine; also after self-calibration there, and referenced at a known pose, (n,).
    """
    sets = sensor_sets(robot) if sets is None else [tuple(names) for names in sets]
    candidates = [robot.with_sensors(*names) for names in sets]
    left_out = 0
    if poses is None:
        grid = workspace_grid(robot)
        bounds = [accuracy(c, grid, level=level, errors="nan") for c in candidates]
        good = np.isfinite(bounds).all(axis=(0, 2, 3))
        if not good.any():
            raise InputError(f"{robot.name}: no pose of its workspace is reachable and regular")
        poses, left_out = grid[good], int((~good).sum())
    poses = np.atleast_2d(numbers_of(poses, "poses"))
    sigma = {}
    for visited in (None, poses)[: 1 + calibrated]:
        for touched in (None, reference_pose)[: 1 + (reference_pose is not None)]:
            each = [accuracy(c, poses, visited, touched, level).sigma for c in candidates]
            sigma[state_of(visited, touched)] = np.sqrt((np.array(each) ** 2).mean(axis=1))
    return Prediction(robot, sets, poses, left_out, sigma, reference_pose)


def steady_state_error(robot: Robot, poses: Array, law: str, level: Level | None = None) -> float:
    """Predict the rms position error at rest under a law over desired poses, (P, n).

    To first order it is the law's cross-sensitivity times the errors of the readings by tolerances,
    encoder counts, conditions at work and the mean of tolerances that are not centered, which the
    law omits.
    """
    names, every = knowledge.learnable(robot), list(robot.parameters)
    H_xi = robot.linearize(poses, "nan", level)[1][..., [every.index(name) for name in names]]
    acting = conditions.columns(robot, poses, robot.is_full(level)) * conditions.sigmas(robot)
    off = [[robot.parameters[name].mean - robot.parameters[name].value] for name in names]
    S = robot.cross_sensitivity(poses, law, "nan")
    geometry = H_xi @ np.hstack([knowledge.root(robot, names), off])
    by_parameters = S @ np.concatenate([geometry, acting], axis=2)
    roots = np.concatenate([by_parameters, S * knowledge.reading_sigma(robot)], axis=-1)
    return float(np.sqrt(np.nanmean((roots[:, summed(robot).columns] ** 2).sum(axis=(1, 2)))))


def overview(found: Prediction, level: Level | None = None) -> tuple[Table, list[str]]:
    """Compare laws as built and self-calibration on few random poses: the position's rms error.

    With a reference pose also the bound of a referenced robot, and these self-calibrated. Returns
    also notes: the best law and sensors, as built and calibrated.
    """
    poses, touched = found.poses, found.reference_pose
    chosen = np.random.default_rng(0).permutation(poses)
    total, unit = summed(found.robot), PRINT[summed(found.robot).unit][1]
    visits = [(f"{n} poses", chosen[:n]) for n in POSES if n <= len(chosen)]
    own, once = visits[-1:], [(REFERENCED, None)] * (touched is not None)
    columns = [*LAWS, *(name for name, _ in once + visits)]
    rows = []
    for names in found.sets:
        r = found.robot.with_sensors(*names)
        errors = [
            steady_state_error(r, poses, law, level) if r.r or law == "joint" else np.nan
            for law in LAWS
        ]
        errors += [
            accuracy(r, poses, visited, touched, level).rms if r.r or visited is None else np.nan
            for _, visited in once + visits
        ]
        named = Cell(label(found.robot, names), ",".join(names) or "none")
        rows.append((named, total.factor * np.array(errors), len(names) > 0))
    rows.sort(key=lambda row: (row[2], row[1][-1]))
    said = []
    referenced = f" and {REFERENCED}" * len(once)
    for how, which in (
        ("As built, best: {} law", LAWS),
        ("Referenced", [name for name, _ in once]),
        ("Self-calibrated on {}" + referenced, [name for name, _ in own]),
    ):
        sizes = [
            (size, name, named)
            for named, errors, _ in rows
            for name, size in zip(columns, errors, strict=True)
            if name in which and np.isfinite(size)
        ]
        if sizes:
            size, name, named = min(sizes)
            said.append(f"{how.format(name)}, {named}: {number(size)} {unit} (1σ).")
    states = "self-calibrated on N poses"
    if once:
        states = f"referenced; {states}{referenced}"
    title = f"Error of the {total.name}, 1σ rms: as built, by law; {states}"
    header = ["sensors", *(f"{name} ({unit})" for name in columns)]
    cells = [
        [named, *(number(v if np.isfinite(v) else None) for v in errors)]
        for named, errors, _ in rows
    ]
    return Table("overview", title, header, cells), said
