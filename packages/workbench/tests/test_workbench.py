"""The workbench against the API. Its states, its answers, its page in a browser."""

import asyncio
import contextlib
import http.client
import importlib.metadata
import itertools
import re
import socket
import subprocess
import sys
import time
import webbrowser
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from browsing import browser  # noqa: F401 – a fixture

import truepose as tp
from truepose.design.criterion import Criterion
from truepose.design.error_budget import errors_at
from truepose.exceptions import PoseError, TrueposeError
from truepose.robot import LAWS, summed
from truepose.robot.frames import frames
from truepose.show.charts import LAW_COLOURS
from truepose_workbench import answers, log_tab, motion_tab, serve, words
from truepose_workbench.scene import Scene
from truepose_workbench.state import (
    Terms,
    begin,
    demonstration,
    error_range,
    groups,
    motor_range,
    pose_range,
)


@pytest.fixture
def state(h4):
    """Return an H4 that is not as drawn, off home."""
    return begin(h4).with_drawn_errors(seed=1).sent([0.03, -0.05, -0.42, 0.2])


@pytest.fixture
def somewhere(chained_robot, rng):
    """Return any robot's state, drawn from its tolerances, in its workspace."""
    box = chained_robot.spec.workspace
    x = chained_robot.home + 0.3 * (rng.uniform(box.minimum, box.maximum) - chained_robot.home)
    return begin(chained_robot).with_drawn_errors(seed=2).sent(x)


def test_a_nacelle_goes_to_where_it_is_dragged_and_its_motors_with_it(somewhere):
    state, robot = somewhere, somewhere.robot
    home = state.sent(robot.home)
    x = home.dragged(frames(robot, state.x_d)).x_d
    assert np.allclose(frames(robot, x), frames(robot, state.x_d), atol=1e-12)
    x = home.driven(robot.ikm(state.x_d)).x_d
    assert np.allclose(frames(robot, x), frames(robot, state.x_d), atol=1e-9)
    with pytest.raises(PoseError, match=r"unreachable|branch lost|limit"):
        state.sent(robot.home + 50.0)


def test_without_errors_every_law_rests_where_it_is_sent_and_with_them_as_settle_says(somewhere):
    honest = answers.rests(somewhere.without_errors())
    for law, rest in answers.rests(somewhere).items():
        if rest.x is None:
            with pytest.raises(TrueposeError, match=re.escape(rest.why)):
                tp.steady_state(somewhere.robot, somewhere.truth, somewhere.x_d, law)
            continue
        x = tp.steady_state(somewhere.robot, somewhere.truth, somewhere.x_d, law)
        assert np.array_equal(rest.x, x)
        assert np.linalg.norm(rest.off) > 1e-6 > np.linalg.norm(honest[law].off)
        assert honest[law].turn < 1e-6


def test_the_picture_magnifies_what_is_wrong_and_nothing_else(somewhere):
    x = answers.rests(somewhere)["joint"].x
    ghost, real = answers.skeletons(somewhere, x)
    assert np.allclose(real, somewhere.truth.skeleton(x), atol=1e-12)
    _, large = answers.skeletons(somewhere, x, magnified=20)
    assert np.allclose(large - ghost, 20 * (real - ghost), atol=1e-12)
    right = somewhere.without_errors()
    ghost, real = answers.skeletons(right, right.x_d, magnified=100)
    assert np.allclose(ghost, real, atol=1e-12)


def test_ellipsoids_are_covariances(somewhere):
    robot, axes = (
        somewhere.robot,
        ["xyz".index(n) for n, _ in somewhere.robot.coordinates if n in "xyz"],
    )
    whole = np.zeros((1, 3, 3))
    whole[np.ix_([0], axes, axes)] = tp.accuracy(robot, somewhere.x_d)[: len(axes), : len(axes)]
    (radii,), (turn,) = answers.ellipsoids(whole)
    assert np.allclose(turn @ np.diag(radii**2) @ turn.T, whole[0], atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1)


def test_sensors_are_read_in_the_files_order_and_no_more_than_fit(h4, state):
    assert state.with_sensors(["z_telemeter", "theta"]).robot.sensors == ("theta", "z_telemeter")
    assert state.with_sensors([]).truth.r == 0
    many = h4.spec.model_copy(
        update={
            "sensor": tuple(
                h4.spec.sensor[0].model_copy(update={"name": f"theta{k}"}) for k in range(17)
            ),
            "sensors": (),
        }
    )
    crowded = begin(tp.Robot(many))
    with pytest.raises(tp.RobotFileError, match="at most 12 sensors can be in use"):
        crowded.with_sensors([sensor.name for sensor in many.sensor])


def test_every_parameter_has_a_slider_that_reaches_its_tolerance(chained_robot):
    found = groups(chained_robot)
    spare = {sensor.name for sensor in chained_robot.spec.sensor} - {*chained_robot.sensors}
    assert [name for names in found.values() for name in names] == [
        name for name in chained_robot.parameters if name.split(".")[0] not in spare
    ]
    for name, p in chained_robot.parameters.items():
        reach = error_range(chained_robot, name)
        assert reach > 0
        assert reach >= 3 * p.sigma


def test_home_is_within_the_sliders(chained_robot):
    for values, ends in (
        (chained_robot.home, pose_range(chained_robot)),
        (chained_robot.ikm(chained_robot.home), motor_range(chained_robot)),
    ):
        assert ((ends[:, 0] <= values) & (values <= ends[:, 1])).all()
        assert (ends[:, 0] < ends[:, 1]).all()


def test_maps_are_of_places_about_the_workspace(somewhere):
    found = answers.map_of(somewhere, "conditioning")
    assert len(found.places) == len(found.shares) > 20
    assert ((found.shares >= 0) & (found.shares <= 1)).all()
    found = answers.map_of(somewhere, "position error")
    target = frames(somewhere.robot, somewhere.x_d)[:3, 3]
    near = found.shares[np.argmin(np.linalg.norm(found.places - target, axis=1))]
    x, terms = somewhere.x_d[None], somewhere.terms
    (there,) = errors_at(somewhere.robot, x, terms.use(somewhere.robot), terms.confidence)
    factor = summed(somewhere.robot).factor
    assert near * float(found.bad) == pytest.approx(factor * there, rel=0.1)


@pytest.mark.parametrize("terms", [Terms(), Terms(20, True), Terms(10, confidence=0.6)], ids=str)
@pytest.mark.parametrize("name", ["h4", "stewart", "g1-ankle", "delta"])
def test_a_set_of_the_front_has_its_error_in_the_budget_and_on_the_map(name, terms):
    robot = tp.load(name)
    found = answers.front(robot, {one.name: 1.0 for one in robot.spec.sensor}, terms)
    every = [choice.error for choice in found.front]
    assert every == sorted(every, reverse=True) and answers.within(found, -1.0) is None
    for budget in (0.0, 1.0, 99.0):
        choice = answers.within(found, budget)
        used = robot.with_sensors(*choice.sensors)
        whole = answers.contributions(used, terms)
        assert choice.price <= budget and whole.error == pytest.approx(choice.error, rel=1e-6)
        assert sum(one.error**2 for one in whole.contributions) == pytest.approx(whole.sigma**2)
        each = errors_at(used, found.over, terms.use(used), terms.confidence)
        at_worst = Criterion("worst", terms.confidence)
        worst = tp.design.error_budget(used, terms.use(used, found.over), at_worst).error
        assert each.max() == pytest.approx(worst, rel=1e-6)
    more = answers.front(robot, found.prices, replace(terms, confidence=0.99))
    assert (np.subtract([choice.error for choice in more.front], every) > 0).all()


def test_a_plan_is_played_from_home_through_its_poses_and_back(h4):
    plan = answers.plan(h4.with_sensors("wire1", "wire2", "wire3"), Terms(4))
    assert len(plan.poses) == 4
    for way, x in ((0.0, h4.home), (5.0, h4.home), (7.0, h4.home), *enumerate(plan.poses, 1)):
        assert np.allclose(answers.along(plan, way), x)
    assert np.allclose(answers.along(plan, 1.5), plan.poses[:2].mean(axis=0))


def seen_by_protan_and_deutan(colour):
    """Return a colour as readers without red or green cones see it (Machado et al. 2009), Lab."""
    rgb = np.array([*bytes.fromhex(colour[1:])]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    kinds = {
        "protan": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
        "deutan": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    }
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    for matrix in kinds.values():
        xyz = to_xyz @ np.clip(matrix @ linear, 0, 1) / [0.9505, 1.0, 1.089]
        x, y, z = np.cbrt(xyz)
        yield np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("colours", [LAW_COLOURS, motion_tab.LIGHTS], ids=["laws", "lights"])
def test_colours_differ_for_colour_blind_readers(colours):
    for one, other in itertools.combinations(colours.values(), 2):
        pairs = zip(seen_by_protan_and_deutan(one), seen_by_protan_and_deutan(other), strict=True)
        assert min(np.linalg.norm(a - b) for a, b in pairs) > 15, (one, other)


@pytest.mark.parametrize("law", LAWS)
def test_a_fault_that_is_switched_on_changes_no_past_and_a_light(state, law):
    stuck = tp.faults.Fault("theta", "stuck", at=0.4)
    before, after = motion_tab.run(state, law), motion_tab.run(state, law, [stuck])
    assert np.array_equal(before.x[:400], after.x[:400])
    last = len(after.time) - 1
    healthy, shown = motion_tab.lights(before, len(before.time) - 1), motion_tab.lights(after, last)
    assert "failed" not in healthy and "suspect" not in healthy and healthy.count("valid") == 5
    assert "theta</td><td>failed (stuck)" in shown
    assert motion_tab.ended([stuck], "theta", 1.0)[0].until == 1.0
    assert motion_tab.ended([stuck], "q1", 1.0) == [stuck]


def test_a_log_is_played_back_and_a_calibration_on_it_brings_the_robot_home(state):
    played = log_tab.calibrated(log_tab.simulated_log(state, poses=40))
    before, after = (log_tab.rms(e.residual) for e in (played.before, played.after))
    assert (after < before / 10).all()
    assert np.isfinite(played.x[0]).all()
    believed = state.believing(played.assessment.fit.robot)
    assert believed.robot.sensors == state.robot.sensors
    wrong, right = (np.linalg.norm(answers.rests(s)["joint"].off) for s in (state, believed))
    assert right < wrong / 2
    assert believed.believing(None).robot == state.drawn
    shown = log_tab.residuals(played, 0)
    assert "theta (°)" in shown and shown.count("<th") == 5


def test_a_log_in_degrees_is_noted(state):
    q_e = state.truth.extended_positions([state.x_d] * 8)
    q_e[:, 4] = np.degrees(q_e[:, 4])
    table = dict(zip(state.drawn.readings, q_e.T, strict=True))
    notes = log_tab.opened(state.drawn, tp.logs.of(state.drawn, table)).notes
    assert any(re.match(r"theta: .* off what motors and tolerances allow: unit", n) for n in notes)


def test_the_help_of_the_command_line_loads_no_viser():
    code = "import sys, truepose.commands.cli; sys.exit('viser' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_words_are_no_markup(h4):
    assert "<b>" not in words.note("<b>")
    assert (
        words.laws(
            {"joint": answers.Rest(None, np.zeros(3), 0.0, "<i>")}, {"joint": "#000000"}
        ).count("&lt;i&gt;")
        == 1
    )


def taken():
    """Return a socket that holds a port."""
    held = socket.socket()
    held.bind(("127.0.0.1", 0))
    held.listen()
    return held


def free() -> int:
    with taken() as held:
        return held.getsockname()[1]


def test_a_port_in_use_is_one_line(run):
    with taken() as held:
        port = held.getsockname()[1]
        status, out, err = run("workbench", "h4", "--port", port, "--no-browser")
    assert (status, out) == (2, "")
    where = f"--port {port}: 127.0.0.1:{port}"
    assert err == f"truepose: error: {where}: Address already in use; choose another\n"


def test_without_a_browser_one_line_says_what_else(run, monkeypatch):

    def none():
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(webbrowser, "get", none)
    status, out, err = run("workbench", "h4", "--port", free())
    assert (status, out) == (2, "")
    assert err == (
        "truepose: error: no browser found; --no-browser serves the page for one on another "
        "machine\n"
    )


def test_a_log_that_is_not_there_ends_the_page(run):
    port = free()
    status, _, err = run("workbench", "h4", "--port", port, "--no-browser", "--log", "no.csv")
    assert status == 2
    assert err.startswith("truepose: error: no.csv: ") and err.count("\n") == 1
    serve.require_free("127.0.0.1", port)


@pytest.fixture
def page(h4):
    """Return a served page of an H4 that is not as drawn."""
    served = serve.open_page(h4, port=free())
    with served.doing():
        served.state = served.state.with_drawn_errors(seed=1)
    yield served
    served.stop()


def asked(page, host="{own}", origin=None, token=None, cookie=None):
    """Ask for the page and for its WebSocket; status of each, bytes of state that came, cookie."""
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    own = f"127.0.0.1:{page.server.get_port()}"
    path = "/" if token is None else f"/?token={token}"
    headers = {"Host": host.format(own=own)}
    headers |= {} if origin is None else {"Origin": origin.format(own=own)}
    headers |= {} if cookie is None else {"Cookie": cookie}
    asking = http.client.HTTPConnection(own)
    asking.request("GET", path, headers=headers)
    response = asking.getresponse()
    body, given = response.read(), response.headers["Set-Cookie"]
    assert response.status == 200 or len(body) < 200
    asking.close()
    with socket.create_connection(("127.0.0.1", page.server.get_port())) as held:
        own_host = headers.pop("Host")
        try:
            with connect(
                f"ws://{own_host}{path}",
                sock=held,
                origin=headers.pop("Origin", None),
                additional_headers=headers,
                subprotocols=[f"viser-v{importlib.metadata.version('viser')}"],
                compression=None,
                max_size=None,
            ) as web:
                return response.status, 101, len(web.recv(timeout=10)), given
        except InvalidStatus as refused:
            return response.status, refused.response.status_code, 0, given


def test_the_address_that_is_printed_opens_the_page(page):
    """By its token or by the cookie that this gives; by any address or name of this machine."""
    token = page._guard.token
    for host in ("{own}", "localhost:9", "192.168.1.7:9", "[::1]:9", socket.gethostname()):
        for origin in (None, f"http://{host}"):
            status, upgraded, size, given = asked(page, host, origin, token)
            assert (status, upgraded) == (200, 101) and size > 1000, (host, origin)
            assert "; HttpOnly; SameSite=Strict" in given
    status, upgraded, size, given = asked(page, cookie=f"a=b; {given.partition(';')[0]}")
    assert (status, upgraded, given) == (200, 101, None) and size > 1000
    assert len(token) > 20 and page.address("10.0.0.2").startswith("http://10.0.0.2:")


@pytest.mark.parametrize(
    "spoilt",
    [
        {"token": None},
        {"token": ""},
        {"token": "x" * 22},
        {"token": "%ff%00%C3"},
        {"token": None, "cookie": "truepose-{port}=no; truepose-1={token}"},
        {"origin": "http://evil.example"},
        {"origin": "http://127.0.0.1:1"},
        {"origin": "http://localhost.evil.example"},
        {"origin": "null"},
        {"host": "evil.example", "origin": "http://evil.example"},
        {"host": "127.0.0.1.evil.example:8080"},
        {"host": "attacker"},
    ],
    ids=str,
)
def test_other_sites_and_who_has_no_token_get_nothing(page, spoilt):
    """Foreign origins, DNS rebinding, no token or another one: 403, and no byte of state."""
    words = {"port": page.server.get_port(), "token": page._guard.token, "own": "{own}"}
    how = {"token": page._guard.token, **spoilt}
    how = {name: value and value.format(**words) for name, value in how.items()}
    assert asked(page, **how) == (403, 403, 0, None)


def test_a_viser_that_cannot_be_guarded_serves_nothing(h4, monkeypatch):
    monkeypatch.setattr("truepose_workbench.guard.Guard._guarded", None)
    monkeypatch.setattr("truepose_workbench.guard.Guard.installed", contextlib.nullcontext)
    port = free()
    with pytest.raises(TrueposeError, match="cannot guard this viser"):
        serve.open_page(h4, port=port)
    serve.require_free("127.0.0.1", port)


def test_the_command_prints_the_token_and_the_network_s_address(run, monkeypatch):
    monkeypatch.setattr(serve, "own_address", lambda: "10.1.2.3")
    monkeypatch.setattr(serve, "serve", lambda page: page.stop())
    port = free()
    _, out, _ = run("workbench", "h4", "--port", port, "--no-browser", "--host", "0.0.0.0")
    assert re.search(rf"http://localhost:{port}/\?token=[\w-]{{20,}} ", out), out
    assert re.search(rf"From other devices: http://10.1.2.3:{port}/\?token=[\w-]{{20,}}\n", out)


def test_a_drag_moves_the_sliders_and_one_out_of_reach_says_why(page, h4):
    x = np.array([0.05, 0.02, -0.41, 0.1])
    with page.doing():
        page.drag(frames(h4, x), True)
    assert np.allclose(page.state.x_d, x, atol=1e-12)
    assert page.tabs[1].pose[0].handle.value == 50.0
    assert page.tabs[1].motors[0].handle.value == pytest.approx(np.degrees(h4.ikm(x)[0]), abs=0.06)
    with page.doing():
        page.drag(frames(h4, [2.0, *x[1:]]), True)
    assert np.allclose(page.state.x_d, x, atol=1e-12)
    assert "unreachable" in page._answers.content


def test_the_first_minute_calibrates_a_robot_whose_rod_is_too_long():
    served = serve.open_page(demonstration(), port=free())
    try:
        assert served.state.errors == pytest.approx({"chain3.rod": 0.003})
        assert served.state.drawn.sensors == ("theta", "z_telemeter")
        with served.doing():
            served.calibrate()
        before, after, bound = map(float, re.findall(r"<b>([\d.]+)</b>", served._verdict.content))
        assert before > 1 and after < before / 3 and bound < before / 2
        assert "after" in served.tabs[3]._about.content
    finally:
        served.stop()


def test_what_a_hand_does_is_seen_in_every_tab(page):
    design, pose, errors, log, faults = page.tabs[:5]
    assert "85 off" in errors._list.content
    with page.doing():
        page.state = page.state.with_sensors(["theta", "z_telemeter"])
    assert design._ticks["z_telemeter"].value and not design._ticks["wire1"].value
    assert "z_telemeter" in faults._reading.options and "z_telemeter" in errors._group.options
    with page.doing():
        log._simulate_log()
    off = np.linalg.norm(answers.rests(page.state)["joint"].off)
    with page.doing():
        log._fit()
    assert np.linalg.norm(answers.rests(page.state)["joint"].off) < off / 2
    assert "after" in log._about.content
    with page.doing():
        faults.toggle()
        faults._begin_fault()
    until(lambda: "failed (" in faults._lights.content)  # the page plays by itself
    until(lambda: faults._chart.visible and len(faults._chart.data[1]) > 10)
    with page.doing():
        faults.toggle()
    assert not page.moving and pose.pose[0].handle.value == pytest.approx(
        1e3 * page.state.x_d[0], abs=0.06
    )


def test_connectors_that_are_swapped_are_swapped_among_readings_of_one_unit(page):
    faults = page.tabs[4]
    with page.doing():
        page.state = page.state.with_sensors(["theta", "z_telemeter"])
        faults._kind.value = "swap"
        faults._name_size()
    assert faults._other.options == ("q2", "q3", "q4", "theta")
    assert faults._other.visible and not faults._size.visible
    with page.doing():
        faults._begin_fault()
    assert [str(fault) for fault in faults._run.faults] == ["q1:swap=q2@0"]
    with page.doing():  # z_telemeter is the only one in metres
        faults._reading.value = "z_telemeter"
        faults._name_size()
        faults._begin_fault()
    assert "must name the reading that it is swapped with" in page._said
    with page.doing():
        faults.toggle()


def test_the_rows_of_a_log_that_is_opened_on_the_page_are_shown(page, rng, anywhere):
    x = anywhere(page.state.drawn, 12, rng)
    rows = np.array([page.state.truth.read(x, seed=3)]).reshape(12, -1)
    text = [",".join(page.state.drawn.readings), *(",".join(map(repr, r.tolist())) for r in rows)]
    log = page.tabs[3]
    with page.doing():
        log._upload(SimpleNamespace(name="../log.csv", content="\n".join(text).encode()))
    assert page._said == ""
    assert log._line.max == 12 and not log._calibrate.disabled
    first = page.state.x_d
    with page.doing():
        log._line.value = 2
        log._go()
    assert np.abs(page.state.x_d - first).max() > 1e-3
    assert log._chart.title == "residual of theta (°)" and len(log._chart.data[1]) == 12
    with page.doing():
        log._upload(SimpleNamespace(name="log.csv", content=b"q1,q2\n0,0"))
    assert page._said.startswith("log.csv: no columns q3, q4, theta")
    assert log._line.max == 12  # the one before stays


def until(true, seconds=90.0):
    """Wait until something holds, and require it."""
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    assert true()


def test_a_budget_chooses_sensors_that_robot_and_figures_have_at_once(page):
    design = page.tabs[0]
    until(lambda: design._front is not None)
    design._budget.value = 200.0
    with page.doing():
        design._choose(200.0)
    best = answers.within(design._front, 200.0)
    assert page.state.drawn.sensors == page.state.truth.sensors == best.sensors != ()
    assert {*page.scene.overlays._names} == {*best.sensors}
    error = f"{1e3 * best.error:.3g} mm"
    until(lambda: error in design._said.content and "price 200" in design._said.content)
    assert f"200, {error}</title>" in design._said.content
    with page.doing():
        page.state = replace(page.state, terms=Terms(20, True, 0.9))
    until(lambda: "90 % quantile of" in design._said.content)
    best = answers.within(design._front, 200.0)  # of robots that are calibrated
    until(lambda: page.state.drawn.sensors == best.sensors)
    until(lambda: f"{1e3 * best.error:.3g} mm" in design._said.content)
    with page.doing():
        design._price("theta", 0.0)
    until(lambda: design._front.prices["theta"] == 0.0)
    with page.doing():  # the steps cost too: 30 are left, of sensors for 100 each
        design._price("self_calibration", 50.0)
        design._price("reference_pose", 120.0)
    until(lambda: page.state.drawn.sensors == ("theta",) and "price 170," in design._said.content)


def test_undoing_returns_to_what_a_user_changed(page):
    before = page.state
    for change in (lambda s: s.sent(s.x_d + 0.01), lambda s: s.with_sensors([])):
        page._changed = -1.0  # not in one movement
        with page.doing():
            page.state = change(page.state)
    with page.doing():  # in one movement with the last
        page.state = page.state.with_sensors(["theta", "wire1"])
    assert page.state.drawn.sensors == ("theta", "wire1")
    with page.doing():
        page.undo()
    assert page.state.drawn.sensors == before.drawn.sensors
    assert np.array_equal(page.state.x_d, before.x_d + 0.01)
    for _ in range(2):
        with page.doing():
            page.undo()
    assert page.state.drawn == before.drawn and np.abs(page.state.x_d - before.x_d).max() < 1e-12


def test_undoing_a_calibration_takes_its_table_away(page):
    page._changed, known = -1.0, page._verdict.content
    with page.doing():
        page.calibrate()
    assert page._verdict.content != known
    with page.doing():
        page.undo()
    assert page._verdict.content == known


def test_ticks_of_two_users_are_kept_while_the_page_is_busy(page):
    ticks = [page.tabs[0]._ticks[name] for name in ("wire1", "wire3", "pivot1")]
    with page.lock:
        for tick in ticks:  # as viser does for a browser's message
            tick._impl.value = True
            asyncio.run(tick._impl.update_cb[-1](SimpleNamespace(client=object(), target=tick)))
        with page.doing():  # somebody else's change
            page.home()
        assert all(tick.value for tick in ticks)
    until(lambda: {"wire1", "wire3", "pivot1"} <= {*page.state.drawn.sensors})


def test_the_last_of_the_frames_that_arrive_while_the_page_is_busy_is_where_the_nacelle_goes(page):
    handle, x = page.scene._gizmos[0], page.state.x_d
    with page.lock:
        for off, phase in ((0.01, "start"), (0.02, "update"), (0.03, "end")):  # as a browser's
            moved = SimpleNamespace(wxyz=handle.wxyz, position=np.add(handle.position, [off, 0, 0]))
            event = SimpleNamespace(client=object(), target=moved, phase=phase)
            asyncio.run(handle._impl_aux.update_cb[-1](event))
        assert np.array_equal(page.state.x_d, x)
    until(lambda: np.allclose(page.state.x_d, np.add(x, [0.03, 0, 0, 0])))
    until(lambda: np.allclose(handle.position, frames(page.state.robot, page.state.x_d)[:3, 3]))


def test_a_plan_is_drawn_played_and_saved_with_the_robot(page):
    design, sent = page.tabs[0], {}
    page.client = SimpleNamespace(send_file_download=sent.__setitem__)
    with page.doing():
        design._save("plan")
    assert "no plan to save" in page._said
    with page.doing():
        page.state = replace(page.state, terms=Terms(6, True))
        design._ask_plan()
    until(lambda: "of 2000 poses" in design._told.content)
    assert len(page.scene.overlays._plan[1].points) == 6
    design._run.value, x = True, page.state.x_d
    until(lambda: np.abs(page.state.x_d - x).max() > 1e-3)
    design._run.value = False
    with page.doing():
        for what in ("robot", "plan"):
            design._save(what)
    assert page._said == "" and [*sent] == ["h4.toml", "h4-poses.csv"]
    assert sent["h4-poses.csv"].decode().splitlines()[0] == "x,y,z,theta,step"
    assert b'sensors = ["theta"]' in sent["h4.toml"]
    with page.doing():  # a plan is of its sensors
        page.state = page.state.with_sensors(["theta", "wire1"])
    assert design._plan is None and not page.scene.overlays._plan


@pytest.mark.parametrize("map_", answers.MAPS[1:])
def test_a_map_has_a_legend_and_is_kept_while_it_is_true(page, map_):
    with page.doing():
        page.map = map_
    drawn = page.scene.overlays._map
    assert "Map: " in page._answers.content and "linear-gradient" in page._answers.content
    with page.doing():
        page.state = page.state.sent(page.state.x_d + np.eye(4)[0] / 100)
    assert page.scene.overlays._map is drawn
    with page.doing():
        page.state = page.state.sent(page.state.x_d + np.eye(4)[2] / 100)
    assert page.scene.overlays._map is not drawn


def test_a_platform_that_only_turns_has_neither_ellipsoids_nor_a_map_of_places():
    served = serve.open_page(tp.load("g1-ankle"), port=free())
    try:
        assert not served.scene.overlays._ellipsoids.visible
        assert "Ellipsoids" not in served._answers.content
        with served.doing():
            served.map = answers.MAPS[1]
        assert "no map: its platform only turns" in served._answers.content
        until(lambda: "95 % quantile of the turn error" in served.tabs[0]._said.content)
    finally:
        served.stop()


#: Controls that a keyboard reaches and that have no name.
NAMELESS = """() => [...document.querySelectorAll("input, [role=slider], button")].filter(
  e => e.offsetParent && e.tabIndex >= 0 && !(
    e.labels?.length || e.getAttribute("aria-label") || e.textContent.trim())
).map(e => e.outerHTML)"""
#: Pairs of texts and controls that overlap.
OVERLAPS = """() => {
  const every = [...document.querySelectorAll("label[for], .answer div, .answer svg, button")];
  const seen = every.filter(e => e.offsetParent).map(e => [e.outerHTML, e.getBoundingClientRect()]);
  return seen.flatMap(([one, a], k) => seen.slice(0, k).filter(([_, b]) =>
    Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2 &&
    Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 2).map(([other]) => [one, other]));
}"""


@pytest.mark.parametrize(("width", "dark"), [(390, True), (1400, False)])
def test_in_a_browser_keys_choose_sensors_and_every_control_has_a_name(
    page,
    browser,  # noqa: F811
    width,
    dark,
):
    page.dress(dark)
    seen, wrong = browser.new_page(viewport={"width": width, "height": 844}), []
    seen.set_default_timeout(90_000)
    seen.on("pageerror", lambda error: wrong.append(str(error)))
    seen.goto(page.address("127.0.0.1"))
    seen.wait_for_selector("text=steady state")
    assert seen.title() == "h4 – truepose"
    icons = seen.locator("link[rel=icon]").evaluate_all("e => e.map(one => one.href)")
    assert len(icons) == 1 and "d55e00" in icons[0]
    for law in LAWS:
        assert seen.get_by_text(law, exact=True).count() >= 1
    box = seen.get_by_text("steady state").bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= width
    assert seen.evaluate("document.scrollingElement.scrollWidth") <= width
    background = seen.locator(".mantine-Paper-root").first.evaluate(
        "e => getComputedStyle(e).backgroundColor"
    )
    assert (max(map(int, re.findall(r"\d+", background)[:3])) < 100) == dark
    seen.get_by_role("slider", name="Budget").wait_for()
    assert seen.evaluate(NAMELESS) == [] == seen.evaluate(OVERLAPS)
    law = page.law
    seen.keyboard.press("l")
    until(lambda: seen.wait_for_timeout(50) or page.law != law)
    seen.get_by_role("slider", name="Budget").press("End")
    until(lambda: seen.wait_for_timeout(50) or page.state.drawn.r == len(page.tabs[0]._ticks))
    assert not wrong
    seen.close()


def test_a_handle_shifts_or_turns_what_is_free(chained_robot):
    added = []
    scene = Scene.__new__(Scene)
    add = lambda path, *_, **__: added.append(path)  # noqa: E731
    scene._server = SimpleNamespace(scene=SimpleNamespace(add_transform_controls=add))
    scene._size = 1.0
    scene._add_gizmos(begin(chained_robot))
    units = {unit for _, unit in chained_robot.coordinates}
    assert set(added) == {{"m": "/shift", "rad": "/turn"}[unit] for unit in units}
