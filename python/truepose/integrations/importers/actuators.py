"""Torque limit and rotor inertia of a joint's actuators."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np


def torque_limit(model: Any, joint: int, actuators: Sequence[int]) -> float:
    """Return the largest force or torque of a joint's actuators, either way, N·m or N, or infinity.

    An actuator's force is clamped before its gear; a joint's range limits the sum at the joint.
    """
    most = sum(_most(model, k) for k in actuators) if actuators else math.inf
    if model.jnt_actfrclimited[joint]:
        most = min(most, _larger(model.jnt_actfrcrange[joint]))
    return most


def _most(model: Any, k: int) -> float:
    """Return the largest force or torque of an actuator after its gear."""
    most = _larger(model.actuator_forcerange[k]) if model.actuator_forcelimited[k] else math.inf
    # A servo's control is a position or speed. A motor's is its force up to a gain: fixed gain (0),
    # no bias (0), no dynamics (0).
    plain = not (model.actuator_gaintype[k] or model.actuator_biastype[k])
    control = model.actuator_ctrladr[k]
    if plain and not model.actuator_dyntype[k] and model.actuator_ctrllimited[control]:
        asked = _larger(model.actuator_ctrlrange[control])
        most = min(most, asked * abs(float(model.actuator_gainprm[k, 0])))
    return most * abs(float(model.actuator_gear[k, 0]))


def _larger(range_: Any) -> float:
    return float(np.abs(range_).max())


def armature(model: Any, joint: int, actuators: Sequence[int]) -> float:
    """Return the inertia of a joint's drive, reflected to the joint, kg·m² or kg."""
    own = float(model.dof_armature[model.jnt_dofadr[joint]])
    return own + sum(
        float(model.actuator_gear[k, 0] ** 2 * model.actuator_armature[k]) for k in actuators
    )
