"""Inverse and forward kinematics of the H4."""

import numpy as np

import truepose as tp

robot = tp.load("h4")  # a shipped robot; the path of your own robot file works as well
print(robot)

# Coordinates are SI: x, y, z in metres, θ of the nacelle in radians.
x = [0.05, -0.02, -0.42, 0.3]

q = robot.ikm(x)  # motor positions that hold the pose
print("motors, degrees:", np.degrees(q).round(3))

r = robot.rkm(x)  # what the redundant sensors read there: here θ itself
print("θ's encoder, degrees:", np.degrees(r).round(3))

back = robot.fkm(q)  # the pose, from the motors alone
print(f"FKM(IKM(x)) - x: at most {np.abs(back - x).max():.0e}")

# dx = J dq: what one count of each motor's encoder does to the nacelle.
J = robot.jacobian(x)
count = J * robot.resolution[: robot.n]
print("one count of a motor moves x, y, z by up to", (1e6 * np.abs(count[:3]).max()).round(), "µm")
print("and turns θ by up to", np.degrees(np.abs(count[3]).max()).round(4), "degrees")

# Every method takes any leading shape: a million poses are one call.
poses = np.tile(x, (1000, 1))
print("1000 poses:", robot.ikm(poses).shape)
