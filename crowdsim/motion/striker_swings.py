"""Strikes of elbows, knees, heads and props: what each of them does as strikes are found in it."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.strikers import GROUPS, HEAD
from crowdsim.motion.swings import Swing
from crowdsim.motion.tracks import Tracks, speeds

_ELBOW_SPEED, _KNEE_SPEED, _HEAD_SPEED, _PROP_SPEED = 1.8, 2.0, 1.2, 4.0
"""Lowest speed relative to the pelvis of each that strikes, for a body of ``HEIGHT`` [m/s]."""
_ELBOW_GAIN, _KNEE_GAIN, _HEAD_GAIN, _PROP_GAIN = 0.12, 0.3, 0.14, 0.3
"""How much further out than before the swing each must reach, for ``HEIGHT`` [m]."""
_FOLDED = -0.1
"""Greatest cosine of the angle between forearm and upper arm of an elbow that strikes: others are of punches."""
_KNEE_LOW, _FOOT_BELOW = 0.12, 0.15
"""How far below the pelvis a knee may be as it strikes, and how far above its foot it stays [m]: the foot of a kick
goes on."""
_STAYS = 0.2
"""How long a leg stays folded after its knee has struck [s]."""
_UPRIGHT = 0.1
"""How far above the pelvis the head must be, for ``HEIGHT`` [m]."""


def other_swing(tracks: Tracks, limb: int, opposite: tuple[Array, Array], size: float, fps: float) -> Swing:
    """Return what a striker that is neither hand nor foot does.

    Elbows reach out from the pelvis with a folded arm, knees from the other foot with a folded leg, heads ahead of the
    pelvis, and props from the middle between the shoulders, as fists do.

    Args:
        tracks: Paths of the body's points.
        limb: Number of ``LIMBS``.
        opposite: Where it goes to where an opponent could stand, and how far ahead it is [m]; see
            ``strikes.opposite_of``. Shapes (F,).
        size: Height of the body over ``HEIGHT``.
        fps: Frames a second.
    """
    from scipy.ndimage import gaussian_filter1d

    point, side = tracks.strikers[:, limb], limb % 2
    everywhere = np.ones(len(point), bool)
    raised = tracks.heads[:, 1] - tracks.pelvises[:, 1] > _UPRIGHT * size
    stretched, near = everywhere, np.inf
    if limb in GROUPS["elbows"]:
        least_speed, least_gain = _ELBOW_SPEED, _ELBOW_GAIN
        reach = np.linalg.norm(point - tracks.pelvises, axis=1)
        upper, lower = tracks.shoulders[:, side] - point, tracks.fists[:, side] - point
        lengths = np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1)
        stretched = np.sum(upper * lower, axis=1) > -_FOLDED * lengths
    elif limb in GROUPS["knees"]:
        least_speed, least_gain = _KNEE_SPEED, _KNEE_GAIN
        reach = np.linalg.norm(point - tracks.feet[:, 1 - side], axis=1)
        raised &= point[:, 1] > tracks.pelvises[:, 1] - _KNEE_LOW * size
        stretched = _stays(point[:, 1] - tracks.feet[:, side, 1] > _FOOT_BELOW * size, round(_STAYS * fps))
    elif limb == HEAD:
        least_speed, least_gain = _HEAD_SPEED, _HEAD_GAIN
        heading, out = tracks.ground[:, 2], point - tracks.pelvises
        reach = out[:, 0] * np.sin(heading) + out[:, 2] * np.cos(heading)
        opposite = everywhere, opposite[1]
    else:
        least_speed, least_gain = _PROP_SPEED, _PROP_GAIN
        reach = np.linalg.norm(point - tracks.shoulders.mean(axis=1), axis=1)
    return Swing(
        speed=np.asarray(gaussian_filter1d(speeds(point - tracks.pelvises, fps), 0.01 * fps)),
        reach=gaussian_filter1d(reach, 0.01 * fps),
        least_speed=least_speed * size,
        least_gain=least_gain * size,
        raised=raised,
        stretched=stretched,
        opposite=opposite[0],
        near=near,
        ahead=np.zeros(len(point)) if limb == HEAD else opposite[1],
    )


def _stays(held: Array, frames: int) -> Array:
    """Return where something holds for some frames on from each; where the clip ends sooner, to its end. Shape (F,)."""
    padded = np.concatenate([~held, np.zeros(frames, bool)])
    ends = np.concatenate([[0], np.cumsum(padded)])
    return np.asarray(ends[frames + 1 :] == ends[: len(held)])
