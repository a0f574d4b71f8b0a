"""A rod 3 mm too long: the reading that detects it, and the effect of each law."""

import numpy as np

import truepose as tp

nominal = tp.load("h4")
true = nominal.replace({"chain4.rod": 0.483})  # nominal 0.480 m, true 0.483 m
x_d = np.array([0.05, -0.05, -0.4, 0.2])

# Joint control (the paper's Figure 1) brings every motor exactly to the position of the IKM.
x = tp.steady_state(nominal, true, x_d, "joint")
print("joint control ends off by, mm and degrees:", ((x - x_d) * [1e3, 1e3, 1e3, 57.2958]).round(2))

# The extended error: motors first, then the redundant sensors.
e = nominal.extended_positions(x_d) - true.extended_positions(x)
print("error of the motors, degrees:", np.degrees(np.abs(e[:4]).max()).round(6))
print("error of θ's encoder, degrees:", np.degrees(e[4]).round(3))

# TEJ = M⁺ turns the extended error into a motor error (the paper's Figure 2).
M, M_plus = nominal.tej(x_d)
print("the TEJ moves the motors by, degrees:", np.degrees(M_plus @ e).round(3))

# Steady state under each law. The Cartesian law takes θ as exact, and x, y, z from all rods.
for law in ("joint", "tej", "cartesian"):
    error = tp.steady_state(nominal, true, x_d, law) - x_d
    position, theta = 1e3 * np.linalg.norm(error[:3]), np.degrees(error[3])
    print(f"{law:10} position {position:5.2f} mm, θ {theta:7.4f} degrees")
