"""Elements of an MJCF model."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.robot.frames import rotation
from truepose.show.colours import COLOURS

MASSLESS = 1e-9  # kg: MuJoCo needs a mass of moving bodies
_NEEDLE = 1e-9  # ratio of a slender rod's axial to transverse inertia
_SPRING_DAMPING = 0.05  # share of critical damping of springs of arms and rods


def text(value: ArrayLike | str) -> str:
    """Return numbers as text that MJCF reads back bit for bit; return text unchanged."""
    if isinstance(value, str):
        return value
    return " ".join(f"{float(v):.17g}" for v in np.atleast_1d(value))


def add(parent: ET.Element, tag: str, **attributes: ArrayLike | str) -> ET.Element:
    """Append an element with these attributes, and return it."""
    return ET.SubElement(parent, tag, {key: text(v) for key, v in attributes.items()})


def turn(axis: int, angle: float) -> Array:
    """Return the rotation about the x, y or z axis (0, 1, 2)."""
    return rotation(angle * np.eye(3)[axis])


def axes(x: ArrayLike, z: ArrayLike) -> Array:
    """Return columns x, y, z with this z, and x as near as possible to the given one."""
    up, near = np.asarray(z, dtype=float), np.asarray(x, dtype=float)
    up = up / np.linalg.norm(up)
    near = near - (near @ up) * up
    near = near / np.linalg.norm(near)
    return np.column_stack([near, np.cross(up, near), up])


def xy(R: Array) -> Array:
    """Return an orientation as attribute xyaxes."""
    return np.concatenate([R[:, 0], R[:, 1]])


def slender(
    body: ET.Element, mass: float, length: float, start: float = 0.0, along: ArrayLike = (1, 0, 0)
) -> None:
    """Add the inertia of a slender rod from `start` to `start` + 1 lengths along a direction."""
    across = max(mass * length**2 / 12, 1e-12)
    frame = axes(along, np.cross(np.asarray(along), np.eye(3)[np.abs(along).argmin()]))
    add(
        body,
        "inertial",
        pos=(start + 0.5) * length * frame[:, 0],
        mass=mass,
        xyaxes=xy(frame),
        diaginertia=[_NEEDLE * across, across, across],
    )


def point(body: ET.Element, mass: float) -> None:
    """Add the inertia of a point mass at the body's origin."""
    add(body, "inertial", pos=[0, 0, 0], mass=mass, diaginertia=[1e-12] * 3)


def spring(
    body: ET.Element, name: str, kind: str, axis: ArrayLike, stiffness: float, inertia: float
) -> None:
    """Add a compliant joint: a spring with little damping."""
    damping = 2 * _SPRING_DAMPING * np.sqrt(stiffness * max(inertia, MASSLESS))
    add(body, "joint", name=name, type=kind, axis=axis, stiffness=stiffness, damping=damping)


def _colour(part: str) -> list[float]:
    code = COLOURS[part].lstrip("#")
    return [int(code[k : k + 2], 16) / 255 for k in (0, 2, 4)] + [1.0]


def capsule(body: ET.Element, part: str, start: ArrayLike, end: ArrayLike, radius: float) -> None:
    """Add a capsule (a ball if both ends coincide) in the colour of a part."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    if np.linalg.norm(end - start) < 1e-6:
        add(body, "geom", type="sphere", pos=start, size=radius, rgba=_colour(part))
    else:
        add(body, "geom", type="capsule", fromto=[*start, *end], size=radius, rgba=_colour(part))


def scene(root: ET.Element, world: ET.Element, outline: Array, planar: bool) -> None:
    """Add floor, light and a camera that shows all points of `outline`."""
    size = float(np.ptp(outline, axis=0).max())
    low, high = outline.min(axis=0), outline.max(axis=0)
    centre = (low + high) / 2
    visual = add(root, "visual")
    add(visual, "global", offwidth=1600, offheight=1200)
    add(visual, "headlight", ambient=[0.4] * 3, diffuse=[0.5] * 3, specular=[0.1] * 3)
    asset = add(root, "asset")
    add(
        asset,
        "texture",
        type="skybox",
        builtin="gradient",
        rgb1=[1, 1, 1],
        rgb2=[0.8, 0.85, 0.9],
        width=64,
        height=64,
    )
    add(
        asset,
        "texture",
        name="floor",
        type="2d",
        builtin="checker",
        rgb1=[0.9] * 3,
        rgb2=[0.84] * 3,
        width=256,
        height=256,
    )
    add(asset, "material", name="floor", texture="floor", texrepeat=[8, 8])
    below = [centre[0], centre[1], low[2] - 0.3 * size]
    add(
        world,
        "geom",
        name="floor",
        type="plane",
        material="floor",
        pos=below,
        size=[2 * size, 2 * size, 0.1],
    )
    add(
        world,
        "light",
        pos=centre + np.array([0, 0, 3 * size]),
        dir=[0, 0, -1],
        directional="true",
        diffuse=[0.4] * 3,
        castshadow="true",
    )
    azimuth, height = np.radians((-90, 90) if planar else (35, 18))
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    away = np.cos(height) * level + [0, 0, np.sin(height)]
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    add(
        world,
        "camera",
        name="view",
        pos=centre + 1.8 * size * away,
        fovy=40,
        xyaxes=np.concatenate([right, np.cross(away, right)]),
    )
