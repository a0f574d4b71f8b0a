"""Accurate parallel robots with redundant sensors."""

from importlib.metadata import version

from truepose import calibration, control, design, faults, logs, moved, simulation
from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.calibration.online import OnlineCalibrator
from truepose.control.controller import Controller
from truepose.control.effects import Effects
from truepose.design.poses import plan_poses
from truepose.design.sensors import select_sensors
from truepose.exceptions import InputError, PoseError, RobotFileError, TrueposeError
from truepose.faults.monitor import FaultMonitor
from truepose.robot import Robot, list_robots, load
from truepose.simulation.equilibrium import steady_state
from truepose.simulation.simulate import simulate
from truepose.studies.study import monte_carlo

moved.answer_imports()
__version__ = version("truepose")
__all__ = [
    "Controller",
    "Effects",
    "FaultMonitor",
    "InputError",
    "OnlineCalibrator",
    "PoseError",
    "Robot",
    "RobotFileError",
    "TrueposeError",
    "accuracy",
    "calibrate",
    "calibration",
    "control",
    "design",
    "faults",
    "list_robots",
    "load",
    "logs",
    "monte_carlo",
    "plan_poses",
    "select_sensors",
    "simulate",
    "simulation",
    "steady_state",
]


def __dir__() -> list[str]:
    """List only the public names."""
    return sorted([*__all__, "__version__"])
