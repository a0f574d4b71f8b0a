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
        most = min(most, np.abs(model.jnt_actfrcrange[joint]).max())
    return float(most)


def _most(model: Any, k: int) -> float:
    """Return the largest force or torque of an actuator after its gear."""
    limited, control = model.actuator_forcelimited[k], model.actuator_ctrladr[k]
    most = np.abs(model.actuator_forcerange[k]).max() if limited else math.inf
    # A servo's control is a position or speed. A motor's is its force up to a gain: fixed gain (0),
    # no bias (0), no dynamics (0).
    kinds = model.actuator_gaintype[k], model.actuator_biastype[k], model.actuator_dyntype[k]
    if not any(kinds) and model.actuator_ctrllimited[control]:
        asked = np.abs(model.actuator_ctrlrange[control]).max()
        most = min(most, asked * abs(model.actuator_gainprm[k, 0]))
    return most * abs(model.actuator_gear[k, 0])


def armature(model: Any, joint: int, actuators: Sequence[int]) -> float:
    """Return the inertia of a joint's drive, reflected to the joint, kg·m² or kg."""
    gear, rotor = model.actuator_gear[actuators, 0], model.actuator_armature[actuators]
    return float(model.dof_armature[model.jnt_dofadr[joint]] + np.sum(gear**2 * rotor))
