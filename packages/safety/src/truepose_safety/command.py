"""`truepose start-test`."""

from typer import Option

from truepose.commands import options
from truepose.show.terminal import Printing
from truepose_safety.start_test import start_test


def command(
    robot: options.RobotName,
    start: str | None = Option(None, "--from", metavar="X,Y,…", help="Pose at rest, m and rad."),
    true: options.TrueRobot = "sampled",
    effects: str = options.effects_option(
        "none", "Effects that the model omits: all, none, or some: friction,delay,…"
    ),
    fault: options.Faults = None,
    seed: options.Seed = 0,
    sensors: options.SensorsOption = None,
    output: Printing = Printing(),
) -> None:
    """Simulate the start-up test of a robot at rest: faults are miswirings of incremental encoders.

    Experimental and uncertified.

    Example: **truepose start-test h4 --fault q1:swap=q2**
    """
    believed = options.load_with(robot, sensors)
    run = start_test(
        believed,
        options.true_robot(believed, true, seed),
        options.faults_of(fault),
        start=options.parse_pose(believed, start, "--from", False),
        effects=None if effects == "none" else options.effects_of(effects),
        seed=seed,
    )
    output.show([run.table()], [run.summary])
