"""Kicks found in unlabelled motion: a foot that swings out from the foot on the floor, high, with the leg stretched."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.swings import Swing
from crowdsim.motion.tracks import Tracks, speeds

MINIMUM_KICK_SPEED = 3.5
"""Lowest speed of a kicking foot relative to the pelvis, for a body of ``HEIGHT`` [m/s]."""
_GAIN = 0.35
"""How much further from the other foot than before the swing a kicking foot must get, for ``HEIGHT`` [m]."""
_LIFT, _LIFT_BEHIND = 0.5, 0.8
"""How far above the other foot it must be then, and where it is behind the body, for ``HEIGHT`` [m]: steps and jogs
stay below 0.4 m, a sprinter's foot swings up to 0.6 m behind, and in a jump both feet are raised."""
_BEHIND = -0.5
"""Cosine of the angle between the direction to the foot and that in which the body faces, below which it is behind."""
_STRETCHED = 0.7
"""How far from the pelvis it must be then, for ``HEIGHT`` [m]: 0.8 m or more in kicks, under 0.5 m where a knee is
lifted or a heel swings up behind in a run."""
_UPRIGHT = 0.1
"""How far above the pelvis the head must be, for ``HEIGHT`` [m]: feet of a body that falls, rolls or turns over are no
kicks."""


def foot_speed(tracks: Tracks, foot: int, fps: float) -> Array:
    """Return the speed of a foot relative to the pelvis, smoothed as strikes are found in it [m/s]. Shape (F,)."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(speeds(tracks.feet[:, foot] - tracks.pelvises, fps), 0.01 * fps))


def foot_swing(tracks: Tracks, foot: int, size: float, fps: float) -> Swing:
    """Return what a foot does; it reaches out from the other foot, which is most often the one on the floor.

    Args:
        tracks: Paths of the body's points.
        foot: 0 left, 1 right.
        size: Height of the body over ``HEIGHT``.
        fps: Frames a second.
    """
    from scipy.ndimage import gaussian_filter1d

    mine, other = tracks.feet[:, foot], tracks.feet[:, 1 - foot]
    heading, out = tracks.ground[:, 2], mine - tracks.pelvises
    ahead = out[:, 0] * np.sin(heading) + out[:, 2] * np.cos(heading)
    behind = ahead < _BEHIND * np.hypot(out[:, 0], out[:, 2])
    raised = mine[:, 1] - other[:, 1] > np.where(behind, _LIFT_BEHIND, _LIFT) * size
    raised &= tracks.heads[:, 1] - tracks.pelvises[:, 1] > _UPRIGHT * size
    return Swing(
        speed=foot_speed(tracks, foot, fps),
        reach=gaussian_filter1d(np.linalg.norm(mine - other, axis=1), 0.01 * fps),
        least_speed=MINIMUM_KICK_SPEED * size,
        least_gain=_GAIN * size,
        raised=raised,
        stretched=np.linalg.norm(out, axis=1) > _STRETCHED * size,
        opposite=np.ones(len(mine), bool),
        near=np.inf,
        ahead=np.zeros(len(mine)),
    )
