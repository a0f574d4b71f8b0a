"""Size limits on models and YAML, checked before any expansion."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

from truepose.exceptions import InputError, TrueposeError, one_line

#: Largest number of elements with all copies; MuJoCo compiles as many in some seconds.
ELEMENTS = 10_000
#: Largest number of characters of a YAML file; PyYAML reads some ten thousand per second.
YAML = 1 << 18


def model(path: Path, text: Callable[[Path], str]) -> ET.Element:
    """Parse a model's XML; raise InputError if it has too many elements with all copies.

    Copies are made by `count` (replicate, composite, flexcomp), include and attach.
    """
    root, total = _size(path, path.parent, text, {})
    if total > ELEMENTS:
        raise InputError(
            f"{path}: {total:.4g} elements with all copies (replicate, include, attach), more than "
            f"{ELEMENTS}; lower the counts, or remove elements that are not part of the robot"
        )
    return root


def _size(
    path: Path, folder: Path, text: Callable[[Path], str], sizes: dict[Path, float]
) -> tuple[ET.Element, float]:
    """Return a file's root and number of elements with all copies; a cycle counts once."""
    first, *more = text(path).split("<!--")  # MuJoCo accepts comments that are invalid XML
    try:
        root = ET.fromstring(first + "".join(part.partition("-->")[2] for part in more))
    except ET.ParseError as error:
        raise InputError(f"{path}: not XML: {error}") from None
    sizes[path.resolve()] = 0.0

    def of(element: ET.Element) -> float:
        name = element.get("file") or ""
        for other in (folder / name, path.parent / name):
            if name and other.is_file():
                if other.resolve() not in sizes:
                    sizes[other.resolve()] = _size(other, folder, text, sizes)[1]
                return sizes[other.resolve()]
        return 0.0  # MuJoCo reports missing files

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
    except ValueError:  # MuJoCo reports invalid numbers
        return 1.0
    return max(math.prod(counts), 1.0)


def yaml(path: Path, text: str) -> Any:
    """Read YAML; refuse aliases, as a few lines of them can expand to gigabytes."""
    try:
        import yaml
    except ImportError:
        raise TrueposeError(
            'YAML is read by PyYAML, which is not installed: pip install "truepose[import]"'
        ) from None
    if len(text) > YAML:
        raise InputError(
            f"{path}: {len(text)} characters, more than {YAML}: keep only the keys of the loops"
        )
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent):
                where = f"line {event.start_mark.line + 1}: alias *{one_line(event.anchor, 40)}"
                raise InputError(f"{path}: {where}: not supported; write the value instead")
        return yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError) as error:
        why = one_line(" ".join(str(error).split()), 200)
        raise InputError(f"{path}: not YAML: {why}") from None
