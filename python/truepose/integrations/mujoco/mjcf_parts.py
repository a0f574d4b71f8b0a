"""Elements of an MJCF model."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike

from truepose.arguments import Array
from truepose.robot.frames import rotation
from truepose.robot.parts import COLOURS

MASSLESS = 1e-9  # kg: MuJoCo needs a mass of moving bodies
_NEEDLE = 1e-9  # ratio of a slender rod's axial to transverse inertia
_SPRING_DAMPING = 0.05  # share of critical damping of springs of arms and rods

#: Options, defaults and colours of every model; solimp is MuJoCo's largest impedance.
HEAD = """
<mujoco>
  <compiler angle="radian" inertiafromgeom="false" autolimits="true"/>
  <option timestep="{timestep}" gravity="{gravity}" integrator="discrete" solver="Newton"
    tolerance="1e-14" iterations="30" jacobian="dense">
    <flag contact="disable" diagexact="enable" autoreset="disable"/>
  </option>
  <default>
    <equality solref="{solref}" solimp="0.9999 0.9999 0.001"/>
    <joint solreffriction="{solref}" solimpfriction="0.9999 0.9999 0.001"/>
    <geom contype="0" conaffinity="0" mass="0"/>
    <site size="{site}" group="4"/>
  </default>
  <visual>
    <global offwidth="1600" offheight="1200"/>
    <headlight ambient="0.4 0.4 0.4" diffuse="0.5 0.5 0.5" specular="0.1 0.1 0.1"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0.8 0.85 0.9" width="64"
      height="64"/>
    <texture name="floor" type="2d" builtin="checker" rgb1="0.9 0.9 0.9" rgb2="0.84 0.84 0.84"
      width="256" height="256"/>
    <material name="floor" texture="floor" texrepeat="8 8"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" material="floor" pos="{below}" size="{floor}"/>
    <light pos="{above}" dir="0 0 -1" directional="true" diffuse="0.4 0.4 0.4" castshadow="true"/>
    <camera name="view" pos="{camera}" fovy="40" xyaxes="{view}"/>
  </worldbody>
  <equality/>
  <actuator/>
</mujoco>
"""


def head(outline: Array, planar: bool, timestep: float, gravity: ArrayLike) -> ET.Element:
    """Return a model without bodies: a camera shows all points of `outline` on a floor."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    size, centre = float((high - low).max()), (low + high) / 2
    azimuth, height = np.radians((-90, 90) if planar else (35, 18))
    away, right, up = (turn(2, azimuth) @ turn(1, -height)).T
    values = {
        "timestep": timestep,
        "gravity": gravity,
        "solref": [timestep / 2, 1],
        "site": size / 200,
        "below": [centre[0], centre[1], low[2] - 0.3 * size],
        "floor": [2 * size, 2 * size, 0.1],
        "above": centre + np.array([0, 0, 3 * size]),
        "camera": centre + 1.8 * size * away,
        "view": [*right, *up],
    }
    return ET.fromstring(HEAD.format(**{key: text(value) for key, value in values.items()}))


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
    return R[:, :2].T.ravel()


def joint(body: ET.Element, kind: str, name: str, axis: ArrayLike, **more: ArrayLike | str) -> None:
    """Add a hinge or a slide."""
    add(body, "joint", type=kind, name=name, axis=axis, **more)


def spring(
    body: ET.Element, kind: str, name: str, axis: ArrayLike, stiffness: float, inertia: float
) -> None:
    """Add a compliant hinge or slide with little damping, unless the stiffness is 0 (rigid)."""
    if stiffness:
        damping = 2 * _SPRING_DAMPING * np.sqrt(stiffness * max(inertia, MASSLESS))
        joint(body, kind, name, axis, stiffness=stiffness, damping=damping)


def slender(
    body: ET.Element, mass: float, length: float, start: float = 0.0, along: ArrayLike = (1, 0, 0)
) -> None:
    """Add the inertia of a slender rod from `start` to `start` + 1 lengths along a direction."""
    across = max(mass * length**2 / 12, 1e-12)
    frame = axes(along, np.cross(np.asarray(along), np.eye(3)[np.abs(along).argmin()]))
    inertia = [_NEEDLE * across, across, across]
    pos = (start + 0.5) * length * frame[:, 0]
    add(body, "inertial", pos=pos, mass=mass, xyaxes=xy(frame), diaginertia=inertia)


def point(body: ET.Element, mass: float) -> None:
    """Add the inertia of a point mass at the body's origin."""
    add(body, "inertial", pos=[0, 0, 0], mass=mass, diaginertia=[1e-12] * 3)


def capsule(body: ET.Element, part: str, start: ArrayLike, end: ArrayLike, radius: float) -> None:
    """Add a capsule (a ball if both ends coincide) in the colour of a part."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    colour = [value / 255 for value in bytes.fromhex(COLOURS[part][1:])]
    if np.linalg.norm(end - start) < 1e-6:
        add(body, "geom", type="sphere", pos=start, size=radius, rgba=[*colour, 1])
    else:
        add(body, "geom", type="capsule", fromto=[*start, *end], size=radius, rgba=[*colour, 1])
