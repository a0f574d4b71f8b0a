"""Contributions of tolerances and readings to the error of a pose."""

import csv
import io

import numpy as np
import pytest

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.design.criterion import SIGMA
from truepose.design.where import Use


@pytest.mark.parametrize(
    "known", [(), ("calibrated_on",), ("reference_pose",), ("calibrated_on", "reference_pose")]
)
@pytest.mark.parametrize("name", ["h4", "stewart"])
def test_half_a_tolerance_brings_what_a_robot_with_it_has(name, anywhere, rng, known):
    robot = tp.load(name)
    x = anywhere(robot, 16, rng)
    at = {"calibrated_on": x[6:], "reference_pose": robot.home}
    at = {key: at[key] for key in known}
    found = tp.design.error_budget(robot, Use(poses=x[:6], **at), SIGMA)
    assert found.error == pytest.approx(found.sigma)
    shares = [one.share for one in found.contributions]
    assert sum(shares) == pytest.approx(1)
    assert shares == sorted(shares, reverse=True) and min(shares) > 0
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
        assert one.halved == pytest.approx(tp.accuracy(half, x[:6], **at).rms, rel=1e-5), one.source


def test_a_contribution_is_what_robots_with_that_error_alone_miss(h4, anywhere, rng):
    """As built, by simulation: 300 robots in which only the rods differ from the drawing."""
    x = anywhere(h4, 6, rng)
    found = tp.design.error_budget(h4, Use(poses=x))
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
    found = tp.design.error_budget(fit.robot, Use(poses=x[:6]))
    assert {"calibration", "motors", "theta"} >= {one.source for one in found.contributions}


def test_the_command_prints_the_budget(run, refusal, tmp_path):
    words = ("error-budget", "h4", "--calibrated", "8", "--confidence", "sigma")
    status, out, err = run(*words, "--plot", tmp_path / "budget.svg", "--format", "csv")
    assert status == 0 and "chain*.rod" in out and "h4 with theta, self-calibrated" in err
    assert (tmp_path / "budget.svg").exists()
    row = next(csv.DictReader(io.StringIO(out)))
    assert (row["source"], row["unit"]) == ("chain*.rod", "mm")
    assert float(row["its σ"]) == pytest.approx(1e3 * tp.load("h4").parameters["chain1.rod"].sigma)
    err = refusal("error-budget", "h4", "--poses", "none.csv")
