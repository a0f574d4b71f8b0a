"""Calibration from sixty poses and one extra encoder."""

import numpy as np

import truepose as tp

drawn = tp.load("h4").with_sensors("theta", "z_telemeter")
real = drawn.sample(seed=2)  # a robot of unknown geometry
box = drawn.spec.workspace
x = np.random.default_rng(0).uniform(box.minimum, box.maximum, (60, 4))

log = dict(
    zip(drawn.readings, real.extended_positions(x).T, strict=True)
)  # q1 … q4, theta, z_telemeter
log["theta"][17] += 0.1  # a gross error, to be detected

fit = tp.calibrate(drawn, log)
print(*fit.notes, sep="\n")
for name in ("chain1.rod", "chain1.arm", "chain1.base.x", "chain1.anchor.x"):
    p = fit.parameters[name]
    print(f"{name:16} {1e3 * p.value:8.3f} ± {1e3 * p.sigma:.3f} mm, {p.verdict}")

for when, robot in (("drawn", drawn), ("calibrated", fit.robot)):
    error = robot.estimate(real.extended_positions(x), errors="nan").x - x
    print(f"{when:10} position off by {1e3 * np.linalg.norm(error[:, :3], axis=1).mean():.2f} mm")
