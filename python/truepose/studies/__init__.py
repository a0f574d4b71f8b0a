"""Monte Carlo studies over robots sampled from their tolerances."""

from truepose.studies.study import Study

__all__ = [
    "Study",
]
