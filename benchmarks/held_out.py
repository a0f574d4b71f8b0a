"""Tables of docs/guides/hexapod.md: held-out errors of a real hexapod's calibration.

held_out.py [--seeds 20] [--sampled 1000] [--picture held-out.svg]      # three minutes on one core

Jugglebot's 108 poses (robots/jugglebot/log.csv) are split into ninths. Each ninth is predicted from
its motors by a calibration on the other eight, and compared with motion capture. Then its motors
are homed again with zeros off by up to 20 mm, and calibrated from ten poses. Model, tolerances and
σ of the measurements are in the robot's file and here; none was tuned on these tables. Finally
hexapods sampled from the same tolerances, anywhere in a tracker's view, test the stated σ.
"""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from printing import arguments, head, row

import truepose as tp
from truepose import logs, robotfile
from truepose.calibration import CalibrationOptions
from truepose.robot import frames, workspace_samples

#: σ of motion capture, m and rad: assumed.
SIGMA = np.array([0.5e-3] * 3 + [np.radians(0.1)] * 3)
SHIFT, FEW = 0.02, 10
#: Numbers of measured poses and of predicted ones per sampled hexapod.
POSES, OTHERS = 60, 20
DRAWN = {"chain*.base.*": 0, "chain*.anchor.*": 0, "chain*.encoder_offset": 1e-7, "chain*.gain": 0}
MODELS = {
    "nominal, registered": DRAWN,
    "geometry": {"chain*.encoder_offset": 0, "chain*.gain": 0},
    "geometry, offsets": {"chain*.gain": 0},
    "geometry, offsets, gains": {},
}


class Misses(NamedTuple):
    """Predicted minus measured poses, (N, 6), m and rad, and the stated covariance."""

    off: np.ndarray
    covariance: np.ndarray

    @property
    def position(self) -> np.ndarray:
        """Position errors, mm."""
        return 1e3 * np.linalg.norm(self.off[:, :3], axis=1)

    @property
    def angle(self) -> np.ndarray:
        """Angle errors, degrees."""
        return np.degrees(np.linalg.norm(self.off[:, 3:], axis=1))

    @property
    def nees(self) -> np.ndarray:
        """Normalised squared errors per coordinate; 1 if the stated covariance is correct."""
        solved = np.linalg.solve(self.covariance, self.off[..., None])[..., 0]
        return (self.off * solved).sum(axis=1) / self.off.shape[1]


def learn(robot: tp.Robot, q: np.ndarray, seen: np.ndarray) -> tp.calibration.Calibration:
    """Calibrate on these rows; the nominal model does not explain them."""
    ignore = CalibrationOptions(cause="ignore")
    return tp.calibrate(robot, q, measured=seen, measured_sigma=SIGMA, options=ignore)


def predict(
    fit: tp.calibration.Calibration, robot: tp.Robot, q: np.ndarray, seen: np.ndarray
) -> Misses:
    """Predict the measurements at these readings, in the frames that the fit estimated."""
    x = robot.fkm(q)
    stated = fit.accuracy_seen(x) + np.diag(SIGMA**2)
    return Misses(fit.registration.see(robot, x, seen).residual, stated)


def with_tolerances(robot: tp.Robot, sigma: dict[str, float]) -> tp.Robot:
    """Return the robot with these tolerances instead of its own; 0: known."""
    tolerances = dict(robot.spec.tolerances)
    for name, value in sigma.items():
        tolerances[name] = tolerances[name].model_copy(update={"sigma": value})
    return tp.Robot(robot.spec.model_copy(update={"tolerances": tolerances}))


def ninths(
    robot: tp.Robot, q: np.ndarray, seen: np.ndarray, rng: np.random.Generator
) -> Iterator[Misses]:
    """Yield the errors of each ninth of the log, predicted from the rest."""
    order = rng.permutation(len(q))
    for k in range(9):
        out = order[k::9]
        kept = np.setdiff1d(order, out)
        fit = learn(robot, q[kept], seen[kept])
        yield predict(fit, fit.robot, q[out], seen[out])


def homed(
    robot: tp.Robot, q: np.ndarray, seen: np.ndarray, rng: np.random.Generator
) -> tuple[Misses, Misses, Misses]:
    """Return errors of a ninth predicted from the rest: before homing, by ten poses, by all."""
    order = rng.permutation(len(q))
    out, kept = order[::9], np.setdiff1d(order, order[::9])
    fit = learn(robot, q[kept], seen[kept])
    few = rng.choice(kept, FEW, replace=False)
    moved = q + rng.uniform(-SHIFT, SHIFT, q.shape[1])
    alone = learn(tp.calibration.rehomed(fit.robot, SHIFT), moved[few], seen[few])
    both = tp.calibrate(  # the tracker has not moved
        robot,
        np.vstack([q[kept], moved[few]]),
        measured=np.vstack([seen[kept], seen[few]]),
        measured_sigma=SIGMA,
        influences=tp.calibration.homings(robot, np.repeat([0, 1], [len(kept), FEW]), SHIFT),
    )
    return (
        predict(fit, fit.robot, q[out], seen[out]),
        predict(alone, alone.robot, moved[out], seen[out]),
        predict(both, both.robot, moved[out], seen[out]),
    )


def sampled(robot: tp.Robot, seed: int) -> tuple[float, Misses]:
    """Sample and calibrate a hexapod; return NEES/48 of ξ and errors at other poses."""
    rng, true = np.random.default_rng((0, seed)), robot.sample(seed)
    x, placed = workspace_samples(robot, POSES + OTHERS, rng), partial(frames.frames, robot)
    base, marker = (placed(rng.standard_normal((1, 6)) * [*3 * [far], 1, 1, 1]) for far in (1, 0.1))
    there = base @ placed(x) @ marker
    noise = placed(SIGMA * rng.standard_normal((POSES, 6)))
    read = there[:POSES].copy()
    read[:, :3, :3] @= noise[:, :3, :3]
    read[:, :3, 3] += noise[:, :3, 3]
    q = true.read(x)
    fit = learn(robot, q[:POSES], frames.coordinates(robot, read))
    error = np.array([p.value - true.parameters[n].value for n, p in fit.parameters.items()])
    nees = error @ np.linalg.solve(fit.covariance, error) / len(error)
    found = fit.robot.fkm(q[POSES:])
    off = fit.registration.see(fit.robot, found, frames.coordinates(robot, there[POSES:])).residual
    return float(nees), Misses(off, fit.accuracy_seen(found))


def over_bound(each: list[Misses]) -> np.ndarray:
    """Return the rms error over the stated σ, of x, y, z, rx, ry, rz."""
    off = np.concatenate([m.off for m in each])
    stated = np.concatenate([np.diagonal(m.covariance, axis1=1, axis2=2) for m in each])
    return np.sqrt((off**2).mean(axis=0) / stated.mean(axis=0))


def picture(misses: dict[str, Misses]) -> Figure:
    """Plot the sorted errors of all poses: nominal, and calibrated without the pose."""
    figure = Figure(figsize=(4.6, 4.8), layout="constrained")  # readable on a phone
    position, angle = figure.subplots(2, 1)
    for name, colour in (("nominal, registered", "#b3261e"), (list(MODELS)[-1], "#1455a4")):
        for axes, values in ((position, misses[name].position), (angle, misses[name].angle)):
            axes.plot(np.arange(1, len(values) + 1), np.sort(values), color=colour, label=name)
    for axes, what in ((position, "position error (mm)"), (angle, "orientation error (°)")):
        axes.set_xlabel("held-out poses, smallest error first")
        axes.set_ylabel(what)
        axes.grid(color="0.92")
        axes.set_ylim(0)
    position.legend(frameon=False)
    return figure


def rms(values: np.ndarray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Print both tables."""
    given = arguments(__doc__, seeds=20, sampled=1000, picture="")
    seeds, shown = range(given.seeds), {}
    robot = tp.load("jugglebot")
    log = logs.read(robot, robotfile.shipped()["jugglebot"].parent / "log.csv")
    q, seen = log.readings, log.measured

    head("held-out ninths", "position rms, mm", "at most", "angle rms, °", "at most", "NEES/6")
    for name, sigma in MODELS.items():
        model = with_tolerances(robot, sigma)
        each = [
            Misses(*map(np.concatenate, zip(*ninths(model, q, seen, np.random.default_rng(seed)),
                                            strict=True)))
            for seed in seeds
        ]  # fmt: skip
        shown[name] = each[0]
        numbers = [
            (rms(m.position), m.position.max(), rms(m.angle), m.angle.max(), m.nees.mean())
            for m in each
        ]
        row(name, *(f"{number:.2f}" for number in np.mean(numbers, axis=0)))
    if given.picture:
        picture(shown).savefig(given.picture)

    trials = [homed(robot, q, seen, np.random.default_rng(seed)) for seed in seeds]
    ratios = np.array([[rms(m.position) / rms(before.position) for m in after]
                       for before, *after in trials])  # fmt: skip
    print(
        f"homed again, each zero off by up to {1e3 * SHIFT:.0f} mm, then {FEW} poses; position rms "
        "of a held-out ninth over that before:"
    )
    for name, ratio in zip(("prior calibration and the ten", "all rows together"), ratios.T,
                           strict=True):  # fmt: skip
        print(f"{name}: {np.median(ratio):.2f} (median of {len(seeds)}; {ratio.min():.2f} to "
              f"{ratio.max():.2f})")  # fmt: skip

    if given.sampled:
        nees, each = [], []
        for seed in range(given.sampled):
            try:
                squared, misses = sampled(robot, seed)
            except tp.PoseError as error:
                print(f"hexapod {seed}: {error}")
                continue
            nees.append(squared)
            each.append(misses)
        apart = np.sqrt(2 / (48 * len(nees)))
        print(f"{len(nees)} sampled hexapods, {POSES} poses each: NEES/48 of the parameters "
              f"{np.mean(nees):.3f} (1 ± {apart:.3f}); {OTHERS} other poses each, rms over the "
              "bound, x y z rx ry rz: " + " ".join(f"{v:.2f}" for v in over_bound(each))
              + f"; NEES/6 {np.mean([m.nees.mean() for m in each]):.2f}; "
              f"{rms(np.concatenate([m.position for m in each])):.2f} mm, "
              f"{rms(np.concatenate([m.angle for m in each])):.3f}°")  # fmt: skip


if __name__ == "__main__":
    main()
