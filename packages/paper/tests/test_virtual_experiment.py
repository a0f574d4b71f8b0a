"""The virtual experiment, which reads vision and encoders alone."""

import numpy as np
import pytest

import truepose as tp
from truepose import logs
from truepose.calibration import CalibrationOptions
from truepose.robot import coordinates, frames
from truepose.simulation.plants import Visit
from truepose.simulation.plants.exact import ExactPlant, follow_backlash
from truepose_paper import experiment, twin, virtual_experiment
from truepose_paper.vision import Setup, Vision


@pytest.fixture(scope="module")
def tilted(truth):
    """Return a true robot whose motors' axes are askew: its nacelle tilts."""
    askew = {f"chain{i}.{k}": 2e-3 * (-1) ** i for i in (1, 2, 3, 4) for k in ("yaw", "tilt")}
    return truth.replace(askew)


@pytest.fixture(scope="module")
def runs(h4, truth):
    plant = ExactPlant(truth)
    return virtual_experiment.run(plant, h4, Vision(Setup()), controls=tuple(experiment.CONTROLS))


@pytest.mark.parametrize("law", ["joint", "tej", "weighted", "cartesian", "estimated"])
def test_the_exact_plant_rests_where_settle_says(h4, truth, table2, law):
    visit = ExactPlant(truth).visit(h4, table2, tp.Controller(law=law))
    assert (visit.status == "ok").all()
    assert np.abs(visit.x - tp.steady_state(h4, truth, table2, law)).max() < 1e-12
    assert np.abs(coordinates(h4, visit.frame) - visit.x).max() < 1e-12


def test_a_hexapod_rests_where_settle_says(stewart, anywhere, rng):
    x_d = anywhere(stewart, 20, rng)
    true = stewart.replace({"chain1.base.x": stewart.parameters["chain1.base.x"].value + 1e-3})
    visit = ExactPlant(true).visit(stewart, x_d, tp.Controller(law="joint"))
    assert np.abs(visit.x - tp.steady_state(stewart, true, x_d, "joint")).max() < 1e-11


def test_at_the_full_level_usual_control_brings_the_motors_where_they_belong(h4, tilted, table2):
    visit = ExactPlant(tilted, level="full").visit(h4, table2, tp.Controller(law="joint"))
    assert np.abs(visit.q_e[:, :4] - h4.ikm(table2)).max() < 1e-12
    assert np.abs(visit.x - tilted.fkm(h4.ikm(table2), level="full")).max() < 1e-11


def test_the_frame_holds_the_tilt_that_x_leaves_out(h4, tilted, table2):
    visit = ExactPlant(tilted, level="full").visit(h4, table2, tp.Controller(law="tej"))
    upright = np.arccos(np.clip(visit.frame[:, 2, 2], -1, 1))
    wanted = np.linalg.norm(tilted.residual_motion(visit.x)[:, :2], axis=1)
    assert np.abs(upright - wanted).max() < 1e-6
    assert upright.max() > 1e-3
    assert np.abs(coordinates(h4, visit.frame) - visit.x).max() < 1e-12


def test_play_of_the_gear_lags_behind_the_nacelle(h4):
    play = np.radians(0.4)
    effects = tp.Effects.none().without()
    effects = tp.Effects(**{**vars(effects), "tool_backlash": play})
    x_d = np.array([[0, 0, -0.4, t] for t in (0.1, 0.2, 0.3, 0.2, 0.1, 0.1 + play / 4)])
    visit = ExactPlant(h4, effects).visit(h4, x_d, tp.Controller(law="joint"))
    ahead = visit.q_e[:, 4] - visit.x[:, 3]
    wanted = play * np.array([-0.5, -0.5, -0.5, 0.5, 0.5, 0.25])
    assert ahead == pytest.approx(wanted, abs=1e-12)


def test_under_redundant_control_play_turns_the_nacelle_itself(h4, table2):
    effects = tp.Effects(**{**vars(tp.Effects.none()), "tool_backlash": np.radians(0.4)})
    visit = ExactPlant(h4, effects).visit(h4, table2, tp.Controller(law="tej"))
    off = np.degrees(visit.x[:, 3] - table2[:, 3])
    assert (visit.status == "ok").all()
    assert np.abs(off).max() == pytest.approx(0.2, rel=0.05)
    assert np.abs(off).min() > 0.17


def test_effects_that_need_forces_are_refused(truth):
    with pytest.raises(tp.InputError, match="unknown effect 'friction'"):
        ExactPlant(truth, tp.Effects())


def test_a_pose_that_cannot_be_reached_is_said_and_left_out(h4, truth, table2):
    poses = np.vstack([table2[:50], [[-0.3, 0, -0.55, 0.0]], [[0.3, 0.0, -0.3, 0.0]]])
    found = virtual_experiment.run(ExactPlant(truth), h4, Vision(Setup()), poses)["joint"]
    assert not found.counted[50:].any() and found.counted[:50].all()
    assert sum(found.excluded.values()) == 2
    assert all("controller" in reason for reason in found.excluded)
    alone = virtual_experiment.run(ExactPlant(truth), h4, Vision(Setup()), poses[:50])["joint"]
    assert np.abs(found.table() - alone.table()).max() < 0.2


def test_leds_out_of_view_are_counted_and_left_out(h4, truth, table2):
    narrow = Setup(pixels=900)
    found = virtual_experiment.run(ExactPlant(truth), h4, Vision(narrow))["joint"]
    assert 0 < found.counted.sum() < len(table2)
    assert all("LEDs in view of all cameras, 3 needed" in reason for reason in found.excluded)
    assert sum(found.excluded.values()) == (~found.counted).sum()
    assert np.isfinite(found.table()).all()


def test_no_pose_in_view_is_an_error(h4, truth):
    away = Setup(centre=(5.0, 0.0, -0.4))
    found = virtual_experiment.run(ExactPlant(truth), h4, Vision(away))["joint"]
    with pytest.raises(tp.InputError, match="no pose counts: 0 of 4 LEDs"):
        found.table()


def test_the_experiment_never_reads_the_true_pose(h4, truth, table2):
    """A plant with a false x gives the same tables: only LEDs and encoders are looked at."""

    class Liar(ExactPlant):
        def visit(self, *args, **kwargs):
            return super().visit(*args, **kwargs)._replace(x=np.zeros((len(table2), 4)))

    for control, honest in virtual_experiment.run(ExactPlant(truth), h4, Vision(Setup())).items():
        lied = virtual_experiment.run(Liar(truth), h4, Vision(Setup()))[control]
        assert (lied.table() == honest.table()).all()


def test_both_readings_of_error(runs, table2):
    """At rest under usual control the encoders show the desired pose, under the TEJ they do not."""
    usual, redundant = runs["joint"], runs["tej"]
    assert np.abs(usual.errors("estimated") - usual.errors("desired")).max() < 0.01
    shown = redundant.errors("desired") - redundant.errors("estimated")
    wanted = experiment.in_print_units(table2 - redundant.estimated)
    assert np.abs(shown - wanted).max() < 1e-9
    assert np.abs(shown[:, 3]).max() > 0.1  # what the TEJ leaves of θ
    with pytest.raises(tp.InputError, match="unknown reading 'error'"):
        usual.errors("error")


def test_vision_agrees_with_the_exact_statics_to_its_own_noise(h4, truth, runs, table2):
    for control in ("joint", "tej", "cartesian"):
        exact = experiment.rest(h4, truth, table2, controls=(control,))[control]
        apart = runs[control].measured - exact
        claimed = np.sqrt(np.diagonal(runs[control].covariance, axis1=1, axis2=2))[:, [0, 1, 2, 5]]
        assert (np.abs(apart) < 6 * claimed).all()


def test_the_paper_is_seen_through_vision(runs):
    """θ's sum of squares falls, the position stays; self-calibration gains on it."""
    tables = {control: run.table("desired") for control, run in runs.items()}
    assert tables["tej"][3, 2] < 0.02 * tables["joint"][3, 2]
    assert tables["tej"][4, 2] > 0.3 * tables["joint"][4, 2]
    assert tables["self-calibrated"][4, 2] < 0.1 * tables["joint"][4, 2]


def test_what_is_asked_wrongly_is_said(h4, delta, truth):
    plant, vision = ExactPlant(truth), Vision(Setup())
    with pytest.raises(tp.InputError, match="unknown control 'jiont'; did you mean 'joint'"):
        virtual_experiment.run(plant, h4, vision, controls=["jiont"])
    with pytest.raises(tp.InputError, match="must be schoenflies"):
        virtual_experiment.run(ExactPlant(delta), delta, vision)


def test_a_visit_has_the_shapes_that_every_plant_promises(h4, truth):
    visit = ExactPlant(truth).visit(h4, np.array([h4.home] * 3), tp.Controller())
    assert isinstance(visit, Visit)
    assert [np.shape(v) for v in visit] == [(3, 5), (3, 4, 4), (3, 4), (3,)]


WAYS = {
    "at one angle": lambda table: table[::5],
    "at another": lambda table: table[2::5],
    "back and forth": lambda table: np.vstack([table[::50], table[::-50]]),
    "all angles": lambda table: table[:125],
}


@pytest.mark.parametrize("law", ["joint", "tej", "weighted", "cartesian", "estimated"])
@pytest.mark.parametrize("way", WAYS)
def test_every_pose_settles_behind_the_play_and_where_its_equations_say(h4, table2, law, way):
    """At rest the motor error vanishes; the tool follows the nacelle where its play ends."""
    there = twin.shipped()
    plant = ExactPlant(
        there.truth.without_quantization(), there.effects.only("backlash"), level="full"
    )
    x_d = WAYS[way](table2)
    visit = plant.visit(h4, x_d, tp.Controller(law=law))
    assert (visit.status == "ok").all()
    half, ahead, theta = 0.5 * there.effects.tool_backlash, 0.0, float(h4.home[-1])
    shown = visit.q_e[:, 4] - plant.truth.extended_positions(visit.x, level="full")[:, 4]
    gain = plant.truth.parameters["theta.gain"].value
    for now, found in zip(visit.x[:, -1], shown / gain, strict=True):
        ahead = min(half, max(-half, ahead + theta - now))
        assert found == pytest.approx(ahead, abs=2e-12)
        ahead, theta = found, now
    if law == "tej":
        error = h4.extended_positions(x_d) - visit.q_e
        assert np.abs(np.einsum("nij,nj->ni", h4.tej(x_d)[1], error)).max() < 1e-11


def test_a_tool_starts_in_the_middle_of_its_play(h4):
    effects = tp.Effects().only("backlash")
    visit = ExactPlant(h4.without_quantization(), effects).visit(
        h4, [h4.home], tp.Controller(law="joint")
    )
    assert visit.q_e[0, 4] == pytest.approx(h4.home[-1], abs=1e-12)


def test_a_law_that_answers_too_much_rests_at_the_end_to_which_it_drives():
    """With t(-half) > t(half) a tool may stand at either; from the middle it is driven to one."""
    tool, end = follow_backlash([0.2, 0.2, np.nan, 0.2], [-0.1, -0.1, np.nan, np.nan], 0.1)
    assert end.tolist()[:2] == [1, -1]
    assert tool.tolist() == [-0.1, 0.2, 0.2, 0.2]
    assert np.isnan(end[2])


@pytest.fixture(scope="module")
def logged(h4, truth, table2):
    poses = np.vstack([table2[::25], [[-0.3, 0, -0.55, 0.0]]])  # the last one is out of reach
    return virtual_experiment.run(ExactPlant(truth), h4, Vision(Setup()), poses)["joint"]


@pytest.mark.parametrize("ending", ["csv", "parquet", "mcap"])
def test_an_experiment_comes_back_with_what_vision_measured(h4, logged, tmp_path, ending):
    path = tmp_path / f"experiment.{ending}"
    logs.write(logged, path)
    log = logs.read(h4, path)
    for found, written in ((log.readings, logged.q_e), (log.measured, logged.measured)):
        assert np.array_equal(found, written, equal_nan=True)
    assert np.isnan(log.readings[-1]).all()
    columns = logs.columns(logged)
    assert all(c.what and c.unit in ("m", "rad", "1") for c in columns)
    assert len({c.name for c in columns}) == len(columns)


@pytest.mark.parametrize("level", ["ideal", "full"])
def test_the_experiments_own_log_calibrates_at_the_defaults(h4, tmp_path, level):
    """The twin of docs/paper.md, whose vision frame is 1.2° and 10 mm off the base."""
    there = twin.shipped()
    run = there.run(h4, ("joint",))["joint"]
    logs.write(run, tmp_path / "experiment.csv")
    log = logs.read(h4, tmp_path / "experiment.csv")
    assert np.isfinite(log.measured_sigma).all()
    fit = tp.calibrate(h4, log, options=CalibrationOptions(level=level, model_error="on"))
    off = fit.registration.see(h4, fit.x, log.measured).residual / log.measured_sigma
    assert np.sqrt(np.mean(off**2)) < 1.3
    built = there.setup.registration
    assert np.abs(fit.registration.base[:2, 3] - built[3:5]).max() < 2e-3
    turn = frames.rotation_vector(fit.registration.base[:3, :3])
    assert np.abs(turn - built[:3]).max() < np.radians(0.3)
