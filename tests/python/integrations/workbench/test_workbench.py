"""The workbench against the API. Its states, its answers, its page in a browser."""

import contextlib
import http.client
import importlib.metadata
import re
import socket
import time
import webbrowser
from types import SimpleNamespace

import numpy as np
import pytest
from browsing import browser  # noqa: F401 – a fixture

import truepose as tp
from truepose.exceptions import InputError, PoseError, TrueposeError
from truepose.integrations.workbench import answers, motion, playback, serve, words
from truepose.integrations.workbench.state import (
    begin,
    demonstration,
    error_range,
    groups,
    motor_range,
    pose_range,
)
from truepose.robot.frames import frames
from truepose.robot.laws import LAWS


@pytest.fixture
def state(h4):
    """Return an H4 that is not as drawn, off home."""
    return begin(h4).with_drawn_errors(seed=1).sent([0.03, -0.05, -0.42, 0.2])


@pytest.fixture
def somewhere(any_robot, rng):
    """Return any robot's state, drawn from its tolerances, in its workspace."""
    box = any_robot.spec.workspace
    x = any_robot.home + 0.3 * (rng.uniform(box.minimum, box.maximum) - any_robot.home)
    return begin(any_robot).with_drawn_errors(seed=2).sent(x)


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


def test_the_ellipsoid_is_the_covariance(somewhere):
    robot = somewhere.robot
    for how in answers.HOWS:
        P = answers.covariance(robot, somewhere.x_d, how)
        radii, axes = answers.ellipsoid(robot, P)
        whole = axes @ np.diag(radii**2) @ axes.T
        linear = ["xyz".index(name) for name, _ in robot.coordinates if name in "xyz"]
        k = len(linear)
        assert np.allclose(whole[np.ix_(linear, linear)], P[:k, :k], atol=1e-15)
        assert np.linalg.det(axes) == pytest.approx(1)
    assert np.array_equal(
        answers.covariance(robot, somewhere.x_d, "as built"), tp.accuracy(robot, somewhere.x_d)
    )


def test_a_sensor_more_never_harms_and_what_one_calibrates_helps(h4):
    one, two = (
        answers.bounds(begin(h4).with_sensors(names).robot)
        for names in ({"theta"}, {"theta", "z_telemeter"})
    )
    for how in answers.HOWS:
        assert two[how][-1] <= one[how][-1]
    assert one["self-calibrated"][-1] < one["as built"][-1] / 3


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
    with pytest.raises(InputError, match="at most 12 sensors can be in use"):
        crowded.with_sensors([sensor.name for sensor in many.sensor])


def test_every_parameter_has_a_slider_that_reaches_its_tolerance(any_robot):
    found = groups(any_robot)
    spare = {sensor.name for sensor in any_robot.spec.sensor} - {*any_robot.sensors}
    assert [name for names in found.values() for name in names] == [
        name for name in any_robot.parameters if name.split(".")[0] not in spare
    ]
    for name, p in any_robot.parameters.items():
        reach = error_range(any_robot, name)
        assert reach > 0
        assert reach >= 3 * p.sigma


def test_home_is_within_the_sliders(any_robot):
    for values, ends in (
        (any_robot.home, pose_range(any_robot)),
        (any_robot.ikm(any_robot.home), motor_range(any_robot)),
    ):
        assert ((ends[:, 0] <= values) & (values <= ends[:, 1])).all()
        assert (ends[:, 0] < ends[:, 1]).all()


def test_the_map_is_the_conditioning_of_places_about_the_workspace(somewhere):
    places, worst = answers.conditioning_map(somewhere, points=9)
    assert len(places) == len(worst) > 20
    assert ((worst >= 0) & (worst <= 1)).all()
    parallel, serial = somewhere.robot.conditioning(somewhere.x_d)
    at = somewhere.sent(somewhere.x_d)
    _, one = answers.conditioning_map(at, points=1, beyond=-0.5)
    assert one.shape == (1,)
    assert 0 < min(parallel, *serial) <= 1


def test_prices_add_up_as_far_as_the_file_names_them():
    used = [SimpleNamespace(name="a", price=120.0), SimpleNamespace(name="b", price=30.5)]
    robot = SimpleNamespace(spec=SimpleNamespace(used=used), sensors=("a", "b"), r=2)
    assert answers.price(robot) == (150.5, ())
    assert "price 150.5" in words.bill(robot, answers.price(robot))
    used[1] = SimpleNamespace(name="b")
    assert "price 120, without b" in words.bill(robot, answers.price(robot))


@pytest.mark.parametrize("law", LAWS)
def test_a_fault_that_is_switched_on_changes_no_past_and_a_light(state, law):
    stuck = tp.faults.Fault("theta", "stuck", at=0.4)
    before, after = motion.run(state, law), motion.run(state, law, [stuck])
    assert np.array_equal(before.x[:400], after.x[:400])
    assert {health for _, health, _ in motion.lights(before, len(before.time) - 1)} == {"valid"}
    assert ("theta", "failed", "stuck") in motion.lights(after, len(after.time) - 1)
    assert motion.ended([stuck], "theta", 1.0)[0].until == 1.0
    assert motion.ended([stuck], "q1", 1.0) == [stuck]


def test_a_log_is_played_back_and_a_calibration_on_it_brings_the_robot_home(state):
    played = playback.calibrated(playback.simulated_log(state, poses=40))
    before, after = (playback.rms(e.residual) for e in (played.before, played.after))
    assert (after < before / 10).all()
    assert np.isfinite(played.x[0]).all()
    believed = state.believing(played.assessment.fit.robot)
    assert believed.robot.sensors == state.robot.sensors
    wrong, right = (np.linalg.norm(answers.rests(s)["joint"].off) for s in (state, believed))
    assert right < wrong / 2
    assert believed.believing(None).robot == state.drawn
    shown = words.residuals(played, 0)
    assert "theta (°)" in shown and shown.count("<th") == 5


def test_a_log_in_degrees_is_refused_in_one_line(state):
    q_e = state.truth.extended_positions([state.x_d] * 8)
    q_e[:, 4] = np.degrees(q_e[:, 4])
    table = dict(zip(state.drawn.readings, q_e.T, strict=True))
    with pytest.raises(InputError, match="theta: in degrees, must be rad"):
        playback.opened(state.drawn, tp.logs.of(state.drawn, table))


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
    pytest.importorskip("viser", reason="the workbench's page needs viser")
    with taken() as held:
        port = held.getsockname()[1]
        status, out, err = run("workbench", "h4", "--port", port, "--no-browser")
    assert (status, out) == (2, "")
    where = f"--port {port}: 127.0.0.1:{port}"
    assert err == f"truepose: error: {where}: Address already in use; choose another\n"


def test_without_viser_one_line_names_the_extra(run, monkeypatch):
    monkeypatch.setattr(serve.importlib.util, "find_spec", lambda name: None)
    status, out, err = run("workbench", "h4", "--no-browser")
    assert (status, out) == (2, "")
    assert err == 'truepose: error: the workbench needs viser: pip install "truepose[workbench]"\n'


def test_without_a_browser_one_line_says_what_else(run, monkeypatch):
    pytest.importorskip("viser", reason="the workbench's page needs viser")

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
    pytest.importorskip("viser", reason="the workbench's page needs viser")
    port = free()
    status, _, err = run("workbench", "h4", "--port", port, "--no-browser", "--log", "no.csv")
    assert status == 2
    assert err.startswith("truepose: error: no.csv: ") and err.count("\n") == 1
    serve.require_free("127.0.0.1", port)


@pytest.fixture
def page(h4):
    """Return a served page of an H4 that is not as drawn."""
    pytest.importorskip("viser", reason="the workbench's page needs viser")
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
    pytest.importorskip("viser", reason="the workbench's page needs viser")
    monkeypatch.setattr("truepose.integrations.workbench.guard.Guard._guarded", None)
    monkeypatch.setattr(
        "truepose.integrations.workbench.guard.Guard.installed", contextlib.nullcontext
    )
    port = free()
    with pytest.raises(TrueposeError, match="cannot guard this viser"):
        serve.open_page(h4, port=port)
    serve.require_free("127.0.0.1", port)


def test_the_command_prints_the_token_and_the_network_s_address(run, monkeypatch):
    pytest.importorskip("viser", reason="the workbench's page needs viser")
    monkeypatch.setattr(serve, "own_address", lambda: "10.1.2.3")
    monkeypatch.setattr(serve, "serve", lambda page: page.stop())
    port = free()
    _, out, _ = run("workbench", "h4", "--port", port, "--no-browser", "--host", "0.0.0.0")
    assert re.search(rf"http://localhost:{port}/\?token=[\w-]{{20,}} ", out), out
    assert re.search(rf"From other devices: http://10.1.2.3:{port}/\?token=[\w-]{{20,}}\n", out)


def test_a_drag_moves_the_sliders_and_one_out_of_reach_says_why(page, h4):
    x = np.array([0.05, 0.02, -0.41, 0.1])
    page._dragged(frames(h4, x), True)
    assert np.allclose(page.state.x_d, x, atol=1e-12)
    assert page.tabs[0]._pose[0].value == 50.0
    assert page.tabs[0]._motors[0].value == pytest.approx(np.degrees(h4.ikm(x)[0]), abs=0.06)
    page._dragged(frames(h4, [2.0, *x[1:]]), True)
    assert np.allclose(page.state.x_d, x, atol=1e-12)
    assert "unreachable" in page._answers.content


def test_the_first_minute_calibrates_a_robot_whose_rod_is_too_long():
    pytest.importorskip("viser", reason="the workbench's page needs viser")
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
    pose, errors, sensors, log, faults = page.tabs[:5]
    assert "85 off" in errors._list.content
    before = sensors._bounds.content
    with page.doing():
        page.state = page.state.with_sensors(["theta", "z_telemeter"])
    assert sensors._bounds.content != before
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
    for _ in range(400):  # the page plays by itself
        if "failed (" in faults._lights.content:
            break
        time.sleep(0.05)
    assert "failed (" in faults._lights.content
    with page.doing():
        faults.toggle()
    assert not page.moving and pose._pose[0].value == pytest.approx(
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


def test_a_log_that_is_opened_on_the_page_is_played(page, rng, anywhere):
    x = anywhere(page.state.drawn, 12, rng)
    rows = np.array([page.state.truth.read(x, seed=3)]).reshape(12, -1)
    text = [",".join(page.state.drawn.readings), *(",".join(map(repr, r.tolist())) for r in rows)]
    log = page.tabs[3]
    with page.doing():
        log._upload(SimpleNamespace(name="../log.csv", content="\n".join(text).encode()))
    assert page._said == ""
    assert log._line.max == 12 and not log._calibrate.disabled
    first = page.state.x_d
    log._run.value = True
    with page.lock:
        log.tick(time.perf_counter())
    assert log._line.value >= 2 and np.abs(page.state.x_d - first).max() > 1e-3
    with page.doing():
        log._upload(SimpleNamespace(name="log.csv", content=b"q1,q2\n0,0"))
    assert page._said.startswith("log.csv: no columns q3, q4, theta")
    assert log._line.max == 12  # the one before stays


@pytest.mark.parametrize(("width", "dark"), [(390, True), (1280, False)])
def test_in_a_browser_a_key_moves_the_robot(page, browser, width, dark):  # noqa: F811
    page.dress(dark)
    seen, wrong = browser.new_page(viewport={"width": width, "height": 844}), []
    seen.set_default_timeout(90_000)
    seen.on("pageerror", lambda error: wrong.append(str(error)))
    seen.goto(page.address("127.0.0.1"))
    seen.wait_for_selector("text=steady state")
    for law in LAWS:
        assert seen.get_by_text(law, exact=True).count() >= 1
    box = seen.get_by_text("steady state").bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= width
    assert seen.evaluate("document.scrollingElement.scrollWidth") <= width
    background = seen.locator(".mantine-Paper-root").first.evaluate(
        "e => getComputedStyle(e).backgroundColor"
    )
    assert (max(map(int, re.findall(r"\d+", background)[:3])) < 100) == dark
    law = page.law
    seen.keyboard.press("l")
    for _ in range(600):
        if page.law != law:
            break
        seen.wait_for_timeout(50)
    assert page.law != law
    x = page.state.x_d[0]
    for _ in range(60):  # a key that meets the answer to the one before is taken back by it
        seen.get_by_role("slider").first.press("ArrowRight")
        seen.wait_for_timeout(500)
        if page.state.x_d[0] > x:
            break
    assert page.state.x_d[0] > x
    assert not wrong
    seen.close()


def test_a_handle_shifts_or_turns_what_is_free(any_robot):
    pytest.importorskip("viser")
    from truepose.integrations.workbench.scene import Scene

    added = []
    scene = Scene.__new__(Scene)
    handle = SimpleNamespace(on_update=lambda function: function)
    add = lambda path, *_, **__: added.append(path) or handle  # noqa: E731
    scene._server = SimpleNamespace(scene=SimpleNamespace(add_transform_controls=add))
    scene._size = 1.0
    scene._add_gizmos(begin(any_robot), lambda *_: None)
    units = {unit for _, unit in any_robot.coordinates}
    assert set(added) == {{"m": "/shift", "rad": "/turn"}[unit] for unit in units}
