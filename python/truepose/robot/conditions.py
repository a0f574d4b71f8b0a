"""Uncertain conditions at work, payload, heat and wear, and their effect on readings and geometry.

Each has one amount a with mean and σ; at a fixed pose readings change by ∂q_e/∂a · (a - mean). The
model has the middle of each range. Self-calibration takes place there: it removes nothing of them.
The ambient temperature of a reference pose is that of the work after it, so that this pose shows
its part; payload, temperature gradients and wear appear after it.
"""

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from truepose import _core
from truepose.arguments import Array, finite_rows
from truepose.exceptions import InputError
from truepose.robot import compliance
from truepose.robot.compliance import under_load
from truepose.robot.description import Description
from truepose.robot.kinematics import Kinematics
from truepose.robot.units import rounded
from truepose.robotfile import to_core
from truepose.robotfile.schema import Conditions
from truepose.show import number

AnyRobot = TypeVar("AnyRobot", bound=Kinematics)

#: When readings are taken: at work, at the reference pose, or in a calibration.
When = Literal["work", "reference", "calibration"]
#: Lever of a unit payload in the derivatives by its centre, m.
_LEVER = 0.01
#: Largest strain of a chain's rods, and turn of an arm, rad, of the model of small deflections.
STRAIN, TURN = 0.01, 0.1
#: Part whose growth moves a point of a chain or a sensor, or a bar's hinge.
_CARRIERS = {"base": "base", "origin": "base"}
_CARRIERS |= dict.fromkeys(("anchor", "pivot", "target"), "platform")


class Condition(NamedTuple):
    """An uncertain condition."""

    name: str  #: its key in [conditions], and the part or direction
    sigma: float
    unit: str
    uniform: bool = False  #: whether it is a range

    @property
    def source(self) -> str:
        """Its key in [conditions]."""
        return self.name.partition(".")[0]


def lengths(robot: Description) -> dict[str, dict[str, float]]:
    """Return what a part's relative growth by 1 adds to parameters, by part: base, arm1, rod1, ….

    The base or their mounting carries the origins of sensors, the platform their targets. The
    encoder of a leg grows with it: it reads less.
    """
    result: dict[str, dict[str, float]] = {}
    chains = enumerate(robot.spec.chain, 1)
    section, carriers = robot.spec.conditions, dict(_CARRIERS)
    if section and section.mounting_expansion is not None:
        carriers["origin"] = "mounting"
    legs = {f"chain{i}.gain" for i, chain in chains if chain.actuator == "telescopic"}
    for name, p in robot.parameters.items():
        part, key = name.split(".")[:2]
        number = part.removeprefix("chain")
        if name in legs:
            result.setdefault(f"rod{number}", {})[name] = -p.value
        elif key in ("arm", "rod"):
            result.setdefault(f"{key}{number}", {})[name] = p.value
        elif key in carriers and not part.startswith("axis"):
            result.setdefault(carriers[key], {})[name] = p.value
    return result


def known(robot: Description) -> list[Condition]:
    """Return the uncertain conditions at work.

    Raises
    ------
    InputError
        A payload, but nothing that it deflects.
    """
    section = robot.spec.conditions
    if section is None:
        return []
    found = [Condition("temperature", _spread(section.temperature), "K", uniform=True)]
    found.append(Condition("warm_up", section.warm_up, "K"))
    found += [Condition(f"gradient.{part}", section.gradient, "K") for part in lengths(robot)]
    found += [Condition(f"wear.{name}", section.wear, "m") for name in _worn(robot)]
    if section.heaviest > 0:
        if not _yielding(robot).any() and not compliance.unknown(robot):
            raise InputError(
                f"{robot.name}: payload up to {section.heaviest:g} kg: rods and arms are stiff: "
                "state all_chains (1/N) or all_arms (rad/(N·m)) of [compliance], or "
                "chain_compliance or arm_compliance of [conditions]"
            )
        sigma = math.hypot(_spread(section.payload), section.payload_sigma)
        found.append(Condition("payload", sigma, "kg", uniform=not section.payload_sigma))
        off = section.payload_centre_sigma
        found += [Condition(f"payload_centre.{axis}", off, "m") for axis in "xyz"]
    return [one for one in found if one.sigma > 0]


def sigmas(robot: Description) -> Array:
    """Return σ of the uncertain conditions, (k,)."""
    return np.array([one.sigma for one in known(robot)])


def columns(robot: Kinematics, x: Array, full: bool, when: When = "work") -> Array:
    """Return ∂(readings)/∂(amounts) of the uncertain conditions at poses, (N, n + r, k).

    NaN where a pose cannot be reached.

    Raises
    ------
    InputError
        A motor cannot hold the largest payload there, or its deflections are not small.
    """
    names = [one.name for one in known(robot)]
    result = np.zeros((len(x), robot.m + robot.r, len(names)))
    if when == "calibration" or not names or not len(x):
        return result
    moves, H_xi = _moves(robot), robot.linearize(x, "nan", "full" if full else "ideal")[1]
    loaded: dict[str, Array] = {}
    if when == "work" and (section := robot.spec.conditions) and section.heaviest > 0:
        regular = x[finite_rows(H_xi)]
        require_torques(robot, section, x)
        require_small(robot, regular, full)
        loaded = _by_payload(robot, x, full, section)
    for k, name in enumerate(names):
        if when == "work" or name == "temperature":
            result[..., k] = H_xi @ moves[name] if name in moves else loaded[name]
    return result


def directions(robot: Kinematics) -> dict[str, Array]:
    """Return what 1σ of each uncertain condition adds to the geometry, (p,), by its name.

    A payload's deflection counts as at home, where it turns or shifts the readings.
    """
    every, moves, loaded = list(robot.parameters), _moves(robot), {}
    if (section := robot.spec.conditions) and section.heaviest > 0:
        level = robot.highest_level
        loaded = _by_payload(robot, robot.home[None], robot.is_full(level), section)
        shifts = [every.index(offset) for offset in reading_offsets(robot)]
        slope = robot.linearize(robot.home, level=level)[1][:, shifts].diagonal()
    result = {}
    for name, sigma, *_ in known(robot):
        if name in loaded:
            moves[name] = np.zeros(len(every))
            moves[name][shifts] = loaded[name][0] / slope
        result[name] = sigma * moves[name]
    return result


def acting(robot: Kinematics, x: Array, full: bool, when: When = "work") -> Array | None:
    """Return columns of uncertain compliances, then of conditions, as the core's bounds take them.

    None without any.
    """
    by = columns(robot, x, full, when)
    if names := compliance.unknown(robot):
        own = under_load(robot, x, full).by_compliance
        by = np.concatenate([compliance.columns(robot, names, own), by], axis=2)
    N, width, k = by.shape
    return by.reshape(N, width * k) if k else None


def together(robot: Kinematics, full: bool, poses: dict[When, Array]) -> Array | None:
    """Return :func:`acting` of readings taken at different times."""
    parts = [acting(robot, x, full, when) for when, x in poses.items()]
    return None if parts[0] is None else np.concatenate([p for p in parts if p is not None])


def under(robot: AnyRobot, amounts: Mapping[str, float]) -> AnyRobot:
    """Return the robot under certain conditions: amounts less their means, by name."""
    section = robot.spec.conditions or Conditions()
    every = np.array([p.value for p in robot.parameters.values()])
    for name, by in _moves(robot).items():
        every = every + amounts.get(name, 0.0) * by
    mass = abs(sum(section.payload) / 2 + amounts.get("payload", 0.0))
    off = [amounts.get(f"payload_centre.{axis}", 0.0) for axis in "xyz"]
    centre = tuple((np.array(section.payload_centre) + off).tolist())
    held = section.model_copy(update={"payload": (mass, mass), "payload_centre": centre})
    warm = robot.replace(dict(zip(robot.parameters, every.tolist(), strict=True)))
    return warm.with_file(conditions=held)


def sampled(robot: AnyRobot, seed: int | np.random.SeedSequence) -> tuple[AnyRobot, AnyRobot]:
    """Return a true robot at the reference pose, and at work, under sampled conditions."""
    rng, amounts = np.random.default_rng(seed), {}
    for one in known(robot):
        half = math.sqrt(3) * one.sigma
        amounts[one.name] = rng.uniform(-half, half) if one.uniform else rng.normal(scale=one.sigma)
    common = {name: a for name, a in amounts.items() if name == "temperature"}
    return under(robot, common), under(robot, amounts)


def require_torques(robot: Kinematics, section: Conditions, x: Array) -> None:
    """Raise InputError where a motor cannot hold the largest payload at rest."""
    limits = robot.torque_limit
    middle, high = sum(section.payload) / 2, section.heaviest
    rest, loaded = np.zeros_like(x), _with(robot, 1.0, section.payload_centre)
    held, more = (_core.inverse_dynamics(c, x, rest, rest)[0] for c in (robot.core, loaded))
    more = more - held
    with np.errstate(divide="ignore", invalid="ignore"):
        room = (limits - np.sign(more) * held) / np.abs(more) + middle
    room = np.where(np.isfinite(room), room, np.inf)
    if (most := room.min()) < high:
        k, motor = np.unravel_index(room.argmin(), room.shape)
        needed = held[k, motor] + (high - middle) * more[k, motor]
        unit = "N·m" if robot.spec.chain[motor].actuator == "revolute" else "N"
        raise InputError(
            f"{robot.name}: payload {high:g} kg: motor q{motor + 1} needs "
            f"{rounded(abs(needed), math.ceil)} {unit} at rest at {_pose(x[k])}, "
            f"torque_limit is {limits[motor]:g} {unit}: it holds "
            + (f"{rounded(most, math.floor)} kg" if most > 0 else "no payload")
        )


def require_small(robot: Kinematics, x: Array, full: bool) -> None:
    """Raise InputError unless deflections under the largest payload at reachable poses are small.

    Linearized models hold for small deflections only; large ones move a pose out of reach.
    """
    given, n = _yielding(robot), robot.m
    if not given.any() or not len(x):
        return
    section = robot.spec.conditions or Conditions()
    high = section.heaviest
    core = _with(robot, high - sum(section.payload) / 2, section.payload_centre)
    at = under_load(robot, x, full, core, compliance=given)
    if not (reached := finite_rows(at.readings)).all():  # the ideal level says how far
        at = under_load(robot, x, False, core, compliance=given)
    strain = np.abs(at.tension * given[:n])
    turn = np.abs(at.by_compliance[:, range(n), range(n, 2 * n)] * given[n:])
    share = np.hstack([strain / STRAIN, turn / TURN])
    reached &= finite_rows(share)
    largest = np.nan_to_num(share, nan=0.0)
    k, part = np.unravel_index(largest.argmax(), share.shape)
    if largest.max() <= 1:
        if reached.all():
            return
        k, said = reached.argmin(), "deflections move the robot out of reach"
    elif part < n:
        said = f"the rods of chain {part + 1} stretch by {number(100 * strain[k, part])} %, "
        said += f"must be at most {100 * STRAIN:g} %: is compliance (1/N) a stiffness?"
    else:
        said = f"arm {part - n + 1} turns by {number(turn[k, part - n])} rad, "
        said += f"must be at most {TURN:g} rad: is arm compliance (rad/(N·m)) a stiffness?"
    under = f"payload {high:g} kg" if high > 0 else "its weight and load"
    raise InputError(f"{robot.name}: {under} at {_pose(x[k])}: {said}")


def _pose(x: Array) -> str:
    return f"({', '.join(f'{v:.4g}' for v in x)})"


def _by_payload(robot: Kinematics, x: Array, full: bool, section: Conditions) -> dict[str, Array]:
    """Return the derivatives of the readings by the payload's mass and centre, (N, n + r)."""
    given = _yielding(robot)
    usual = under_load(robot, x, full, compliance=given).readings

    def by_one(off: Array) -> Array:
        loaded = _with(robot, 1.0, np.array(section.payload_centre) + off)
        return under_load(robot, x, full, loaded, compliance=given).readings - usual

    result = {"payload": by_one(np.zeros(3))}
    if not section.payload_centre_sigma:
        return result
    low, high = section.payload
    rms = math.sqrt((low * low + low * high + high * high) / 3 + section.payload_sigma**2)
    for axis, step in zip("xyz", _LEVER * np.eye(3), strict=True):
        result[f"payload_centre.{axis}"] = rms * (by_one(step) - result["payload"]) / _LEVER
    return result


def _yielding(robot: Description) -> Array:
    """Return the compliances under a payload, (2 m,): the robot's, else of its [conditions]."""
    given, section = compliance.of_all(robot), robot.spec.conditions
    if section and not given.any():
        return np.repeat([section.chain_compliance, section.arm_compliance], robot.m)
    return given


def _with(robot: Kinematics, mass: float, centre: ArrayLike) -> _core.Robot:
    core = robot.core.without_limits()
    to_core.add_body(core, mass, centre)
    core.finish()
    return core


def _growth(robot: Description) -> dict[str, Array]:
    """Return ∂(parameters)/∂(temperature of a part), 1/K times their units, by part."""
    section, every = robot.spec.conditions or Conditions(), list(robot.parameters)
    result = {}
    for part, own in lengths(robot).items():
        rate = getattr(section, f"{part.rstrip('0123456789')}_expansion")
        result[part] = rate * np.array([own.get(name, 0.0) for name in every])
    return result


def reading_offsets(robot: Description) -> list[str]:
    """Return the parameters that shift each reading, (m + r) names."""
    motors = [robot.spec.of_motor(k, "encoder_offset") for k in range(robot.m)]
    return [*motors, *(f"{name}.offset" for name in robot.sensors)]


def _worn(robot: Description) -> list[str]:
    """Return the parameters that wear changes: lengths of rods, and of telescopic legs."""
    legs = {f"chain{i}" for i, c in enumerate(robot.spec.chain, 1) if c.actuator == "telescopic"}
    return [
        name
        for name in robot.parameters
        if (key := name.partition("."))[2] == ("encoder_offset" if key[0] in legs else "rod")
    ]


def _moves(robot: Description) -> dict[str, Array]:
    """Return ∂(parameters)/∂(amount) of heat and wear, by the condition's name."""
    growth, every = _growth(robot), list(robot.parameters)
    moves = dict.fromkeys(("temperature", "warm_up"), np.sum([*growth.values()], axis=0))
    moves |= {f"gradient.{part}": by for part, by in growth.items()}
    return moves | {f"wear.{name}": 1.0 * (np.array(every) == name) for name in _worn(robot)}


def common_growth(robot: Description) -> dict[str, float]:
    """Return what one σ of the ambient temperature adds to the parameters that readings show."""
    section = robot.spec.conditions or Conditions()
    growth = _spread(section.temperature) * np.sum([*_growth(robot).values()], axis=0)
    read = {name for name, _ in to_core.columns(robot.spec)}
    every = zip(robot.parameters, growth.tolist(), strict=True)
    return {name: by for name, by in every if by and name in read}


def _spread(ends: tuple[float, float]) -> float:
    return (ends[1] - ends[0]) / math.sqrt(12)
