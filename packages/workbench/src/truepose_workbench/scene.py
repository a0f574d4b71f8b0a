"""The workbench's scene: robot, true robot, steady states, handles, and what surrounds them."""

import itertools
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from trimesh.creation import cylinder, icosphere
from trimesh.graph import smooth_shade
from viser import ViserServer
from viser.transforms import SE3, SO3

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.exceptions import InputError
from truepose.robot import LAWS, Law
from truepose.robot.frames import frames
from truepose.robot.parts import COLOURS, Part, parts_of
from truepose.show.charts import LAW_COLOURS
from truepose_workbench.answers import Rest, ellipsoids, map_of, skeletons
from truepose_workbench.charts import USED, legend, rgb, shades
from truepose_workbench.state import State

#: Line width of a sensor by its kind; the others are discs at a joint.
_LINES = {"distance": 1.0, "plane_distance": 2.5, "coordinate": 2.5, "rod_length": 1.0}
_DISC = 13.0
_WIDTH = 2.2e-3  #: ratio of a part's radius to its line width, for a robot of 1 m
_GHOST = (150, 155, 165)
#: Lighter colours for parts that are invisible on a dark page.
_PARTS = COLOURS | {"motor": "#5b6270", "carriage": "#5b6270"}
#: Largest half axis of an ellipsoid, as a share of the robot's size.
_LARGEST = 0.06
_SCREEN: Any = {"thickness": 2.0, "thickness_units": "screen"}  #: lines of a width in pixels
#: Meshes of which many are drawn.
_MANY: Any = {"cast_shadow": False, "lod": "off"}


class Scene:
    """Draw states, and report frames to which the nacelle is dragged.

    `on` registers a function to be called with the events of a handle.
    """

    def __init__(
        self,
        server: ViserServer,
        state: State,
        on: Callable[[Any, Callable[[Any], None]], Any],
        dragged: Callable[[Array, bool], None],
    ):
        self._server = server
        points = state.drawn.skeleton(state.drawn.home)
        points_of = points.reshape(-1, 3)
        self._size = max(float(np.ptp(points_of, axis=0).max()), 0.05)
        self._bars: dict[str, Any] = {}
        server.scene.configure_default_lights(cast_shadow=False)
        centre = points_of.mean(axis=0)
        self._camera(state, centre)
        server.scene.add_grid(
            "/floor",
            width=3 * self._size,
            height=3 * self._size,
            cell_size=0.1 if self._size > 0.3 else 0.02,
            position=(*centre[:2], float(points_of[:, 2].min()) - 0.35 * self._size),
            plane_opacity=0.0,
        )
        self._marks = {
            law: server.scene.add_icosphere(
                f"/laws/{law}", radius=0.022 * self._size, color=rgb(colour), cast_shadow=False
            )
            for law, colour in LAW_COLOURS.items()
        }
        self.overlays = Overlays(server, state, self._size)
        self._gizmos = self._add_gizmos(state)
        for gizmo in self._gizmos:
            on(gizmo, partial(_dropped, dragged))

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

    def _add_gizmos(self, state: State) -> list[Any]:
        """Add handles to shift the nacelle, and to rotate it within its mobility."""
        planar = state.drawn.spec.mobility.startswith("planar")
        units = [unit for _, unit in state.drawn.coordinates]
        add: Any = partial(self._server.scene.add_transform_controls, depth_test=False)
        gizmos, size = [], self._size
        if "m" in units:
            free = (True, True, not planar)
            gizmos.append(add("/shift", 0.22 * size, active_axes=free, disable_rotations=True))
        if "rad" in units:  # the axes normal to the rotation
            about = (True, True, "m" not in units or units.count("rad") > 1)
            rings = {"active_axes": about, "disable_axes": True, "disable_sliders": True}
            gizmos.append(add("/turn", 0.16 * size, **rings))
        return gizmos

    def place_gizmos(self, state: State) -> None:
        """Move the drag handles to the nacelle's target."""
        frame = frames(state.robot, state.x_d)
        wxyz = SO3.from_matrix(frame[:3, :3]).wxyz
        for gizmo in self._gizmos:
            gizmo.position, gizmo.wxyz = frame[:3, 3], wxyz

    def show_robot(self, state: State, x: Array | None, magnified: float) -> None:
        """Draw the true robot at x; its deviation from the ghost at x_d is magnified."""
        ghost, real = skeletons(state, x, magnified)
        parts = parts_of(state.drawn, ghost, state.x_d)
        self._draw("ghost", parts, [_GHOST] * len(parts), 0.28)
        apart = real is not None and float(np.abs(real - ghost).max()) > 1e-4 * self._size
        self._bars["ghost"].visible = apart  # hidden if it coincides with the robot
        if real is not None and x is not None:
            parts = parts_of(state.truth, real, state.x_d + magnified * (x - state.x_d))
            used = state.truth.spec.used  # their parts are the last
            count = len(parts) - len(used)
            for k, sensor in enumerate(used, count):
                parts[k] = (*parts[k][:2], _LINES.get(sensor.kind, _DISC))
            self._draw("robot", parts, [rgb(_PARTS[name]) for name, _, _ in parts], None)
            names = {sensor.name: parts[k][1][0] for k, sensor in enumerate(used, count)}
            self.overlays.show_names(names)

    def _draw(
        self,
        name: str,
        parts: Sequence[Part],
        colours: Sequence[tuple[int, int, int]],
        opacity: float | None,
    ) -> None:
        """Draw each straight piece of each part as an instance of one cylinder mesh."""
        of = np.repeat(np.arange(len(parts)), [len(points) - 1 for _, points, _ in parts])
        a = np.concatenate([points[:-1] for _, points, _ in parts])
        b = np.concatenate([points[1:] for _, points, _ in parts])
        length = np.linalg.norm(b - a, axis=1)
        point = length < 1e-9  # draw a motor without an axis as a short piece
        a[point, 2] -= 0.012 * self._size
        length[point] = 0.012 * self._size
        radii = _WIDTH * self._size * np.array([width for _, _, width in parts])[of]
        d = (b - a) / length[:, None]
        wxyz = np.column_stack([1 + d[:, 2], -d[:, 1], d[:, 0], np.zeros(len(d))])
        wxyz[d[:, 2] < -1 + 1e-9] = (0, 1, 0, 0)
        shape = {
            "batched_positions": (a + b) / 2,
            "batched_wxyzs": wxyz / np.linalg.norm(wxyz, axis=1)[:, None],
            "batched_scales": np.column_stack([radii, radii, length]),
            "batched_colors": np.array(colours, dtype=np.uint8)[of],
        }
        there = self._bars.get(name)
        if there is not None and len(there.batched_positions) == len(d):
            for key, values in shape.items():
                setattr(there, key, values)
            return
        # Of radius 1 and length 1 about z; its caps are sharp.
        mesh = smooth_shade(cylinder(1.0, 1.0, sections=14), angle=np.radians(45))
        self._bars[name] = self._server.scene.add_batched_meshes_simple(
            f"/{name}", mesh.vertices, mesh.faces, opacity=opacity, **_MANY, **shape
        )

    def show_rests(self, state: State, found: dict[Law, Rest], magnified: float) -> None:
        """Mark the steady-state reference point under each law, deviations from x_d magnified."""
        sent = frames(state.robot, state.x_d)[:3, 3]
        for law in LAWS:
            mark, rest = self._marks[law], found.get(law)
            mark.visible = rest is not None and rest.x is not None
            if mark.visible:
                mark.position = sent + magnified * found[law].off

    def show_gizmos(self, wanted: bool) -> None:
        """Show the drag handles, or hide them during a run."""
        for gizmo in self._gizmos:
            gizmo.visible = wanted


def _dropped(dragged: Callable[[Array, bool], None], event: Any) -> None:
    """Report the frame of a drag handle."""
    turn = SO3(np.asarray(event.target.wxyz))
    frame = SE3.from_rotation_and_translation(turn, event.target.position).as_matrix()
    dragged(frame, event.phase == "end")


def corners(state: State) -> Array:
    """Return poses at the corners of the workspace's positions, (2^k, n); none without a box."""
    box, robot = state.drawn.spec.workspace, state.drawn
    linear = [k for k, (_, unit) in enumerate(robot.coordinates) if unit == "m"]
    if box is None or not linear:
        return np.empty((0, robot.n))
    x = np.tile(robot.home, (2 ** len(linear), 1))
    x[:, linear] = [*itertools.product(*np.transpose([box.minimum, box.maximum])[linear])]
    return x


class Overlays:
    """What surrounds the robot: workspace, map, ellipsoids, planned poses, names."""

    def __init__(self, server: ViserServer, state: State, size: float):
        self._scene, self._size = server.scene, size
        self._map: Any = None
        self._mapped: object = None  #: what the map shows
        self._legend = ""  #: of the map
        self._plan: list[Any] = []
        self.named = True  #: whether sensors have names
        self._names: dict[str, Any] = {}
        self._corners = corners(state)
        if len(self._corners):
            at = frames(state.drawn, self._corners)[:, :3, 3]
            near = (self._corners[:, None] != self._corners).sum(axis=2) == 1
            edges = at[np.argwhere(np.triu(near))]
            self._scene.add_line_segments("/workspace", edges, (130, 130, 130), **_SCREEN)
        ball, count = icosphere(subdivisions=2), 1 + len(self._corners)
        self._ellipsoids = self._scene.add_batched_meshes_simple(
            "/ellipsoids",
            ball.vertices,
            ball.faces,
            np.tile([1.0, 0, 0, 0], (count, 1)),
            np.zeros((count, 3)),
            batched_scales=np.ones((count, 3)),
            batched_colors=(214, 140, 0),
            opacity=0.75,
            **_MANY,
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
        use = state.terms.use(state.robot)
        P = np.asarray(
            accuracy(state.robot, x, use.calibrated_on, use.reference_pose, errors="nan")
        )
        whole = np.zeros((len(x), 3, 3))
        whole[np.ix_(range(len(x)), axes, axes)] = P[:, : len(axes), : len(axes)]
        radii, directions = ellipsoids(np.nan_to_num(whole))
        room = _LARGEST * self._size / max(float(radii.max()), 1e-12)
        decade = 10.0 ** np.floor(np.log10(room))
        factor = float(decade * max(digit for digit in (1, 2, 5) if digit * decade <= room))
        self._ellipsoids.batched_scales = np.maximum(factor * radii, 1e-5)
        self._ellipsoids.batched_wxyzs = SO3.from_matrix(directions).wxyz
        self._ellipsoids.batched_positions = frames(state.robot, x)[:, :3, 3]
        return factor

    def show_map(self, state: State, kind: str) -> str:
        """Colour places about the workspace; return the legend."""
        if kind != "none" and state.drawn.spec.mobility == "rotational":
            raise InputError(f"{state.drawn.name}: no map: its platform only turns")
        asked = (kind, state.robot, state.terms, *state.x_d[2:])
        if asked == self._mapped:
            return self._legend
        self._mapped, self._legend = asked, ""
        if kind != "none":
            places, shares, *scale = map_of(state, kind)
            step = float(np.ptp(places, axis=0).max()) / np.sqrt(len(places))
            look: Any = {"point_shape": "square", "precision": "float32", "point_shading": "flat"}
            self._map = self._scene.add_point_cloud(  # anew: its number of points changes
                "/map", places, shades(shares), point_size=0.62 * step, **look
            )
            self._legend = legend(*scale)
        elif self._map is not None:
            self._map.visible = False
        return self._legend

    def show_plan(self, state: State, poses: Array | None) -> None:
        """Draw the tour from home through poses and back; none hides it."""
        for handle in self._plan:
            handle.remove()
        self._plan = []
        if poses is not None:
            home, colour, size = state.drawn.home, rgb(USED), 0.014 * self._size
            way = frames(state.drawn, np.vstack([home, poses, home]))[:, :3, 3]
            legs, add = np.stack([way[:-1], way[1:]], axis=1), self._scene
            ball: Any = {"point_shape": "circle", "precision": "float32", "point_size": size}
            self._plan = [
                add.add_line_segments("/plan/tour", legs, colour, **_SCREEN),
                add.add_point_cloud("/plan/poses", way[1:-1], colour, **ball),
            ]

    def show_names(self, named: dict[str, Array]) -> None:
        """Write the sensors' names at their places, if they have any."""
        named = named if self.named else {}
        for name in self._names.keys() - named.keys():
            self._names.pop(name).remove()
        for name, place in named.items():
            if name not in self._names:
                self._names[name] = self._scene.add_label(
                    f"/names/{name}", name, font_screen_scale=0.8, anchor="bottom-center"
                )
            self._names[name].position = place
