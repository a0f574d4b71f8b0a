"""The experiment of Tables 2 and 3: 625 poses at steady state, and the statistics of Table 3."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t

from truepose.arguments import Array, numbers_of
from truepose.calibration import CalibrationOptions
from truepose.calibration.calibrate import calibrate
from truepose.exceptions import InputError
from truepose.robot import Law, Robot
from truepose.simulation.equilibrium import steady_state
from truepose.threads import each
from truepose_paper import article
from truepose_paper.article import QUANTITIES, STATISTICS, with_paper_errors

Control = Literal["joint", "tej", "weighted", "cartesian", "self-calibrated"]

#: Law of each control. The controller's model is the expected robot (prior means of the tolerances)
#: under `weighted`, the robot calibrated at the same poses under joint control under
#: `self-calibrated`, and the nominal robot under the others.
CONTROLS: dict[Control, Law] = {
    "joint": "joint",
    "tej": "tej",
    "weighted": "weighted",
    "cartesian": "cartesian",
    "self-calibrated": "estimated",
}
#: Controls of the printed Table 3, and their columns' names there.
PRINTED: dict[Control, str] = {"joint": "usual", "tej": "redundant"}
#: Function called with the numbers of finished and of all parts of a study.
Progress = Callable[[int, int], None]
#: Names of the controls for people.
LABELS: dict[Control, str] = {
    "joint": "usual",
    "tej": "TEJ",
    "weighted": "weighted",
    "cartesian": "Cartesian",
    "self-calibrated": "self-calibrated",
}


@dataclass(frozen=True)
class Experiment:
    """Results of the experiment. Errors are true minus desired, mm and degrees."""

    robot: Robot
    truths: list[Robot]
    poses: Array  #: (P, 4), m and rad (nacelle)
    errors: dict[Control, Array]  #: (robots, P, 4) each
    tables: dict[Control, Array]  #: (robots, 5, 4) each, see :func:`table3`
    measured: dict[Control, Array]  #: (robots, 5, 4), Table 3 of estimated − true poses, as printed

    def ratio(self, quantity: str, statistic: str, control: Control = "tej") -> Array:
        """Return a control's statistic divided by that of joint control, one value per robot."""
        at = QUANTITIES.index(quantity), STATISTICS.index(statistic)
        return self.tables[control][(slice(None), *at)] / self.tables["joint"][(slice(None), *at)]


def draw_robots(robot: Robot, count: int, seed: int) -> list[Robot]:
    """Sample `count` true robots with the paper's errors; the first do not depend on `count`."""
    return [with_paper_errors(robot, s) for s in np.random.SeedSequence(seed).spawn(count)]


def believed(control: Control, robot: Robot, calibrated: Callable[[], Robot]) -> Robot:
    """Return the controller's model under a control, see :data:`CONTROLS`."""
    if control == "weighted":
        return robot.expected()
    return calibrated() if control == "self-calibrated" else robot


def self_calibrated(robot: Robot, truth: Robot, visited: Array, seed: int = 0) -> Robot:
    """Return the robot calibrated from the true robot's readings at these poses, joint control.

    The poses are those of :func:`truepose_paper.article.offset`. Use one `seed` per robot.
    """
    readings = truth.read(steady_state(robot, truth, article.offset(visited, seed), "joint"))
    options = CalibrationOptions(cause="ignore", loss="squares")
    return calibrate(robot, readings, options=options).robot


def rest(
    robot: Robot,
    truth: Robot,
    poses: Array,
    visited: Array | None = None,
    controls: Iterable[Control] = tuple(CONTROLS),
    seed: int = 0,
) -> dict[Control, Array]:
    """Return the steady-state poses of a true robot under each control, exact statics: (P, n) each.

    `robot` is nominal, `poses` (P, n) are desired. The self-calibration visits `visited` (N, n),
    default `poses`, with the `seed` of :func:`self_calibrated`.
    """
    learnt = poses if visited is None else visited

    def under(control: Control) -> Array:
        model = believed(control, robot, lambda: self_calibrated(robot, truth, learnt, seed))
        return steady_state(model, truth, poses, CONTROLS[control])

    return {control: under(control) for control in controls}


def run(
    robot: Robot,
    truths: list[Robot],
    poses: Array | None = None,
    progress: Progress = lambda done, total: None,
    controls: Sequence[Control] = tuple(CONTROLS),
) -> Experiment:
    """Compute the steady-state pose of every true robot at every pose under each control.

    `robot` is nominal, of schoenflies mobility with θ measured and tolerances. `poses` (P, 4) are
    desired, default Table 2's 625. `progress` is called after each robot; ratios need joint control
    among the `controls`.
    """
    poses = article.table2() if poses is None else numbers_of(poses, "poses")

    def settled(numbered: tuple[int, Robot]) -> dict[Control, Array]:
        seed, truth = numbered
        return rest(robot, truth, poses, None, controls, seed)

    found = list(each(settled, enumerate(truths), progress))
    errors = {c: in_print_units(np.array([x[c] for x in found]) - poses) for c in controls}
    tables = {control: table3(values) for control, values in errors.items()}

    def as_measured(control: Control) -> Array:  # the paper's error, exactly measured
        q_e = [truth.extended_positions(x[control]) for truth, x in zip(truths, found, strict=True)]
        estimated = [estimate(control, robot, poses, readings) for readings in q_e]
        return table3(in_print_units(np.array(estimated) - [x[control] for x in found]))

    measured = {control: as_measured(control) for control in PRINTED if control in controls}
    return Experiment(robot, truths, poses, errors, tables, measured)


def estimate(control: Control, believed: Robot, poses: Array, q_e: Array) -> Array:
    """Return the pose estimated from readings by each control's own model; NaN if none fits."""
    if control == "joint":
        return believed.fkm(q_e[:, : believed.m], guess=poses, errors="nan")
    if control in ("tej", "cartesian"):
        return believed.redundant_fkm(q_e, errors="nan")
    return believed.estimate(q_e, guess=poses, errors="nan").x


def with_m_at_x(robot: Robot, x_d: Array, q_e: Array) -> Array:
    """Return the motor error of the paper's law with M at the present pose x instead of x_d."""
    _, M_plus = robot.tej(robot.redundant_fkm(q_e))
    return M_plus @ (robot.extended_positions(x_d) - q_e)


def changed_by_m_at_x(
    robot: Robot, truths: Sequence[Robot], poses: Array, progress: Progress
) -> Array:
    """Return by how much M at x instead of x_d changes the steady-state pose, (robots, P, 4).

    In mm and degrees, exact statics.
    """

    def change(truth: Robot) -> Array:
        at_x, at_desired = (steady_state(robot, truth, poses, law) for law in (with_m_at_x, "tej"))
        return in_print_units(np.asarray(at_x) - at_desired)

    return np.array(list(each(change, truths, progress)))


def law_seconds(robot: Robot, poses: Array) -> float:
    """Return the time of J, M and M⁺ at a pose, s: the shortest of five runs over all poses."""
    many = np.tile(poses, (16, 1))

    def seconds() -> float:
        start = time.perf_counter()
        robot.tej(many)
        return time.perf_counter() - start

    return min(seconds() for _ in range(5)) / len(many)


def moved_by_tej(result: Experiment, pose: ArrayLike) -> Array:
    """Return how far the TEJ moves each robot's position from joint control's, (robots,), mm.

    Both are desired to be at `pose`; exact statics.
    """
    usual, redundant = (
        np.array([steady_state(result.robot, truth, pose, law)[:3] for truth in result.truths])
        for law in ("joint", "tej")
    )
    return 1e3 * np.linalg.norm(redundant - usual, axis=1)


def theta_law(robot: Robot, poses: Array) -> Array:
    """Return 1/(1 + w |j|²) at each pose, the share of a small static θ error that the TEJ leaves.

    j is the θ row of J, w the weight of that row in the TEJ.
    """
    weight = next(s.weight for s in robot.spec.sensor if s.kind == "platform_angle")
    j = robot.jacobian(poses)[..., 3, :]
    return 1 / (1 + weight * (j**2).sum(axis=-1))


def in_print_units(error: ArrayLike) -> Array:
    """Convert errors (..., 4) from m and rad to mm and degrees."""
    return np.asarray(error, dtype=float) * np.array([1e3, 1e3, 1e3, 180 / np.pi])


def table3(error: ArrayLike) -> Array:
    """Compute the statistics of Table 3.

    Parameters
    ----------
    error : array_like, shape (..., poses, 4)
        Errors of x, y, z (mm) and θ (degrees) at every pose.

    Returns
    -------
    ndarray, shape (..., 5, 4)
        Rows x, y, z, θ and the norm of (x, y, z); columns average, peak to peak, sum of squares
        ("quadratic error"; mm², for θ deg²), average of absolute values.

    Examples
    --------
    >>> from truepose_paper.experiment import table3
    >>> print(table3([[3, 0, 0, 1], [0, -4, 0, -1]])[[0, 1, 3, 4]])
    [[ 1.5  3.   9.   1.5]
     [-2.   4.  16.   2. ]
     [ 0.   2.   2.   1. ]
     [ 3.5  1.  25.   3.5]]
    """
    error = np.asarray(error, dtype=float)
    if error.ndim < 2 or error.shape[-1] != 4 or error.shape[-2] == 0:
        raise InputError(f"error: shape {error.shape}, must be (..., poses, 4)")
    norm = np.linalg.norm(error[..., :3], axis=-1, keepdims=True)
    values = np.concatenate([error, norm], axis=-1)
    mean, squares = values.mean(axis=-2), (values**2).sum(axis=-2)
    spread, average = np.ptp(values, axis=-2), np.abs(values).mean(axis=-2)
    return np.stack([mean, spread, squares, average], axis=-1)


def position_rms(error: Array) -> float:
    """Return the position rms over the finite rows of errors (P, 3 or more), m, in mm."""
    squares = (error[:, :3] ** 2).sum(axis=1)
    squares = squares[np.isfinite(squares)]
    return float(1e3 * np.sqrt(squares.mean())) if len(squares) else float("nan")


def over_robots(each: Array) -> Array:
    """Return the root mean square over the last axis; NaN robots do not count."""
    return np.sqrt(np.nanmean(np.square(each), axis=-1))


def rms_interval(each: Array, under: Array | None = None) -> tuple[float, float]:
    """Return the 90 % interval of the rms over all robots of a kind, from the sampled ones.

    `each` is the rms of each robot, (robots,). With `under`, the rms of the same robots, the
    interval is that of the ratio `each` / `under`.

    The mean squares average independent robots, so the logarithm of their root is nearly normal.
    Its scatter comes from the robots' influences, its quantile from Student's t. Bootstrap
    percentiles are a few percent too narrow here, because a robot's squared error has only two to
    three effective degrees of freedom.
    """
    under = np.ones_like(each) if under is None else under
    size = over_robots(each) / over_robots(under)
    influence = 0.5 * np.square(each / over_robots(each))
    influence -= 0.5 * np.square(under / over_robots(under))
    count = len(each)
    reach = float(t.ppf(0.95, count - 1) * influence.std(ddof=1) / np.sqrt(count))
    return float(size * np.exp(-reach)), float(size * np.exp(reach))
