"""A motor and its encoder; a chain of motor, arm and rod."""

from typing import Annotated, Literal, Self, get_args

from pydantic import model_validator

from truepose.robotfile.base import (
    Angle,
    Counts,
    Direction,
    Ends,
    Gain,
    Harmonics,
    Index,
    Joint,
    Length,
    Mass,
    NonNegative,
    Number,
    Positive,
    Section,
    Sigma,
    key,
    not_degrees,
    not_millimetres,
    unit,
)

Actuator = Literal["revolute", "prismatic", "telescopic"]
ACTUATORS: tuple[str, ...] = get_args(Actuator)
#: Actuators of chains that a key is for, where these are not all.
_OF_ACTUATORS = {
    "arm_compliance": ("revolute",),
    "eccentricity": ("revolute",),
    "spool_buildup": ("prismatic", "telescopic"),
    "pair_axis": ("prismatic",),
}


class Drive(Section):
    """A motor and its encoder."""

    encoder_offset: Annotated[Number, unit("rad or m")] = key("reading = gain * q - offset", 0.0)
    gain: Gain = key(
        "of the motor's reading: its encoder's scale, its screw's or belt's pitch over the "
        "nominal one, or -1 for a reading that counts backwards",
        1.0,
    )
    spool_buildup: Annotated[Number, unit("1/m")] = key(
        "of a line that winds in layers on its spool (slides and legs): it is v + "
        "spool_buildup * v² out, v = (reading + offset) / gain; thickness / (4π radius²), "
        "negative where the length grows as the line leaves the spool",
        0.0,
    )
    backlash: Annotated[NonNegative, unit("rad or m")] = key(
        "between encoder and arm, slide or leg, whole width; a reading is off by half of it, "
        "either way",
        0.0,
    )
    encoder_counts: Counts | None = key("per turn, or per m; without it: no counts", None)
    lead: Annotated[Number, unit("m or rad")] | None = key(
        "travel per turn of the motor's shaft, for logs whose column is q1_turns: a "
        "screw's lead, a spool's or pulley's circumference; negative where it turns the other "
        "way",
        None,
    )
    encoder_noise: Sigma = key("σ of a reading", 0.0)
    eccentricity: Harmonics = key(
        "c1, s1, c2, s2: an angle φ reads φ + c1 cos φ + s1 sin φ + c2 cos 2φ + s2 sin 2φ "
        "(revolute)",
        (0, 0, 0, 0),
    )
    limits: Annotated[Ends, unit("rad or m")] | None = key(
        "stops of the motor, lower and upper: its position before the encoder's offset", None
    )
    speed_limit: Annotated[Positive, unit("rad/s or m/s")] | None = key(
        "of the motor, either way; paths that ask for more are refused", None
    )


def check_drive(drive: Drive, actuator: str) -> None:
    """Raise ValueError where a motor has keys that are for others, or limits in degrees or mm."""
    for name, kinds in _OF_ACTUATORS.items():
        field = type(drive).model_fields.get(name)
        if field and getattr(drive, name) != field.default and actuator not in kinds:
            must = f"{' and '.join(kinds)} {'chains' if isinstance(drive, Chain) else 'motors'}"
            raise ValueError(f"'{name}' is for {must}, not {actuator}")
    unlikely = not_degrees if actuator == "revolute" else not_millimetres
    unlikely(drive.limits or (), "limits = ")


class Chain(Drive):
    """One motor, its arm and its rod (a spatial parallelogram counts as one rod)."""

    actuator: Actuator = key("how the motor moves B, the rod's end on its side")
    base: Joint = key("P, a point of the motor's axis")
    axis: Direction = key("u, motor axis or slide direction", (0, 0, 1))
    arm_zero: Direction = key("e, arm's direction at q = 0", (1, 0, 0))
    arm: Length | None = key("l = |PB| (revolute: needed)", None)
    rod: Length | None = key("L = |AB| (not telescopic: needed)", None)
    working_mode: Literal[-1, 1] = key("sign of the entry of J_q", -1)
    anchor: Joint = key("A in the body that carries it")
    bar: Index | None = key("bar that carries A; without it, the platform itself", None)
    rod_spacing: Length = key("between the two rods of a spatial parallelogram; full level", 0.08)
    rod_difference: Annotated[Number, unit("m")] = key(
        "length of the rod on the side of +u less that of the other, m; full level", 0.0
    )
    pair_axis: Direction | None = key(
        "from one rod of a carriage to the other (prismatic); by default across its rail and "
        "its rods at home, if these are not parallel. Rods at the end of an arm lie along u",
        None,
    )
    yaw: Angle = key("turns e and u about z", 0.0)
    tilt: Angle = key("turns u about e", 0.0)
    compliance: Annotated[NonNegative, unit("1/N")] | None = key(
        "strain of its rods, leg or belt per newton of the tension of all its rods together, "
        "1/(EA), beside that of [compliance]",
        None,
    )
    arm_compliance: Annotated[NonNegative, unit("rad/(N·m)")] | None = key(
        "of arm, shaft and gear between encoder and rods, 1/stiffness, beside that of "
        "[compliance] (revolute)",
        None,
    )
    torque_limit: Annotated[Positive, unit("N·m or N")] | None = key("motor's, either way", None)
    drive_inertia: Annotated[NonNegative, unit("kg·m² or kg")] = key(
        "rotor and arm about the motor's axis; of a slide motor and carriage. Of "
        "the nominal arm: the parameter 'arm' does not change it",
        0.0,
    )
    arm_mass: Mass = key("arm, or carriage", 0.0)
    rod_mass: Mass = key("all rods of the chain together", 0.0)
    viscous_friction: Annotated[NonNegative, unit("N·m·s/rad or N·s/m")] = key("of the motor", 0.0)
    coulomb_friction: Annotated[NonNegative, unit("N·m or N")] = key("motor's, at any speed", 0.0)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        turns = self.actuator == "revolute"
        for name, needed in (("arm", turns), ("rod", self.actuator != "telescopic")):
            if needed and getattr(self, name) is None:
                raise ValueError(f"a {self.actuator} chain needs '{name}' (m)")
        check_drive(self, self.actuator)
        lean = sum(a * b for a, b in zip(self.axis, self.arm_zero, strict=True))
        if turns and abs(lean) > 1e-6:
            raise ValueError(f"'arm_zero' must be normal to 'axis'; their product is {lean:.3g}")
        slender = self.arm_mass * (self.arm or 0.0) ** 2 / 3
        least, unit, part = {  # the arm or the carriage that a drive includes
            "revolute": (slender, "kg·m²", "arm_mass · arm²/3 of a slender arm"),
            "prismatic": (self.arm_mass, "kg", "arm_mass of the carriage"),
        }.get(self.actuator, (0.0, "", ""))
        if self.drive_inertia < least * (1 - 1e-9):
            raise ValueError(
                f"drive_inertia = {self.drive_inertia:g} {unit}: must be at least {least:.3g} "
                f"{unit}, the {part}, which is part of it"
            )
        return self
