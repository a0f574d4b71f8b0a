"""Optimal sensor sets within a budget, and their bound."""

import dataclasses
import itertools
import json
import re

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose.commands.design import notes, verified
from truepose.design.criterion import SIGMA, Criterion
from truepose.design.linear import LinearErrors
from truepose.design.search import Search
from truepose.design.verification import Verification, verify, wilson
from truepose.design.where import Known, Use, volume_poses
from truepose.robotfile import path_of
from truepose.robotfile.schema import Prices

HOMED = Use(reference_pose=(0.0, 0.0, -0.4, 0.0))
PRICES = {"theta": 90.0, "z_telemeter": 400.0, "wire1": 250.0, "wire2": 250.0, "pivot1": 40.0}


@pytest.mark.parametrize("touched", [None, 0.0, 1e-4])
@pytest.mark.parametrize("calibrated", [False, True])
def test_what_sets_are_worth_is_the_bound(any_robot, anywhere, rng, calibrated, touched):
    """At the finest level: of no sensor, one, some, all."""
    x = anywhere(any_robot, 12, rng)
    names = [sensor.name for sensor in any_robot.spec.sensor]
    nowhere = np.zeros((0, any_robot.n))
    known = (
        {} if touched is None else {"reference_pose": any_robot.home, "reference_sigma": touched}
    )
    visited = x[6:] if calibrated else nowhere
    sigma = [max(touched or 0.0, 1e-12)] * any_robot.n
    there = nowhere if touched is None else any_robot.home[None]
    errors = LinearErrors(any_robot, names, x[:6], Known(visited, there, sigma))
    for chosen in {(), *((k,) for k in range(min(2, len(names)))), tuple(range(len(names)))[:5]}:
        robot = any_robot.with_sensors(*(names[k] for k in chosen))
        P = tp.accuracy(robot, x[:6], calibrated_on=visited if calibrated else None, **known)
        assert max(errors.each(SIGMA, chosen)) ** 0.5 == pytest.approx(P.rms, rel=1e-5)


@pytest.mark.parametrize(
    ("known", "survives"), [({}, False), ({"reference_pose": [0, 0, -0.4, 0]}, False), ({}, True)]
)
@pytest.mark.parametrize("must", [(), ("theta",)])
def test_the_best_is_the_best_of_all_sets(h4, known, survives, must):
    """By enumeration: for a budget the most accurate, for its accuracy the cheapest."""
    every = []
    x = tp.select_sensors(h4, PRICES).over[:5]
    for size in range(len(PRICES) + 1):
        for names in itertools.combinations(PRICES, size):
            if set(must) <= set(names):
                price = sum(PRICES[name] for name in names)
                left = [set(names) - {gone} for gone in names] if survives else []
                sigma = max(
                    tp.accuracy(h4.with_sensors(*own), x, **known).rms for own in left or [names]
                )
                every.append((price, sigma, set(names)))
    use = Use(poses=x, **known)
    how = {"must": must, "survives": survives, "use": use, "criterion": SIGMA}
    for budget in (130, 350, 600, 2000):
        found = tp.select_sensors(h4, PRICES, budget=budget, **how)
        price, sigma, _ = min((e for e in every if e[0] <= budget), key=lambda e: e[1])
        assert found.proven and found.gap == 0 and found.best.price <= budget
        assert found.best.error == pytest.approx(sigma, rel=1e-6)
        again = tp.select_sensors(h4, PRICES, target=sigma * (1 + 1e-6), **how)
        cheapest = min(e[0] for e in every if e[1] <= sigma * (1 + 1e-6))
        assert again.proven and again.best.price == pytest.approx(cheapest)
    for choice in found.front:
        assert not any(
            price <= choice.price and sigma < choice.error * (1 - 1e-6) for price, sigma, _ in every
        )


def linear(rows):
    """What a set of candidates leaves of unknowns that each reads a row of."""

    def cost(chosen):
        own = rows[list(chosen)]
        return float(np.trace(np.linalg.inv(np.eye(rows.shape[1]) + own.T @ own)))

    return cost


@pytest.fixture(params=range(3))
def crowded(request):
    """What 20 candidates leave: a cost that falls with each more, as information adds up."""
    rng = np.random.default_rng(request.param)
    rows = rng.normal(size=(20, 6)) * rng.lognormal(size=(20, 1))
    return linear(rows), rng.uniform(1, 3, 20)


def test_of_twenty_candidates_five_are_proven_the_best(crowded):
    cost, prices = crowded
    search = Search(cost, prices, [], survives=False)
    budget = 5 * np.median(prices)
    best, bound = search.most_accurate(budget)
    assert bound == search.cost(best) and search.spent(best) <= budget
    assert search.cost(search.greedy(budget)) <= 1.02 * bound


@pytest.mark.parametrize("survives", [False, True])
@pytest.mark.parametrize("must", [(), (3,)])
@pytest.mark.parametrize("whole", [False, True], ids=["any prices", "whole prices"])
def test_of_twelve_candidates_the_best_are_those_of_all_sets(crowded, must, survives, whole):
    """Also where many sets cost the same, and where some candidates cost nothing."""
    cost, prices = crowded
    how = (cost, np.floor(prices[:12]) - 1 if whole else prices[:12], must, survives)
    search, front = Search(*how), [(-1, np.inf)]
    free = [k for k in range(12) if k not in must]
    sets = (own for size in range(13) for own in itertools.combinations(free, size))
    for price, least in sorted(
        (search.spent(x), search.cost(x)) for x in ((*must, *x) for x in sets)
    ):
        if least < front[-1][1] * (1 - 1e-9):
            front.append((price, least))
    again = Search(*how)
    assert again.look_round()
    found = [(again.spent(own), again.cost(own)) for own in again.front()]
    assert np.allclose(found, front[1:], rtol=1e-9, atol=1e-9)
    for price, least in front[2::5]:
        best, bound = Search(*how).most_accurate(price * (1 + 1e-9))
        assert search.cost(best) == bound == pytest.approx(least, rel=1e-9)
        cheapest, lowest = Search(*how).cheapest(least * (1 + 1e-12))
        assert search.spent(cheapest) == pytest.approx(lowest) == pytest.approx(price)


def test_a_front_of_many_candidates_is_marked_as_greedy(run, h4, tmp_path):
    """In the result, the table, the notes and the picture."""
    text = path_of("h4").read_text()
    wire = text[text.index('[[sensor]]\nname = "wire3"') :].partition("\n\n")[0]
    copies = (wire.replace("wire3", f"wire{k}") for k in range(4, 10))
    file, price = tmp_path / "wired.toml", ("--price", "*=40")
    file.write_text("\n\n".join([text.replace(wire, ""), wire, *copies]))
    status, out, errors = run("design", file, *price, "--plot", tmp_path / "front.svg")
    assert status == 0 and "(greedy choices, not proven)" in " ".join(out.split()), errors
    assert "The front is greedy, not proven, with 17 candidates" in " ".join(out.split())
    assert "greedy" in (tmp_path / "front.svg").read_text()
    status, out, errors = run("design", file, *price, "--format", "csv")
    assert all(row.endswith(",greedy") for row in out.splitlines()[1:]), out
    few = tp.select_sensors(h4, {"theta": 90, "wire1": 250})
    assert few.exact


def test_a_search_that_is_cut_short_tells_its_gap(crowded, monkeypatch):
    cost, prices = crowded
    full = Search(cost, prices, [], survives=False).most_accurate(12)
    monkeypatch.setattr("truepose.design.search.MOST", 150)
    best, bound = Search(cost, prices, [], survives=False).most_accurate(12)
    assert bound <= full[1] <= cost(best)
    assert bound < cost(best)


def test_of_sets_with_one_price_the_most_accurate_is_the_cheapest():
    """Two that together are better than the best of all with either."""
    cost = {(): 9, (0,): 5, (1,): 6, (2,): 6, (0, 1): 3, (0, 2): 3, (1, 2): 2, (0, 1, 2): 1}
    assert Search(cost.__getitem__, [1.0] * 3, (), False).cheapest(3) == ((1, 2), 2.0)


@pytest.mark.parametrize("seed", [2, 17, 20, 36])
def test_two_that_stand_in_for_each_other_are_found(seed):
    """Where any one may fail, the first of two is worth nothing by itself, and not begun with."""
    rng = np.random.default_rng(seed)
    cost = linear(5 * rng.normal(size=(12, 3)) * rng.lognormal(size=(12, 1)))
    prices = rng.uniform(1, 3, 12)
    budget = 5 * np.median(prices)
    search = Search(cost, prices, [], survives=True)
    least = search.most_accurate(budget)[1]
    assert search.cost(search.greedy(budget)) <= 1.02 * least
    assert search.cost(search._grown(budget, search.cost)) > 1.1 * least


@pytest.mark.parametrize("measure", ["rms", "worst"])
@pytest.mark.parametrize("noisy", [0.0, 1.0])
def test_the_error_that_a_share_of_robots_keeps_is_the_quantile_of_all(measure, noisy, rng):
    """Few dominant errors or many, of the robots or of each pose, normal or uniform."""
    for p, uniform in itertools.product((1, 3, 20), (False, True)):
        L = rng.normal(size=(8, 3, p)) * rng.lognormal(sigma=1.0, size=(1, 1, p))
        N = noisy * np.mean(L**2) * np.array([np.diag(rng.uniform(size=3)) for _ in L])
        by = Criterion(measure, 0.95)
        limit = by.squared(L, N, L if uniform else None) ** 0.5
        u = rng.uniform(-(3**0.5), 3**0.5, (20_000, p)) if uniform else rng.normal(size=(20_000, p))
        e = np.einsum("tcp,rp->rtc", L, u)
        e += np.sqrt(np.diagonal(N, axis1=1, axis2=2)) * rng.normal(size=e.shape)
        each, kept = by.of_errors(e[:, None])
        if measure == "worst":
            each = each[:, np.argmax(kept)]
        assert (each <= limit).mean() == pytest.approx(0.95, abs=0.02)


def test_repeatability_and_pose_accuracy_are_those_of_iso_9283(rng):
    """Of 30 cycles at a pose: accuracy by the robot's own error, repeatability by its noise."""
    L, N = 1e-3 * rng.normal(size=(1, 3, 2)), 1e-8 * np.diag([1.0, 2.0, 5.0])[None]
    u, noise = rng.normal(size=(4000, 2)), rng.normal(size=(4000, 30, 1, 3))
    e = np.einsum("tcp,rp->rtc", L, u)[:, None] + np.sqrt(np.diagonal(N[0])) * noise
    accuracy, repeatability = Criterion("AP", 0.9), Criterion("RP")
    least = accuracy.squared(L, N, noise=N)
    assert (accuracy.of_errors(e)[0] ** 2 <= least).mean() == pytest.approx(0.9, abs=0.02)
    each = repeatability.of_errors(e)[0]
    assert each.mean() == pytest.approx(repeatability.squared(L, N) ** 0.5, rel=0.03)


@pytest.mark.parametrize(
    "known",
    [
        {},
        {"calibrated_on": True},
        {"reference_pose": True},
        {"reference_pose": True, "reference_sigma": True},
    ],
    ids=["built", "cal", "ref", "ref at a measured pose"],
)
@pytest.mark.parametrize("measure", ["rms", "worst", "AP"])
def test_the_stated_share_of_simulated_robots_keeps_the_error(h4, known, measure):
    """Uniform tolerances, full level, counts."""
    x = tp.select_sensors(h4, {"theta": 90}).over
    off = [2e-3, 2e-3, 2e-3, 5e-3]  # of the measured pose, m and rad
    at = {"calibrated_on": x[:8], "reference_pose": h4.home, "reference_sigma": off}
    use = Use(poses=x[8:14], **{key: at[key] for key in known})
    found = tp.select_sensors(
        h4, {"theta": 90, "wire1": 250}, budget=1000, use=use, criterion=Criterion(measure)
    )
    seen = verify(found, robots=150, seed=5)
    assert seen.interval[0] - 0.02 < 0.95 < seen.interval[1] + 0.02
    assert seen.error == pytest.approx(found.best.error, rel=0.12)


@pytest.mark.parametrize("asked", [{"budget": 300}, {"target": 7e-3}], ids=str)
def test_a_prediction_that_too_few_robots_keep_is_not_verified(h4, asked):
    found = tp.select_sensors(h4, {"theta": 90, "wire1": 250}, **asked)
    for within, word in ((380, "Verified"), (374, "Verified"), (340, "Not verified")):
        seen = Verification(400, found.best.error, within / 400, wilson(within, 400), 8e-3)
        assert verified(found, seen).startswith(word)
        assert ("--target" in verified(found, seen)) == ("target" in asked and within == 340)


def test_pose_accuracy_averages_noise_but_not_counts(h4):
    """At one pose a reading without noise is the same in all cycles."""
    coarse = tuple(c.model_copy(update={"encoder_counts": 1440}) for c in h4.spec.chain)
    noisy = tuple(
        c.model_copy(update={"encoder_counts": None, "encoder_noise": 2 * np.pi / 1440 / 12**0.5})
        for c in h4.spec.chain
    )
    errors = []
    for chain in (coarse, noisy):
        robot = tp.Robot(h4.spec.model_copy(update={"chain": chain}))
        x = tp.select_sensors(robot, {"theta": 90}).over
        use = Use(poses=x[24:], calibrated_on=x[:24], reference_pose=robot.home)
        found = tp.select_sensors(
            robot, {"wire1": 250}, must=["wire1"], budget=300, use=use, criterion=Criterion("AP")
        )
        seen = verify(found, robots=150, seed=5)
        assert seen.interval[0] - 0.02 < 0.95 < seen.interval[1] + 0.02
        errors.append(found.best.error)
    assert errors[0] > 1.2 * errors[1]


def test_a_refusal_says_which_step_reaches_the_target(h4):
    with pytest.raises(tp.InputError) as told:
        tp.select_sensors(h4, {"theta": 90, "wire1": 250}, target=0.5e-3)
    said = str(told.value)
    assert "all 2 sensors together reach 6.953 mm" in said
    helps = "cheapest step: referenced at home (no price given), with motors alone (0)"
    assert said.endswith(helps)
    found = tp.select_sensors(h4, {"theta": 90, "wire1": 250}, use=HOMED, target=5e-4)
    assert found.best.price == 0 and list(found.steps) == ["self-calibrated on 10 poses"]


def test_what_is_done_once_has_its_price(h4):
    """In a refusal, in every state, and within the budget."""
    priced = PRICES | {"reference_pose": 210, "self_calibration": 60}
    with refused(r"home: 210; with motors alone \(0\) 210 together"):
        tp.select_sensors(h4, priced, target=0.5e-3)
    found = tp.select_sensors(h4, priced, budget=400)
    assert {state: best.once for state, best in found.steps.items()} == {
        "self-calibrated on 10 poses": 60,
        "referenced at home": 210,
        "self-calibrated on 10 poses and referenced at home": 270,
    }
    assert all(best.total <= 400 for best in found.steps.values())
    there = tp.select_sensors(h4, priced, budget=400, use=HOMED)
    assert there.best.total <= 400 and there.best.once == 210
    unknown = tp.select_sensors(h4, PRICES, budget=400, use=HOMED)
    assert unknown.best.total is None and unknown.best.price <= 400
    file = h4.spec.model_copy(update={"prices": Prices(reference_pose=35.0)})
    own = tp.select_sensors(tp.Robot(file), PRICES, budget=400)
    assert own.steps["referenced at home"].once == 35
    paid = tp.select_sensors(h4, priced, budget=215, use=HOMED)
    assert paid.best.sensors == () and paid.best.total == 210
    assert "motors alone: 0 + 210 of one-time steps = 210" in notes(paid)[-1]
    assert tp.select_sensors(h4, PRICES, budget=30).best.sensors == ()


@pytest.mark.parametrize("name", ["h4", "stewart"])
@pytest.mark.parametrize("survives", [False, True])
def test_the_cheapest_set_keeps_position_and_angle(name, survives, anywhere, rng):
    """By enumeration, each by a selection of its own; one of them limits."""
    robot = tp.load(name)
    x, names = anywhere(robot, 6, rng), [sensor.name for sensor in robot.spec.sensor][:4]
    prices = dict(zip(names, rng.uniform(50, 400, 4), strict=True))
    asked = {"use": Use(poses=x), "survives": survives}
    turn = [k for k, (_, unit) in enumerate(robot.coordinates) if unit == "rad"]
    every = []
    for size in range(5):
        for own in itertools.combinations(names, size):
            left = [set(own) - {gone} for gone in own] if survives else []
            P = [tp.accuracy(robot.with_sensors(*one), x) for one in left or [own]]
            angle = max(np.diagonal(p, axis1=1, axis2=2)[:, turn].sum(axis=1).mean() for p in P)
            size_ = max(p.rms for p in P), angle**0.5
            every.append((sum(prices[n] for n in own), *size_))
    for _, error, angle in every[2::5]:
        goal = {"target": error * 1.001, "target_angle": angle * 1.001}
        found = tp.select_sensors(robot, prices, **goal, **asked, criterion=SIGMA)
        fits = [p for p, e, a in every if e <= goal["target"] and a <= goal["target_angle"]]
        assert found.best.price == pytest.approx(min(fits)) and found.proven
        assert found.best.error <= goal["target"] and found.best.angle <= goal["target_angle"]
        by_angle = found.best.angle / goal["target_angle"] > found.best.error / goal["target"]
        assert found.limiting == ("angle" if by_angle else "position")
    with refused(r"reach .*°, limited by angle"):
        tp.select_sensors(robot, prices, target=1.0, target_angle=1e-9, **asked)


def test_simulated_robots_keep_both(h4):
    """The share of those that keep both is at most that of either."""
    use = Use(poses=tp.select_sensors(h4, {"theta": 90}).over[:6])
    priced = {"theta": 90, "wire1": 250}
    both = tp.select_sensors(h4, priced, use=use, target=8e-3, target_angle=6e-3)
    seen, alone = verify(both, robots=60), tp.select_sensors(h4, priced, use=use, target=8e-3)
    assert both.best.sensors == ("theta", "wire1") and alone.best.sensors == ("wire1",)
    assert (
        0.9 <= seen.share <= verify(dataclasses.replace(both, target_angle=None), robots=60).share
    )
    narrow = dataclasses.replace(both, target_angle=both.best.angle / 4)
    assert verify(narrow, robots=60).share < 0.5


def test_the_search_ends_where_a_cost_is_no_number(monkeypatch):
    search, twice = Search(lambda _: np.nan, [1.0], (), survives=False), iter([(0,), (0,)])
    monkeypatch.setattr(search, "_filled", lambda *_: next(twice))
    assert search._exchanged((0,), 5.0, search.cost) == (0,)


def test_a_volume_is_poses(h4):
    ranges = {"z": (-0.38, -0.36), "theta": (-0.1, 0.2)}
    x = volume_poses(h4, ranges)
    low, high = np.array([-0.1, -0.1, -0.38, -0.1]), np.array([0.1, 0.1, -0.36, 0.2])
    assert x.shape == (32, 4) and (x >= low).all() and (x <= high).all()
    assert (np.ptp(x, axis=0) > 0.8 * (high - low)).all()


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        (
            {"z": (-0.5, -0.2)},
            "volume: .* of it is out of reach: .*truepose info h4",
        ),
        ({"z": (1, 2)}, "volume: 100% of it is out of reach"),
        ({"u": (1, 2)}, "volume: unknown coordinate 'u'"),
        ({"z": (2, 1)}, "volume: z = 2 to 1: must be LOW, HIGH"),
    ],
)
def test_a_volume_out_of_reach_is_refused(h4, ranges, message):
    with refused(message):
        volume_poses(h4, ranges)


def test_the_commands_take_a_volume_or_poses(run, tmp_path):
    (tmp_path / "way.csv").write_text("x,y,z,theta\n0,0,-0.4,0\n0.05,0,-0.4,0.2\n")
    words = ("design", "h4", "--price", "theta=90,wire1=250")
    far = run(*words, "--format", "csv", "--volume", "z=-420mm..-0.35m")[1]
    near = run(*words, "--format", "csv", "--poses", tmp_path / "way.csv")[1]
    assert far.splitlines()[0] == near.splitlines()[0] and far != near
    for command in (("error-budget", "h4"), ("plan", "h4", "--count", "3", "--candidates", "40")):
        status, out, err = run(*command, "--poses", tmp_path / "way.csv")
        assert status == 0 and re.search(r"\b2 poses", out + err)
    status, _, err = run(*words, "--volume", "z=-0.4..-0.3", "--poses", tmp_path / "way.csv")
    assert (status, err.count("\n")) == (2, 1) and "--poses, --volume: name one of them" in err
    status, out, err = run(*words, "--target", "8mm,0.4deg", "--robots", "20")
    assert status == 0 and "mm, 0.255°; the position limits" in out, out
    assert "95 % quantile of the position and angle error" in " ".join(out.split())


@pytest.mark.parametrize("option", ["--poses", "--calibrated"])
def test_a_pose_of_a_file_that_is_out_of_reach_is_named(run, tmp_path, option):
    (tmp_path / "far.csv").write_text("x,y,z,theta\n0,0,-0.4,0\n0,0,-0.9,0\n")
    status, _, err = run("design", "h4", "--price", "theta=1", option, tmp_path / "far.csv")
    assert (status, err.count("\n")) == (2, 1)
    assert "far.csv: line 3 (x, y, z, theta): h4: pose x = [0, 0, -0.9, 0]: chain 1" in err


def test_prices_that_are_given_apart_add_up(run):
    words = ("design", "h4", "--robots", "0", "--format", "json", "--price")
    assert run(*words, "t*=9,theta=8,wire1=5") == run(*words, "t*=9,theta=8", "--price", "wire1=5")


def test_a_file_of_version_0_5_with_prices_of_machining_loads_and_says_so(run, tmp_path):
    entry = '"chain*.rod" = { interval = [-0.003, 0.010]'
    steps = ", price_steps = [{ sigma = 1e-3, price = 300 }]"
    file = tmp_path / "priced.toml"
    file.write_text(path_of("h4").read_text().replace(entry, entry + steps))
    status, _, err = run("design", file, "--price", "theta=90")
    assert status == 0 and "chain*.rod: price_steps: not used since 0.6" in err


def test_prices_stand_in_the_file_too(h4):
    sensors = [s.model_copy(update={"price": 10.0 * k}) for k, s in enumerate(h4.spec.sensor)]
    robot = tp.Robot(h4.spec.model_copy(update={"sensor": sensors}))
    assert tp.select_sensors(robot, budget=25).prices["wire1"] == 60
    with refused("h4: sensor theta: has no price"):
        tp.select_sensors(h4)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"prices": {"tehta": 1}}, "prices: unknown sensor 'tehta'"),
        ({"prices": {"theta": -1}}, "prices: theta = -1: must be a finite number of at least 0"),
        ({"budget": 50, "must": ["theta"]}, "budget 50: too small: theta cost 90"),
        ({"budget": 0}, "budget = 0: must be a finite number greater than 0"),
        ({"budget": 50, "target": 1e-3}, "budget and target: give one of them"),
        ({"target_angle": 1e-3}, "target_angle: needs a target of the position too"),
        ({"target": 1e-3, "target_angle": -1}, "target_angle = -1: must be a finite number"),
        ({"target": 1e-6}, "target 0.001 mm: all 5 sensors together reach"),
        (
            {"target": 1e-6, "survives": True},
            "sensors together, after the worst failure of one, reach",
        ),
        ({"must": ["elbow1"]}, "must: sensor elbow1 has no price"),
        (
            {"prices": PRICES | {"reference_pose": 210}, "budget": 30, "use": HOMED},
            "budget 30: too small: one-time steps cost 210",
        ),
        ({"prices": {}}, "h4: no sensor to choose"),
    ],
)
def test_what_cannot_be_chosen_is_said(h4, asked, message):
    with refused(message):
        tp.select_sensors(h4, **{"prices": PRICES, **asked})


def test_the_command_says_what_the_function_finds(run, tmp_path):
    words = ("design", "h4", "--price", "theta=90,z_telemeter=400,wire1=250,wire2=250,pivot1=40")
    status, out, err = run(*words, "--budget", "400", "--format", "json", "--plot", "front.svg")
    found = tp.select_sensors(tp.load("h4"), PRICES, budget=400)
    rows = json.loads(out)["design"]
    assert status == 0 and [row["price"] for row in rows] == [c.price for c in found.front]
    assert [row["position (mm)"] for row in rows] == pytest.approx(
        [1e3 * choice.error for choice in found.front]
    )
    assert "proven the best" in err and (tmp_path / "front.svg").exists()
    said = run(*words, "--target", "9mm", "--calibrated", "6", "--survives", "--must", "theta")[1]
    assert "self-calibrated, any one sensor failed" in said and "proven the best" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("five-bar", "--price", "*=100", "--budget", "100"),
            "*: five-bar has no sensor in its file",
        ),
        (("h4",), "h4: sensor theta: has no price (the file's key price, --price, prices)"),
        (("h4", "--price", "theta=9", "--target", "0mm"), "--target 0mm: must be a length greater"),
        (
            ("h4", "--price", "theta=9", "--target", "1mm,2mm"),
            "--target 1mm,2mm: must be a length and an",
        ),
        (
            ("h4", "--price", "theta=9", "--volume", "z=1"),
            "--volume z=1: must be COORDINATE=LOW..HIGH",
        ),
        (("h4", "--price", "theta"), "--price theta: must be SENSOR=PRICE"),
        (
            ("h4", "--price", "theta=90", "--target", "1um"),
            "theta reaches 12.03 mm; truepose",
        ),
        (
            ("h4", "--calibrated", "99999999", "--price", "theta=90"),
            "from 1 to 10000, or a CSV file",
        ),
        (("h4", "--price", "theta=90", "--confidence", "0.9"), "--confidence 0.9: must be 50%"),
        (("h4", "--price", "theta=90", "--measure", "mean"), "--measure"),
        (("h4", "--price", "none"), "--price none: must be SENSOR=PRICE"),
        (("h4", "--price", "theta=9", "--price", "theta=8"), "--price theta: is given twice"),
        (
            ("h4", "--price", "theta=9", "--volume", "z=-0.4m..-0.5m"),
            "--volume z=-0.4m..-0.5m: must be COORDINATE=LOW..HIGH",
        ),
        (
            ("h4", "--price", "theta=9", "--volume", "z=-0.4m..-0.3m,z=-0.41m..-0.4m"),
            "--volume z: is given twice",
        ),
    ],
)
def test_what_is_wrong_with_the_words_is_one_line(refusal, words, message):
    assert message in refusal("design", *words)
