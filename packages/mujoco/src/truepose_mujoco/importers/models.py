"""Readers of MJCF, and of a URDF with a YAML file of its loops, within limits of size."""

import contextlib
import itertools
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from truepose import files
from truepose.exceptions import InputError, choose, one_line
from truepose_mujoco.importers.links import Mechanism

_MOST = 1 << 24  # largest number of bytes of a model
#: Largest number of elements with all copies; MuJoCo compiles as many in some seconds.
_ELEMENTS = 10_000
#: Largest number of characters of a YAML file; PyYAML reads some ten thousand per second.
_YAML = 1 << 18
#: Types of joints in the YAML; the letters are axes of rotation in the joint's frame.
_RETYPED = ("SPHERICAL", "FIXED", *(f"UJOINT_{a}{b}" for a, b in itertools.permutations("XYZ", 2)))


def from_mjcf(path: str | Path) -> Mechanism:
    """Read an MJCF file with loops by equality/connect and equality/weld.

    InputError: MuJoCo cannot read the file.
    """
    path = Path(path)
    _model(path)

    def compiled(whole: bool) -> Any:
        spec = mujoco.MjSpec.from_file(str(path))
        if not whole:  # without shapes, whose files may be missing
            shapes = [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH]
            for part in [*shapes, *spec.meshes]:
                spec.delete(part)
            _light(spec)
        return spec.compile()

    model = _first(path, lambda: compiled(True), lambda: compiled(False))
    return Mechanism(model, path)


def from_urdf(path: str | Path, loops: str | Path) -> Mechanism:
    """Read a URDF and a YAML file of its loops.

    The YAML is that of public collections of parallel robots: `closed_loop`, pairs of links whose
    frames coincide; `type` of each, "3d" (origins) or "6d" (whole frames); `name_mot`, driven
    joints; `joint_name` and `joint_type`, joints other than hinges: SPHERICAL, UJOINT_XY, …

    InputError: a file is not as described.
    """
    path, loops = Path(path), Path(loops)
    said = _loops(loops)
    root = _model(path)
    if root.tag != "robot":
        raise InputError(f"{path}: <{one_line(root.tag, 40)}>: the root of a URDF must be <robot>")
    for part in root.iter("link"):  # shapes' files may be missing
        for shape in [child for child in part if child.tag in ("visual", "collision")]:
            part.remove(shape)

    spec = _first(path, lambda: mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode")))
    spec.compiler.fusestatic = 0
    _light(spec)
    joints = {joint.name: joint for joint in spec.joints}
    links = {body.name: body for body in spec.bodies}
    links = {
        joint.get("name"): links[child.get("link")]
        for joint in root.iter("joint")
        for child in joint.iter("child")
    } | links
    for name, kind in zip(said["joint_name"], said["joint_type"], strict=True):
        joint = _among(joints, name, "joint", loops)
        joint.limited = 0
        if kind == "FIXED":
            spec.delete(joint)
        elif kind == "SPHERICAL":
            joint.type = mujoco.mjtJoint.mjJNT_BALL
        else:
            joint.type = mujoco.mjtJoint.mjJNT_HINGE
            joint.axis, second = (np.eye(3)["XYZ".index(axis)] for axis in kind[-2:])
            joint.parent.add_joint(name=f"{name} {kind[-1]}", axis=second)
    for pair, kind in zip(said["closed_loop"], said["type"], strict=True):
        name, kinds = "-".join(map(str, pair)), mujoco.mjtEq
        for k, link in enumerate(pair):
            _among(links, link, "link", loops).add_site(name=f"{name} {k}")
        spec.add_equality(
            name=name,
            type=kinds.mjEQ_WELD if kind == "6d" else kinds.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f"{name} 0",
            name2=f"{name} 1",
        )
    for name in said["name_mot"]:
        _among(joints, name, "joint", loops)
        spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
    return Mechanism(_first(path, spec.compile), path)


def _text(path: Path) -> str:
    return files.text(path, _MOST).removeprefix("\ufeff")


def _model(path: Path) -> ET.Element:
    """Parse a model's XML; raise InputError if it has too many elements with all copies.

    Copies are made by `count` (replicate, composite, flexcomp), include and attach.
    """
    root, total = _size(path, path.parent, {})
    if total > _ELEMENTS:
        raise InputError(
            f"{path}: {total:.4g} elements with all copies (replicate, include, attach), more than "
            f"{_ELEMENTS}; lower the counts, or remove elements that are not part of the robot"
        )
    return root


def _size(path: Path, folder: Path, sizes: dict[Path, float]) -> tuple[ET.Element, float]:
    """Return a file's root and number of elements with all copies; a cycle counts once."""
    first, *more = _text(path).split("<!--")  # MuJoCo accepts comments that are invalid XML
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
                    sizes[other.resolve()] = _size(other, folder, sizes)[1]
                return sizes[other.resolve()]
        return 0.0  # MuJoCo reports missing files

    attached = max((of(part) for part in root.iterfind("asset/model")), default=0.0)
    total, left = 0.0, [(root, 1.0)]
    while left:
        element, times = left.pop()
        with contextlib.suppress(ValueError):  # MuJoCo reports invalid numbers
            times *= max(math.prod(map(float, element.get("count", "").split())), 1.0)
        total += times
        if element.tag == "include":
            total += times * of(element)
        elif element.tag == "attach":
            total += times * attached
        left += [(child, times) for child in element]
    return root, total


def _yaml(path: Path) -> Any:
    """Read YAML; refuse aliases, as a few lines of them can expand to gigabytes."""
    text = _text(path)
    if len(text) > _YAML:
        raise InputError(
            f"{path}: {len(text)} characters, more than {_YAML}: keep only the keys of the loops"
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


def _light(spec: Any) -> None:
    """Allow moving bodies without mass; only kinematics is needed."""
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-9, 1e-12
    spec.compiler.balanceinertia = 1


def _first(path: Path, *ways: Callable[[], Any]) -> Any:
    """Return the result of the first way that works, or raise the first way's error."""
    said: Exception | None = None
    mujoco.set_mju_user_warning(lambda _: None)
    for way in ways:
        try:
            return way()
        except (ValueError, RuntimeError, TypeError) as error:
            said = said or error
    raise InputError(f"{path}: MuJoCo: {one_line(' '.join(str(said).split()), 300)}")


def _among(known: dict[str, Any], name: object, what: str, where: Path) -> Any:
    if str(name) not in known:
        raise InputError(f"{where}: {choose(what, name, known)}")
    return known[str(name)]


def _loops(path: Path) -> dict[str, list]:
    """Read the YAML of loops, and check it."""
    data = _yaml(path)
    if not isinstance(data, dict):
        raise InputError(f"{path}: must have the keys closed_loop, type, name_mot")
    keys = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
    found = {key: data.get(key) or [] for key in keys}
    for key, value in found.items():
        if not isinstance(value, list):
            raise InputError(f"{path}: {key}: must be a list")
    for one, other in (("closed_loop", "type"), ("joint_name", "joint_type")):
        if len(found[one]) != len(found[other]):
            raise InputError(
                f"{path}: {len(found[one])} of {one}, {len(found[other])} of {other}: "
                "the numbers must be equal"
            )
    for pair in found["closed_loop"]:
        if not (isinstance(pair, list) and len(pair) == 2):
            raise InputError(f"{path}: closed_loop: {one_line(pair, 80)}: must be two links")
    found["type"] = [str(kind).lower() for kind in found["type"]]
    for key, choices in (("type", ("3d", "6d")), ("joint_type", _RETYPED)):
        for kind in found[key]:
            if kind not in choices:
                raise InputError(f"{path}: {choose(key, kind, choices)}")
    return found
