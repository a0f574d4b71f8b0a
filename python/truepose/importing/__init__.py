"""What robot does another program's model describe? Links and joints, and which robot they are."""

from truepose.importing.links import Link, Mechanism
from truepose.importing.models import from_mjcf, from_urdf
from truepose.importing.pivot import pivot_of

__all__ = ["Link", "Mechanism", "from_mjcf", "from_urdf", "pivot_of"]
