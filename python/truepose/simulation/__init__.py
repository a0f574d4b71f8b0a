"""Simulation: plants, paths, moves and static equilibrium of a robot with errors."""

from typing import TYPE_CHECKING

from truepose import moved
from truepose.simulation.path_accuracy import PathAccuracy, path_accuracy
from truepose.simulation.paths import Circle, Line, SampledPath, Waypoints
from truepose.simulation.run import Run
from truepose.simulation.simulate import Simulation

__all__ = [
    "Circle",
    "Line",
    "PathAccuracy",
    "Run",
    "SampledPath",
    "Simulation",
    "Waypoints",
    "path_accuracy",
]

if not TYPE_CHECKING:
    __getattr__ = moved.answers(__name__)
