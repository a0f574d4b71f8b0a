"""truepose makes parallel robots accurate with redundant sensors."""

from importlib.metadata import version

from truepose.calibration.bound import accuracy
from truepose.calibration.fit import Fit, calibrate
from truepose.calibration.online import OnlineCalibration
from truepose.calibration.registration import Registration
from truepose.exceptions import InputError, PoseError, RobotFileError, TrueposeError
from truepose.headers import get_cmake_dir, get_include
from truepose.robot.assembly import assembly_modes
from truepose.robot.redundancy import Estimate
from truepose.robot.robot import Parameter, Robot, load, robots
from truepose.simulation.effects import Effects
from truepose.simulation.simulate import Controller, Simulation, settle, simulate
from truepose.simulation.true_robots import with_paper_errors

__version__ = version("truepose")
__all__ = [
    "Controller",
    "Effects",
    "Estimate",
    "Fit",
    "InputError",
    "OnlineCalibration",
    "Parameter",
    "PoseError",
    "Registration",
    "Robot",
    "RobotFileError",
    "Simulation",
    "TrueposeError",
    "accuracy",
    "assembly_modes",
    "calibrate",
    "get_cmake_dir",
    "get_include",
    "load",
    "robots",
    "settle",
    "simulate",
    "with_paper_errors",
]
