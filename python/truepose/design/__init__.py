"""Design before building: sensors, calibration poses, sensor placement, error budget."""

from truepose.design.candidates import CandidatePoses
from truepose.design.criterion import Criterion
from truepose.design.error_budget import Contribution, ErrorBudget, error_budget
from truepose.design.placement import Placement, place_sensors
from truepose.design.pose_plan import PosePlan
from truepose.design.selection import SensorSelection, SensorSet
from truepose.design.where import Use

__all__ = [
    "CandidatePoses",
    "Contribution",
    "Criterion",
    "ErrorBudget",
    "Placement",
    "PosePlan",
    "SensorSelection",
    "SensorSet",
    "Use",
    "error_budget",
    "place_sensors",
]
