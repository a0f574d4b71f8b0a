"""Compliance of rods, legs and belts, and its calibration."""

import json

import numpy as np
import pytest
from fixtures import refused

import truepose as tp
from truepose import _core
from truepose.calibration import CalibrationOptions, Payloads
from truepose.exceptions import RobotFileError
from truepose.robot import compliance

LEFT_OUT = "compliance and load are ignored\n"
LEVELS = ("ideal", "full")


def text_of(name, compliances, load=(0, 0, 0)):
    """A shipped robot's file with compliant rods: tolerances of compliances, by parameter."""
    told = "".join(f'"{of}" = {{ sigma = {sigma} }}\n' for of, sigma in compliances.items())
    source = tp.load(name).spec._text.replace("[tolerances]\n", f"[tolerances]\n{told}")
    return source + f"\n[compliance]\nload = [{', '.join(str(float(f)) for f in load)}]\n"


@pytest.fixture
def yielding(load):
    """Return a function that loads a shipped robot with compliant rods."""
    return lambda *of: load(text_of(*of))


def at_level(robot, level):
    if level == "full" and not robot.full:
        pytest.skip(f"{robot.name}: {robot.full.reason}")
    return robot.with_level(level)


def read(robot, x, force, seed):
    """Readings under forces that differ from line to line, noise and counts included."""
    full = robot.is_full(None)
    added = compliance.given_way(robot, x, full, force=force).readings
    exact = np.ascontiguousarray(robot.stiff.extended_positions(x) + added)
    return np.asarray(_core.spoil(robot.core, exact, seed))


def loaded(robot):
    """The same under a load, its rods soft, each a little otherwise."""
    planar = robot.spec.mobility.startswith("planar")
    soft = robot.with_payload((20, -50, 0) if planar else (10, -20, -100))
    return soft.replace({"compliance.all_chains": 2e-6, "chain2.compliance": 1e-6})


@pytest.mark.parametrize("level", LEVELS)
def test_the_forward_model_undoes_the_inverse_one_under_load(
    chained_robot, level, anywhere, rng, count
):
    robot = loaded(at_level(chained_robot, level))
    x = anywhere(robot, min(count, 2000), rng)
    q = robot.ikm(x, errors="nan")
    good = np.isfinite(q).all(axis=1)
    assert good.mean() > 0.3 and np.abs(q - robot.stiff.ikm(x, "nan"))[good].max() > 1e-5
    assert robot.fkm(q[good], guess=x[good]) == pytest.approx(x[good], abs=1e-10)
    q_e = robot.extended_positions(x[good])
    assert q_e[:, : robot.m] == pytest.approx(q[good], abs=1e-14)
    if robot.r:
        found = robot.estimate(q_e, guess=x[good])
        assert found.x == pytest.approx(x[good], abs=1e-9)
        assert found.chi2 == pytest.approx(0, abs=1e-9)


def test_a_chain_under_tension_is_one_with_longer_rods(chained_robot, anywhere, rng):
    robot = loaded(chained_robot)
    x = anywhere(robot, 5, rng)
    for pose, pull in zip(x, robot.rod_forces(x, errors="nan"), strict=True):
        if not np.isfinite(pull).all():
            continue
        longer = {}
        for k, strain in enumerate(robot.compliance * pull, start=1):
            name = f"chain{k}.rod"
            if name in robot.parameters:
                longer[name] = robot.parameters[name].value * (1 + strain)
            else:  # a leg, which reads less by its deflection
                P, A = robot.skeleton(pose)[k - 1, [0, 2]]
                gain = robot.parameters[f"chain{k}.gain"].value
                name, more = f"chain{k}.encoder_offset", gain * strain * np.linalg.norm(P - A)
                longer[name] = robot.parameters[name].value + more
        assert robot.ikm(pose) == pytest.approx(robot.stiff.replace(longer).ikm(pose), abs=1e-12)


@pytest.mark.parametrize("level", LEVELS)
def test_derivatives_by_compliance_are_those_of_finite_differences(
    chained_robot, level, anywhere, rng
):
    robot = loaded(at_level(chained_robot, level))
    x = anywhere(robot, 10, rng)
    x = x[np.isfinite(robot.extended_positions(x, "nan")).all(axis=1)]
    _, H_xi = robot.linearize(x)
    names, h = list(robot.parameters), 1e-8
    elastic = level == "full" and "stretch" in robot.full.reason  # to first order in the strain
    for name in ("chain2.compliance", "compliance.all_chains"):
        at = robot.parameters[name].value
        more, less = (robot.replace({name: at + d}).extended_positions(x) for d in (h, -h))
        slope = (more - less) / (2 * h)
        off = 0.01 * np.abs(slope).max() if elastic else 1e-4 * (1 + np.abs(slope).max())
        assert H_xi[..., names.index(name)] == pytest.approx(slope, abs=off)


CASES = {
    "hexapod": ("stewart", ("roll", "pitch"), "ideal"),
    "rod by rod": ("h4", ("theta", "z_telemeter"), "full"),
}


@pytest.mark.parametrize("case", CASES)
def test_compliances_are_found_within_their_sigma(yielding, anywhere, case):
    """Geometry and compliances drawn from the tolerances, loads that differ: NEES in band."""
    name, sensors, level = CASES[case]
    soft = {"compliance.all_chains": 2e-6, "chain*.compliance": 5e-7}
    robot = yielding(name, soft).with_sensors(*sensors).with_level(level)
    every, own = [], []
    for seed in range(8):
        true, rng = robot.sample(seed), np.random.default_rng(seed)
        x = anywhere(robot, 60, rng) * ([1, 1, 1, 0.7, 0.7, 0.7] if robot.n == 6 else 1)
        force = rng.uniform(0, 1, (60, 1)) * [0, 0, -300.0]
        fit = tp.calibrate(robot, read(true, x, force, seed), loads=Payloads(force=force))
        error = np.array([p.value - true.parameters[n].value for n, p in fit.parameters.items()])
        at = [k for k, n in enumerate(fit.names) if "compliance" in n]
        every.append(error @ np.linalg.solve(fit.covariance, error) / len(error))
        own.append(error[at] @ np.linalg.solve(fit.covariance[np.ix_(at, at)], error[at]) / len(at))
        assert len(at) == robot.n + 1 and fit.parameters["compliance.all_chains"].ratio < 0.3
        assert 0.7 < np.sqrt(fit.chi2.sum() / fit.redundancy.sum()) < 1.3
    assert np.mean(every) == pytest.approx(1, abs=0.25)
    assert np.mean(own) == pytest.approx(1, abs=0.7)


def test_what_was_learnt_of_compliance_is_the_prior_of_the_next_calibration(
    yielding, anywhere, tmp_path
):
    """Two logs one after the other, the file between them, or both at once: the same posterior."""
    robot = yielding("stewart", {"chain*.compliance": 1e-6}).with_sensors("roll", "pitch")
    true, rng = robot.sample(3), np.random.default_rng(3)
    x = anywhere(robot, 80, rng) * [1, 1, 1, 0.7, 0.7, 0.7]
    force = rng.uniform(0, 1, (80, 1)) * [0, 0, -400.0]
    q_e = read(true, x, force, 3)

    def fitted(robot, rows):
        loads = tp.calibration.Payloads(force=force[rows])
        return tp.calibrate(robot, q_e[rows], loads=loads)

    both, first = fitted(robot, slice(None)), fitted(robot, slice(40))
    first.robot.save(tmp_path / "first.toml")
    again = tp.load(tmp_path / "first.toml").with_sensors("roll", "pitch")
    assert again.parameters == first.robot.parameters
    then = fitted(again, slice(40, None))
    for name, of in both.parameters.items():
        last = then.parameters[name]
        assert abs(last.value - of.value) < 0.1 * of.sigma, name
        assert last.sigma == pytest.approx(of.sigma, rel=0.05), name
    forgotten = tp.calibration.rehomed(then.robot, 0.001).parameters["chain1.compliance"].sigma
    assert forgotten == pytest.approx(then.parameters["chain1.compliance"].sigma)


def test_measured_tensions_and_loads_come_with_a_table(yielding, anywhere, rng):
    robot = yielding("3rpr", {"compliance.all_chains": 1e-5}).with_sensors()
    robot = robot.replace({})
    true = robot.expected().replace({"compliance.all_chains": 4e-6})
    x = anywhere(robot, 40, rng)
    pull = rng.uniform(50, 400, (40, 3))
    added = compliance.given_way(true, x, False, tension=pull).readings
    table = {f"q{k + 1}": (true.stiff.extended_positions(x) + added)[:, k] for k in range(3)}
    outside = dict(zip(("measured_x", "measured_y", "measured_theta"), x.T, strict=True))
    tensions = {f"q{k + 1}_tension": pull[:, k] for k in range(3)}
    options = CalibrationOptions(registration="known", measured_angle_sigma=1e-6)
    fit = tp.calibrate(robot, table | outside | tensions, measured_sigma=1e-6, options=options)
    of = fit.parameters["compliance.all_chains"]
    assert of.verdict == "identified" and abs(of.value - 4e-6) < 3 * of.sigma
    assert not any("not used" in note for note in fit.notes)
    wrong = Payloads(tension=pull[:, :2])
    with refused(r"tension: shape \(40, 2\), must be \(40, 3\)"):
        tp.calibrate(robot, np.column_stack(list(table.values())), loads=wrong)


@pytest.mark.parametrize("level", LEVELS)
def test_the_bound_counts_compliances_that_are_not_known(h4, yielding, anywhere, rng, level):
    """Against dense generalised least squares over geometry and compliances."""
    robot = yielding("h4", {"chain*.compliance": 1e-5}, (0, 0, -100)).with_level(level)
    robot = robot.with_sensors("theta", "z_telemeter").with_file(conditions=None)
    x = anywhere(robot, 6, rng)
    P = tp.accuracy(robot, x, model_error=False)
    H_x, H_xi = robot.expected().linearize(x)
    sigma = np.array([p.sigma for p in robot.parameters.values()])
    C = (H_xi * sigma**2) @ H_xi.swapaxes(1, 2) + np.diag(robot.reading_sigma**2)
    dense = np.linalg.inv(H_x.swapaxes(1, 2) @ np.linalg.solve(C, H_x))
    assert pytest.approx(dense, rel=1e-6, abs=1e-14) == P
    known = tp.accuracy(h4.with_sensors(*robot.sensors).with_level(level), x)
    assert (
        np.trace(P[:, :3, :3], axis1=1, axis2=2)
        > 0.99 * np.trace(known[:, :3, :3], axis1=1, axis2=2)
    ).all()
    seen = anywhere(robot, 30, rng)
    touched = tp.accuracy(
        robot, x, model_error=False, calibrated_on=seen, reference_pose=robot.home
    )
    assert (np.linalg.eigvalsh(P - touched) > -1e-12).all()


@pytest.mark.parametrize("level", LEVELS)
def test_estimates_under_load_are_as_far_off_as_their_covariance_says(yielding, anywhere, level):
    """Robots drawn, geometry and compliance, read once each: NEES in band, not without it."""
    soft = {"ideal": 3e-4, "full": 2e-5}[level]  # 3 mm, as the H4's rods; what they tilt is more
    robot = yielding("h4", {"chain*.compliance": soft}, (60, -40, -60)).with_level(level)
    robot = robot.with_sensors("theta", "z_telemeter")
    sure = {n: t for n, t in robot.spec.tolerances.items() if not n.endswith("compliance")}
    blind = tp.Robot(robot.spec.model_copy(update={"tolerances": sure})).expected()
    robot, nees, less = robot.expected(), [], []
    for seed in range(60):
        true = robot.sample(seed)
        x = anywhere(robot, 1, np.random.default_rng(seed))[0]
        q_e = true.read(x, seed)
        for by, to in ((robot, nees), (blind, less)):
            found = by.estimate(q_e, guess=x, level=level)
            off = found.x - x
            to.append(off @ np.linalg.solve(found.covariance, off) / 4)
    assert np.mean(nees) == pytest.approx(1, abs=0.5)
    assert np.mean(less) > 1.2 * np.mean(nees)


# The command line, and what does not know of compliance.


def test_the_command_finds_the_compliance_of_a_log_with_loads(run, tmp_path, anywhere, plain_page):
    path = tmp_path / "soft.toml"
    path.write_text(text_of("stewart", {"compliance.all_chains": 1e-6}), encoding="utf-8")
    robot = tp.load(path).with_sensors("roll", "pitch")
    true, rng = robot.expected().replace({"compliance.all_chains": 4e-7}), np.random.default_rng(5)
    x = anywhere(robot, 60, rng) * [1, 1, 1, 0.7, 0.7, 0.7]
    force = rng.uniform(0, 1, (60, 1)) * [0, 0, -400.0]
    cells = np.hstack([read(true, x, force, 5), force[:, 2:]])
    names = ",".join([*robot.readings, "load_z"])
    np.savetxt(tmp_path / "log.csv", cells, delimiter=",", header=names, comments="")
    options = ("--sensors", "roll,pitch", "--format", "json", "-o", "found.toml")
    status, out, err = run("calibrate", "soft.toml", "log.csv", *options)
    assert status == 0 and "not used" not in err
    tables = json.loads(out)
    (row,) = (r for r in tables["parameters"] if r["parameter"] == "compliance.all_chains")
    assert row["unit"] == "µm/m/N" and row["value"] == pytest.approx(0.4, abs=3 * row["σ"])
    assert row["verdict"] == "identified"
    rolled = next(r for r in tables["residuals"] if r["reading"] == "roll")
    assert rolled["held out"] < 2 * rolled["expected"]
    found = tp.load("found.toml")
    assert found.parameters["compliance.all_chains"].sigma == pytest.approx(1e-6 * row["σ"])
    assert run("check", "found.toml")[0] == 0
    status, out, _ = run("info", "found.toml", "--samples", "100")
    assert status == 0 and "strain of its rods there" in out
    status, _, err = run("export", "c", "found.toml", "-o", "found.h")
    assert status == 0 and "a controller assumes stiff rods" in err
    assert "stiff" not in run("export", "c", "stewart", "-o", "stiff.h")[2]
    status, _, err = run("simulate", "found.toml", "--law", "joint")
    assert status == 0
    assert err == "truepose: stewart: a simulation assumes stiff rods: " + LEFT_OUT


def test_a_simulation_of_a_robot_whose_rods_give_way_says_that_it_has_them_stiff(h4):
    soft = h4.with_payload((0, 0, 0)).replace({"compliance.all_chains": 1e-7})
    for work in (
        lambda: tp.steady_state(soft, soft, soft.home, "joint"),
        lambda: tp.simulate(soft, run=tp.simulation.Run(duration=0.2)),
        lambda: tp.OnlineCalibrator(soft),
    ):
        with pytest.warns(UserWarning, match="assumes stiff rods"):
            work()


SPOILT = {
    "[compliance]\nall_chains = -1e-6": "compliance.all_chains = -1e-06: input should be",
    "[compliance]\nload = [0.0, 1.0]": "compliance.load",
    "[compliance]\nstiffness = 1e6": "unknown key 'stiffness'",
    '[parameters]\n"chain9.compliance" = 1e-6': "unknown parameter 'chain9.compliance'",
}


@pytest.mark.parametrize("added", SPOILT)
def test_a_wrong_word_of_stretch_is_refused(load, delta, added):
    with pytest.raises(RobotFileError) as error:
        load(delta.spec._text + f"\n{added}\n")
    assert SPOILT[added] in str(error.value)


def test_a_file_that_says_nothing_of_stretch_has_no_parameter_of_it(chained_robot):
    assert not any(name.endswith("compliance") for name in chained_robot.parameters)
    assert not chained_robot.is_compliant and chained_robot.stiff == chained_robot


def test_a_load_is_saved(tmp_path, delta):
    robot = delta.with_payload((0, 1, -20)).replace({"compliance.all_chains": 1e-6})
    robot.save(tmp_path / "loaded.toml")
    again = tp.load(tmp_path / "loaded.toml")
    assert again.parameters == robot.parameters
    assert again.spec.compliance.load == (0, 1, -20)
    assert again.rod_forces(delta.home) == pytest.approx(robot.rod_forces(delta.home))


def test_a_known_pose_is_read_under_the_load_of_the_file(yielding, anywhere, rng):
    robot = yielding("delta", {"compliance.all_chains": 2e-7}).with_sensors("z_telemeter")
    true = robot.sample(1)
    x, loads = anywhere(robot, 20, rng), Payloads(force=[(0.0, 0.0, -50.0)] * 20)
    heavy = true.with_payload((0.0, 0.0, -50.0)).extended_positions(x)
    known = (true.extended_positions(robot.home), robot.home)
    fit = tp.calibrate(robot, heavy, loads=loads, known_pose=known)
    assert fit.robot.estimate(known[0]).x == pytest.approx(robot.home, abs=1e-5)
