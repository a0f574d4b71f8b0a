"""What surrounds the robot in the scene: workspace, maps, ellipsoids, planned poses, names."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from trimesh.creation import icosphere
from viser import ViserServer
from viser.transforms import SO3

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.exceptions import InputError
from truepose.robot.frames import frames
from truepose_workbench.answers import conditioning_map, ellipsoids, error_map
from truepose_workbench.charts import MAPS, USED, rgb, shades
from truepose_workbench.state import State

#: Largest half axis of an ellipsoid, as a share of the robot's size.
_LARGEST = 0.06


def corners(state: State) -> Array:
    """Return poses at the corners of the workspace's positions, (2^k, n); none without a box."""
    box, robot = state.drawn.spec.workspace, state.drawn
    linear = [k for k, (name, _) in enumerate(robot.coordinates) if name in ("x", "y", "z")]
    if box is None or not linear:
        return robot.home[:0, None].reshape(0, robot.n)
    x = np.tile(robot.home, (2 ** len(linear), 1))
    x[:, linear] = [*itertools.product(*np.transpose([box.minimum, box.maximum])[linear])]
    return x


class Overlays:
    """Everything in the scene that is no part of a robot."""

    def __init__(self, server: ViserServer, state: State, size: float):
        self._scene, self._size = server.scene, size
        self._map: Any = None
        self._mapped: object = None  #: what the map shows
        self._ends: tuple[float, float] | None = None  #: values of its scale
        self._plan: list[Any] = []
        self.named = True  #: whether sensors have names
        self._names: dict[str, Any] = {}
        self._corners = corners(state)
        if len(self._corners):
            at = frames(state.drawn, self._corners)[:, :3, 3]
            near = (self._corners[:, None] != self._corners).sum(axis=2) == 1
            edges = np.argwhere(np.triu(near))
            colours = np.full((len(edges), 2, 3), 130, np.uint8)
            self._scene.add_line_segments(
                "/workspace", at[edges], colours, thickness=1.5, thickness_units="screen"
            )
        ball = icosphere(subdivisions=2)
        count = 1 + len(self._corners)
        self._ellipsoids = self._scene.add_batched_meshes_simple(
            "/ellipsoids",
            ball.vertices.astype(np.float32),
            ball.faces.astype(np.uint32),
            batched_wxyzs=np.tile([1.0, 0, 0, 0], (count, 1)).astype(np.float32),
            batched_positions=np.zeros((count, 3), np.float32),
            batched_scales=np.ones((count, 3), np.float32),
            batched_colors=np.tile(np.array([214, 140, 0], np.uint8), (count, 1)),
            opacity=0.75,
            cast_shadow=False,
            lod="off",
        )

    def show_ellipsoids(self, state: State, wanted: bool) -> float | None:
        """Draw 1 σ of the position estimate at the target and at the corners of the workspace.

        Returns their magnification, 1, 2 or 5 times a power of ten; None for a rotational robot.
        """
        axes = ["xyz".index(name) for name, _ in state.robot.coordinates if name in "xyz"]
        self._ellipsoids.visible = wanted and bool(axes)
        if not self._ellipsoids.visible:
            return None
        x = np.vstack([state.x_d, self._corners])
        P = np.asarray(accuracy(state.robot, x, **state.terms.known(state.robot), errors="nan"))
        whole = np.zeros((len(x), 3, 3))
        whole[np.ix_(range(len(x)), axes, axes)] = P[:, : len(axes), : len(axes)]
        radii, directions = ellipsoids(np.nan_to_num(whole))
        room = _LARGEST * self._size / max(float(radii.max()), 1e-12)
        decade = 10.0 ** np.floor(np.log10(room))
        factor = float(decade * max(digit for digit in (1, 2, 5) if digit * decade <= room))
        self._ellipsoids.batched_scales = np.maximum(factor * radii, 1e-5).astype(np.float32)
        turns = [SO3.from_matrix(R).wxyz for R in directions]
        self._ellipsoids.batched_wxyzs = np.array(turns, np.float32)
        self._ellipsoids.batched_positions = frames(state.robot, x)[:, :3, 3].astype(np.float32)
        return factor

    def show_map(self, state: State, kind: str) -> tuple[float, float] | None:
        """Colour places about the workspace; return the values of both ends of the scale."""
        if kind != "none" and state.drawn.spec.mobility == "rotational":
            raise InputError(f"{state.drawn.name}: no map: its platform only turns")
        asked = (kind, state.robot, state.terms, *state.x_d[2:])
        if asked == self._mapped:
            return self._ends
        self._mapped, self._ends = asked, None
        if kind == "none":
            if self._map is not None:
                self._map.visible = False
            return None
        places, values = (error_map if kind == MAPS[1] else conditioning_map)(state)
        low, high = (0.0, 1.0) if kind == MAPS[2] else (0.0, 3 * float(np.median(values)))
        high = min(high, float(values.max()))
        share = (values - low) / max(high - low, 1e-12)
        step = float(np.ptp(places, axis=0).max()) / np.sqrt(len(places))
        self._map = self._scene.add_point_cloud(  # anew: its number of points changes
            "/map",
            places.astype(np.float32),
            shades(1 - share if kind == MAPS[2] else share),
            point_size=0.62 * step,
            point_shape="square",
            precision="float32",
            point_shading="flat",
        )
        self._ends = low, high
        return self._ends

    def show_plan(self, state: State, poses: Array) -> None:
        """Draw the tour from home through poses and back; none hides it."""
        for handle in self._plan:
            handle.remove()
        self._plan = []
        if not len(poses):
            return
        way = frames(state.drawn, np.vstack([state.drawn.home, poses, state.drawn.home]))[:, :3, 3]
        add, colour = self._scene.add_line_segments, np.array(rgb(USED), np.uint8)
        legs = np.stack([way[:-1], way[1:]], axis=1)
        self._plan.append(
            add(
                "/plan/tour",
                legs,
                np.tile(colour, (len(legs), 2, 1)),
                thickness=2.0,
                thickness_units="screen",
            )
        )
        for k, place in enumerate(way[1:-1], 1):
            name, at = f"/plan/{k}", tuple(place)
            ball = self._scene.add_icosphere(name, 0.012 * self._size, tuple(colour), position=at)
            self._plan.append(ball)

    def show_names(self, named: Sequence[tuple[str, Array]]) -> None:
        """Write the sensors' names at their places, if they have any."""
        named = named if self.named else ()
        for name in {*self._names} - {name for name, _ in named}:
            self._names.pop(name).remove()
        for name, place in named:
            if name not in self._names:
                self._names[name] = self._scene.add_label(
                    f"/names/{name}", name, font_screen_scale=0.8, anchor="bottom-center"
                )
            self._names[name].position = tuple(place)
