"""Limits on models and on YAML, checked before anything is expanded."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

from truepose.exceptions import InputError, one_line

#: Elements of a model with all copies; MuJoCo compiles so many in some seconds.
ELEMENTS = 10_000
#: Characters of a YAML file: PyYAML reads some ten thousand a second.
YAML = 1 << 18


def model(path: Path, text: Callable[[Path], str]) -> ET.Element:
    """Parse a model's XML; InputError where it has too many elements with all copies.

    Copies are those of `count` (replicate, composite, flexcomp), of included files and of attached
    models.
    """
    root, total = _size(path, path.parent, text, {})
    if total > ELEMENTS:
        raise InputError(
            f"{path}: {total:.4g} elements with all copies (replicate, include, attach), more than "
            f"{ELEMENTS}; lower the counts, or leave out what is no part of the robot"
        )
    return root


def _size(
    path: Path, folder: Path, text: Callable[[Path], str], sizes: dict[Path, float]
) -> tuple[ET.Element, float]:
    """Root of a file and how many elements it has with all copies; a cycle counts once."""
    first, *more = text(path).split("<!--")  # MuJoCo takes comments that are no XML
    try:
        root = ET.fromstring(first + "".join(part.partition("-->")[2] for part in more))
    except ET.ParseError as error:
        raise InputError(f"{path}: not XML: {error}") from None
    sizes[path.resolve()] = 0.0

    def of(element: ET.Element) -> float:
        name = element.get("file") or ""
        for other in (folder / name, path.parent / name):
            if name and other.is_file():
                known = other.resolve()
                if known not in sizes:
                    sizes[known] = _size(other, folder, text, sizes)[1]
                return sizes[known]
        return 0.0  # what is missing MuJoCo names

    attached = max((of(part) for part in root.iterfind("asset/model")), default=0.0)
    total, left = 0.0, [(root, 1.0)]
    while left:
        element, times = left.pop()
        times *= _copies(element)
        total += times
        if element.tag == "include":
            total += times * of(element)
        elif element.tag == "attach":
            total += times * attached
        left += [(child, times) for child in element]
    return root, total


def _copies(element: ET.Element) -> float:
    try:
        counts = [float(word) for word in element.get("count", "").split()]
    except ValueError:  # what is no number MuJoCo names
        return 1.0
    return max(math.prod(counts), 1.0)


def yaml(path: Path, text: str) -> Any:
    """Read YAML without aliases, which a few lines of can stand for gigabytes."""
    import yaml

    if len(text) > YAML:
        raise InputError(
            f"{path}: {len(text)} characters, more than {YAML}: keep the keys of the loops alone"
        )
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent):
                where = f"line {event.start_mark.line + 1}: alias *{one_line(event.anchor, 40)}"
                raise InputError(f"{path}: {where}: aliases are not read; write its value there")
        return yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError) as error:
        why = one_line(" ".join(str(error).split()), 200)
        raise InputError(f"{path}: not YAML: {why}") from None
