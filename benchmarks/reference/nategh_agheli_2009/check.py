"""Hexapod of Nategh and Agheli (2009): kinematics, 42 parameters, number of configurations."""

from pathlib import Path

import numpy as np
from rows import Row, numbers, table, worst
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.calibration import CalibrationOptions

HERE = Path(__file__).parent
MM = 1e-3
#: σ of the simulated measurements, m and rad: almost none.
SIGMA = 1e-7
#: Parameters by columns of parameters.csv.
COLUMNS = {
    "u_x": "base.x", "u_y": "base.y", "u_z": "base.z",
    "s_x": "anchor.x", "s_y": "anchor.y", "s_z": "anchor.z", "l0": "encoder_offset",
}  # fmt: skip


def parameters(which: str) -> dict[str, float]:
    """Return the 42 parameters of one set in SI units, by name."""
    columns = table(HERE / "parameters.csv")
    values = numbers(columns, *COLUMNS) * MM
    return {
        f"chain{leg}.{name}": value
        for leg, of, row in zip(columns["leg"], columns["which"], values, strict=True)
        if of == which
        for name, value in zip(COLUMNS.values(), row, strict=True)
    }


def by_angle(radius: float, between: float) -> np.ndarray:
    """Return x, y of joints in pairs `between` degrees apart about 0°, 120° and 240°, (6, 2)."""
    angle = np.radians([sign * between / 2 + at for at in (0, 120, 240) for sign in (1, -1)])
    points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points[[0, 3, 2, 5, 4, 1]]  # legs 1 to 6 as the table counts them


def calibration(nominal: tp.Robot, real: tp.Robot, want: np.ndarray) -> tuple[float, int]:
    """Return the worst parameter error, mm, and how many combinations the poses identify."""
    legs = nominal.ikm(want)
    seen = real.fkm(legs, guess=want)
    options = CalibrationOptions(measured_angle_sigma=SIGMA, registration="known")
    fit = tp.calibrate(nominal, legs, measured=seen, measured_sigma=SIGMA, options=options)
    off = [found.value - real.parameters[name].value for name, found in fit.parameters.items()]
    prior = nominal.parameters["chain1.base.x"].sigma  # the same for all 42
    known = np.linalg.eigvalsh(fit.covariance) < (0.5 * prior) ** 2
    return float(np.abs(off).max() / MM), int(known.sum())


def cost_of_viso(poses: np.ndarray, changes: np.ndarray) -> float:
    """Return the cost of Viso's fit with the orientation of the first desired pose, mm⁴."""
    fit = np.reshape(list(parameters("Viso's fit").values()), (6, 7)) / MM
    legs = poses[:, None, :3] + fit[:, 3:6] - fit[:, :3]
    return float((((legs**2).sum(axis=2) - (fit[:, 6] + changes) ** 2) ** 2).sum())


def rows() -> list[Row]:
    """Compare."""
    columns = table(HERE / "poses.csv")
    want = np.hstack([numbers(columns, "want_x", "want_y", "want_z") * MM, np.zeros((18, 3))])
    changes = numbers(columns, *(f"dl{k}" for k in range(1, 7)))
    printed = numbers(columns, *"xyzabc")
    nominal = tp.load(HERE / "robot.toml")
    real = nominal.replace(parameters("real"))

    chosen = np.reshape(list(parameters("nominal").values()), (6, 7)) / MM
    joints = np.hstack([by_angle(325, 40), by_angle(125, 85)])
    x = real.fkm(nominal.ikm(want), guess=want)
    angles = Rotation.from_rotvec(x[:, 3:]).as_euler("XYZ", degrees=True)

    rng = np.random.default_rng(0)
    tilted = rng.uniform([-0.4, -0.4, 0.7, *[-0.3] * 3], [0.4, 0.4, 1.05, *[0.3] * 3], (7, 6))
    fits = {n: calibration(nominal, real, tilted[:n]) for n in (6, 7)}
    eighteen = calibration(nominal, real, want)
    seven = calibration(nominal, real, want[np.linspace(0, 17, 7).round().astype(int)])
    return [
        worst("nominal joints, from radii and angles", chosen[:, [0, 1, 3, 4]], joints, 5e-5, "mm"),
        worst("leg length variations", changes, nominal.ikm(want) / MM, 0.005, "mm"),
        worst("poses of the real robot", printed[:, :3], x[:, :3] / MM, 0.005, "mm"),
        worst("their Euler angles", printed[:, 3:], angles, 0.005, "°", bound=0.01,
              explained="Viso's forward kinematics closes the legs to 0.02 mm only, as the printed "
              "back-check of the 108 legs shows: 0.01° at the platform's radius."),
        Row("cost of Viso's fit, rotations left out", np.sqrt(59802249880772056),
            cost_of_viso(printed, changes), 5e5, "mm⁴"),
        Row("worst parameter error, 18 poses", 226.3089, eighteen[0], 1e-3, "mm", bound=227.0,
            explained="Viso's cost uses one orientation for all poses, that of the first desired "
            "one; the real robot's Euler angles reach 22°. The row above reproduces that cost."),
        Row("parameters identified, 7 tilted poses", 42, fits[7][1], 0),
        Row("their worst error", 0, fits[7][0], 1e-3, "mm"),
        Row("parameters identified, 6 tilted poses", 36, fits[6][1], 0),
        Row("parameters identified, 7 of the 18 poses", 42, seven[1], 0, bound=2,
            explained="Desired orientations are all zero, so the 7 poses are too alike; the worst "
            f"error is then {seven[0]:.1f} mm. Seven poses suffice if they tilt."),
    ]  # fmt: skip
