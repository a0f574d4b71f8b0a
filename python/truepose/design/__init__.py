"""Design before building: sensors, calibration poses, sensor placement, tolerances."""

from truepose.design.candidates import CandidatePoses
from truepose.design.error_budget import Contribution, ErrorBudget, error_budget
from truepose.design.placement import Placement, place_sensors
from truepose.design.pose_plan import PosePlan
from truepose.design.selection import SensorSelection, SensorSet

__all__ = [
    "CandidatePoses",
    "Contribution",
    "ErrorBudget",
    "Placement",
    "PosePlan",
    "SensorSelection",
    "SensorSet",
    "error_budget",
    "place_sensors",
]
