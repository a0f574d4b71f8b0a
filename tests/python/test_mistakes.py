"""Natural mistakes. Each gets one line that says what to do."""

import re
import warnings

import numpy as np
import pytest
from fixtures import drawn_poses

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose.robotfile import shipped

H4 = tp.load("h4")
X = [0.05, 0.05, -0.4, 0.2]
Q = H4.ikm(X)
DELTA = tp.load("delta")
Fault, Disturbance = tp.faults.Fault, tp.faults.Disturbance


class Millimetres:
    """What a library of units gives."""

    units = "millimeter"
    to_base_units = None


def some_readings():
    """Return readings of 30 poses."""
    x = drawn_poses(H4, 30, 0)
    return H4.extended_positions(x)


MISTAKES = {
    "a pose in mm": (lambda: H4.ikm([50, 50, -400, 0.2]), r"unreachable; is it in mm or degrees"),
    "an angle in degrees": (
        lambda: H4.ikm([0.05, 0.05, -0.4, 11.5]),
        r"theta = 11.5 rad .*degrees",
    ),
    "a pose without its angle": (lambda: H4.ikm(X[:3]), r"x: shape \(3,\), must be \(\.\.\., 4\)"),
    "too many motors": (
        lambda: H4.fkm([*Q, 0.1]),
        r"q: shape \(5,\), must be \(\.\.\., 4\) for h4",
    ),
    "motors in degrees": (lambda: H4.fkm(np.degrees(Q)), r"m and rad\?"),
    "a NaN": (lambda: H4.ikm([np.nan, 0, -0.4, 0]), "must be finite numbers"),
    "a text for a pose": (lambda: H4.ikm("home"), "x = 'home': must be numbers"),
    "nothing for a pose": (lambda: H4.ikm(None), r"must be \(\.\.\., 4\) for h4"),
    "poses in columns": (lambda: H4.ikm(np.zeros((4, 10))), r"shape \(4, 10\), must be"),
    "complex poses": (lambda: H4.ikm(np.array(X, complex)), "must be real"),
    "a masked pose": (lambda: H4.ikm(np.ma.array(X, mask=[1, 0, 0, 0])), "fill the masked values"),
    "a pose with units": (
        lambda: H4.ikm(Millimetres()),
        r"has units \(millimeter\): pass x\.to_ba",
    ),
    "other columns": (lambda: H4.ikm({"x": [0.05], "y": [0.05]}), "must be x, y, z, theta or q1"),
    "errors": (
        lambda: H4.ikm(X, errors="ignore"),
        r"unknown errors 'ignore' \(choices: raise, nan",
    ),
    "an assigned parameter": (
        lambda: H4.parameters.__setitem__("chain1.rod", 0.5),
        r"does not change a robot; robot\.replace",
    ),
    "effects without an object": (
        lambda: tp.Effects.only("thermal"),
        r"Effects\(\)\.only\('thermal'\)",
    ),
    "a law of its own name": (
        lambda: tp.simulate(H4, H4, law="tej"),
        "controller='tej'",
    ),
    "a marker of one number": (
        lambda: tp.calibration.Registration(marker=0.1),
        "marker = 0.1: must be 3 numbers",
    ),
    "a pattern of other rows": (
        lambda: tp.calibrate(
            H4,
            H4.read(np.tile(X, (9, 1)), seed=1),
            influences=[
                tp.calibration.NuisanceParameter(
                    name="heat", pattern=np.ones((3, 5)), amount=(0.0, 1.0)
                )
            ],
        ),
        r"heat: pattern: shape \(3, 5\), must be \(9, 5\)",
    ),
    "a force of one number": (
        lambda: Disturbance("contact", 0.1, force=3.0),
        "force = 3.0: must be a list",
    ),
    "a level": (lambda: H4.with_level("fulll"), "did you mean 'full'"),
    "an unknown sensor": (lambda: H4.with_sensors("thetta"), "did you mean 'theta'"),
    "a sensor twice": (lambda: H4.with_sensors("theta", "theta"), "named twice"),
    "no such robot": (lambda: tp.load("h5"), "choices: .*3rpr, .*or the path of a robot file"),
    "a robot loaded": (lambda: tp.load(H4), "must be a shipped robot's name or a file's path"),
    "a folder loaded": (lambda: tp.load("."), "Is a directory"),
    "a parameter misspelt": (
        lambda: H4.replace({"chain1.lenght": 0.48}),
        r"choices: .*chain1\.rod",
    ),
    "a rod in mm": (lambda: H4.replace({"chain1.rod": 483}), "its rod is .* mm too long"),
    "a negative rod": (lambda: H4.replace({"chain1.rod": -0.48}), r"must be greater than 0 \(m\)"),
    "a parameter as text": (lambda: H4.replace({"chain1.rod": "483mm"}), "must be a finite number"),
    "a name to accuracy": (
        lambda: tp.accuracy("h4", X),
        r"robot = 'h4': must be a Robot: truepose\.",
    ),
    "a name to steady_state": (lambda: tp.steady_state("h4", H4, X), r"truepose\.load\(name\)"),
    "a name to calibrate": (lambda: tp.calibrate("h4", {}), r"truepose\.load\(name\)"),
    "a name to simulate": (lambda: tp.simulate("h4"), r"truepose\.load\(name\)"),
    "a name to plan_poses": (lambda: tp.plan_poses("h4", 5), r"truepose\.load\(name\)"),
    "a name to select_sensors": (lambda: tp.select_sensors("h4"), r"truepose\.load\(name\)"),
    "a name to margins": (lambda: tp.control.stability_margins("h4"), r"truepose\.load\(name\)"),
    "a true name": (lambda: tp.simulate(H4, "delta"), r"truth = 'delta': must be a Robot"),
    "a law misspelt": (lambda: tp.steady_state(H4, H4, X, "cartezian"), "did you mean 'cartesian'"),
    "a law's old name": (lambda: tp.Controller(law="redundant"), "choices: joint, tej, cartesian"),
    "no sensor for a law": (
        lambda: tp.steady_state(DELTA, DELTA, DELTA.home, "tej"),
        r"needs a redundant sensor, .*with_sensors",
    ),
    "another robot": (lambda: tp.steady_state(H4, DELTA, X), "must have the same mobility and sen"),
    "negative poles": (
        lambda: tp.Controller(frequency=-1),
        "must be a finite number greater than 0",
    ),
    "a period in ms": (lambda: tp.Controller(period=1), r"at most 0\.2 s; is it in ms\?"),
    "a list as a log": (
        lambda: tp.calibrate(H4, [1, 2, 3]),
        r"shape \(3,\), must be \(\.\.\., 5\)",
    ),
    "a log without theta": (
        lambda: tp.calibrate(H4, {f"q{k}": [0] for k in range(1, 5)}),
        "no column 'theta' .*leave a sensor out",
    ),
    "a log of unequal columns": (
        lambda: tp.calibrate(H4, {**{f"q{k}": [0, 0] for k in range(1, 5)}, "theta": [0]}),
        r"column theta: shape \(1,\), must be \(2,\)",
    ),
    "a log's path": (
        lambda: tp.calibrate(H4, "log.csv"),
        r"pass truepose\.logs\.read\(robot, 'log",
    ),
    "a log in degrees": (
        lambda: tp.calibrate(H4, np.degrees(some_readings())),
        "in degrees, must be rad",
    ),
    "a loss misspelt": (
        lambda: tp.calibrate(H4, some_readings(), options=CalibrationOptions(loss="studend")),
        "mean 'student'",
    ),
    "motors to estimate": (
        lambda: H4.estimate(Q),
        r"q_e: shape \(4,\), must be \(\.\.\., 5\) for h4",
    ),
    "options as a dict": (
        lambda: tp.calibrate(H4, some_readings(), options={"loss": "squares"}),
        r"options = .*CalibrationOptions\(",
    ),
    "a robot of a name": (lambda: tp.Robot("h4"), r"spec = 'h4': .*truepose\.load\(name\)"),
    "a name to for_robot": (lambda: tp.Controller.for_robot("h4"), r"truepose\.load\(name\)"),
    "a log's path first": (lambda: tp.logs.read("log.csv", H4), r"truepose\.load\(name\)"),
    "a parameter without its chain": (lambda: H4.parameters["rods"], r"unknown parameter 'rods'"),
    "a pattern to replace": (lambda: H4.replace({"chain*.rod": 0.48}), r"mean 'chain1\.rod'"),
    "a kind of fault": (lambda: Fault("theta", "broken"), "choices: bias, jump, spike, stuck"),
    "a fault's reading": (
        lambda: tp.simulate(H4, faults=[Fault("tetha", "stuck")]),
        "mean 'theta'",
    ),
    "one fault": (
        lambda: tp.simulate(H4, faults=Fault("theta", "stuck")),
        "list of Fault: .fault.",
    ),
    "effects as text": (
        lambda: tp.simulate(H4, effects="all"),
        r"must be a Effects: truepose\.Effe",
    ),
    "a monitor as a flag": (
        lambda: tp.simulate(H4, monitor=True),
        r"truepose\.FaultMonitor\(…\), or N",
    ),
    "one disturbance": (
        lambda: tp.simulate(
            H4, run=tp.simulation.Run(disturbances=Disturbance("payload", size=1.0))
        ),
        "list of Disturbance: .disturbance.",
    ),
    "learning as a flag": (
        lambda: tp.simulate(H4, run=tp.simulation.Run(learn=True)),
        r"truepose\.OnlineCalibrator\(…\)",
    ),
    "a circle in mm": (
        lambda: tp.simulate(H4, path=tp.simulation.Circle(centre=H4.home, radius=50, frequency=1)),
        "is it in mm or degrees",
    ),
    "a study misspelt": (lambda: tp.monte_carlo("rst", "h4", 2), r"mean 'rest'.*file\.py:function"),
    "gravity as a number": (lambda: H4.with_gravity(9.81), r"must be three finite numbers, m/s²"),
    "a load as a number": (lambda: H4.with_payload(5), "must be three finite numbers, N"),
    "a seed as text": (lambda: H4.sample("a"), "must be a whole number from 0"),
    "a fit for a section": (lambda: H4.with_calibration(3), r"fit\.robot has one"),
    "a log's arguments": (lambda: tp.logs.write("x.csv", {}), r"logs\.write\(run, 'log\.csv'\)"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_gets_one_line_that_says_what_to_do(name):
    mistake, said = MISTAKES[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        with pytest.raises((tp.TrueposeError, UserWarning)) as refused:
            mistake()
    line = str(refused.value)
    assert "\n" not in line and re.search(said, line), line


def test_a_list_of_sensors_and_a_table_of_poses_are_taken_as_they_are_meant():
    assert H4.with_sensors(["theta", "z_telemeter"]).sensors == ("theta", "z_telemeter")
    table = dict(zip(("theta", "z", "y", "x"), [[v] for v in X[::-1]], strict=True))
    np.testing.assert_array_equal(H4.ikm(table), [Q])


def logged(text: str) -> dict[str, str]:
    """Return a log as a file."""
    return {"log.csv": text}


HEAD = ",".join(H4.readings)
ROWS = "\n".join(",".join(map(repr, row)) for row in some_readings().tolist())
CALIBRATE = "calibrate h4 log.csv"
#: Files, a command line, and what its answer must name.
COMMANDS = {
    "a log that is not there": ({}, CALIBRATE, "log.csv"),
    "a folder as a log": ({"log.csv/a": ""}, CALIBRATE, "log.csv"),
    "an empty log": (logged(""), CALIBRATE, "log.csv"),
    "a log of a head alone": (logged(HEAD), CALIBRATE, "log.csv"),
    "a log without a head": (logged(ROWS), CALIBRATE, "line 1"),
    "capital columns": (logged(f"{HEAD.upper()}\n{ROWS}"), CALIBRATE, "q1"),
    "columns of other names": (logged(f"{HEAD.replace('q', 'm')}\n{ROWS}"), CALIBRATE, "--columns"),
    "a unit in the head": (logged(f"{HEAD.replace('q1', 'q1 (deg)')}\n{ROWS}"), CALIBRATE, "q1"),
    "a unit in the head of a measurement": (
        logged(f"{HEAD},measured_x [mm]\n" + ROWS.replace("\n", ",1\n") + ",1"),
        CALIBRATE,
        "'measured_x = NAME mm'",
    ),
    "legs of other names": (
        logged("leg1,leg2,leg3,leg4,leg5,leg6\n1,1,1,1,1,1"),
        "calibrate stewart log.csv",
        "'q1 = NAME mm'",
    ),
    "a tracker's columns without measured_": (
        logged("q1,q2,q3,x,y,z\n" + ",".join(map(repr, DELTA.ikm(DELTA.home).tolist())) + ",0,0,0"),
        "calibrate delta log.csv",
        "not used: x, y, z",
    ),
    "a log between spaces": (logged(f"{HEAD}\n{ROWS}".replace(",", "  ")), CALIBRATE, "commas"),
    "decimal commas": (
        logged(f"{HEAD}\n{ROWS}".replace(",", ";").replace(".", ",")),
        CALIBRATE,
        "decimals",
    ),
    "a word in a log": (logged(f"{HEAD}\n{ROWS}\na,b,c,d,e"), CALIBRATE, "line 32"),
    "a short row": (logged(f"{HEAD}\n{ROWS}\n1,2"), CALIBRATE, "line 32"),
    "a column twice": (logged(f"{HEAD},q1\n{ROWS}"), CALIBRATE, "line 2"),
    "a log first": (logged(f"{HEAD}\n{ROWS}"), "calibrate log.csv h4", "log.csv"),
    "a sensor's σ without unit": (
        logged(f"{HEAD}\n{ROWS}"),
        f"{CALIBRATE} --measured-sigma 0.02",
        "0.02mm",
    ),
    "an unknown formula": (
        logged(f"{HEAD}\n{ROWS}"),
        [*CALIBRATE.split(), "--columns", "q1 = A * mm"],
        "q1 = A",
    ),
    "an output that is a folder": (
        logged(f"{HEAD}\n{ROWS}") | {"out.toml/a": ""},
        f"{CALIBRATE} -o out.toml",
        "out.toml",
    ),
    "an output that exists": (
        logged(f"{HEAD}\n{ROWS}") | {"out.toml": ""},
        f"{CALIBRATE} -o out.toml",
        "--force",
    ),
    "a robot misspelt": ({}, "info h44", "'h4'"),
    "a robot in capitals": ({}, "info H4", "'h4'"),
    "a robot file that is not there": ({}, "check my.toml", "my.toml"),
    "a robot of a CSV": (logged(f"{HEAD}\n{ROWS}"), "check log.csv", "log.csv"),
    "no robot": ({}, "info", "ROBOT"),
    "a command misspelt": ({}, "calibrat h4", "calibrate"),
    "a renamed command": ({}, "robots", "truepose list"),
    "a renamed study": ({}, "study rest h4", "monte-carlo"),
    "an unknown format": ({}, "export urdf h4", "choices: c"),
    "an unknown option": ({}, "accuracy h4 --sensor theta", "--sensors"),
    "a sensor misspelt": ({}, "accuracy h4 --sensors tetha", "'theta'"),
    "a target without a unit": ({}, "design h4 --target 0.1 --price *=1", "0.1mm"),
    "a target of another unit": ({}, "design h4 --target 0.1deg --price *=1", "0.1deg"),
    "a budget of words": ({}, "design h4 --budget cheap", "cheap"),
    "a law in capitals": ({}, "simulate h4 --law TEJ", "'tej'"),
    "a fault without a kind": ({}, "simulate h4 --fault theta", "READING:KIND"),
    "an unknown fault": ({}, "simulate h4 --fault theta:frozen", "stuck"),
    "a pose in mm": ({}, "simulate h4 --from 50,50,-400,0", "mm"),
    "a pose of three numbers": ({}, "simulate h4 --from 0.05,0.05,-0.4", "theta"),
    "an effect misspelt": ({}, "simulate h4 --effects frition", "'friction'"),
    "a negative seed": ({}, "simulate h4 --seed -1", "-1"),
    "an output format": ({}, "accuracy h4 --format xml", "json"),
    "a picture's ending": ({}, "accuracy h4 --plot a.bmp", ".png"),
    "poses without a column": ({"p.csv": "x,y,z\n0,0,-0.4"}, "accuracy h4 --poses p.csv", "theta"),
    "poses in mm": (
        {"p.csv": "x,y,z,theta\n50,0,-400,0"},
        "accuracy h4 --poses p.csv",
        "mm",
    ),
    "poses without a head": ({"p.csv": "0.05,0,-0.4,0"}, "accuracy h4 --poses p.csv", "p.csv"),
    "no pose": ({}, "plan h4 --count 0", "--count"),
    "an unknown study": ({}, "monte-carlo acuracy h4", "calibration"),
    "a study's robot first": ({}, "monte-carlo h4 rest", "function"),
    "robots without tolerances": (
        {"r.toml": shipped()["five-bar"].read_text(encoding="utf-8").partition("[tolerances]")[0]},
        "monte-carlo rest r.toml",
        "tolerances",
    ),
    "a share without %": ({}, "design h4 --confidence 0.95 --price *=1", "0.95"),
    "a price with a colon": ({}, "design h4 --price theta:90", "SENSOR=PRICE"),
    "a payload of one number": ({}, "accuracy h4 --conditions payload=2", "LOW..HIGH"),
    "a volume without units": ({}, "error-budget h4 --volume z=-450..-400", "units"),
    "a word of 0.5": ({}, "simulate h4 --true drawn", "sampled"),
    "a period in ms": ({}, "export c h4 --period 1", "ms"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_mistake_in_a_command_gets_one_line_that_names_the_thing(name, run, tmp_path):
    made, words, thing = COMMANDS[name]
    for path, text in made.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    status, out, err = run(*(words.split() if isinstance(words, str) else words))
    said = err.strip() or out.strip()  # check prints its problems
    assert status == 2 and "\n" not in said and thing in said and "a bug in" not in said


#: Changes of the H4's file, and what the answer must name.
IN_FILES = {
    "no closing quote": ('name = "h4"', 'name = "h4', "line 3"),
    "no quotes": ('"schoenflies"', "schoenflies", "quotes"),
    "a key misspelt": ("encoder_counts", "encoder_count", "'encoder_counts'"),
    "a rod in mm": ("rod = 0.48", "rod = 480", "mm"),
    "a decimal comma": ("rod = 0.48", "rod = 0,48", "point"),
    "an unknown unit": ("rod = 0.48", 'rod = "48 cm"', "mm"),
    "an unknown mobility": ('"schoenflies"', '"scara"', "'schoenflies'"),
    "an unknown kind": ('kind = "platform_angle"', 'kind = "angle"', "platform_angle"),
    "a key twice": ('name = "h4"', 'name = "h4"\nname = "h4"', "line 4"),
}


@pytest.mark.parametrize("name", IN_FILES)
def test_a_mistake_in_a_robot_file_gets_one_line_that_names_the_thing(name, run, h4_text, tmp_path):
    old, new, thing = IN_FILES[name]
    assert old in h4_text
    (tmp_path / "robot.toml").write_text(h4_text.replace(old, new, 1), encoding="utf-8")
    status, _, err = run("info", "robot.toml")
    assert status == 2 and err.count("\n") == 1 and thing in err and "robot.toml" in err


#: Mistakes in Python that end in Python's own kinds of errors, and what these must name.
OF_PYTHON = {
    "a robot's parameters": (lambda: setattr(H4, "parameters", {}), "replace"),
    "a robot's home": (lambda: setattr(H4, "home", [0, 0, 0, 0]), "with_"),
    "a robot file's name": (lambda: setattr(H4.spec, "name", "x"), "with_file"),
    "a list of names": (lambda: H4.replace(["chain1.rod"]), "chain1.rod"),
    "a negative tolerance": (
        lambda: H4.with_file(tolerances={"chain*.rod": {"sigma": -1.0}}),
        "sigma = -1",
    ),
    "negative noise": (lambda: H4.with_each("sensor", lambda _: {"noise": -1.0}), "noise = -1"),
    "a key of a file misspelt": (lambda: H4.with_file(tolerence={}), "'tolerances'"),
    "a sensor in use that is none": (lambda: H4.with_file(sensors=["nope"]), "nope"),
    "a log and a robot": (lambda: tp.calibrate(some_readings(), H4), "robot"),
    "a log of NaN": (lambda: tp.calibrate(H4, np.full((9, 5), np.nan)), "every motor"),
    "tp.robots": (lambda: tp.robots, "list_robots"),
    "tp.Watch": (lambda: tp.Watch, "FaultMonitor"),
    "tp.Fault": (lambda: tp.Fault("theta", "stuck"), "truepose.faults.Fault"),
    "robot.finest": (lambda: H4.finest, "at_highest_level"),
    "tp.load_robot": (lambda: tp.load_robot, "truepose.load "),
    "robot.forward_kinematics": (lambda: H4.forward_kinematics(Q), "is fkm"),
    "robot.inverse_kinematics": (lambda: H4.inverse_kinematics(X), "is ikm"),
    "robot.dof": (lambda: H4.dof, "is n "),
    "robot.ikn": (lambda: H4.ikn(X), "'ikm'"),
    "a law in capitals": (lambda: tp.Controller(law="TEJ"), "'tej'"),
    "half a pose": (lambda: tp.plan_poses(H4, 5.5), "count = 5.5"),
}


@pytest.mark.parametrize("name", OF_PYTHON)
def test_a_mistake_in_python_gets_one_line_that_names_the_thing(name):
    mistake, thing = OF_PYTHON[name]
    with pytest.raises((tp.TrueposeError, AttributeError)) as refused:
        mistake()
    assert "\n" not in str(refused.value) and thing in str(refused.value)
