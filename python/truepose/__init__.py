"""truepose makes parallel robots accurate with redundant sensors."""

from importlib.metadata import version

from truepose.assembly import assembly_modes
from truepose.bound import accuracy
from truepose.calibration import Fit, calibrate
from truepose.effects import Effects
from truepose.errors import with_paper_errors
from truepose.exceptions import InputError, PoseError, RobotFileError, TrueposeError
from truepose.online import OnlineCalibration
from truepose.redundancy import Estimate
from truepose.registration import Registration
from truepose.robot import Parameter, Robot, load, robots
from truepose.simulations import Controller, Simulation, settle, simulate

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
    "load",
    "robots",
    "settle",
    "simulate",
    "with_paper_errors",
]
