"""Controllers: a law, its gains, its feed-forward."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self, cast

from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, require
from truepose.control.effects import Effects
from truepose.control.gains import choose as choose_gains
from truepose.control.settings import ControllerSettings
from truepose.exceptions import InputError, PoseError
from truepose.robot import LAWS, Law, Robot, as_row, require_sensors, usual

#: Motor error ê, (n,), from the controller's robot, the desired pose and the readings (n + r,).
OwnLaw = Callable[[Robot, Array, Array], ArrayLike]
LONGEST_STOP = 5.0  #: s, of a stop along the path


@dataclass(frozen=True, kw_only=True)
class Controller(ControllerSettings):
    """A joint PD (or PID) on the motor error of one of the laws.

    Parameters
    ----------
    law : {"joint", "tej", "cartesian", "weighted", "estimated"} or callable
        The paper's Figure 1 (joint control), Figure 2 (TEJ), or closing remark (redundant FKM);
        Figure 2 with the weighted TEJ; or the Cartesian law on :meth:`Robot.estimate`. All but
        "joint" need a redundant sensor in use. The last two weight the readings by tolerances (or
        calibration) of the controller's robot and take its parameter values as they are: pass
        ``robot.expected()`` for the prior mean, ``fit.robot`` for a calibrated one. Or a function
        law(robot, x_d, q_e) that returns the motor error ê, (n,), from the controller's robot, the
        desired pose (n,) and the readings (n + r,).
    frequency, damping : float
        PD gains by pole placement, rad/s and 1.
    integral : float
        Integral action: ki = integral · kp, 1/s; 0 is none.
    gains : {"inertia", "diagonal"}
        Inertia that the gains multiply: the nominal joint inertia JᵀMJ at the setpoint, so that
        every motor has these poles at every pose; or its diagonal at the start, a PD per motor as
        in the paper, where 150 rad/s at the start of its move become 84 to 254 rad/s over Table 2.
    feed_forward : {"none", "gravity", "full"}
        From the nominal robot: nothing, its weight, or weight, inertia and Coriolis.
    period : float
        Control period, s.
    velocity_bandwidth : float
        Bandwidth of the velocity tracking loops (of the readings, or of x̂), rad/s.
    damped_below : float
        Damp the Jacobian where a :meth:`Robot.conditioning` of the setpoint is less, which bounds
        torques near a singularity; 0: never, as in the paper.
    sigma_scale : int
        "weighted" and "estimated" only: factor on the readings' σ in the weights. The best weights
        of a calibrated robot amplify differences of its readings, and with them the readings'
        errors by compliant arms and delayed torques; a larger scale amplifies less.
    """

    @property
    def built_in(self) -> Law:
        """The law's name; InputError where the law is a function, which cannot be linearized."""
        if callable(self.law):
            raise InputError(
                f"law {law_name(self.law)}: is a function; here only {', '.join(LAWS)} work "
                "(functions: steady_state, simulate, monte_carlo)"
            )
        return self.law

    @classmethod
    def for_robot(
        cls,
        robot: Robot,
        effects: Effects | None = None,
        law: Law | OwnLaw | Self | None = None,
        *,
        period: float = 1e-3,
    ) -> Self:
        """Return the fastest controller that is stable with the effects that the model omits.

        Its poles and velocity filter keep margins of 6 dB, 30° and two cycles of delay, at home and
        at the corners of the workspace, of all motors at once and of each motor and each reading
        alone. Quantization, as white noise, causes torques of at most 1 % of a motor's limit (rms)
        and a limit cycle of the platform of at most 50 µm and 0.05°. At most 150 rad/s, as in the
        paper. :func:`stability_margins` shows the margins.

        Parameters
        ----------
        robot : Robot
            The controller's robot.
        effects : Effects, optional
            All by default.
        law : law, callable or Controller, optional
            By default the TEJ law, without a sensor in use the joint law; an own law takes
            their gains. Of a Controller all settings are kept but `frequency`,
            `velocity_bandwidth` and `sigma_scale`, which are chosen. A law alone has a damping of
            0.55: with less than the paper's 1 a loop of the same stiffness responds less to high
            frequencies, a count's step or an arm's ringing.
        period : float
            Control period of a law alone, s.

        Raises
        ------
        InputError
            No poles keep these margins, for instance because of a long period; the message has the
            reason. Or the law needs a redundant sensor, and none is in use.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.load("h4")
        >>> controller = tp.Controller.for_robot(h4)
        >>> 30 < controller.frequency < 50
        True
        >>> tp.simulate(h4, controller=controller, effects=tp.Effects()).status
        'ok'
        """
        require(robot, Robot, "robot", "truepose.load(name)")
        if isinstance(law, Controller):
            rest = law
        else:
            rest = cls(law=usual(robot) if law is None else law, period=period, damping=0.55)
        like = usual(robot) if callable(rest.law) else rest.law
        require_sensors(robot, like)
        return cast(Self, choose_gains(robot, like, effects or Effects(), rest))

    def settings(self, robot: Robot, x: ArrayLike) -> _core.ControlSettings:
        """Return the core's settings, with the gains placed at the pose x."""
        law = "joint" if callable(self.law) else self.law
        require_sensors(robot, law)
        settings = _core.ControlSettings()
        settings.law = _core.laws[law].law
        settings.gains = getattr(_core.Gains, self.gains)
        settings.feed_forward = getattr(_core.FeedForward, self.feed_forward)
        for name in ("period", "velocity_bandwidth", "damped_below", "sigma_scale"):
            setattr(settings, name, getattr(self, name))
        place = as_row(robot, x, "x")
        status, _ = settings.place_poles(robot.core, place, self.frequency, self.damping)
        if status:
            raise PoseError(
                f"{robot.name}: gains at x = {place.tolist()}: {_core.describe(status)}"
            )
        settings.ki = [self.integral * kp for kp in settings.kp]
        return settings


def law_name(law: Any) -> str:
    """Return the name of a law, or of the function that is one."""
    return law if isinstance(law, str) else getattr(law, "__name__", type(law).__name__)


def warn_if_for_rigid(
    robot: Robot, controller: Controller, effects: Effects | None, stacklevel: int = 3
) -> None:
    """Warn if compliant arms or rods meet the default gains, or faster ones, of rigid robots."""
    usual = ControllerSettings()
    names = ("frequency", "damping", "velocity_bandwidth")
    fast = all(getattr(controller, name) >= getattr(usual, name) for name in names)
    if fast and effects is not None and (effects.arm_stiffness or effects.rod_stiffness):
        warnings.warn(
            f"{robot.name}: gains of {controller.frequency:g} rad/s are for rigid robots, and may "
            "be unstable with these effects: take truepose.Controller.for_robot(robot, effects)",
            stacklevel=stacklevel,
        )


def require_same_readings(robot: Robot, truth: Robot) -> None:
    """Raise InputError unless the controller's and the true robot have the same readings."""
    for one, name in ((robot, "robot"), (truth, "truth")):
        require(one, Robot, name, "truepose.load(name)")
    if (robot.spec.mobility, robot.sensors) != (truth.spec.mobility, truth.sensors):
        raise InputError(f"{robot!r} and {truth!r} must have the same mobility and sensors")
