"""Readers of MJCF, and of a URDF with a YAML file of its loops."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from truepose.exceptions import InputError, TrueposeError, choose, one_line
from truepose.files import contents
from truepose.integrations.importers import bounds
from truepose.integrations.importers.links import Closure, Mechanism, Model

_MOST = 1 << 24  # largest number of bytes of a model
#: Joints of a URDF by their name in the YAML: the axes of rotation in their frame.
_RETYPED = {"SPHERICAL": "XYZ", "FIXED": ""} | {
    f"UJOINT_{a}{b}": a + b for a, b in itertools.permutations("XYZ", 2)
}


def from_mjcf(path: str | Path) -> Mechanism:
    """Read an MJCF file with loops by equality/connect and equality/weld.

    InputError: MuJoCo cannot read the file. TrueposeError: MuJoCo is not installed.
    """
    mujoco = _mujoco()
    path = Path(path)
    bounds.model(path, _text)

    def compiled(whole: bool) -> Any:
        spec = mujoco.MjSpec.from_file(str(path))
        if not whole:  # without shapes, whose files may be missing
            for shape in [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH]:
                spec.delete(shape)
            for mesh in list(spec.meshes):
                spec.delete(mesh)
            _light(spec)
        return spec.compile()

    m = Model(mujoco, _first(path, lambda: compiled(True), lambda: compiled(False)))
    return Mechanism(m, path, list(m.closures()), {*m.actuators()}, {})


def from_urdf(path: str | Path, loops: str | Path) -> Mechanism:
    """Read a URDF and a YAML file of its loops.

    The YAML is that of public collections of parallel robots: `closed_loop`, pairs of links whose
    frames coincide; `type` of each, "3d" (origins) or "6d" (whole frames); `name_mot`, driven
    joints; `joint_name` and `joint_type`, joints other than hinges: SPHERICAL, UJOINT_XY, …

    InputError: a file is not as described. TrueposeError: MuJoCo or PyYAML is not installed.
    """
    mujoco = _mujoco()
    path, loops = Path(path), Path(loops)
    said = _loops(loops)
    root = bounds.model(path, _text)
    if root.tag != "robot":
        raise InputError(f"{path}: <{one_line(root.tag, 40)}>: the root of a URDF must be <robot>")
    for part in root.iter("link"):  # shapes' files may be missing
        for shape in [child for child in part if child.tag in ("visual", "collision")]:
            part.remove(shape)

    def compiled() -> Any:
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
        spec.compiler.fusestatic = 0
        _light(spec)
        return spec.compile()

    m = Model(mujoco, _first(path, compiled))
    model = m.model
    joints = {model.joint(k).name: k for k in range(model.njnt)}
    links = {model.body(k).name: k for k in range(model.nbody)}
    links.setdefault(_root(root), 0)  # MuJoCo welds it to the world
    retyped = {
        _among(joints, name, "joint", loops): _RETYPED[kind]
        for name, kind in zip(said["joint_name"], said["joint_type"], strict=True)
    }
    closures = []
    for (one, other), kind in zip(said["closed_loop"], said["type"], strict=True):
        a, b = (_among(links, name, "link", loops) for name in (one, other))
        held = np.eye(4) if kind == "6d" else None
        closures.append(Closure(f"{one}-{other}", (a, b), m.data.xpos[[a, b]], held))
    motors = {_among(joints, name, "joint", loops) for name in said["name_mot"]}
    return Mechanism(m, path, closures, motors, retyped)


def _mujoco() -> Any:
    try:
        import mujoco
    except ImportError:
        raise TrueposeError(
            'models are read by MuJoCo, which is not installed: pip install "truepose[import]"'
        ) from None
    mujoco.set_mju_user_warning(lambda _: None)
    return mujoco


def _text(path: Path) -> str:
    try:
        data = contents(path, _MOST + 1)
        if len(data) > _MOST:
            raise InputError(f"{path}: more than {_MOST} bytes")
        return data.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: cannot be read: not a text file") from None


def _light(spec: Any) -> None:
    """Allow moving bodies without mass; only kinematics is needed."""
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-9, 1e-12
    spec.compiler.balanceinertia = 1


def _first(path: Path, *ways: Callable[[], Any]) -> Any:
    """Return the result of the first way that works, or raise the first way's error."""
    said: Exception | None = None
    for way in ways:
        try:
            return way()
        except (ValueError, RuntimeError, TypeError) as error:
            said = said or error
    raise InputError(f"{path}: MuJoCo: {one_line(' '.join(str(said).split()), 300)}")


def _root(root: ET.Element) -> str:
    """Return the link of a URDF that is no joint's child."""
    children = {child.get("link") for child in root.iterfind("joint/child")}
    names = (link.get("name", "") for link in root.iterfind("link"))
    return next((name for name in names if name not in children), "")


def _among(known: dict[str, int], name: object, what: str, where: Path) -> int:
    if name not in known:
        raise InputError(f"{where}: {choose(what, name, known)}")
    return known[str(name)]


def _loops(path: Path) -> dict[str, list]:
    """Read the YAML of loops, and check it."""
    data = bounds.yaml(path, _text(path))
    if not isinstance(data, dict):
        raise InputError(f"{path}: must have the keys closed_loop, type, name_mot")
    found: dict[str, list] = {}
    for key in ("closed_loop", "type", "name_mot", "joint_name", "joint_type"):
        found[key] = data.get(key) or []
        if not isinstance(found[key], list):
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
    for key, choices in (("type", ("3d", "6d")), ("joint_type", tuple(_RETYPED))):
        for kind in found[key]:
            if kind not in choices:
                raise InputError(f"{path}: {choose(key, kind, choices)}")
    return found
