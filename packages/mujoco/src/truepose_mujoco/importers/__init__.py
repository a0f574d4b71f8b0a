"""Import of robot files from MJCF and URDF models."""

from truepose_mujoco.importers.models import from_mjcf, from_urdf
from truepose_mujoco.importers.writing import robot_of

__all__ = ["from_mjcf", "from_urdf", "robot_of"]
