"""Entry points with which integrations add commands, log formats and clusters.

Groups: ``truepose.commands`` (a function or a typer app; ``export.NAME`` adds to a group),
``truepose.log_formats`` (a module with ``MAGIC``, ``read`` and ``write``; named by its ending) and
``truepose.clusters`` (a context manager that yields an executor). The core imports no integration.
"""

from importlib.metadata import EntryPoint, entry_points


def plugins(group: str) -> dict[str, EntryPoint]:
    """Return the installed entry points of a group, by name."""
    return {found.name: found for found in entry_points(group=f"truepose.{group}")}
