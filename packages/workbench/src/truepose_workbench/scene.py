"""The workbench's scene: robot, true robot, sensors, steady states, handles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from trimesh.creation import cylinder
from trimesh.graph import smooth_shade
from viser import TransformControlsHandle, ViserServer
from viser.transforms import SE3, SO3

from truepose.arguments import Array
from truepose.robot.frames import frames
from truepose.robot.laws import Law
from truepose.robot.parts import COLOURS, Part, parts_of
from truepose_workbench.answers import Rest, skeletons
from truepose_workbench.charts import LAW_COLOURS, rgb, shades
from truepose_workbench.overlays import Overlays
from truepose_workbench.state import State

#: Line width of a sensor by its kind; the others are discs at a joint.
_LINES = {"distance": 1.0, "plane_distance": 2.5, "coordinate": 2.5, "rod_length": 1.0}
_DISC = 13.0
_WIDTH = 2.2e-3  #: ratio of a part's radius to its line width, for a robot of 1 m
_GHOST = (150, 155, 165)
#: Lighter colours for parts that are invisible on a dark page.
_PARTS = COLOURS | {"motor": "#5b6270", "carriage": "#5b6270"}


class Scene:
    """Draw states, and report frames to which the nacelle is dragged."""

    def __init__(self, server: ViserServer, state: State, dragged: Callable[[Array, bool], None]):
        self._server = server
        points = state.drawn.skeleton(state.drawn.home)
        self._size = max(float(np.ptp(points.reshape(-1, 3), axis=0).max()), 0.05)
        self._bars: dict[str, Any] = {}
        server.scene.configure_default_lights(cast_shadow=False)
        centre = points.reshape(-1, 3).mean(axis=0)
        self._camera(state, centre)
        low = float(points[..., 2].min())
        server.scene.add_grid(
            "/floor",
            width=3 * self._size,
            height=3 * self._size,
            cell_size=0.1 if self._size > 0.3 else 0.02,
            section_size=0.5,
            position=(centre[0], centre[1], low - 0.35 * self._size),
            cell_color=(160, 165, 175),
            section_color=(130, 135, 145),
            plane_opacity=0.0,
        )
        self._marks = {
            law: server.scene.add_icosphere(
                f"/laws/{law}", radius=0.022 * self._size, color=rgb(colour), cast_shadow=False
            )
            for law, colour in LAW_COLOURS.items()
        }
        self.overlays = Overlays(server, state, self._size)
        self._gizmos = self._add_gizmos(state, dragged)

    def _camera(self, state: State, centre: Array) -> None:
        """Show the whole robot: beside the panel, or above it on a narrow screen."""
        camera = self._server.initial_camera
        planar = state.drawn.spec.mobility.startswith("planar")
        away = np.array([0.0, -0.25, 1.9]) if planar else np.array([1.15, -1.45, 0.75])
        away *= 0.52 * self._size
        camera.look_at, camera.position = tuple(centre), tuple(centre + away)

        up = np.array([0.0, 1.0, 0.0] if planar else [0.0, 0.0, 1.0])
        right = np.cross(up, away) / np.linalg.norm(np.cross(up, away))

        @self._server.on_client_connect
        def _(client: Any) -> None:
            aspect = client.camera.aspect
            far = away * (min(0.9 / aspect, 2.0) if aspect < 1 else max(1.7 / aspect, 1.0))
            half = np.tan(client.camera.fov / 2) * float(np.linalg.norm(far))  # half of the view
            # Part hidden by the panel: below on a narrow screen, else on the right.
            aside = -half / 2 * up if aspect < 1 else 0.25 * half * right
            client.camera.position = centre + far + aside
            client.camera.look_at = centre + aside

    def _add_gizmos(
        self, state: State, dragged: Callable[[Array, bool], None]
    ) -> list[TransformControlsHandle]:
        """Add handles to shift the nacelle, and to rotate it within its mobility."""
        planar = state.drawn.spec.mobility.startswith("planar")
        units = [unit for _, unit in state.drawn.coordinates]
        free = (True, True, not planar)
        add = self._server.scene.add_transform_controls
        gizmos = []
        if "m" in units:
            handle = add("/shift", 0.22 * self._size, active_axes=free, disable_rotations=True)
            gizmos.append(handle)
        if "rad" in units:  # the axes normal to the rotation
            about = (True, True, "m" not in units or units.count("rad") > 1)
            only_rings: dict[str, Any] = {"disable_axes": True, "disable_sliders": True}
            gizmos.append(add("/turn", 0.16 * self._size, active_axes=about, **only_rings))
        for gizmo in gizmos:
            gizmo.depth_test = False

            @gizmo.on_update
            def _(event: Any) -> None:
                turn = SO3(np.asarray(event.target.wxyz))
                frame = SE3.from_rotation_and_translation(turn, event.target.position).as_matrix()
                dragged(frame, event.phase == "end")

        return gizmos

    def place_gizmos(self, state: State) -> None:
        """Move the drag handles to the nacelle's target."""
        frame = frames(state.robot, state.x_d)
        wxyz = SO3.from_matrix(frame[:3, :3]).wxyz
        for gizmo in self._gizmos:
            gizmo.position, gizmo.wxyz = frame[:3, 3], wxyz

    def show_robot(self, state: State, x: Array | None, magnified: float, coloured: bool) -> None:
        """Draw the true robot at x; its deviation from the ghost at x_d is magnified."""
        ghost, real = skeletons(state, x, magnified)
        self._draw("ghost", parts_of(state.drawn, ghost, state.x_d), None)
        apart = real is not None and float(np.abs(real - ghost).max()) > 1e-4 * self._size
        self._bars["ghost"].visible = apart  # hidden if it coincides with the robot
        if real is not None and x is not None:
            off = magnified * (x - state.x_d)
            shown = parts_of(state.truth, real, state.x_d + off)
            at = state.robot.conditioning(state.x_d) if coloured else None
            used = state.truth.spec.used  # their parts are the last
            count = len(shown) - len(used)
            for k, sensor in enumerate(used, count):
                shown[k] = (*shown[k][:2], _LINES.get(sensor.kind, _DISC))
            self._draw("robot", shown, _colours(shown, state.robot.n, at))
            places = [points[0] for _, points, _ in shown[count:]]
            self.overlays.show_names([*zip([one.name for one in used], places, strict=True)])

    def _draw(self, name: str, parts: list[Part], colours: Array | None) -> None:
        """Draw each straight piece of each part as an instance of one cylinder mesh."""
        of = np.repeat(np.arange(len(parts)), [len(points) - 1 for _, points, _ in parts])
        a = np.concatenate([points[:-1] for _, points, _ in parts])
        b = np.concatenate([points[1:] for _, points, _ in parts])
        length = np.linalg.norm(b - a, axis=1)
        point = length < 1e-9  # draw a motor without an axis as a short piece
        a[point, 2] -= 0.012 * self._size
        length[point] = 0.012 * self._size
        radii = _WIDTH * self._size * np.array([width for _, _, width in parts])[of]
        d = (b - a) / np.maximum(length, 1e-12)[:, None]
        wxyz = np.column_stack([1 + d[:, 2], -d[:, 1], d[:, 0], np.zeros(len(d))])
        wxyz[d[:, 2] < -1 + 1e-9] = (0, 1, 0, 0)
        wxyz /= np.linalg.norm(wxyz, axis=1)[:, None]
        shape = {
            "batched_positions": ((a + b) / 2).astype(np.float32),
            "batched_wxyzs": wxyz.astype(np.float32),
            "batched_scales": np.column_stack([radii, radii, length]).astype(np.float32),
            "batched_colors": np.tile(np.array(_GHOST, np.uint8), (len(d), 1))
            if colours is None
            else colours[of],
        }
        there = self._bars.get(name)
        if there is not None and len(there.batched_positions) == len(d):
            for key, values in shape.items():
                setattr(there, key, values)
            return
        self._bars[name] = self._server.scene.add_batched_meshes_simple(
            f"/{name}",
            *_cylinder(),
            opacity=0.28 if colours is None else None,
            cast_shadow=False,
            lod="off",
            **shape,
        )

    def show_rests(self, state: State, found: dict[Law, Rest], magnified: float) -> None:
        """Mark the steady-state reference point under each law, deviations from x_d magnified."""
        sent = frames(state.robot, state.x_d)[:3, 3]
        for law, mark in self._marks.items():
            rest = found.get(law)
            mark.visible = rest is not None and rest.x is not None
            if mark.visible:
                mark.position = sent + magnified * found[law].off

    def show_gizmos(self, wanted: bool) -> None:
        """Show the drag handles, or hide them during a run."""
        for gizmo in self._gizmos:
            gizmo.visible = wanted


def _colours(parts: list[Part], n: int, conditioning: Any) -> Array:
    """Return each part's colour, (k, 3): its own, or by its chain's or nacelle's conditioning."""
    colours = np.array([rgb(_PARTS[name]) for name, _, _ in parts], dtype=np.uint8)
    if conditioning is None:
        return colours
    rods = [k for k, (name, _, _) in enumerate(parts) if name == "rod"]
    for number, k in enumerate(rods):
        colours[k] = shades(1 - conditioning.serial[number * n // len(rods)])
    platform = [name in ("nacelle", "central bar", "lateral bar") for name, _, _ in parts]
    colours[platform] = shades(1 - conditioning.parallel)
    return colours


def _cylinder() -> tuple[Array, Array]:
    """Return vertices and faces of a cylinder of radius 1 and length 1 about z, caps sharp."""
    mesh = smooth_shade(cylinder(1.0, 1.0, sections=14), angle=np.radians(45))
    return mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32)
