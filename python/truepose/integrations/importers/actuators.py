"""Torque limit and rotor inertia of a joint's actuators."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np


def torque_limit(model: Any, joint: int, actuators: Sequence[int]) -> float:
    """Return the most that its actuators give a joint, either way, N·m or N; maybe infinity.

    An actuator's force is clamped before its gear; a joint's range is of the sum at the joint.
    """
    most = sum(_most(model, k) for k in actuators) if actuators else math.inf
    if model.jnt_actfrclimited[joint]:
        most = min(most, _larger(model.jnt_actfrcrange[joint]))
    return most


def _most(model: Any, k: int) -> float:
    """Return the most that an actuator gives, behind its gear."""
    most = _larger(model.actuator_forcerange[k]) if model.actuator_forcelimited[k] else math.inf
    # A servo's control is a position or a speed; a motor's is its force but for a gain: its gain
    # is fixed (0), it has no bias (0) and no dynamics (0).
    plain = not (model.actuator_gaintype[k] or model.actuator_biastype[k])
    control = model.actuator_ctrladr[k]
    if plain and not model.actuator_dyntype[k] and model.actuator_ctrllimited[control]:
        asked = _larger(model.actuator_ctrlrange[control])
        most = min(most, asked * abs(float(model.actuator_gainprm[k, 0])))
    return most * abs(float(model.actuator_gear[k, 0]))


def _larger(range_: Any) -> float:
    return float(np.abs(range_).max())


def armature(model: Any, joint: int, actuators: Sequence[int]) -> float:
    """Return what spins in a joint's drive, felt at the joint, kg·m² or kg."""
    own = float(model.dof_armature[model.jnt_dofadr[joint]])
    return own + sum(
        float(model.actuator_gear[k, 0] ** 2 * model.actuator_armature[k]) for k in actuators
    )
