"""Mistakes in an outside measurement: its axes, its frame, its angles, its units, its rows."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from truepose import _core
from truepose.arguments import Array, finite_rows
from truepose.calibration.causes.columns import DEGREES, UNITS, reordered
from truepose.calibration.causes.hypothesis import LN_RATE, Case, Hypothesis
from truepose.calibration.causes.rows import later
from truepose.calibration.registration import Registration, registration_of
from truepose.logs import orientation
from truepose.logs.orientation import ORDERS, of_euler
from truepose.robot import angles, frames

#: Most rows by which a measurement is late or early.
LATE = 10
#: Candidates of a kind that are fitted, those nearest to the motors' prediction.
NEAREST = 3
#: Distance from the motors' prediction, over that of the measurement as it is, worth a fit.
NEARER = 0.5
#: Distances that count as equal, relative: those of mirror images in an unknown frame.
EQUAL = 1e-6


#: An outside measurement with a mistake undone: what it was, (N, n), density as of the hypothesis.
Candidate = tuple[str, Array, float]


class View:
    """Motors' poses of a log, and the distance of outside measurements from them."""

    def __init__(self, case: Case):
        self.log, self.robot = case.log, (robot := case.robot.expected())
        self.names, self.angle = case.log.outside_names(robot), angles(robot)
        self.by = registration_of(case.options.registration)
        self.x = case.x
        self.spatial = robot.spec.mobility == "spatial"
        self.moving = robot.spec.framed
        self.unknown = self.moving and any(self.by.base_sigma)
        #: whether measured angles tell one exchange of axes from another in an unknown frame
        self.told = self.spatial and bool(
            np.isfinite(np.asarray(case.log.measured)[:, self.angle]).any()
        )

    def distance(self, measured: Array) -> float:
        """Return the median distance of positions plus that of angles, over their spreads."""
        core, (place, turn) = self.robot.core, self.by.marker_sigma
        known = *self.by.begin(), self.unknown, place > 0, turn > 0
        base, marker = _core.registered(core, *known, self.x, measured)
        off = _core.seen(core, base.ravel(), marker.ravel(), self.x, measured)[1]
        total = 0.0
        for which in (~self.angle, self.angle):
            some = finite_rows(off[:, which])
            if which.any() and some.sum() >= 4:
                x = self.x[some][:, which]
                spread, by = (
                    np.median(np.linalg.norm(of, axis=1))
                    for of in (x - np.median(x, axis=0), off[some][:, which])
                )
                total += float(by / max(spread, 1e-9))
        return total


def nearer(
    case: Case, made: Callable[[View, Array], Iterator[Candidate]], share: float = NEARER
) -> Iterator[Hypothesis]:
    """Yield the candidates nearest to the motors' poses, if nearer than the log as it is."""
    if case.log.measured is None:
        return
    view, given = View(case), np.asarray(case.log.measured)
    every = list(made(view, given))
    far = np.array([view.distance(measured) for _, measured, _ in every])
    limit = share * view.distance(given)
    before: list[float] = []
    for k in np.argsort(far, kind="stable"):
        if far[k] >= limit or len(before) == NEAREST:
            return
        if any(abs(far[k] - other) <= EQUAL * other for other in before):
            continue  # the same in an unknown frame
        before.append(float(far[k]))
        text, measured, density = every[k]
        log = replace(case.log, measured=measured, euler=None, form="")
        odds = LN_RATE - math.log(len(every))
        yield Hypothesis(text, replace(case, log=log), log_odds=odds, density=density)


def axes(case: Case) -> Iterator[Hypothesis]:
    """Axes of the measurement exchanged or reversed: of a turned or a mirrored frame."""
    yield from nearer(case, _axes)
    if case.log.measured is None or (view := View(case)).unknown or not view.moving:
        return
    known, view.by, view.unknown = view.distance(case.log.measured), Registration(), True
    if view.distance(case.log.measured) < NEARER * known:
        text = "in a frame of their own, not the base's: registration unknown"
        given = replace(case, options=replace(case.options, registration=view.by))
        yield Hypothesis(f"{', '.join(view.names)}: {text}", given, registered=True)


def _axes(view: View, given: Array) -> Iterator[Candidate]:
    place, turns = np.flatnonzero(~view.angle), np.flatnonzero(view.angle)
    for P in _signed(len(place)) if view.moving and len(place) else ():
        moved = given.copy()
        moved[:, place] = given[:, place] @ P.T
        mirrored = np.linalg.det(P) < 0
        if len(turns) or mirrored or not view.unknown:
            yield _held(view, P, place, mirrored), moved, 0.0
        for turned in _turned(view, P, given[:, turns], mirrored) if len(turns) else ():
            both = moved.copy()
            both[:, turns] = turned
            yield _held(view, P, np.r_[place, turns], mirrored), both, 0.0
    for P in _signed(len(turns)) if len(turns) else ():
        moved = given.copy()
        moved[:, turns] = given[:, turns] @ P.T
        yield _held(view, P, turns, False), moved, 0.0


def _turned(view: View, P: Array, given: Array, mirrored: bool) -> Iterator[Array]:
    """Yield angles, (N, k), as they would be in a frame that `P` exchanges or reverses."""
    if not view.spatial:
        yaw = math.atan2(P[1, 0], P[0, 0])
        yield yaw + float(np.linalg.det(P[:2, :2])) * given
        return
    yield given @ P.T
    if mirrored:  # a rotation vector keeps its sense there
        yield -given @ P.T
    elif not view.unknown:
        result, read = given.copy(), finite_rows(given)
        result[read] = frames.rotation_vector(P @ frames.rotation(given[read]))
        yield result


def _signed(size: int) -> list[Array]:
    """Return every signed permutation matrix but the identity, the simplest first."""
    own = np.eye(size)
    made = [
        np.array(signs)[:, None] * own[list(order)]
        for order in itertools.permutations(range(size))
        for signs in itertools.product((1.0, -1.0), repeat=size)
    ]
    made.sort(key=lambda P: float((own != P).any(axis=1).sum() + 0.1 * (P < 0).sum()))
    return made[1:]


def _held(view: View, P: Array, columns: Array, mirrored: bool) -> str:
    """Say what the columns hold where `P` times them is right."""
    names = [view.names[k] for k in columns]
    size = len(P)
    if mirrored and view.unknown and not (view.told and len(columns) == size):
        return f"{', '.join(names)}: mirrored: two axes exchanged, or one with its sign flipped"
    source = zip(np.abs(P).argmax(axis=0), P.sum(axis=0), strict=True)
    said = reordered(names[:size], [("-" if sign < 0 else "") + names[k] for k, sign in source])
    said += f", and so {', '.join(names[size:])}" * (len(names) > size)
    if mirrored or size < 2 or view.angle[columns[0]]:
        return said
    whole = np.eye(3)
    whole[:size, :size] = P
    turn = np.degrees(frames.rotation_vector(whole))
    by, along = float(np.linalg.norm(turn)), int(np.abs(turn).argmax())
    about = f" about {'xyz'[along]}" * bool(abs(turn[along]) > 0.99 * by)
    return f"{said} (a frame turned by {by:.0f}°{about})"


def euler(view: View, given: Array) -> Iterator[Candidate]:
    """Euler angles in place of a rotation vector, or of another convention."""
    raw, form = view.log.euler, view.log.form
    if not view.spatial or form == "quaternion":
        return
    raw = given[:, 3:] if raw is None else raw
    read = finite_rows(raw)
    size = np.abs(raw[read]).max(initial=0.0)
    usual = orientation.require(form or None)
    usual = usual if usual.isupper() else usual[::-1].upper()
    for order in ORDERS:
        if form and order == usual:
            continue
        for back in (False, True)[: 1 if form else 2]:
            if form:
                text = f"measured_roll, pitch, yaw: turns in the order {order}, not {form}: "
                text += f"euler {order}"
            else:
                which = "yaw, pitch, roll" if back else "roll, pitch, yaw"
                text = f"measured_rx, ry, rz are Euler angles ({which}), {order}"
            for factor in (1.0, DEGREES)[: 2 if size > 0.5 else 1]:
                moved = given.copy()
                angle = raw[read] / factor
                moved[read, 3:] = of_euler(angle[:, ::-1] if back else angle, order)
                degrees = "; in degrees" * (factor != 1)
                odds = -3.0 * float(read.sum()) * math.log(factor)
                yield text + degrees, moved, odds


def unit(view: View, given: Array) -> Iterator[Candidate]:
    """Measured lengths or angles in another unit."""
    for angle in (False, True):
        which = view.angle == angle
        raw = given[:, which]
        if not which.any() or not np.isfinite(raw).any():
            continue
        names = ", ".join(np.array(view.names)[which])
        for factor, text in UNITS["rad" if angle else "m"].items():
            moved = given.copy()
            if angle and view.log.euler is not None:
                read = finite_rows(view.log.euler)
                moved[read, 3:] = of_euler(view.log.euler[read] / factor, view.log.form)
            else:
                moved[:, which] = raw / factor
            odds = -float(np.isfinite(raw).sum()) * math.log(factor)
            yield f"{names}: {text}", moved, odds


def shifted(view: View, given: Array) -> Iterator[Candidate]:
    """The rows of the whole measurement shifted against the motors' and sensors'."""
    some = np.isfinite(given).any(axis=0)
    names = ", ".join(np.array(view.names)[some])
    for size in range(1, min(LATE, len(given) // 4) + 1):
        for by in (size, -size):
            text = f"{names}: their rows are {size} too {'late' if by > 0 else 'early'}"
            yield text, later(given, by), 0.0
