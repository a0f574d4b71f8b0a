"""Prints the tables of docs/accuracy.md: do calibrations of many H4s reach their bound?

trials.py [--robots 400]      # a few minutes on one core
"""

import argparse

import numpy as np

import truepose as tp
from truepose import paper_data, trials

ELBOWS, WIRES = ([f"{kind}{k}" for k in ks] for kind, ks in (("elbow", "1234"), ("wire", "123")))
CASES = {
    "motors + θ": (["theta"], "ideal"),
    "motors + θ + z": (["theta", "z_telemeter"], "ideal"),
    "motors + θ + elbows": (["theta", *ELBOWS], "ideal"),
    "motors + θ + wires": (["theta", *WIRES], "ideal"),
    "full: motors + θ": (["theta"], "full"),
    "full: motors + θ + z": (["theta", "z_telemeter"], "full"),
    "full: motors + θ + elbows": (["theta", *ELBOWS], "full"),
}
TOUCH_OFF = (0.0, 0.0, -0.4, 0.0)


def at_bar(robot: tp.Robot) -> tp.Robot:
    """θ read between the central bar and lateral bar 1, as it is built."""
    sensors = tuple(
        s.model_copy(update={"bar": 1}) if s.name == "theta" else s for s in robot.spec.sensor
    )
    return tp.Robot(robot.spec.model_copy(update={"sensor": sensors}))


def ratios(error: np.ndarray, bound: np.ndarray) -> str:
    """Root mean square over the bound's, one a coordinate."""
    rms = np.sqrt((error**2).mean(axis=(0, 1)) / np.einsum("kii->ki", bound).mean(axis=0))
    return " ".join(f"{v:.2f}" for v in rms)


def cells(ran: trials.Trials) -> list[str]:
    """Figures of one case, mm."""
    usual, own, held, touched = (
        1e3 * np.sqrt(ran.squares(e).mean())
        for e in (ran.usual, ran.error, ran.held_out, ran.touched_off)
    )
    bound, bound_touched = (1e3 * np.sqrt(ran.position(P)) for P in (ran.bound, ran.bound_touched))
    count, p = len(ran.xi_nees), ran.parameters
    of_robot = ran.x_nees.mean(axis=1)
    return [
        f"{usual:.2f}",
        f"{own:.3f}",
        f"{usual / own:.1f}",
        f"{bound:.3f}",
        f"{own / bound:.2f}",
        ratios(ran.error, ran.bound),
        f"{held:.3f}",
        f"{touched:.3f}",
        f"{bound_touched:.3f}",
        f"{touched / bound_touched:.2f}",
        ratios(ran.touched_off, ran.bound_touched),
        f"{ran.xi_nees.mean():.1f} of {p} ± {3.29 * np.sqrt(2 * p / count):.1f}",
        f"{of_robot.mean():.2f} of 4 ± {3.29 * of_robot.std(ddof=1) / np.sqrt(count):.2f}",
    ]


ABSOLUTE = ("usual", "calibrated", "gain", "bound", "ratio", "x, y, z, θ", "other poses")
TOUCHED = ("touched off", "bound", "ratio", "x, y, z, θ", "NEES of ξ", "NEES of x")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=400)
    count = parser.parse_args().robots
    h4, poses = at_bar(tp.load("h4")), paper_data.table2()
    box = h4.spec.workspace
    others = np.random.default_rng(5).uniform(box.minimum, box.maximum, (200, 4))
    rows = {}
    for name, (sensors, level) in CASES.items():
        robot = h4.with_sensors(*sensors)
        ran = trials.run(robot, poses, TOUCH_OFF, others, count, level=level, true_level=level)
        rows[name] = cells(ran)
    for header, part in ((ABSOLUTE, slice(0, 7)), (TOUCHED, slice(7, None))):
        print("| sensors | " + " | ".join(header) + " |\n" + "|---" * (len(header) + 1) + "|")
        for name, values in rows.items():
            print(f"| {name} | " + " | ".join(values[part]) + " |")
        print()


if __name__ == "__main__":
    main()
