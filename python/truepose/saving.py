"""How does a robot become a robot file again? With its comments, and never half written."""

from __future__ import annotations

import contextlib
import os
import shutil
import uuid
from pathlib import Path

import tomlkit

from truepose import robot_file
from truepose.exceptions import InputError
from truepose.schema import Calibration, RobotFile


def to_toml(spec: RobotFile, values: dict[str, float]) -> str:
    """Write a robot as a robot file's text.

    Parameters
    ----------
    spec : RobotFile
        The robot. If it was read from a file, that file's order and comments are kept.
    values : dict
        Parameters that the file's drawn values do not tell.
    """
    document = tomlkit.parse(spec._text) if spec._text else _written_out(spec)
    before = robot_file.parse(document.as_string(), spec.name)
    for key in ("sensors", "gravity", "level", "quantised"):
        if getattr(spec, key) != getattr(before, key):
            value = getattr(spec, key)
            if value is None:
                document.pop(key)
                continue
            document[key] = list(value) if isinstance(value, tuple) else value
    if spec.calibration != before.calibration:
        document.pop("calibration", None)
        if spec.calibration:
            document["calibration"] = _calibration(spec.calibration)
    if values:
        table = document.setdefault("parameters", tomlkit.table())
        for name, value in values.items():
            table[name] = value
    return document.as_string()


def _calibration(calibration: Calibration) -> tomlkit.items.Table:
    table = tomlkit.table()
    table.update(calibration.model_dump(exclude={"root"}, exclude_defaults=True, mode="json"))
    rows = tomlkit.array()
    for row in calibration.root:
        rows.add_line(list(row))
    rows.add_line()
    table["root"] = rows
    return table


def _written_out(spec: RobotFile) -> tomlkit.TOMLDocument:
    """Write every key that differs from its default, the pattern's chains one by one."""
    data = spec.model_dump(
        exclude_defaults=True, exclude={"pattern", "parameters", "calibration"}, mode="json"
    )
    document = tomlkit.document()
    document.update(data)
    return document


def replace_file(path: Path, contents: str | bytes) -> None:
    """Write a file at once: whoever reads it sees the old contents or the new ones.

    Raises
    ------
    InputError
        The file cannot be written; what was there is untouched.
    """
    path = Path(os.path.realpath(path))
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with draft.open("xb") as file:
            file.write(contents.encode() if isinstance(contents, str) else contents)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            shutil.copymode(path, draft)
        os.replace(draft, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            draft.unlink()
