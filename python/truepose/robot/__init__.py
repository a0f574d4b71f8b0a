"""Robots: kinematics, readings, and prior knowledge of their parameters."""
