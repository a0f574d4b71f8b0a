"""Physical effects that the controller's model omits, with defaults and sources."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from truepose import _core
from truepose.arguments import check_seed, finite
from truepose.exceptions import InputError, choose
from truepose.robot import Robot
from truepose.robotfile.chains import Chain
from truepose.robotfile.schema import Tolerance
from truepose.robotfile.to_core import PAIRED

#: Friction of a motor whose file has none, over its torque limit (assumed).
FRICTION = 0.01


def assumed_friction(chain: Chain) -> float:
    """Return a motor's Coulomb friction, N·m or N: the file's, else `FRICTION`; 0: unknown."""
    return chain.coulomb_friction or FRICTION * (chain.torque_limit or 0)


#: Effects that are switched on and off together.
GROUPS = {
    "backlash": ("tool_backlash",),
    "friction": ("motor_friction", "joint_friction"),
    "compliance": ("arm_stiffness", "rod_stiffness"),
    "thermal": ("warm_up", "base_expansion", "arm_expansion", "rod_expansion"),
    "eccentricity": ("eccentricity",),
    "quantization": ("quantization",),
    "delay": ("delay",),
    "ripple": ("torque_ripple",),
}


@dataclass(frozen=True, kw_only=True)
class Effects:
    """Strengths of the unmodelled effects; 0 switches one off.

    The defaults are assumed, orders of magnitude for a machine of the H4's size, except handbook
    values of the expansions. Groups, for :meth:`only` and :meth:`without`: "backlash", "friction",
    "compliance", "thermal", "eccentricity", "quantization", "delay", "ripple".

    Examples
    --------
    >>> import truepose as tp
    >>> tp.Effects().without("thermal").warm_up, tp.Effects.none().motor_friction
    (0.0, 0.0)
    """

    tool_backlash: float = math.radians(0.1)
    #: rad, whole width at the tool gear, as platform angle (×4 at the tool: 0.4°)
    motor_friction: float = 0.1  #: N·m (N on a slide), Coulomb, of each motor
    joint_friction: float = 0.005  #: N·m, Coulomb friction of each passive joint
    arm_stiffness: float = 2e4
    #: N·m/rad, of each arm about its motor's axis, at the root
    rod_stiffness: float = 5e6  #: N/m, of each rod of a chain, along it
    warm_up: float = 20.0  #: K, rise of temperature
    warm_up_time: float = 7200.0  #: s, which it takes, linearly
    base_expansion: float = 23e-6  #: 1/K, of the base (aluminium)
    arm_expansion: float = 23e-6  #: 1/K, of the arms (aluminium)
    rod_expansion: float = 1e-6  #: 1/K, of the rods (carbon fibre along its layers)
    eccentricity: float = math.radians(0.02)
    #: rad, first harmonic of every rotary encoder's shaft; random phase
    quantization: float = 1.0  #: 1: readings have the file's counts; 0: none
    delay: float = 1.0  #: cycles, from a reading to its torque: 0 or 1
    torque_ripple: float = 0.01  #: of the torque; 6 periods a turn, random phase

    def __post_init__(self) -> None:
        for f in fields(self):
            finite(f.name, getattr(self, f.name), 0)
        for name in ("quantization", "delay"):
            if getattr(self, name) not in (0, 1):
                raise InputError(f"{name} = {getattr(self, name)}: must be 0 or 1")
        if self.warm_up and not self.warm_up_time:
            raise InputError("warm_up_time = 0: must be greater than 0")

    @classmethod
    def groups(cls) -> tuple[str, ...]:
        """Return the names of effects that can be switched on and off."""
        return tuple(GROUPS)

    @classmethod
    def none(cls) -> Effects:
        """Return no effects: the model is exact, readings are unquantized."""
        return cls().without(*cls.groups())

    def without(self, *groups: str) -> Effects:
        """Return a copy with these groups switched off."""
        if not isinstance(self, Effects):
            raise InputError(f"without() needs an object: Effects().without({self!r})")
        for group in groups:
            if group not in GROUPS:
                raise InputError(choose("effect", group, GROUPS))
        return replace(self, **{name: 0.0 for group in groups for name in GROUPS[group]})

    def only(self, *groups: str) -> Effects:
        """Return a copy with all other groups switched off."""
        if not isinstance(self, Effects):
            raise InputError(f"only() needs an object: Effects().only({self!r})")
        self.without(*groups)  # refuses unknown ones
        return self.without(*GROUPS.keys() - set(groups))

    def geometry(self, truth: Robot, time: float = 0.0, seed: int = 0) -> Robot:
        """Return the true robot's geometry some time, s, after a cold start.

        Thermal growth of base, arms and rods; eccentric encoders with phases from `seed`;
        quantization on or off. `truth` is the cold robot.
        """
        finite("time", time, 0, " (s)")
        share = min(1.0, time / self.warm_up_time) if self.warm_up else 0.0
        values = {name: p.value for name, p in truth.parameters.items()}
        grown = {
            name: values[name] + share * gain
            for part in self.growth(truth)
            for name, gain in part.items()
        }
        rng = np.random.default_rng(check_seed(seed))
        for cosine in (name for name in values if name.endswith(".eccentricity.c1")):
            phase = rng.uniform(0, 2 * math.pi)  # one per encoder, used or not
            sine = cosine.removesuffix("c1") + "s1"
            grown[cosine] = values[cosine] + self.eccentricity * math.cos(phase)
            grown[sine] = values[sine] + self.eccentricity * math.sin(phase)
        robot = truth.replace(grown)
        return robot if self.quantization else robot.without_quantization()

    def growth(self, robot: Robot) -> list[dict[str, float]]:
        """Return the growth of base, arms and rods over the whole warm-up, m by parameter.

        Three temperatures, each common to many parameters: divided by √rows, the `drift` of
        :class:`OnlineCalibrator`.

        Examples
        --------
        >>> import truepose as tp
        >>> base, arms, rods = tp.Effects().growth(tp.load("h4"))
        >>> round(arms["chain1.arm"] * 1e6, 1)  # µm
        119.6
        """
        parts = {"base": self.base_expansion, "arm": self.arm_expansion, "rod": self.rod_expansion}
        return [
            {
                name: p.value * rate * self.warm_up
                for name, p in robot.parameters.items()
                if name.startswith("chain") and name.split(".")[1] == part
            }
            for part, rate in parts.items()
        ]

    def allowed_for(self, robot: Robot) -> Robot:
        """Return the robot with tolerances and noise that allow for these effects.

        They keep a calibration from attributing effects to lengths and angles: encoders may be
        eccentric (tolerances of c1 and s1: known amplitude, unknown phase), and angles read through
        a gear are off by up to half its backlash (noise). Warm-up is within most robots'
        tolerances; arms and rods deflect by less than a count.

        Examples
        --------
        >>> import truepose as tp
        >>> h4 = tp.Effects().allowed_for(tp.load("h4"))
        >>> round(h4.parameters["chain1.eccentricity.s1"].sigma * 1e6), h4.spec.sensor[0].noise > 0
        (247, True)
        """
        names = [name for name in robot.parameters if name.endswith((".c1", ".s1"))]
        sigma = self.eccentricity / math.sqrt(2)
        known = {name: Tolerance(sigma=sigma) for name in names} if sigma > 0 else {}
        half = self.tool_backlash / 2
        noisy = robot.with_each("sensor", lambda s: {"noise": math.hypot(s.noise, half * s.geared)})
        return noisy.with_file(tolerances=known | robot.spec.tolerances)

    def plant(self, robot: Robot, seed: int = 0) -> _core.Effects:
        """Return the core's struct for :func:`truepose.simulate`: all effects but geometry.

        A chain's passive joints count at its motor: four for a pair of rods, otherwise two, each
        rotating as far as the motor does.
        """
        core = _core.Effects()
        core.backlash = self.tool_backlash
        joints = 4 if robot.spec.mobility in PAIRED else 2
        friction = self.motor_friction + joints * self.joint_friction
        core.friction = [friction] * robot.m
        core.arm_stiffness, core.rod_stiffness = self.arm_stiffness, self.rod_stiffness
        core.ripple = self.torque_ripple
        rng = np.random.default_rng([check_seed(seed), 1])
        core.phase = rng.uniform(0, 2 * math.pi, 6)
        core.delayed = bool(self.delay)
        return core
