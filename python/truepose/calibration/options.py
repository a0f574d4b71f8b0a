"""Options of a calibration."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from numpy.typing import ArrayLike

from truepose.arguments import Level
from truepose.calibration.registration import Registration, registration_of
from truepose.exceptions import InputError, choose

ModelError = Literal["on", "off"]
Loss = Literal["student", "squares"]
CauseChoice = Literal["refuse", "apply", "ignore"]


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """How a robot is fitted to a log: options of :func:`truepose.calibrate`.

    The result has the cause in ``causes``, the frame in ``registration``, the lean in
    ``influences``.

    Parameters
    ----------
    level : {"ideal", "full"}, optional
        One rod per chain, or every rod; by default full where the robot has it
        (:attr:`Robot.highest_level`). The calibrated robot keeps it.
    loss : {"student", "squares"}
        Influence of a gross error: none, or all. Both are least squares where no row contradicts
        all others. Rows that do are found by Student's loss, and left out.
    model_error : {"on", "off"}
        Whether to allow, at the ideal level, for the errors that it omits: axis errors that tilt
        the platform and turn its bars, by the file's tolerances. The calibrated robot's estimates
        then include them. "off" is for robots that are ideal on paper.
    cause : {"refuse", "apply", "ignore"}
        What to do with a log that a mistake explains decisively: a motor homed off, a wrong rod,
        exchanged columns, a slipped encoder. Refuse it, calibrate with the mistake undone, or do
        not search.
    registration : {"unknown", "known"} or Registration
        Frame of outside measurements, and the measured marker. Unknown: identified with the
        geometry within wide priors. Known: base frame and platform reference point.
    measured_angle_sigma : float, optional
        σ of measured angles, rad; 0.01° by default.
    lean : float, or array_like, shape (2,), optional
        σ of the base's (shank's) lean about each horizontal axis: common to the log, and of each
        posture; with columns base_lean_x and base_lean_y (the base's roll and pitch by an IMU on
        it, rad), σ of that IMU's bias. Inclinometers and a table's flat postures depend on it. By
        default 0.2° (assumed) with these columns, 1° (assumed) with flat postures, else 0.
    euler : str, optional
        Convention of measured_roll, measured_pitch, measured_yaw: by default "ZYX",
        R = R_z(yaw) R_y(pitch) R_x(roll); every order of the three axes, about the turned axes
        (upper case) or fixed ones (lower case, the first turn first: "xyz" is "ZYX").

    Raises
    ------
    InputError
        An unknown word.

    Examples
    --------
    >>> import truepose as tp
    >>> from truepose.robot.workspace import workspace_grid
    >>> robot = tp.load("h4")
    >>> readings = robot.sample(seed=1).read(workspace_grid(robot))
    >>> options = tp.calibration.CalibrationOptions(level="ideal")
    >>> tp.calibrate(robot, readings, options=options).level
    'ideal'
    """

    level: Level | None = None
    loss: Loss = "student"
    model_error: ModelError = "on"
    cause: CauseChoice = "refuse"
    registration: Literal["unknown", "known"] | Registration = field(
        default="unknown", metadata={"words": Literal["unknown", "known"]}
    )
    measured_angle_sigma: float | None = field(default=None, metadata={"option": False})
    lean: ArrayLike | None = field(default=None, metadata={"text": "lean"})
    euler: str | None = None

    def __post_init__(self) -> None:
        for name, words in (("loss", Loss), ("model_error", ModelError), ("cause", CauseChoice)):
            if getattr(self, name) not in get_args(words):
                raise InputError(choose(name, getattr(self, name), get_args(words)))
        registration_of(self.registration)
