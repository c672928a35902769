"""Heads turn towards opponents, within what necks allow, at each control frame of a take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import correlate1d

from crowdsim.core.easing import ease
from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.ground import wrap
from crowdsim.take.data import TakeData
from crowdsim.take.kernels.gaze import Gaze, turn_heads
from crowdsim.take.kernels.records import Moments, Posed
from crowdsim.take.limbs import chain_of
from crowdsim.take.motion import PoseMotion
from crowdsim.take.window import Window

_SHARES = {"neck": 0.4, "head": 0.6}
"""Shares of a turn."""
_NEAR, _FAR = 6.0, 10.0
"""Distance up to which avatars look at opponents, and from which they do not [m]."""
_SPREAD = 4
"""Control frames before and after over which a turn is averaged, so that a new opponent turns no head at once."""
_SMOOTH = np.hanning(2 * _SPREAD + 3)[1:-1] / (_SPREAD + 1)
"""Weights of that average."""
MOST, _SOFT = np.deg2rad(75.0), np.deg2rad(30.0)
"""Angle between chest and head about the vertical up to which heads are turned, and range over which they ease into it
[rad]."""
_FREE = np.deg2rad(8.0)
"""Angle off the opponent that heads keep from the motion [rad]."""
_BEHIND = np.deg2rad(120.0)
"""Range, up to straight behind, over which heads stop following: there they would have to choose a side [rad]."""


def build_gaze(motion: PoseMotion) -> Gaze:
    """Return what a body looks with."""
    roles, skeleton = motion.body.roles, motion.skeleton
    chain = chain_of(skeleton, [roles["head"]])
    shares = np.zeros(len(chain))
    for role, part in _SHARES.items():
        shares[chain == roles[role]] += part
    return Gaze(np.asarray(skeleton.parents, dtype=np.int64), chain, shares)


class HeadTurns:
    """How far heads turn.

    Args:
        take: The take.
        motions: The motion of each of its policies.
    """

    def __init__(self, take: TakeData, motions: Sequence[PoseMotion]) -> None:
        self._take, self._motions = take, motions

    def find(self, first: int, stop: int) -> Array:
        """Return how far all avatars' heads turn about the vertical at control frames [rad]. Shape (T, N, 1)."""
        take = self._take
        low, high = max(first - _SPREAD, 0), min(stop + _SPREAD, take.frame_count)
        ways = _ways(take, low, high)
        sizes = np.linalg.norm(ways, axis=-1)
        action, done = np.asarray(take.action[low:high]), np.asarray(take.action_frame[low:high], dtype=float)
        heading, turns = np.asarray(take.heading[low:high], dtype=float), np.zeros(action.shape)
        for index, motion in enumerate(self._motions):
            here = (action >= 0) & (take.cast.policies == index) & (sizes > 0.0)
            way, frames = ways[here], motion.frames_at(action[here], done[here])
            face, chest = motion.looks[frames].astype(float).T
            error = wrap(np.arctan2(way[:, 0], way[:, 1]) - heading[here] - face)
            follows = sizes[here] * ease((np.pi - np.abs(error)) / _BEHIND)
            turned = wrap(face - chest)
            error = follows * (error - _FREE * np.tanh(error / _FREE))
            # A head that the motion itself turns further stays as it is.
            turns[here] = np.where(motion.down[frames], 0.0, _kept(turned + error) - _kept(turned))
        # Where a take begins and ends, its first and its last frame stand for those beyond.
        return correlate1d(turns, _SMOOTH, axis=0, mode="nearest")[first - low : stop - low, :, None]


def _ways(take: TakeData, first: int, stop: int) -> Array:
    """Directions to opponents at control frames, x and z; shorter where they are far away. Shape (T, N, 2)."""
    x, z = (np.asarray(values[first:stop], dtype=float) for values in (take.x, take.z))
    whom, there = np.asarray(take.opponent[first:stop]), np.asarray(take.action[first:stop]) >= 0
    rows = np.arange(len(x))[:, None]
    seen = np.stack([x[rows, np.maximum(whom, 0)], z[rows, np.maximum(whom, 0)]], axis=-1)
    known = (whom >= 0) & there[rows, np.maximum(whom, 0)]
    if len(take.target_names):
        targets = np.asarray(take.targets[first:stop], dtype=float)[..., [0, 2]]
        scripted = whom < -1
        seen = np.where(scripted[..., None], targets[rows, np.maximum(-2 - whom, 0)], seen)
        known |= scripted
    towards = seen - np.stack([x, z], axis=-1)
    far = np.linalg.norm(towards, axis=-1)
    known &= there & (far > 1e-6)
    weights = np.clip((_FAR - far) / (_FAR - _NEAR), 0.0, 1.0)
    # Where nothing is known, positions may be no numbers.
    return np.where(known[..., None], towards * (weights / np.maximum(far, 1e-6))[..., None], 0.0)


def _kept(angles: Array) -> Array:
    """The parts of angles that lie within ``MOST``, smoothly."""
    size, free = np.abs(angles), MOST - _SOFT
    return np.where(size <= free, angles, np.copysign(free + _SOFT * np.tanh((size - free) / _SOFT), angles))


def look(window: Window, gaze: Gaze, moments: Moments, poses: Posed) -> None:
    """Turn heads towards opponents, in place.

    Args:
        window: The stretch of the take.
        gaze: What bodies look with.
        moments: Who is posed, and when.
        poses: Their poses; rotations are changed.
    """
    share(len(moments.columns), turn_heads, moments, window.rows, gaze, poses, threads=window.threads)
