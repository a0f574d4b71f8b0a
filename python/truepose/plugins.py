"""Optional packages, and entry points of integrations: commands, log formats and clusters.

Groups: ``truepose.commands`` (a function or a typer app; ``export.NAME`` adds to a group),
``truepose.studies`` (a function of a study), ``truepose.supervisors`` (``forces``: a class of
:class:`truepose.faults.monitor.Supervising` objects; ``safety``: one of
:class:`truepose.control.limits.Guarding` objects), ``truepose.log_formats`` (a module with
``MAGIC``, ``read`` and ``write``; named by its ending) and ``truepose.clusters`` (a context manager
that yields a function to submit a task, and the number of workers). The core imports no
integration.
"""

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from truepose.exceptions import InputError


def plugins(group: str) -> dict[str, EntryPoint]:
    """Return the installed entry points of a group, by name."""
    return {found.name: found for found in entry_points(group=f"truepose.{group}")}


def package(module: str, message: str) -> Any:
    """Return an optional package with one of its modules imported; InputError if it is missing."""
    try:
        return __import__(module)
    except ImportError:
        raise InputError(message) from None
