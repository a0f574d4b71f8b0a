"""Sensors that bring the H4 to 0.1 mm: chosen, placed, and verified in closed loop.

Every rod by itself, from its file with more candidates: encoders on every passive joint,
inclinometers, finer counts. Table of docs/choose-sensors.md.

sensors_to_tenth.py choose                      # sets by number and by price
sensors_to_tenth.py verify [--robots 400] [--jobs 2]
"""

import functools
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np
from printing import arguments, head, row

import truepose as tp
from truepose.design.criterion import SIGMA
from truepose.design.where import Use
from truepose.robot import Robot, workspace_grid, workspace_samples
from truepose.robotfile.schema import RobotFile

#: Assumed prices, any currency: of a sensor by the beginning of its name.
PRICES = {
    "theta": 90,
    "pivot2": 90,
    "elbow": 150,
    "lateral": 150,
    "foot": 150,
    "wire": 250,
    "tilt": 300,
    "z_telemeter": 400,
}
#: Price of all motors' encoders with so many times the counts of the file; of a dowel.
FINER, DOWEL = {1: 0, 4: 200, 16: 600}, 100
#: Assumed: the file's counts per turn; σ of an inclinometer, rad; σ of a dowel's pose, m and rad.
COUNTS, TILT, DOWEL_SIGMA = 14400, 2e-5, (1e-5, 1e-5, 1e-5, 1e-4)
HOME = (0.0, 0.0, -0.4, 0.0)  #: pose of the dowel
JUDGED = 105  #: random poses of Table 2's box, for every robot
#: σ that leaves 95 % of errors below 0.1 mm (verified).
TARGET = 0.058e-3


class Setup(NamedTuple):
    """Sensors, counts and reference to be verified."""

    sensors: tuple[str, ...]
    finer: int = 1
    dowel: bool = True
    placed: tuple[str, ...] = ()  #: sensors mounted at the best place found

    @property
    def label(self) -> str:
        told = " + ".join(self.sensors) + (f", counts × {self.finer}" if self.finer > 1 else "")
        told += f", {', '.join(self.placed)} placed" if self.placed else ""
        return told + (", dowel" if self.dowel else "")

    @property
    def price(self) -> float:
        return sum(map(price, self.sensors)) + FINER[self.finer] + DOWEL * self.dowel


#: Verified sets; `choose` finds those that are not placed.
VERIFIED = (
    Setup(("z_telemeter", "tilt_x"), dowel=False),
    Setup(("wire1", "wire2", "wire3"), dowel=False),
    Setup(("wire1", "wire2"), placed=("wire1", "wire2")),
    Setup(("theta", "wire1"), 4),
    Setup(("elbow3",), 16),
    Setup(("wire1",), 16),
)


def price(name: str) -> float:
    """Return the price of a candidate."""
    return next(price for start, price in PRICES.items() if name.startswith(start))


@functools.cache
def h4(finer: int = 1) -> Robot:
    """Return the H4 with all candidates, its encoders' counts so many times as fine."""
    data = tp.load("h4").spec.model_dump(exclude_unset=True)
    sensors = list(data["sensor"])
    for chain in "1234":
        of = {"chain": int(chain), "counts": COUNTS}
        sensors.append({"name": f"lateral{chain}", "kind": "rod_lateral"} | of)
        sensors.append({"name": f"foot{chain}", "kind": "rod_in_plane", "side": "platform"} | of)
    for name, axis in (("tilt_x", (1, 0, 0)), ("tilt_y", (0, 1, 0))):
        sensors.append({"name": name, "kind": "inclinometer", "axis": axis, "noise": TILT})
    data["sensor"] = [s | {"counts": finer * s["counts"]} if "counts" in s else s for s in sensors]
    data["chain"] = [c | {"encoder_counts": finer * COUNTS} for c in data["chain"]]
    offset = {"sigma": np.radians(0.02)}
    data["tolerances"] |= {f"{n}*.offset": offset for n in ("lateral", "foot", "tilt")}
    return Robot(RobotFile.model_validate(data))


def use_of(dowel: bool, **poses: np.ndarray) -> Use:
    """Return the use of robots, which may stand on a dowel once."""
    known = {"reference_pose": HOME, "reference_sigma": DOWEL_SIGMA} if dowel else {}
    return Use(**poses, **known)


def choose() -> None:
    """Print the smallest and the cheapest sets that reach the target, by counts and reference."""
    # pivot1 is theta's joint; chains 2 and 4 mirror 1 and 3.
    names = [s.name for s in h4().spec.sensor if s.name not in ("pivot1", "wire2")]
    names = [name for name in names if not name.endswith(("2", "4")) or name == "pivot2"]
    names.append("wire2")
    poses = workspace_grid(h4())
    for dowel in (True, False):
        for finer, more in FINER.items():
            for what, prices in (
                ("smallest", dict.fromkeys(names, 1.0)),
                ("cheapest", {name: float(price(name)) for name in names}),
            ):
                begin = f"{'dowel' if dowel else 'no reference'}, counts × {finer}, {what}: "
                try:
                    found = tp.select_sensors(
                        h4(finer),
                        prices,
                        target=TARGET,
                        use=use_of(dowel, calibrated_on=poses, poses=poses[::4]),
                        criterion=SIGMA,
                    )
                except tp.InputError as error:
                    print(begin + str(error), flush=True)
                    continue
                best = found.best
                total = sum(map(price, best.sensors)) + more + DOWEL * dowel
                print(
                    f"{begin}{' + '.join(best.sensors)}, σ {1e3 * best.error:.3f} mm, price "
                    f"{total:.0f}{'' if found.proven else ', not proven'}",
                    flush=True,
                )


def nominal(setup: Setup) -> Robot:
    """Return the robot of a setup, its sensors placed."""
    robot = h4(setup.finer).with_sensors(*setup.sensors)
    if setup.placed:
        use = use_of(setup.dowel, calibrated_on=workspace_grid(robot)[::25])
        robot = tp.design.place_sensors(robot, setup.placed, use=use).robot
    return robot


def verify(task: tuple[Setup, int, int]) -> np.ndarray:
    """Return errors of robots, mm: (robots, poses, 3): usual, in closed loop, and with counts."""
    setup, first, last = task
    robot = nominal(setup)
    table, found = workspace_grid(robot), []
    for source in np.random.SeedSequence(5).spawn(last)[first:]:
        draw, noise = source.spawn(2)
        rng = np.random.default_rng(noise)
        true = robot.sample(draw)
        judged = workspace_samples(robot, JUDGED, rng)
        log = true.read(tp.steady_state(robot, true, table, "joint"), seed=int(rng.integers(2**31)))
        options = {}
        if setup.dowel:
            at = np.array(HOME) + np.array(DOWEL_SIGMA) * rng.standard_normal(4)
            q_e = true.read(at, seed=int(rng.integers(2**31)))
            options["known_pose"] = (q_e, HOME, DOWEL_SIGMA)
        fit = tp.calibrate(robot, log, **options)
        usual = tp.steady_state(robot, true, judged, "joint") - judged
        x = np.asarray(tp.steady_state(fit.robot, true, judged, "estimated"))
        seen = fit.robot.estimate(true.read(x, seed=int(rng.integers(2**31))), guess=x).x
        off = [usual, x - judged, x - seen]  # the loop holds the estimate at its target
        found.append([1e3 * np.linalg.norm(np.asarray(e)[:, :3], axis=1) for e in off])
    return np.array(found).swapaxes(1, 2)


def main() -> None:
    given = arguments(__doc__, "choose", "verify", robots=400, jobs=2)
    if given.what == "choose":
        choose()
        return
    step = 20
    starts = range(0, given.robots, step)
    tasks = [(s, k, min(k + step, given.robots)) for s in VERIFIED for k in starts]
    head("sensors", "price", "usual", "rms", "95 %", "rms with counts", "95 % with counts", "gain")
    with ProcessPoolExecutor(given.jobs) as pool:
        answers = pool.map(verify, tasks)
        for setup in VERIFIED:
            error = np.concatenate([next(answers) for _ in starts])
            rms = np.sqrt((error**2).mean(axis=(0, 1)))
            most = np.percentile(error, 95, axis=(0, 1))
            found = (f"{value:.3f}" for value in (rms[1], most[1], rms[2], most[2]))
            gain = f"{rms[0] / rms[2]:.0f}"
            row(setup.label, f"{setup.price:.0f}", f"{rms[0]:.2f}", *found, gain)


if __name__ == "__main__":
    main()
