"""The move of the paper's Figures 11 to 13: 0.2 s, under each control law."""

import numpy as np

import truepose as tp

nominal = tp.load("h4")
true = nominal.sample(seed=1)  # every part within its tolerances


def show(name, run):
    error = run.error[-1]  # true minus desired, 0.2 s after the move
    peak = np.degrees(np.abs(run.error[:, 3]).max())
    position, theta = 1e3 * np.linalg.norm(error[:3]), np.degrees(error[3])
    print(f"{name:18} end: {position:6.3f} mm, {theta:7.3f} degrees; θ's peak {peak:.3f}")


# The controller's model is `nominal`; dynamics, gravity and encoders are those of `true`.
show("ideal robot", tp.simulate(nominal.without_quantization()))
for law in ("joint", "tej", "cartesian"):
    run = tp.simulate(nominal, true, law)
    show(law, run)

# All settings are arguments: the start and the end, the gains, feed-forward, integral action …
gentle = tp.Controller(law="tej", frequency=80, integral=10)
show(
    "gentle, integral",
    tp.simulate(nominal, true, gentle, run=tp.simulation.Run(duration=0.4, hold=0.6)),
)
print("a run's log:", run.time.shape, run.x.shape, run.q_e.shape, run.torque.shape)
