"""Where avatars look: heads turn towards opponents, within what necks allow."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.body import Body
from crowdsim.take.data import TakeData
from crowdsim.take.kernels.gaze import Gaze, turn_heads
from crowdsim.take.kernels.records import Moments, Posed
from crowdsim.take.motion import PoseMotion, chain_of
from crowdsim.take.window import Window

_SHARES = {"neck": 0.4, "head": 0.6}
"""Shares of a turn."""
_NEAR, _FAR = 6.0, 10.0
"""Distance up to which avatars look at opponents, and from which they do not [m]."""
_SPREAD = 4
"""Control frames before and after over which a direction is averaged, so that a new opponent turns no head at once."""


def face_direction(body: Body) -> Array:
    """Return where a body's face looks, in the frame of the head's joint. Shape (3,)."""
    return _ahead(body, np.asarray(body.head_offset, dtype=float))


def build_gaze(motion: PoseMotion) -> Gaze:
    """Return what a body looks with."""
    body, skeleton = motion.body, motion.skeleton
    chest, head = body.roles["chest"], body.roles["head"]
    chain = chain_of(skeleton, [head, chest])
    shares = np.zeros(len(chain))
    for role, part in _SHARES.items():
        shares[chain == body.roles[role]] += part
    towards_neck = np.asarray(skeleton.offsets[body.roles["neck"]], dtype=float)
    parents = np.asarray(skeleton.parents, dtype=np.int64)
    return Gaze(parents, chain, shares, chest, head, face_direction(body), _ahead(body, towards_neck))


def directions(take: TakeData, first: int, stop: int) -> Array:
    """Return where all avatars look at control frames, x and z; shorter where they look less. Shape (T, N, 2)."""
    low, high = max(first - _SPREAD, 0), min(stop + _SPREAD, take.frame_count)
    x, z = (np.asarray(values[low:high], dtype=float) for values in (take.x, take.z))
    whom, there = np.asarray(take.opponent[low:high]), np.asarray(take.action[low:high]) >= 0
    rows = np.arange(len(x))[:, None]
    seen = np.stack([x[rows, np.maximum(whom, 0)], z[rows, np.maximum(whom, 0)]], axis=-1)
    known = (whom >= 0) & there[rows, np.maximum(whom, 0)]
    if len(take.target_names):
        targets = np.asarray(take.targets[low:high], dtype=float)[..., [0, 2]]
        scripted = whom < -1
        seen = np.where(scripted[..., None], targets[rows, np.maximum(-2 - whom, 0)], seen)
        known |= scripted
    towards = seen - np.stack([x, z], axis=-1)
    far = np.linalg.norm(towards, axis=-1)
    known &= there & (far > 1e-6)
    weights = np.clip((_FAR - far) / (_FAR - _NEAR), 0.0, 1.0)
    # Where nothing is known, positions may be no numbers.
    towards = np.where(known[..., None], towards * (weights / np.maximum(far, 1e-6))[..., None], 0.0)
    return _averaged(towards, first - low, stop - low)


def _averaged(values: Array, first: int, stop: int) -> Array:
    """Return rows ``first`` to ``stop`` of values (R, n, 2), averaged over those around them; ends repeat."""
    rows, total = np.arange(first, stop), np.zeros((stop - first, *values.shape[1:]))
    for away in range(-_SPREAD, _SPREAD + 1):
        weight = (1.0 + np.cos(np.pi * away / (_SPREAD + 1))) / (2.0 * (_SPREAD + 1))
        total += weight * values[np.clip(rows + away, 0, len(values) - 1)]
    return total


def look(window: Window, gaze: Gaze, moments: Moments, poses: Posed) -> None:
    """Turn heads towards opponents, in place.

    Args:
        window: The stretch of the take.
        gaze: What bodies look with.
        moments: Who is posed, and when.
        poses: Their poses; rotations are changed.
    """
    share(len(moments.columns), turn_heads, moments, window.rows, gaze, poses, threads=window.threads)


def _ahead(body: Body, up: Array) -> Array:
    """Where the feet point, at right angles to ``up``. Shape (3,)."""
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    ahead = np.asarray(body.sole_offsets[:, 1] - body.sole_offsets[:, 0], dtype=float).sum(axis=0)
    ahead = ahead - up * float(ahead @ up)
    length = float(np.linalg.norm(ahead))
    return np.asarray(ahead / length) if length > 1e-9 else np.array([0.0, 0.0, 1.0])
