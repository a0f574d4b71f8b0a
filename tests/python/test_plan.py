"""Planned calibration poses: gain, limits, order."""

import csv
import itertools
import json
from types import SimpleNamespace

import numpy as np
import pytest
from fixtures import drawn_poses, refused

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.design.candidates import CandidatePoses, drawn, rows_of
from truepose.design.exchange import Exchange, Objective, posterior
from truepose.design.poses import Sought
from truepose.design.tour import tour
from truepose.design.where import Use
from truepose.robot import summed


@pytest.fixture(scope="session")
def seeing():
    """Return an H4 read by θ and the telemeter."""
    return tp.load("h4").with_sensors("theta", "z_telemeter")


@pytest.fixture
def problem(rng):
    """Candidates of up to two rows, what is known before, and what counts."""
    C = rng.normal(size=(12, 2, 5)) * rng.lognormal(size=(12, 1, 1))
    C[::3, 1] = 0
    root = rng.normal(size=(5, 5))
    return C, np.linalg.inv(root @ root.T), np.diag(rng.uniform(size=5))


@pytest.mark.parametrize(("sharp", "to"), [(1.0, 1e-9), (1e5, 1e-6)])
def test_what_a_candidate_is_worth_is_what_it_changes(problem, sharp, to):
    """However much sharper than what was known."""
    C, prior, M = problem
    C = sharp * C
    pick = Exchange(C, prior, M).grow(4)
    worth, before = pick.worth()
    for c in set(range(len(C))) - set(pick.chosen):
        G = posterior(prior, C, [*pick.chosen, c])
        assert worth[c] == pytest.approx(before - np.sum(M * (G @ G.T)), rel=to)
    assert (worth[pick.chosen] == -np.inf).all()


@pytest.mark.parametrize("n", [1, 3, 5])
def test_the_set_is_the_best_or_nearly(problem, n):
    C, prior, M = problem
    goal = Objective()
    goal.rows, goal.weights = SimpleNamespace(C=C, known=prior), lambda _: M
    goal.cost = lambda G: float(np.sum(M * (G @ G.T)))
    every = [goal.cost(goal.after(c)) for c in itertools.combinations(range(len(C)), n)]
    found = goal.best(n)
    assert len(set(found)) == n
    assert goal.cost(goal.after(found)) <= 1.02 * min(every)
    bound = goal.certified(found)
    assert (n > 1) * 0.5 * min(every) < bound <= min(every) * (1 + 1e-12)


@pytest.mark.parametrize(
    "how",
    [(), ("reference_pose",), ("reference_pose", "reference_sigma"), ("relative_to",)],
    ids="+".join,
)
@pytest.mark.parametrize("level", ["ideal", "full"])
def test_what_is_promised_is_the_bound(any_robot, anywhere, rng, how, level):
    if (level == "full" and not any_robot.full) or not any_robot.spec.sensor:
        pytest.skip("no such level, or nothing to calibrate by")
    robot = any_robot.with_sensors("all")
    known = {key: 1e-4 if key == "reference_sigma" else robot.home for key in how}
    at = anywhere(robot, 1, rng)[0]
    relative = {key: known[key] for key in how if key == "relative_to"}
    use = Use(poses=[robot.home, at], **{key: known[key] for key in how if key not in relative})
    plan = tp.plan_poses(robot, 6, candidates=40, level=level, use=use, **relative)
    for k in (0, 3, 6):
        x = np.concatenate([np.zeros((0, robot.n)), *(step.poses for step in plan.steps[:k])])
        P = tp.accuracy(robot, plan.over, x, level=level, **known)
        assert plan.sigma[k, -1] == pytest.approx(P.rms, rel=1e-6)
    assert (np.diff(plan.sigma[:, -1]) <= 1e-12).all() or "relative_to" in how
    assert plan.everything <= plan.sigma[-1, -1] * (1 + 1e-9)


def test_planned_poses_promise_more_than_random_ones(any_robot):
    """Than any of twenty random sets of as many of the same candidates."""
    if not any_robot.spec.sensor:
        pytest.skip("nothing to calibrate by")
    plan = tp.plan_poses(any_robot.with_sensors("all"), 10, candidates=300)
    assert plan.sigma[-1, -1] < plan.random.min()


def test_calibrations_on_planned_poses_keep_the_promise(robots_drawn):
    """Robots drawn from the tolerances: squared errors over the promised variance are about 1."""
    robot = tp.load("delta").with_sensors("z_telemeter", "elbow1", "elbow2")
    plan = tp.plan_poses(robot, 20, candidates=500)
    at = plan.over[::4]
    P = tp.accuracy(robot, at, calibrated_on=plan.poses)
    nees = []
    for seed in range(robots_drawn):
        true = robot.sample(seed)
        true = true.with_level(true.highest_level)
        fit = tp.calibrate(robot, true.read(plan.poses, seed))
        found = fit.robot.estimate(true.read(at, 1000 + seed), guess=at)
        off = at - found.x
        nees.append(np.einsum("ki,kij,kj->k", off, np.linalg.inv(P), off).mean() / robot.n)
    spread = np.std(nees) / np.sqrt(len(nees))
    assert abs(np.mean(nees) - 1) < 3 * spread + 0.03
    assert spread < 0.25


@pytest.fixture(scope="module")
def readings(seeing):
    """A log of eight poses."""
    x = tp.plan_poses(seeing, 8, candidates=100, seed=5).poses
    return seeing.sample(3).with_level("full").read(x, 1)


def test_the_next_poses_begin_with_what_a_log_knows(seeing, readings):
    """A fit, its readings, or a table of them: the same plan, from the fit's own accuracy."""
    robot, fit = seeing, tp.calibrate(seeing, readings)
    plan = tp.plan_poses(robot, 5, candidates=200, after=fit)
    assert plan.sigma[0, -1] == pytest.approx(tp.accuracy(fit.robot, plan.over).rms, rel=1e-6)
    for log in (readings, dict(zip(robot.readings, readings.T, strict=True))):
        same = tp.plan_poses(robot, 5, candidates=200, after=log)
        assert same.sigma == pytest.approx(plan.sigma, rel=1e-9)
    alone = tp.plan_poses(robot.with_sensors("theta"), 2, candidates=40, after=fit)
    assert tuple(alone.robot.sensors) == ("theta",)
    anew = tp.plan_poses(robot, 5, candidates=200)
    chosen = [{step.candidate for step in of.steps} for of in (plan, anew)]
    assert chosen[0] != chosen[1]


@pytest.mark.parametrize(("name", "count"), [("h4", 8), ("stewart", 10), ("hexaglide", 10)])
def test_refined_poses_are_better_apart_and_in_reach(name, count):
    """Than the chosen candidates; a hexapod's by 3 % or more; the bound is below both."""
    robot = tp.load(name)
    robot = robot.with_sensors(*[sensor.name for sensor in robot.spec.sensor][:2])
    fine = tp.plan_poses(robot, count, candidates=400)
    plain = tp.plan_poses(robot, count, candidates=drawn(robot, 400, 0))
    least = 1.0 if name == "h4" else 0.97
    assert fine.bound <= fine.sigma[-1, -1] < least * plain.sigma[-1, -1]
    again = tp.accuracy(robot, fine.over, calibrated_on=fine.poses)
    assert again.rms == pytest.approx(fine.sigma[-1, -1], rel=1e-5)
    low, high = robot.spec.workspace.minimum, robot.spec.workspace.maximum
    assert ((fine.poses >= low) & (fine.poses <= high)).all()
    share = (fine.poses - low) / np.subtract(high, low)
    apart = np.abs(share[:, None] - share).max(axis=-1) + np.eye(count)
    assert apart.min() >= 0.01


def test_refined_poses_end_where_no_step_helps(h4):
    """By the bound itself: steps of single coordinates change the plan's σ by next to nothing."""
    plan = tp.plan_poses(h4, 6, candidates=400)
    low, high = (np.array(end) for end in (h4.spec.workspace.minimum, h4.spec.workspace.maximum))
    least = plan.sigma[-1, -1]
    for k, c in itertools.product(range(6), range(4)):
        for step in (-0.02, 0.02):
            x = plan.poses.copy()
            x[k, c] = np.clip(x[k, c] + step * (high - low)[c], low[c], high[c])
            after = tp.accuracy(h4, plan.over, calibrated_on=x).rms
            assert after > least * (1 - 1e-3)


def test_a_target_takes_no_more_than_it_needs(h4):
    plan = tp.plan_poses(h4, candidates=100, target=2e-3)
    assert plan.needed == len(plan.steps)
    assert (
        plan.sigma[-1, -1]
        <= 2e-3
        < tp.plan_poses(h4, plan.needed - 1, candidates=100).sigma[-1, -1]
    )
    assert tp.plan_poses(h4, 5, candidates=100, target=2e-3).needed is None
    assert tp.plan_poses(h4, candidates=100, target=1.0).steps == []


def test_only_where_the_machine_can_be(h4):
    """Limits, the assembly mode and each sensor's range; what is left out is counted."""
    box = h4.spec.workspace
    inside = tp.plan_poses(h4, 5, candidates=200)
    far = np.array([[2.0, 0, -0.4, 0], [0, 0, 0.4, 0]])
    x = np.vstack([step.poses for step in inside.steps])
    plan = tp.plan_poses(h4, 5, candidates=np.vstack([far, x]))
    assert plan.left_out == 2
    assert {step.candidate for step in plan.steps} == {2, 3, 4, 5, 6}
    sensors = [s.model_copy(update={"range": (-0.3, 0.3)}) for s in h4.spec.sensor]
    narrow = type(h4)(
        h4.spec.model_copy(update={"sensor": sensors}),
        {name: p.value for name, p in h4.parameters.items()},
    )
    assert box.maximum[3] > 0.3
    plan = tp.plan_poses(narrow, 5, candidates=200)
    assert plan.left_out > 20
    assert np.abs(narrow.rkm(plan.poses)).max() <= 0.3


@pytest.fixture
def bed(delta, anywhere, rng):
    """Poses of a Delta without sensors that touches its bed, and pairs whose distance is measured.

    The first ten are on the bed, thirty more are the ends of pairs.
    """
    x = anywhere(delta, 40, rng)
    x[:10, 2] = -0.22
    plane = tp.calibration.PlaneContacts(lines=range(10), sigma=2e-5, height=(-0.22, 1e-5))
    pairs = np.arange(10, 40).reshape(-1, 2)
    distances = tp.calibration.DistanceMeasurements(
        pairs=pairs, measured=0.1 * np.ones(15), sigma=5e-5
    )
    return tp.design.CandidatePoses(poses=x, differences=[plane, distances])


def test_points_touched_and_distances_are_chosen_among_each_other(delta, bed):
    """With what each promises: that of the bound when just these are measured."""
    plan = tp.plan_poses(delta, 8, candidates=bed)
    assert plan.candidates == 25
    assert {step.what for step in plan.steps} == {"plane", "distances"}
    x = np.concatenate([step.poses for step in plan.steps])
    first = np.cumsum([0, *(len(step.poses) for step in plan.steps)])
    lines = [int(k) for k, s in zip(first, plan.steps, strict=False) if s.what == "plane"]
    pairs = [
        [int(k), int(k) + 1] for k, s in zip(first, plan.steps, strict=False) if s.what != "plane"
    ]
    measured = [
        tp.calibration.PlaneContacts(lines=lines, sigma=2e-5, height=(-0.22, 1e-5)),
        tp.calibration.DistanceMeasurements(
            pairs=pairs, measured=0.1 * np.ones(len(pairs)), sigma=5e-5
        ),
    ]
    P = tp.accuracy(delta, plan.over, x, differences=measured)
    assert plan.sigma[-1, -1] == pytest.approx(P.rms, rel=1e-6)


def test_a_bed_that_a_log_knows_is_the_same_bed(delta, bed):
    """By its name: more touches of it promise what all together would; of another they do not."""
    x = np.asarray(bed.poses)[:10]
    settings = {"sigma": 2e-5, "slope_sigma": 0.01}
    readings = delta.expected().with_level("full").extended_positions(x)
    log = tp.calibration.PlaneContacts(lines=range(10), above=x[:, 2] + 0.22, **settings)
    fit = tp.calibrate(delta, readings, differences=[log])
    touches = tp.design.CandidatePoses(
        poses=x + np.array([0, 0, 0.02]),
        differences=[tp.calibration.PlaneContacts(lines=range(10), **settings)],
    )
    plan = tp.plan_poses(delta, 4, candidates=touches, after=fit)
    both = np.concatenate([x, *(step.poses for step in plan.steps)])
    together = tp.accuracy(
        delta,
        plan.over,
        both,
        differences=[tp.calibration.PlaneContacts(lines=range(14), **settings)],
    )
    assert plan.sigma[-1, -1] == pytest.approx(together.rms, rel=0.01)
    table = tp.calibration.PlaneContacts(lines=range(10), name="table", **settings)
    other = tp.design.CandidatePoses(poses=touches.poses, differences=[table])
    apart = tp.plan_poses(delta, 4, candidates=other, after=fit)
    assert apart.sigma[-1, -1] != pytest.approx(plan.sigma[-1, -1], rel=1e-3)


@pytest.mark.parametrize("registration", ["known", "unknown"])
def test_poses_measured_from_outside_promise_what_they_teach(delta, registration):
    """σ of the arms after a plan: that of calibrations on its poses, with a tracker."""
    robot = delta.with_sensors("z_telemeter")
    few = tp.design.CandidatePoses(
        poses=np.vstack([s.poses for s in tp.plan_poses(robot, 12, candidates=200).steps]),
        measured_sigma=2e-5,
        registration=registration,
    )
    plan = tp.plan_poses(robot, 12, candidates=few)
    readings = robot.expected().with_level("full").extended_positions(plan.poses)
    fit = tp.calibrate(
        robot,
        readings,
        measured=plan.poses,
        measured_sigma=2e-5,
        options=CalibrationOptions(registration=registration),
    )
    P = tp.accuracy(fit.robot, plan.over)
    assert plan.sigma[-1, -1] == pytest.approx(P.rms, rel=0.01)


@pytest.mark.parametrize(
    ("name", "sensors"),
    [("jugglebot", ()), ("jugglebot", ("roll",)), ("delta", ("z_telemeter",)), ("3rpr", ())],
)
def test_what_a_tracker_is_to_see_is_promised_as_a_calibration_says(name, sensors, anywhere, rng):
    """In its own frame: what a fit states of its predictions, at poses it was not made of."""
    robot = tp.load(name).with_sensors(*sensors)
    x = anywhere(robot, 40, rng)
    candidates = tp.design.CandidatePoses(
        poses=x[6:], measured_sigma=1e-4, measured_angle_sigma=1e-4
    )
    known = {"measured_sigma": 1e-4, "options": CalibrationOptions(measured_angle_sigma=1e-4)}
    plan = tp.plan_poses(robot, 15, candidates=candidates, use=Use(poses=x[:6]), seen=True)

    def seen(plan):
        visited = np.vstack([step.poses for step in plan.steps])
        model = robot.expected().with_level(robot.highest_level)
        fit = tp.calibrate(robot, model.extended_positions(visited), measured=visited, **known)
        P = np.diagonal(fit.accuracy_seen(x[:6]), axis1=1, axis2=2)
        return np.sqrt(P[:, summed(robot).columns].sum(axis=1).mean())

    assert plan.sigma[-1, -1] == pytest.approx(seen(plan), rel=0.02)
    if not sensors:  # with sensors the robot's gains are best for its own frame
        other = tp.plan_poses(robot, 15, candidates=candidates, use=Use(poses=x[:6]))
        assert seen(plan) <= seen(other) * (1 + 1e-6)


@pytest.mark.parametrize("slow", [False, True], ids=["as it is", "one motor slow"])
def test_a_tour_is_the_shortest_of_all_where_all_can_be_tried(any_robot, anywhere, rng, slow):
    robot = any_robot
    if slow:
        speeds = [{"speed_limit": 10.0 ** (k > 0)} for k in range(robot.m)]
        motors = zip(robot.spec.motors, speeds, strict=True)
        slow_ones = tuple(one.model_copy(update=speed) for one, speed in motors)
        table = "chain" if robot.spec.chain else "motor"
        robot = tp.Robot(robot.spec.model_copy(update={table: slow_ones}))
    x = anywhere(robot, 40, rng)
    x = x[np.isfinite(robot.ikm(x, "nan", "ideal")).all(axis=1)][:6]
    q = robot.ikm(np.vstack([robot.home, x]), level="ideal")
    speed = np.array([motor.speed_limit for motor in robot.spec.motors], dtype=float)
    speed = speed if np.isfinite(speed).all() else np.ptp(q, axis=0)

    def along(order):
        way = q[[0, *(k + 1 for k in order), 0]]
        return np.abs(np.diff(way, axis=0) / speed).max(axis=1).sum()

    shortest = min(map(along, itertools.permutations(range(len(x)))))
    assert along(tour(robot, x)) <= 1.05 * shortest


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"count": 0}, "count = 0: must be a whole number of at least 1"),
        ({"count": 50, "candidates": 20}, "count = 50: only 20 candidates are reachable"),
        ({"target": 0.0}, "target = 0.0: must be a finite number greater than 0"),
        ({"target": 1e-6, "candidates": 20}, "all 20 candidates together reach"),
        ({"candidates": [[3.0, 0, 0, 0]]}, "none of 1 is reachable"),
        ({"candidates": [[0.0, 0, 0]]}, "must be"),
        ({"use": Use(poses=[[3.0, 0, 0, 0]])}, "poses 0: cannot be reached"),
        ({"use": Use(calibrated_on=[[0, 0, -0.4, 0]])}, "calibrated_on: a plan chooses these"),
        ({"relative_to": [0.0, 0]}, "relative_to: shape"),
        ({"seen": True, "candidates": 20}, "seen: needs candidates with measured_sigma"),
    ],
)
def test_what_cannot_be_planned_is_said(h4, asked, message):
    with refused(message):
        tp.plan_poses(h4, **asked)


def test_the_command_says_what_the_function_finds(run, tmp_path):
    h4, words = tp.load("h4"), ("plan", "h4", "--count", "4", "--candidates", "80", "--seed", "2")
    status, out, _ = run(*words, "--format", "json", "-o", "poses.csv", "--plot", "plan.svg")
    plan = tp.plan_poses(h4, 4, candidates=80, seed=2)
    rows = json.loads(out)["plan"]
    assert status == 0 and [row["pose"] for row in rows] == [0, 1, 2, 3, 4]
    assert [row["position (mm)"] for row in rows] == pytest.approx(1e3 * plan.sigma[:, -1])
    with (tmp_path / "poses.csv").open() as file:
        written = list(csv.DictReader(file))
    x = [[float(row[name]) for name, _ in h4.coordinates] for row in written]
    assert (np.array(x) == plan.poses).all()
    assert [int(row["step"]) - 1 for row in written] == plan.order
    assert sorted(row["on the tour"] for row in rows[1:]) == [1, 2, 3, 4]
    assert (tmp_path / "plan.svg").read_text().count("</svg>") == 1
    said = run(*words)[1]
    own = f"h4: 4 of 80 poses: {1e3 * plan.sigma[-1, -1]:.2f} mm; σ over 625 poses."
    assert own in said and "Random 4 of them" in said
    assert f"No other 4 are better by more than {plan.gap:.1%}." in said
    more = tp.plan_poses(h4, 14, candidates=drawn(h4, 80, 2)).sigma[-1, -1]  # not refined either
    assert plan.longer == (10, pytest.approx(more, rel=0.1))


def test_poses_that_were_written_are_candidates_again_and_never_lost(run, tmp_path):
    """A plan is written over by a plan; not what somebody has added readings to."""
    words = ("plan", "h4", "--candidates", "60", "-o", "poses.csv")
    assert run(*words, "--count", "6")[0] == 0
    again = run("plan", "h4", "--candidates", "poses.csv", "--count", "6")[1]
    assert "6 of 6 poses" in again
    assert run(*words, "--count", "5", "--force")[0] == 0
    path = tmp_path / "poses.csv"
    before = path.read_text()
    status, _, err = run(*words, "--count", "5")
    assert (status, path.read_text()) == (2, before)
    assert err.startswith("truepose: error: -o poses.csv: exists; --force")


def test_the_command_goes_on_from_a_log(run, seeing, readings):
    header = ",".join(seeing.readings)
    np.savetxt("log.csv", readings, delimiter=",", header=header, comments="")
    words = ("plan", "h4", "--sensors", "theta,z_telemeter", "--candidates", "80", "--count", "3")
    rows = json.loads(run(*words, "--after", "log.csv", "--format", "json")[1])["plan"]
    fit = tp.calibrate(seeing, readings)
    plan = tp.plan_poses(seeing, 3, candidates=80, after=fit)
    assert [row["position (mm)"] for row in rows] == pytest.approx(1e3 * plan.sigma[:, -1])
    alone = json.loads(run(*words, "--format", "json")[1])["plan"]
    assert rows[0]["position (mm)"] < 0.5 * alone[0]["position (mm)"]


def test_a_target_is_met_on_the_command_line_or_the_nearest_told(run, tmp_path):
    said = run("plan", "h4", "--candidates", "80", "--target", "2.5mm")[1]
    assert "Target 2.5 mm: reached with" in said
    said = run("plan", "h4", "--candidates", "80", "--target", "2.5mm", "--count", "2")[1]
    assert "Target 2.5 mm: not reached with 2." in said
    status, said, _ = run("plan", "h4", "--target", "1m", "-o", "plan.csv")
    assert "no more poses needed: 7.47 mm, the target 1000 mm is reached." in said
    assert status == 0 and not (tmp_path / "plan.csv").exists() and "Wrote" not in said
    assert "plan.csv: not written: the plan has no poses" in said


def test_where_poses_hardly_matter_it_is_said(run):
    words = ("plan", "stewart", "--sensors", "all", "--candidates", "200", "--count")
    assert "hardly matters here" in run(*words, "30")[1]
    assert "hardly matters" not in run("plan", "h4", "--candidates", "200", "--count", "10")[1]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("h4", "--target", "3deg"),
            "must be a length greater than 0 with its unit, as 0.1mm (units:",
        ),
        (("h4", "--target", "1.6"), "--target 1.6: must be a length greater than 0 with its unit"),
        (("h4", "--count", "0"), "'--count': Input should be greater than or equal to 1"),
        (("h4", "--candidates", "none.csv"), "none.csv: cannot be read: No such file"),
        (("h4", "--candidates", "0"), "--candidates 0: must be a whole number from 1 to 100000"),
        (("h4", "--after", "none.csv"), "none.csv: cannot be read"),
        (("h4", "--outside", "fine"), "--outside fine: must be a length and an angle"),
        (("h4", "--sensors", "none"), "none identifies a parameter"),
        (("h4", "--reference-pose", "0,0"), "--reference-pose 0,0: must be 4 numbers"),
        (
            (
                "h4",
                "--seen",
            ),
            "--seen: needs --outside",
        ),
        (
            ("h4", "--reference-pose", "0,0,5,0"),
            "--reference-pose 0,0,5,0: h4: pose x = [0, 0, 5, 0",
        ),
        (("h4", "-o", "no/poses.csv"), "-o no/poses.csv: cannot be written"),
        (
            ("g1-ankle", "--sensors", "foot_pitch", "--outside", "0.05mm"),
            "--outside 0.05mm: g1-ankle's coordinates are in rad",
        ),
    ],
)
def test_what_is_wrong_with_the_words_is_one_line(refusal, tmp_path, words, message):
    assert message in refusal("plan", *words) and list(tmp_path.iterdir()) == []


def test_amounts_of_influences_are_as_unknown_on_candidates_as_they_were_on_the_log(rng):
    """A log, then candidates that the same influences act on, or all at once: one posterior."""
    robot = tp.load("stewart").with_sensors("roll", "pitch")
    x = drawn_poses(robot, 50, rng) * [1, 1, 1, 0.7, 0.7, 0.7]
    pattern = np.zeros((50, 8))
    pattern[:, 0] = 1e-3  # what moves the zero of a motor
    q_e = robot.expected().extended_positions(x)

    def drift(rows):
        return [
            tp.calibration.NuisanceParameter(name="drift", pattern=pattern[rows], amount=(0.0, 1.0))
        ]

    log, new = np.arange(30), np.arange(30, 50)
    first = tp.calibrate(robot, q_e[log], influences=drift(log))
    both = tp.calibrate(robot, q_e, influences=drift(np.arange(50)))
    candidates = CandidatePoses(poses=x[new], influences=drift(new))
    rows = rows_of(first.robot, candidates, "ideal", first)
    left = rows.root @ posterior(rows.known, rows.C, range(20))
    p = len(first.names)
    sigma = np.sqrt(np.diag(left @ left.T))
    assert sigma[:p] == pytest.approx(np.sqrt(np.diag(both.covariance)), rel=0.02)
    assert sigma[p] == pytest.approx(both.influences["drift"].sigma, rel=0.02)
    plain = rows_of(first.robot, CandidatePoses(poses=x[new]), "ideal", first)
    taken_as_known = plain.root @ posterior(plain.known, plain.C, range(20))
    zero = first.names.index("chain1.encoder_offset")
    assert np.linalg.norm(taken_as_known[zero]) < 0.9 * sigma[zero]


def test_the_weights_of_a_plan_are_the_slope_of_its_cost(seeing):
    """M with d cost = tr(M dΣ)."""
    rows = rows_of(seeing, CandidatePoses(poses=drawn(seeing, 60, 0)), "full")
    sought = Sought(seeing, rows, "full", None, np.zeros((0, seeing.n)))
    G, step = posterior(rows.known, rows.C, range(20)), 1e-3
    slope = (sought.cost((1 + step) * G) - sought.cost((1 - step) * G)) / (2 * step)
    assert slope == pytest.approx(2 * np.trace(sought.weights(G) @ G @ G.T), rel=step)
