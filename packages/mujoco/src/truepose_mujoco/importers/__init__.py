"""Integration of MJCF and URDF: import of robot files from their models."""

from truepose_mujoco.importers.links import Link, Mechanism
from truepose_mujoco.importers.models import from_mjcf, from_urdf
from truepose_mujoco.importers.rotational import pivot_of

__all__ = ["Link", "Mechanism", "from_mjcf", "from_urdf", "pivot_of"]
