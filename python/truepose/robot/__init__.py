"""Robots: kinematics, readings, and what is known of their parameters."""
