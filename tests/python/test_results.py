"""Printing and drawing of results: every public result class shows itself."""

import inspect

import numpy as np
import pytest
from fixtures import require_shown

import truepose as tp
from truepose.calibration import zero
from truepose.calibration.learnt import VERDICTS
from truepose.faults.monitor import Review
from truepose.robot import coordinate_axes, summed, usual
from truepose.robot.redundancy import Estimate
from truepose.show import PRINT, Shown, printed


def test_a_fit_says_what_it_rests_on_and_draws_every_parameter(h4, truth, table2):
    fit = tp.calibrate(h4, truth.read(table2[::5], seed=1))
    said = repr(fit)
    assert said == str(fit)
    assert said.startswith("h4 calibrated on 125 of 125 lines of theta, full level, ")
    verdicts = [p.verdict for p in fit.parameters.values()]
    assert (
        f"{len(verdicts)} uncertain parameters: {verdicts.count('identified')} identified" in said
    )
    assert all(note in said for note in fit.notes)
    (axes,) = fit.plot().axes
    drawn = sorted(fit.names, key=lambda name: [*VERDICTS].index(fit.parameters[name].verdict))
    assert [label.get_text() for label in axes.get_yticklabels()] == drawn


def test_a_run_says_how_far_off_it_was_and_draws_that(chained_robot):
    run = tp.simulate(chained_robot)
    said, begin = str(run), f"{chained_robot.name} under {usual(chained_robot)} control, 0.4 s, "
    assert said.startswith(f"{begin}401 periods: {run.status}")
    total = summed(chained_robot)
    most = np.linalg.norm(run.error[:, total.columns], axis=1).max()
    assert f"{total.name}: {printed(most, total.unit, '.3g')} off at most" in said
    assert ("turn: " in said) == any(unit == "rad" for _, unit in chained_robot.coordinates)
    lines = [line for axes in run.plot().axes for line in axes.lines if len(line.get_xdata()) > 2]
    assert len(lines) == chained_robot.n + 2 * chained_robot.m  # of each torque its mean as well
    drawn = PRINT[chained_robot.coordinates[0][1]][0] * run.error[:, 0]
    assert np.allclose(lines[0].get_ydata(), drawn)


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_an_estimate_says_where_and_how_surely_and_draws_both(h4, shape, rng, anywhere):
    count = int(np.prod(shape, dtype=int))
    x = anywhere(h4, count, rng).reshape(*shape, 4)
    estimate = h4.estimate(h4.extended_positions(x))
    said = repr(estimate)
    sigma = np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1))
    if shape:
        assert said.startswith(f"{count} estimates, {count} ok; σ, rms: ")
        rms = np.sqrt((sigma**2).reshape(-1, 4).mean(axis=0))
        assert said.endswith(", ".join(f"{s:.2g}" for s in rms))
    else:
        assert f"{x[0]:.6g} ± {sigma[0]:.2g}" in said and said.endswith("; ok")
    for k, (axes, of) in enumerate(zip(estimate.plot().axes, coordinate_axes(h4), strict=True)):
        assert axes.get_ylabel() == of.label
        drawn, bars = axes.lines[0].get_ydata(), axes.collections[0].get_segments()
        assert drawn == pytest.approx(of.factor * estimate.x[..., k].ravel())
        assert np.ptp(bars, axis=1)[:, 1] == pytest.approx(2 * of.factor * sigma[..., k].ravel())


def test_an_estimate_that_was_not_found_is_left_out_of_both(h4):
    q_e = h4.extended_positions([h4.home, h4.home])
    q_e[1] = np.nan
    estimate = h4.estimate(q_e, errors="nan")
    assert repr(estimate).startswith("2 estimates, 1 ok; ")
    assert np.isfinite(estimate.plot().axes[0].lines[0].get_ydata()).sum() == 1


def poses_of(robot, count=12):
    """Draw poses from the inner half of a robot's workspace."""
    box = robot.spec.workspace
    middle = (np.array(box.minimum) + box.maximum) / 2
    half = (np.array(box.maximum) - box.minimum) / 4
    return np.random.default_rng(1).uniform(middle - half, middle + half, (count, robot.n))


def reviewed(robot):
    run = tp.simulate(robot, controller="joint")
    q_e = run.q_e.copy()
    q_e[200:, -1] += 0.5
    return tp.FaultMonitor().review(robot, q_e)


def isolated(robot):
    q_e = robot.expected().extended_positions(poses_of(robot))
    q_e[:, 0] += 0.2
    return tp.faults.isolate(robot, q_e)


#: How a result of every public class is made of a robot with a redundant sensor.
RESULTS = {
    "Robot": lambda robot: robot,
    "Estimate": lambda robot: robot.estimate(robot.extended_positions(poses_of(robot))),
    "Accuracy": lambda robot: tp.accuracy(robot, poses_of(robot)),
    "Calibration": lambda robot: tp.calibrate(robot, robot.expected().read(poses_of(robot))),
    "SensorSelection": lambda robot: tp.select_sensors(
        robot,
        dict.fromkeys(robot.sensors, 90),
        use=tp.design.Use(poses=poses_of(robot)),
        target=1.0,
    ),
    "ErrorBudget": lambda robot: tp.design.error_budget(
        robot, tp.design.Use(poses=poses_of(robot))
    ),
    "Placement": lambda robot: tp.design.place_sensors(
        tp.load("h4"),
        ["wire1"],
        within={"*": (-0.1, 0.1)},
        use=tp.design.Use(poses=poses_of(tp.load("h4"), 2)),
    ),
    "PosePlan": lambda robot: tp.plan_poses(robot, 4, candidates=poses_of(robot), target=1.0),
    "StabilityMargins": lambda robot: tp.control.stability_margins(
        robot, "joint", poses=[robot.home]
    ),
    "Simulation": lambda robot: tp.simulate(robot, controller="joint"),
    "SteadyState": lambda robot: tp.steady_state(robot, robot, poses_of(robot), "joint"),
    "PathAccuracy": lambda robot: tp.simulation.path_accuracy(
        robot, tp.simulation.Circle(centre=robot.home, radius=0.02, frequency=4), runs=2
    ),
    "Study": lambda robot: tp.monte_carlo("rest", robot, count=3, workers=0),
    "Detectability": lambda robot: tp.faults.detectability(robot, poses_of(robot)),
    "Isolation": isolated,
    "Review": reviewed,
    "Zeroing": lambda robot: zero(robot, robot.expected().extended_positions([robot.home])),
}
MADE = {"h4": "theta,z_telemeter", "stewart": "z_telemeter,roll", "g1-ankle": "roll_encoder"}
#: Of a robot that turns about two axes alone, these have no meaning.
WITHOUT = {("g1-ankle", "PathAccuracy")}


@pytest.mark.parametrize(
    ("name", "kind"),
    [(name, kind) for name in MADE for kind in RESULTS if (name, kind) not in WITHOUT],
)
def test_every_result_shows_itself(name, kind):
    robot = tp.load(name).with_sensors(*MADE[name].split(","))
    if kind == "Zeroing" and name != "g1-ankle":
        robot = tp.load("g1-ankle")
    result = RESULTS[kind](robot)
    assert type(result).__name__ == kind
    require_shown(result)


def test_every_class_that_a_public_function_returns_shows_itself():
    given = {tp.logs.Log, tp.calibration.NuisanceParameter}  # given to other functions
    rooms = [tp, *(getattr(tp, name) for name in tp.__all__ if inspect.ismodule(getattr(tp, name)))]
    functions = [
        function
        for room in rooms
        for function in map(room.__dict__.get, room.__all__)
        if inspect.isfunction(function)
    ]
    assert {tp.accuracy, tp.steady_state, tp.faults.isolate} <= set(functions)
    seen = {Estimate, Review}  # of methods
    for function in functions:
        returned = inspect.signature(function).return_annotation
        if isinstance(returned, str):
            returned = vars(inspect.getmodule(function)).get(returned.partition("[")[0])
        if isinstance(returned, type) and returned not in given:
            assert issubclass(returned, Shown), (function, returned)
            seen.add(returned)
    assert {of.__name__ for of in seen} == set(RESULTS)


@pytest.mark.parametrize("package", ["pandas", "polars"])
def test_parameters_go_into_a_data_frame(h4, package):
    frames = pytest.importorskip(package)
    frame = frames.DataFrame(h4.table())
    assert list(frame.columns) == ["name", "value", "unit", "sigma"]
    assert list(frame["name"]) == list(h4.parameters)
    factors = {unit: factor for factor, unit in PRINT.values()}
    factor = [factors[unit] for unit in frame["unit"]]
    assert set(frame["unit"]) == {"mm", "°", ""}
    for column in ("value", "sigma"):
        own = [getattr(p, column) for p in h4.parameters.values()]
        assert list(frame[column]) == [f * of for f, of in zip(factor, own, strict=True)]
    fit = tp.calibrate(h4, h4.expected().read(poses_of(h4)))
    learnt = frames.DataFrame(fit.table())
    assert list(learnt["parameter"]) == list(fit.names)
    shown = zip(learnt["value"], learnt["unit"], fit.parameters.values(), strict=True)
    assert all(value == factors[unit] * p.value for value, unit, p in shown)


def test_what_is_computed_from_an_accuracy_is_a_plain_array(h4):
    P = tp.accuracy(h4, [h4.home, h4.home])
    for values in (P[0], P - P, np.exp(P), 2 * P, P.copy()):
        assert type(values) is np.ndarray or values._repr_html_() is None
    assert P.sigma.shape == (2, 5)
    assert P.rms == pytest.approx(P.worst) == P.at(0.5) == P.sigma[0, -1]
