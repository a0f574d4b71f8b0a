"""truepose makes parallel robots accurate with redundant sensors."""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.calibration.fault_limits import FaultLimits, fault_limits
from truepose.calibration.fit import Fit
from truepose.calibration.isolation import Isolation, isolate
from truepose.calibration.online import OnlineCalibration
from truepose.calibration.registration import Registration
from truepose.exceptions import InputError, PoseError, RobotFileError, TrueposeError
from truepose.headers import get_cmake_dir, get_include
from truepose.robot.assembly import assembly_modes
from truepose.robot.description import Parameter
from truepose.robot.redundancy import Estimate
from truepose.robot.robot import Robot, load, robots
from truepose.simulation.controller import Controller
from truepose.simulation.effects import Effects
from truepose.simulation.faults import Fault
from truepose.simulation.margins import Margins, margins
from truepose.simulation.path_accuracy import PathAccuracy, path_accuracy
from truepose.simulation.paths import Circle, Line, Sampled, WayPoints
from truepose.simulation.settle import settle
from truepose.simulation.simulate import Cycle, Simulation, simulate
from truepose.simulation.watch import Watch

if TYPE_CHECKING:
    from truepose.paper.errors import with_paper_errors

__version__ = version("truepose")
__all__ = [
    "Circle",
    "Controller",
    "Cycle",
    "Effects",
    "Estimate",
    "Fault",
    "FaultLimits",
    "Fit",
    "InputError",
    "Isolation",
    "Line",
    "Margins",
    "OnlineCalibration",
    "Parameter",
    "PathAccuracy",
    "PoseError",
    "Registration",
    "Robot",
    "RobotFileError",
    "Sampled",
    "Simulation",
    "TrueposeError",
    "Watch",
    "WayPoints",
    "accuracy",
    "assembly_modes",
    "calibrate",
    "fault_limits",
    "get_cmake_dir",
    "get_include",
    "isolate",
    "load",
    "margins",
    "path_accuracy",
    "robots",
    "settle",
    "simulate",
    "with_paper_errors",
]


def __getattr__(name: str) -> Any:
    """Load of the paper only what is asked for: robots are controlled without it."""
    if name == "with_paper_errors":
        from truepose.paper.errors import with_paper_errors

        return with_paper_errors
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Show what is offered, without the rooms and what was imported on the way."""
    return sorted([*__all__, "__version__"])
