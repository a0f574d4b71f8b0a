"""The workbench's page: a panel over the scene."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from viser import GuiApi, ViserServer, uplot

from truepose.arguments import Array
from truepose.calibration.bound import accuracy
from truepose.exceptions import TrueposeError, one_line
from truepose.robot import LAWS, Law, usual
from truepose.show.charts import LAW_COLOURS
from truepose_workbench import answers, words
from truepose_workbench.guard import Guard
from truepose_workbench.scene import Scene
from truepose_workbench.state import State

FRAMES = 20  #: animation frames per second
#: Changes that follow one another within this time, s, are undone together.
_PAUSE = 0.7
_HINT = "Calibrate: from its own readings at 40 poses. Undo: key U."


class Page:
    """A served page. All changes go through :meth:`doing`, one at a time."""

    def __init__(
        self, state: State, host: str, port: int, tabs: Mapping[str, Any], dark: bool = False
    ):
        self._guard = Guard(host, port, f"{state.drawn.name} – truepose")
        with contextlib.redirect_stdout(None):  # viser prints an address without token
            with self._guard.installed():
                label = f"truepose: {state.drawn.name}"
                self.server = ViserServer(host, port, label=label, verbose=False)
            if not self._guard.guards:
                self.server.stop()
                raise TrueposeError("the workbench cannot guard this viser: install viser 1.1")
        self.state = state
        self.law: Law = usual(state.drawn)  #: law of the displayed robot
        self.magnified = 10.0
        self.ellipsoids, self.map = True, answers.MAPS[0]
        self.moving = False  #: moved by a run, not by hand
        self.lock = threading.RLock()
        self.client: Any = None  #: browser of the event that is handled
        self._waiting: dict[int, Any] = {}  #: newest value of each control, not yet handled
        self._events = ThreadPoolExecutor(1)  #: one event after another
        self._computations = ThreadPoolExecutor(1)  #: those that take longer
        self._wanted: dict[str, object] = {}  #: newest computation of each kind
        self._before: list[tuple[State, str]] = []  #: states to which undoing returns, verdicts
        self._changed = 0.0  #: time of the last change
        self._stopped = threading.Event()
        self.dark = dark  #: initial theme
        self.dress(dark)
        gui = self.server.gui
        self._said = ""
        self._answers = gui.add_html("")
        do = gui.add_button_group("This robot", ("Calibrate", "Undo"), hint=_HINT)
        self._verdict = gui.add_html("")
        group = gui.add_tab_group()
        self.scene = Scene(self.server, state, self.on, self.drag)
        self.tabs: list[Any] = []
        for label, made in tabs.items():
            folder = gui.add_folder(label, expand_by_default=False) if label == "View" else None
            with folder or group.add_tab(label):
                self.tabs.append(made(self, gui))
        self.on(do, lambda what: self.undo() if what == "Undo" else self.calibrate())
        self.scene.place_gizmos(state)
        self._keys(gui)
        self.show()
        self._player = threading.Thread(target=self._play, daemon=True)
        self._player.start()

    def address(self, host: str) -> str:
        """Return the page's address with its token; `host` is the name that browsers use."""
        return f"http://{host}:{self.server.get_port()}/?token={self._guard.token}"

    def dress(self, dark: bool) -> None:
        """Set a dark or a light page."""
        self.server.gui.configure_theme(
            dark_mode=dark,
            show_logo=False,
            show_share_button=False,
            brand_color=(88, 150, 220) if dark else (31, 95, 168),
        )

    def on(self, handle: Any, do: Callable[[Any], object]) -> Any:
        """Call `do` with a handle's value, or the event, after the user's events.

        Of those that arrive while another event is handled only the newest is.
        """

        async def happened(event: Any) -> None:
            if event.client is not None:  # None: set by this program
                self._waiting[id(handle)] = getattr(event.target, "value", event)
                self._events.submit(answer, event.client).add_done_callback(Future.result)

        def answer(client: Any) -> None:
            with self.lock:
                if id(handle) in self._waiting:
                    self.client = client
                    with self.doing():
                        do(self._waiting.pop(id(handle)))

        events = ("on_click", "on_trigger", "on_upload", "on_update")
        next(getattr(handle, name) for name in events if hasattr(handle, name))(happened)
        return handle

    def put(self, handle: Any, value: Any) -> None:
        """Set a control, unless a user has changed it meanwhile."""
        if id(handle) not in self._waiting:
            handle.value = value

    def later(self, kind: str, find: Callable[[], Any], show: Callable[[Any], None]) -> None:
        """Compute outside the lock, then show the result; only the newest of each kind."""
        self._wanted[kind] = asked = object()

        def run() -> None:
            if self._wanted[kind] is not asked:
                return
            try:
                found = find()
            except TrueposeError as error:
                found = error
            with self.lock, self.server.atomic():
                if self._wanted[kind] is asked:
                    show(found)

        self._computations.submit(run).add_done_callback(Future.result)

    @contextlib.contextmanager
    def doing(self) -> Iterator[None]:
        """Lock, change, and show the state; report errors in one line."""
        with self.lock, self.server.atomic():
            before, verdict, self._said = self.state, self._verdict.content, ""
            try:
                yield
            except TrueposeError as error:
                self._said = one_line(error, 300)
            if self.state is not before:
                now = time.monotonic()
                if now - self._changed > _PAUSE:  # not passed through
                    self._before.append((before, verdict))
                self._changed = now
            self.show()

    def undo(self) -> None:
        """Return to the state before the last change, and to what was known of it."""
        if self._before:
            state, self._verdict.content = self._before.pop()
            self.send(state)
            self._changed = time.monotonic()  # itself no change to undo

    def drag(self, frame: Array, ended: bool) -> None:
        """Move to a frame of a drag; at its end the handles return to the nacelle."""
        try:
            self.state = self.state.dragged(frame)
        finally:
            if ended:
                self.scene.place_gizmos(self.state)

    def show(self) -> None:
        """Show the state; during a run the motion tab shows the robot."""
        state, said = self.state, self._said
        found = answers.rests(state)
        legend = ""
        try:
            if not self.moving:
                self.scene.show_robot(state, found[self.law].x, self.magnified)
                self.scene.show_rests(state, found, self.magnified)
            around = self.scene.overlays
            if factor := around.show_ellipsoids(state, self.ellipsoids and not self.moving):
                legend = words.note(f"Ellipsoids: 1 σ of the estimate, × {factor:g}")
            legend += around.show_map(state, self.map)
        except TrueposeError as error:
            said = said or one_line(error, 300)
        self._answers.content = words.page(
            words.STYLE,
            words.laws(found, LAW_COLOURS),
            words.conditioning(state.robot.conditioning(state.x_d)),
            words.note(said, wrong=True) if said else words.pose(state, self.magnified),
            legend,
        )
        for tab in self.tabs:
            tab.follow(state)

    def send(self, state: State) -> None:
        """Accept a state with a new target that was not set by dragging."""
        self.state = state
        self.scene.place_gizmos(state)

    def home(self) -> None:
        """Move home."""
        self.send(self.state.sent(self.state.drawn.home))

    def _keys(self, gui: GuiApi) -> None:
        """Add keys for frequent actions; the command palette lists them."""

        def next_law() -> None:
            self.law = LAWS[(LAWS.index(self.law) + 1) % len(LAWS)]

        def no_errors() -> None:
            self.state = self.state.without_errors()

        actions: Any = {"U": ("Undo", self.undo), "H": ("Home", self.home)}
        actions |= {"L": ("Next law", next_law), "N": ("No errors", no_errors)}
        actions["M"] = "Move, or stop", self.tabs[4].toggle
        for key, (label, do) in actions.items():
            self.on(gui.add_command(label, hotkey=key), lambda _, do=do: do())  # type: ignore[misc]

    def _play(self) -> None:
        """Advance the animations until the page is stopped."""
        while not self._stopped.wait(1 / FRAMES):
            now = time.perf_counter()
            with self.lock, self.server.atomic():
                for tab in self.tabs:
                    with contextlib.suppress(TrueposeError):  # an unreachable pose
                        tab.tick(now)

    def calibrate(self) -> None:
        """Simulate a log and calibrate on it; show the error before and after."""
        log, law, over = self.tabs[3], self.law, answers.workspace_poses(self.state.drawn)
        before = answers.position_error(self.state.believing(None), law, over)
        visited = log.calibrate()
        after = answers.position_error(self.state, law, over)
        drawn = self.state.drawn
        bound = accuracy(drawn, over, calibrated_on=visited, errors="nan").rms
        self._verdict.content = words.page(
            words.verdict(drawn, law, (before, after, bound), len(over), len(visited))
        )

    def stop(self) -> None:
        """Stop serving the page."""
        self._stopped.set()
        self._player.join()
        self._computations.shutdown(cancel_futures=True)
        self._events.shutdown(cancel_futures=True)
        with contextlib.redirect_stdout(None):
            self.server.stop()


def plot(gui: GuiApi, title: str, data: Iterable[Array], series: Sequence[uplot.Series]) -> Any:
    """Add a plot of series against the first of the data."""
    return gui.add_uplot(
        tuple(data),
        (uplot.Series(label=""), *series),
        title=title,
        scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
        legend=uplot.Legend(show=True),
        aspect=1.6,
    )


class Tab:
    """A tab of the panel, made from the page and the page's controls."""

    def __init__(self, page: Page):
        self.page = page

    def follow(self, state: State) -> None:
        """Show the state, after a change from elsewhere."""

    def tick(self, now: float) -> None:
        """Advance the animation to the time `now`."""
