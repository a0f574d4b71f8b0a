"""Accurate parallel robots with redundant sensors."""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from truepose import moved
from truepose.exceptions import InputError, PoseError, RobotFileError, TrueposeError
from truepose.robot import Robot, list_robots, load

if TYPE_CHECKING:
    from truepose import calibration, control, design, faults, logs, simulation
    from truepose.calibration.bound import accuracy
    from truepose.calibration.calibrate import calibrate
    from truepose.calibration.online import OnlineCalibrator
    from truepose.control.controller import Controller
    from truepose.control.effects import Effects
    from truepose.design.poses import plan_poses
    from truepose.design.sensors import select_sensors
    from truepose.faults.monitor import FaultMonitor
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

#: Modules of the names that are imported on first use; other names are modules themselves.
_LATER = {
    "Controller": "truepose.control.controller",
    "Effects": "truepose.control.effects",
    "FaultMonitor": "truepose.faults.monitor",
    "OnlineCalibrator": "truepose.calibration.online",
    "accuracy": "truepose.calibration.bound",
    "calibrate": "truepose.calibration.calibrate",
    "monte_carlo": "truepose.studies.study",
    "plan_poses": "truepose.design.poses",
    "select_sensors": "truepose.design.sensors",
    "simulate": "truepose.simulation.simulate",
    "steady_state": "truepose.simulation.equilibrium",
}


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in __all__:
            raise AttributeError(moved.absent(__name__, name))
        module = import_module(_LATER.get(name, f"{__name__}.{name}"))
        value = getattr(module, name) if name in _LATER else module
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """List only the public names."""
    return sorted([*__all__, "__version__"])
