"""truepose makes parallel robots accurate with redundant sensors."""

from importlib.metadata import version

from truepose.assembly import assembly_modes
from truepose.errors import with_paper_errors
from truepose.exceptions import InputError, PoseError, RobotFileError, TrueposeError
from truepose.robot import Parameter, Robot, load, robots
from truepose.simulations import Controller, Simulation, settle, simulate

__version__ = version("truepose")
__all__ = [
    "Controller",
    "InputError",
    "Parameter",
    "PoseError",
    "Robot",
    "RobotFileError",
    "Simulation",
    "TrueposeError",
    "assembly_modes",
    "load",
    "robots",
    "settle",
    "simulate",
    "with_paper_errors",
]
