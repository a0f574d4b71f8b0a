"""truepose makes parallel robots accurate with redundant sensors."""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from truepose.calibration.bound import accuracy
from truepose.calibration.calibrate import calibrate
from truepose.calibration.candidates import Candidates
from truepose.calibration.design import Choice, Design, design
from truepose.calibration.differences import Distances, Plane, Revisits
from truepose.calibration.fault_limits import FaultLimits, fault_limits
from truepose.calibration.fit import Fit
from truepose.calibration.influences import Influence
from truepose.calibration.isolation import Isolation, isolate
from truepose.calibration.online import OnlineCalibration
from truepose.calibration.placing import Placement, place
from truepose.calibration.plan import Plan, plan
from truepose.calibration.registration import Registration
from truepose.calibration.rehomed import homings, rehomed
from truepose.calibration.zeroing import Zeroing, zero
from truepose.exceptions import InputError, PoseError, RobotFileError, TrueposeError
from truepose.headers import get_cmake_dir, get_include
from truepose.robot.assembly import assembly_modes
from truepose.robot.description import Parameter
from truepose.robot.redundancy import Estimate
from truepose.robot.robot import Robot, load, robots
from truepose.robot.stretch import Loads
from truepose.simulation.controller import Controller
from truepose.simulation.effects import Effects
from truepose.simulation.faults import Fault
from truepose.simulation.margins import Margins, margins
from truepose.simulation.path_accuracy import PathAccuracy, path_accuracy
from truepose.simulation.paths import Circle, Line, Sampled, WayPoints
from truepose.simulation.settle import settle
from truepose.simulation.simulate import Cycle, Simulation, simulate
from truepose.simulation.watch import Watch
from truepose.studies.study import Study, study

if TYPE_CHECKING:
    from truepose.paper.errors import with_paper_errors

__version__ = version("truepose")
__all__ = [
    "Candidates",
    "Choice",
    "Circle",
    "Controller",
    "Cycle",
    "Design",
    "Distances",
    "Effects",
    "Estimate",
    "Fault",
    "FaultLimits",
    "Fit",
    "Influence",
    "InputError",
    "Isolation",
    "Line",
    "Loads",
    "Margins",
    "OnlineCalibration",
    "Parameter",
    "PathAccuracy",
    "Placement",
    "Plan",
    "Plane",
    "PoseError",
    "Registration",
    "Revisits",
    "Robot",
    "RobotFileError",
    "Sampled",
    "Simulation",
    "Study",
    "TrueposeError",
    "Watch",
    "WayPoints",
    "Zeroing",
    "accuracy",
    "assembly_modes",
    "calibrate",
    "design",
    "fault_limits",
    "get_cmake_dir",
    "get_include",
    "homings",
    "isolate",
    "load",
    "margins",
    "path_accuracy",
    "place",
    "plan",
    "rehomed",
    "robots",
    "settle",
    "simulate",
    "study",
    "with_paper_errors",
    "zero",
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
