"""Settings for a Maslow's firmware: the anchors under which its kinematics errs least.

The firmware knows anchors, one extension and, with pull request #1060, one stiffness of all belts.
It knows neither offsets of single belts nor, without #1060, stretch. The anchors here minimize the
sled's position error over the box of the poses that were read, all belts weighted alike. A common
shift and rotation does not count, since the work's place on the board is arbitrary.
"""

from typing import NamedTuple

import numpy as np

from truepose.arguments import Array, sigmas_of
from truepose.robot import knowledge
from truepose_sleds.belts import Sled, influences

#: Points of the box in each direction.
POINTS = 12
#: Force that tightens the lower belts for a reading, N: default of pull request #1060.
PULL = 156.96
#: Settings that are written; bl is the origin, br on the x axis.
WRITTEN = ("tlX", "tlY", "trX", "trY", "brX")
#: σ by which the zero of a belt changes at each power cycle, m (four cycles of one machine).
ZERO = 0.001


class Anchors(NamedTuple):
    """Anchors for the firmware."""

    values: dict[str, float]  #: of each setting that is written, m
    sigma: dict[str, float]  #: of these over power cycles, m
    error: float  #: rms of the sled's position error that the firmware cannot represent, m
    expected: float  #: the same after another power cycle: with σ of every unknown, m


def best(sled: Sled, stretches: bool, missing: float = 0.0) -> Anchors:
    """Return the best anchors for belts that stretch as for a reading, or are corrected for it.

    `missing` is the extension that the firmware adds to the lengths of this log, m.
    """
    from scipy.optimize import least_squares

    low, high = sled.x.min(axis=0), sled.x.max(axis=0)
    robot, box = sled.fit.robot, np.linspace(low, high, POINTS).T
    x = np.stack(np.meshgrid(*box), axis=-1).reshape(-1, 2)
    lengths = robot.extended_positions(x) + missing + stretches * sled.stretch(x)

    def seen(unknowns: Array) -> tuple[Array, Array]:
        """Return distances of the anchors, and the gain from belts to positions, (N, 2, 4)."""
        corners = np.zeros((4, 2))
        corners[[0, 0, 1, 1, 3], [0, 1, 0, 1, 0]] = unknowns[:5]
        c, s = np.cos(unknowns[7]), np.sin(unknowns[7])
        away = (x @ np.array([[c, s], [-s, c]]) + unknowns[5:7])[:, None] - corners
        distance = np.linalg.norm(away, axis=2)
        return distance, np.linalg.pinv(away / distance[..., None])

    def errors(unknowns: Array) -> Array:
        distance, gain = seen(unknowns)
        return (gain @ (lengths - distance)[..., None]).ravel()

    begun = [of.value for of in sled.anchors.values()]
    answer = least_squares(errors, [*begun, 0.0, 0.0, 0.0])
    names = list(sled.fit.names)
    by = knowledge.linearized(robot, x, names)[1]
    strains = [np.asarray(of.pattern) for of in influences(robot, x, sled.model.tightened)]
    strains += [np.zeros_like(lengths)] * len(sled.slips)
    pulled = np.reshape(strains, (len(strains), *lengths.shape)).transpose(1, 2, 0)
    by = np.concatenate([by, stretches * pulled], axis=2)
    moved = (seen(answer.x)[1] @ by).reshape(2 * len(x), -1)
    zeroed = [name.endswith("offset") for name in names] + [False] * len(strains)
    covariance = sled.fit.joint_covariance + ZERO**2 * np.diag(zeroed)
    to_settings = -np.linalg.pinv(answer.jac)[:5] @ moved
    place = answer.jac[:, 5:]  # shift and rotation of the work
    left = moved - place @ (np.linalg.pinv(place) @ moved)
    error2, unknown2 = 2 * answer.cost / len(x), np.sum((left @ covariance) * left) / len(x)
    return Anchors(
        dict(zip(WRITTEN, answer.x[:5].tolist(), strict=True)),
        dict(zip(WRITTEN, sigmas_of(to_settings @ covariance @ to_settings.T), strict=True)),
        float(np.sqrt(error2)),
        float(np.sqrt(error2 + unknown2)),
    )


def stiffness(sled: Sled, pull: float = PULL) -> float | None:
    """Return the belts' axial stiffness, N, by the lower ones' tension; None without strain."""
    amounts = [
        of.value
        for name, of in sled.fit.influences.items()
        if name.startswith("strain") and "weight" not in name
    ]
    mean = float(np.mean(amounts)) if amounts else 0.0
    return pull / mean if mean > 0 else None
