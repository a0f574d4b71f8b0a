"""Simulated faults on every plant."""

import re

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import _core, logs
from truepose.commands.options import faults_of
from truepose.faults import Fault
from truepose.faults.fault import FAULT_KINDS
from truepose.simulation.plants.dynamic import DynamicPlant, visit
from truepose.simulation.plants.exact import ExactPlant

AT, UNTIL = 0.1, 0.15  # s, within the usual move of 0.2 s
SIZES = {"bias": 0.01, "jump": 0.01, "spike": 0.02, "drift": 0.1, "gain": 1.05, "delay": 0.0042}
SIZES |= {"noise": 0.01, "coarse": 16.0, "hold": 0.005}
AT_REST = ("bias", "jump", "sign", "gain", "swap")
MOVE = np.array([[0.05, -0.05, -0.45, 0.1]])


def fault(kind, reading="theta", at=AT, until=None):
    other = "q2" if kind == "swap" else None
    return Fault(reading, kind, at, SIZES.get(kind), until, other)


def reads(kind, time, healthy, column):
    """What the definition makes of healthy readings (T, n + r), from AT on."""
    s, since = healthy[:, column], time - AT
    first = int(np.argmax(since >= -1e-9))
    late = np.maximum(np.arange(len(s)) - 5, 0)  # 4.2 ms in periods of 1 ms
    lying = {
        "bias": s + 0.01,
        "jump": s + 0.01,
        "spike": s + 0.02 * (np.arange(len(s)) == first),
        "stuck": np.full(len(s), s[first]),
        "dropout": np.full(len(s), np.nan),
        "drift": s + 0.1 * since,
        "sign": -s,
        "gain": 1.05 * s,
        "delay": s[late],
        "swap": healthy[:, 1],
        "hold": s[np.maximum(first + (np.arange(len(s)) - first) // 5 * 5, 0)],
    }[kind]
    return np.where(np.arange(len(s)) < first, s, lying)


@pytest.fixture(scope="module")
def exact(h4):
    return h4.without_quantization()


@pytest.fixture(scope="module")
def whole(h4):
    return tp.simulate(h4)


@pytest.mark.parametrize("reading", ["theta", "q1"])
@pytest.mark.parametrize("kind", [k for k in FAULT_KINDS if k not in ("noise", "coarse", "loose")])
def test_a_faulty_reading_is_what_its_kind_makes_of_the_true_one(exact, kind, reading):
    column = exact.readings.index(reading)
    run = tp.simulate(exact, faults=[fault(kind, reading)], controller="estimated")
    healthy = exact.extended_positions(run.x)
    expected = healthy.copy()
    expected[:, column] = reads(kind, run.time, healthy, column)
    if kind == "swap":
        expected[run.time >= AT - 1e-9, 1] = healthy[run.time >= AT - 1e-9, column]
    assert len(run.time) > 150
    np.testing.assert_allclose(run.q_e, expected, rtol=0, atol=1e-12)


ENDS = [k for k in FAULT_KINDS if k not in ("jump", "spike", "coarse")]  # `exact` has no counts


@pytest.mark.parametrize("kind", ENDS)
def test_a_fault_that_ends_leaves_a_whole_reading(exact, kind):
    over = fault(kind, "theta", until=AT + 0.002)
    run = tp.simulate(exact, faults=[over])
    off = ~(np.abs(run.q_e[:, 4] - exact.extended_positions(run.x)[:, 4]) < 1e-12)
    assert set(np.flatnonzero(off)) <= {100, 101}
    assert off.any() or kind in ("stuck", "hold", "loose")  # stuck reads right where it stops
    assert len(run.time) == 401


def test_two_faults_act_one_after_the_other(exact):
    run = tp.simulate(exact, faults=[fault("gain", "q1"), fault("bias", "q1")], controller="joint")
    s = exact.extended_positions(run.x)[100:, 0]
    assert run.q_e[100:, 0] == pytest.approx(1.05 * s + 0.01, abs=1e-12)


def test_a_frozen_theta_takes_the_nacelle_away_under_the_papers_law_alone(h4):
    """The worst of them: the TEJ multiplies θ's error by |j|², 8 to 38."""
    stuck = [fault("stuck")]
    astray, usual = (tp.simulate(h4, controller=law, faults=stuck) for law in ("tej", "joint"))
    assert np.linalg.norm(astray.error[:, :3], axis=1).max() > 0.37
    assert np.degrees(np.abs(astray.error[:, 3]).max()) > 130
    assert usual.x.tobytes() == tp.simulate(h4, controller="joint").x.tobytes()


def test_without_an_answer_the_machine_goes_on_with_its_last_torque(h4, whole):
    run = tp.simulate(h4, faults=[fault("dropout", "q1", until=AT + 0.003)])
    silent = np.flatnonzero(~run.answered)
    assert silent.tolist() == [100, 101, 102] and len(run.time) == len(whole.time)
    assert (run.torque[silent] == run.torque[99]).all()
    assert (run.cycle_status[silent] == run.cycle_status[100]).all()
    assert _core.describe(int(run.cycle_status[100])) == "not finite"
    assert run.status == "no answer in 3 cycles: not finite"
    assert np.abs(run.error[-1, :3]).max() < 1e-3  # and finds back
    assert whole.answered.all() and whole.status == "ok" and not whole.near_singular.any()


def test_out_of_its_workspace_the_run_ends_and_says_so(h4):
    run = tp.simulate(h4, faults=[fault("sign", "q1")])
    assert len(run.time) < 401
    assert (
        run.status
        == run.ended
        == f"stopped after {len(run.time) * 1e-3:.3f} s: " + (run.ended.split("s: ", 1)[1])
    )


def test_a_log_tells_where_there_was_no_answer(h4, tmp_path):
    run = tp.simulate(h4, faults=[fault("dropout", until=AT + 0.003)])
    assert "no_answer" not in {column.name for column in tp.simulate(h4).columns()}
    flags = {column.name: column.values for column in run.columns()}["no_answer"]
    assert np.flatnonzero(flags).tolist() == [100, 101, 102]
    for ending in (".csv", ".parquet", ".mcap"):
        if ending != ".csv":
            pytest.importorskip({".parquet": "pyarrow", ".mcap": "mcap"}[ending])
        logs.write(run, tmp_path / f"run{ending}")
        np.testing.assert_array_equal(logs.read(h4, tmp_path / f"run{ending}").readings, run.q_e)


@pytest.mark.parametrize("kind", AT_REST)
@pytest.mark.parametrize("reading", ["theta", "q1"])
def test_a_robot_rests_where_its_simulated_move_ends(exact, kind, reading):
    """Or nowhere, where the fault turns the loop's feedback round and the move runs away."""
    robot = exact.with_gravity((0, 0, 0))
    lying = [fault(kind, reading, at=0)]
    plants = [
        ExactPlant(robot, level="ideal", faults=lying),
        DynamicPlant(robot, duration=0.2, hold=0.8, faults=lying),
    ]
    statics, moved = (plant.visit(robot, MOVE, tp.Controller()) for plant in plants)
    if kind in ("sign", "swap"):
        assert statics.status[0] != "ok" and moved.status[0] != "ok"
        assert np.isnan(statics.x).all() and np.isnan(moved.x).all()
    else:
        assert statics.status[0] == moved.status[0] == "ok"
        assert moved.x == pytest.approx(statics.x, abs=1e-6)
        assert moved.q_e == pytest.approx(statics.q_e, abs=1e-6)
        assert np.abs(statics.x - MOVE).max() > 1e-4


@pytest.mark.parametrize("gain", [0.5, 2.0, 3.0])
def test_an_encoder_that_counts_several_times_halves_or_doubles_the_way(exact, gain):
    """Gain 2 overstates the motion: steps as long as the nominal robot's would not settle."""
    wanted = exact.ikm(MOVE)
    wanted[:, 0] /= gain
    plant = ExactPlant(exact, level="ideal", faults=[Fault("q1", "gain", size=gain)])
    found = plant.visit(exact, MOVE, tp.Controller(law="joint"))
    assert found.x == pytest.approx(exact.fkm(wanted), abs=1e-9)


def test_along_a_path_the_faults_clock_runs_on(h4):
    poses = np.repeat(MOVE, 3, axis=0) * [[1, 1, 1, 1], [0, 1, 1, -1], [1, 0, 1, 0.5]]
    usual = {"duration": 0.25, "hold": 0.35}
    second = Fault("theta", "bias", at=0.6, size=0.01, until=1.2)
    plants = [DynamicPlant(h4, faults=f, **usual) for f in ((), [second])]
    controller = tp.Controller(frequency=40, velocity_bandwidth=300)
    whole, lying = (plant.visit(h4, poses, controller) for plant in plants)
    assert lying.status.tolist() == ["ok"] * 3
    assert lying.x[0].tolist() == whole.x[0].tolist()
    assert abs(lying.x[1, 3] - whole.x[1, 3]) > 5e-3
    assert np.abs(lying.x[2] - whole.x[2]).max() < 1e-3


def test_what_is_stuck_stays_stuck_from_pose_to_pose(h4):
    poses = np.repeat(MOVE, 3, axis=0) * [[1, 1, 1, 1], [0, 1, 1, -1], [1, 0, 1, 0.5]]
    stuck = Fault("theta", "stuck", at=0.5)
    q_e, _, x, status = visit(h4, h4, poses, "joint", faults=[stuck])
    assert status.tolist() == ["ok"] * 3
    assert (q_e[1:, 4] == q_e[1, 4]).all() and np.ptp(x[:, 3]) > 0.1


def test_a_visit_says_where_the_controller_had_no_answer(h4):
    lost = Fault("theta", "dropout", at=0.3, until=0.304)
    q_e, _, x, status = visit(h4, h4, np.repeat(MOVE, 2, axis=0), faults=[lost])
    assert status.tolist() == ["no answer in 4 cycles: not finite", "ok"]
    assert np.isfinite(x).all() and np.isfinite(q_e).all()
    assert DynamicPlant(h4, faults=[lost], hold=0.15).visit(
        h4, MOVE, tp.Controller(frequency=40, velocity_bandwidth=300)
    ).status.tolist() == ["no answer in 4 cycles: not finite"]


BAD = [
    (("theta", "stuk"), "unknown kind of fault 'stuk'; did you mean 'stuck'?"),
    (("theta", "bias"), "theta: bias: size = None: must be a finite number, rad or m"),
    (("theta", "bias", 0, np.nan), "size = nan: must be a finite number"),
    (("theta", "drift", 0, np.inf), "size = inf: must be a finite number, rad/s or m/s"),
    (("theta", "stuck", 0, 0.1), "theta: stuck: size = 0.1: this kind has none"),
    (("theta", "stuck", -1.0), "at = -1.0: must be a finite number of at least 0"),
    (("theta", "stuck", np.nan), "at = nan: must be a finite number of at least 0"),
    (("theta", "delay", 0, 0.0), "size = 0.0: must be a finite number greater than 0, s"),
    (("theta", "coarse", 0, -1.0), "size = -1.0: must be a finite number greater than 0, a f"),
    (("theta", "stuck", 0.2, None, 0.1), "until = 0.1: must be greater than at, 0.2"),
    (("theta", "jump", 0.2, 0.1, 0.3), "until = 0.3: has no end; a bias may have one"),
    (("theta", "swap"), "other = None: must name the reading that it is swapped with"),
    (("theta", "sign", 0, None, None, "q1"), "other = 'q1': only of a swap"),
]


@pytest.mark.parametrize(("words", "said"), BAD, ids=lambda v: " ".join(map(str, v[:2])))
def test_a_fault_that_is_none_is_refused_in_one_line(words, said):
    with refused(re.escape(said)):
        Fault(*words)


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        (
            [Fault("thet", "stuck")],
            "unknown reading 'thet'; did you mean 'theta'? (choices: q1,",
        ),
        ([Fault("q1", "swap", other="q9")], "unknown reading 'q9'"),
        ([Fault("q1", "swap", other="q1")], "unknown other reading 'q1'"),
        (
            [Fault("q1", "swap", other="z_telemeter")],
            "unknown other reading 'z_telemeter'",
        ),
        ([Fault("q1", "delay", size=11.0)], "at most 10000 control periods of 0.001 s"),
        (Fault("q1", "stuck"), "faults: must be a list of Fault"),
        ("q1:stuck", "faults: must be a list of Fault"),
        ({Fault("q1", "stuck")}, "faults: must be a list of Fault"),
        (["q1:stuck"], "faults: 'q1:stuck': must be a Fault"),
    ],
    ids=str,
)
def test_a_fault_that_the_robot_cannot_have_is_refused(h4, faults, said):
    robot = h4.with_sensors("theta", "z_telemeter")
    with refused(re.escape(said)):
        tp.simulate(robot, faults=faults)
    if "periods" not in said:  # a plant does not know its controller's period
        with refused(re.escape(said)):
            DynamicPlant(robot, faults=faults)


@pytest.mark.parametrize("kind", [kind for kind in FAULT_KINDS if kind not in AT_REST])
def test_statics_refuse_what_needs_time(h4, kind):
    with refused(r"needs time.*choices: bias, jump, sign, gain, swap"):
        ExactPlant(h4, faults=[fault(kind, at=0)])
    with refused("statics have no time: leave out at and until"):
        ExactPlant(h4, faults=[fault("bias", at=0.1)])


@pytest.mark.parametrize("kind", FAULT_KINDS)
@pytest.mark.parametrize("until", [None, 0.25])
def test_the_command_line_reads_what_a_fault_says_of_itself(kind, until):
    lying = fault(kind, until=None if kind in ("jump", "spike") else until)
    assert faults_of([str(lying)]) == [lying]


def test_the_command_simulates_a_fault(run, h4):
    words = ("--true", "nominal", "--fault", "theta:stuck@0.1", "--format", "csv")
    status, said, err = run("simulate", "h4", *words)
    alone = tp.simulate(h4, faults=[Fault("theta", "stuck", 0.1)])
    assert status == 0 and err.endswith(f"faults theta:stuck@0.1: {alone.status}\n")
    assert repr(float(np.degrees(np.abs(alone.error[:, 3]).max()))) in said


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("theta", "--fault theta: must be READING:KIND[=SIZE][@TIME[..END]]"),
        ("theta:bias=x", "--fault theta:bias=x: size and times must be numbers"),
        ("theta:stuck@soon", "size and times must be numbers"),
        ("theta:frozen", "unknown kind of fault 'frozen' (choices: bias, jump, "),
        ("phi:stuck", "unknown reading 'phi'"),
    ],
)
def test_the_command_says_what_is_wrong_with_a_fault(refusal, word, said):
    assert said in refusal("simulate", "h4", "--fault", word)


def test_the_documentation_has_every_kind():
    table = Fault.__doc__.split("=\n")[2].splitlines()
    for kind, row in _core.fault_kinds.items():
        (line,) = (line for line in table if line.startswith(f"    {kind} "))
        size, end, rest = (line[part].strip() for part in map(slice, (67, 81, 90), (80, 89, 99)))
        units = {"reading": "rad or m", "reading/s": "rad/s or m/s"}
        assert size == units.get(row.size, row.size)
        assert (end == "yes", rest == "yes") == (row.lasts, row.at_rest)


def test_coarse_counts_are_multiples_of_the_readings_own(h4):
    run = tp.simulate(h4, faults=[Fault("q1", "coarse", size=16)], controller="joint")
    count = 16 * h4.resolution[0]
    np.testing.assert_allclose(run.q_e[:, 0] / count, np.round(run.q_e[:, 0] / count), atol=1e-9)
    unquantized = h4.without_quantization()
    with refused("has no counts; use noise"):
        tp.simulate(unquantized, faults=[Fault("q1", "coarse", size=16)])


def test_noise_differs_from_seed_to_seed_and_repeats_with_it(h4):
    noisy = [Fault("theta", "noise", size=0.01)]
    one, two, other = (
        tp.simulate(h4, faults=noisy, run=tp.simulation.Run(seed=seed)) for seed in (1, 1, 2)
    )
    assert one.q_e.tobytes() == two.q_e.tobytes() != other.q_e.tobytes()
