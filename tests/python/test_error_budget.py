"""Contributions of tolerances and readings to the error of a pose."""

import csv
import io
import itertools

import numpy as np
import pytest

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.robot.units import summed
from truepose.robotfile.schema import Tolerance

KNOWN = pytest.mark.parametrize(
    "known", [(), ("calibrated_on",), ("reference_pose",), ("calibrated_on", "reference_pose")]
)


def position(robot, x, known):
    """Return the bound of the position, rms over the poses."""
    P = tp.accuracy(robot, x, **known)
    counted = summed(robot).columns
    return float(np.sqrt(np.diagonal(P, axis1=1, axis2=2)[:, counted].sum(axis=1).mean()))


@KNOWN
def test_the_squares_of_all_contributions_are_the_variance_of_the_bound(
    any_robot, anywhere, rng, known
):
    x = anywhere(any_robot, 12, rng)
    at = {"calibrated_on": x[6:], "reference_pose": any_robot.home}
    at = {key: at[key] for key in known}
    found = tp.design.error_budget(any_robot, poses=x[:6], confidence=None, **at)
    assert sum(one.share for one in found.contributions) == pytest.approx(1)
    assert found.sigma == pytest.approx(position(any_robot, x[:6], at), rel=1e-5)
    assert found.error == pytest.approx(found.sigma)
    shares = [one.share for one in found.contributions]
    assert shares == sorted(shares, reverse=True) and min(shares) > 0


@KNOWN
@pytest.mark.parametrize("name", ["h4", "stewart"])
def test_half_a_tolerance_brings_what_a_robot_with_it_has(name, anywhere, rng, known):
    robot = tp.load(name)
    x = anywhere(robot, 16, rng)
    at = {"calibrated_on": x[6:], "reference_pose": robot.home}
    at = {key: at[key] for key in known}
    found = tp.design.error_budget(robot, poses=x[:6], confidence=None, **at)
    tolerances = robot.spec.tolerances
    for one in found.contributions:
        if (own := tolerances.get(one.source)) is None:
            continue
        fields = {"sigma": own.sigma and own.sigma / 2}
        if own.interval is not None:  # about its middle
            middle, width = own.mean, own.interval[1] - own.interval[0]
            fields["interval"] = middle - width / 4, middle + width / 4
        finer = tolerances | {one.source: own.model_copy(update=fields)}
        half = tp.Robot(robot.spec.model_copy(update={"tolerances": finer}))
        assert one.halved == pytest.approx(position(half, x[:6], at), rel=1e-5), one.source


def test_a_contribution_is_what_robots_with_that_error_alone_miss(h4, anywhere, rng):
    """As built, by simulation: 300 robots in which only the rods differ from the drawing."""
    x = anywhere(h4, 6, rng)
    found = tp.design.error_budget(h4, poses=x)
    rods = next(one for one in found.contributions if one.source == "chain*.rod")
    model, off = h4.expected(), []
    names = [name for name in h4.parameters if name.endswith(".rod")]
    for _ in range(300):
        wrong = {n: model.parameters[n].value + rng.normal(scale=0.00375) for n in names}
        readings = model.replace(wrong).extended_positions(x)
        off.append(model.estimate(readings, guess=x).x - x)
    rms = np.sqrt((np.array(off)[..., :3] ** 2).sum(axis=-1).mean())
    assert rods.error == pytest.approx(rms, rel=0.1)


def test_after_a_calibration_its_correlated_parameters_are_one_source(h4, anywhere, rng):
    true, x = h4.sample(seed=1), anywhere(h4, 40, rng)
    fit = tp.calibrate(h4, true.read(x, 1), options=CalibrationOptions(cause="ignore"))
    found = tp.design.error_budget(fit.robot, poses=x[:6])
    assert {"calibration", "motors", "theta"} >= {one.source for one in found.contributions}


def test_the_command_prints_the_budget(run, tmp_path):
    words = ("error-budget", "h4", "--calibrated", "8", "--confidence", "sigma")
    status, out, err = run(*words, "--plot", tmp_path / "budget.svg", "--format", "csv")
    assert status == 0 and "chain*.rod" in out and "h4 with theta, self-calibrated" in err
    assert (tmp_path / "budget.svg").exists()
    row = next(csv.DictReader(io.StringIO(out)))
    assert (row["source"], row["unit"]) == ("chain*.rod", "mm")
    assert float(row["its σ"]) == pytest.approx(1e3 * tp.load("h4").parameters["chain1.rod"].sigma)
    status, _, err = run("error-budget", "h4", "--poses", "none.csv")
    assert status == 2 and err.count("\n") == 1


STEPS = {
    "chain*.rod": {2e-3: 40.0, 1e-3: 90.0, 3e-4: 300.0},
    "chain*.base.*": {2e-4: 60.0, 1e-4: 150.0},
    "chain*.encoder_offset": {2e-4: 35.0},
}


@pytest.mark.parametrize("calibrated", [False, True])
def test_the_cheapest_tolerances_are_those_of_all_levels(h4, calibrated):
    """By robots with every combination of levels; the sensors in use are kept for nothing."""
    x = tp.design.error_budget(h4).over[:12]
    known = {"calibrated_on": x[6:]} if calibrated else {}
    every = []
    for own in itertools.product(*([None, *curve] for curve in STEPS.values())):
        finer = {
            group: Tolerance(sigma=sigma)
            for group, sigma in zip(STEPS, own, strict=True)
            if sigma is not None
        }
        spec = h4.expected().spec.model_copy(update={"tolerances": h4.spec.tolerances | finer})
        robot = tp.Robot(spec, {n: p.value for n, p in h4.expected().parameters.items()})
        price = sum(STEPS[group][own.sigma] for group, own in finer.items())
        every.append((price, position(robot, x[:6], known)))
    for price, error in every[3::7]:
        best = tp.select_sensors(
            h4, {"theta": 0.0}, must=["theta"], price_steps=STEPS, target=1.0001 * error,
            poses=x[:6], confidence=None, **known,
        ).best  # fmt: skip
        assert best.price == pytest.approx(min(p for p, e in every if e <= 1.0001 * error))
        assert best.price <= price and best.sensors == ("theta",)


def test_the_command_finds_and_verifies_the_cheapest_tolerances(run):
    steps = [word for text in ("chain*.rod=2mm:40,0.3mm:300", "chain*.base.*=0.1mm:150")
             for word in ("--price-steps", text)]  # fmt: skip
    status, out, err = run("error-budget", "h4", "--target", "8mm", *steps, "--robots", "40")
    assert status == 0, err
    assert "Best: theta; machined: rod 2 mm: 40" in out and "40 simulated robots" in out
    row = next(line for line in out.splitlines() if line.startswith("chain*.rod  "))
    assert row.split()[1:] == ["mm", "3.75", "2.00", "40.0"]
    status, _, err = run("error-budget", "h4", "--target", "0.1mm", *steps)
    assert (status, err.count("\n")) == (2, 1) and "machined to the smallest σ, reach" in err
    status, _, err = run("error-budget", "h4", *steps)
    assert status == 2 and "--price-steps: needs --target" in err


@pytest.mark.parametrize(
    ("robot", "target", "said"),
    [
        ("delta", "5mm", "Target 5 mm: met already, without finer tolerances: 1.363 mm"),
        ("h4", "50mm", "Target 50 mm: met already, without finer tolerances: 12.03 mm"),
        ("delta", "1um", "target 0.001 mm: motors alone reach 1.363 mm"),
        ("h4", "1um", "without --target shows what limits it; no tolerance has a price (--price-"),
    ],
)
def test_a_target_is_met_already_or_needs_prices(run, robot, target, said):
    status, out, err = run("error-budget", robot, "--target", target, "--robots", "20")
    assert said in " ".join((out + err).split())
    assert (status, "Cheapest" in out) == (0 if "met" in said else 2, False)
