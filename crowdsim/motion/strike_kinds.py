"""Kinds of strikes by what strikes, of punches by the path of the fist; and whether they go to the head or the body."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.strikers import GROUPS
from crowdsim.motion.tracks import Tracks, build_tracks

KINDS = ("straight", "hook", "uppercut", "kick", "elbow", "knee", "prop", "head")
_OTHERS = {"feet": "kick", "elbows": "elbow", "knees": "knee", "props": "prop", "head": "head"}
HEIGHTS = ("head", "body")

_OUTWARD = 0.8
"""Cosine between a fist's velocity and its direction from the shoulder, from which a strike is straight.

The fist of a hook or an uppercut moves about the shoulder instead.
"""
_STRETCHED = 0.85
"""Share of its length to which an arm is stretched at the furthest reach of a strike that is straight."""
_UPWARD = 0.42
"""Share of the fist's path that is upward, from which a strike that is not straight is an uppercut."""
_BEFORE = 0.05
"""Time before the fist's highest speed at which its path begins [s]."""


def strike_kinds(database: MotionDatabase) -> Array:
    """Return the kind of each strike, as numbers of ``KINDS``. Shape (S,), uint8.

    A strike is straight where the fist, at its highest speed, moves away from the shoulder, and the arm ends stretched.
    Else it is an uppercut where the fist's path to its furthest reach climbs, and a hook where it does not. Motion is
    relative to the pelvis. Strikes of feet are kicks, others are what strikes.
    """
    rate = database.playback_rate
    frames, peaks = (np.asarray(one, dtype=np.int64) for one in (database.strike_frames, database.strike_peaks))
    starts = np.asarray(database.clip_starts, dtype=np.int64) * database.stride
    clips = np.searchsorted(starts, frames, side="right") - 1
    first, last = starts[clips], starts[clips + 1] - 1
    step = max(1, round(rate / 60.0))
    at_peak, _ = _pose(database, peaks)
    limbs = np.asarray(database.strike_limbs, dtype=np.int64)
    hands = limbs % 2
    which = np.arange(len(frames)), hands
    velocity = _fists(database, np.minimum(peaks + step, last), hands)
    velocity -= _fists(database, np.maximum(peaks - step, first), hands)
    outward = _cosine(velocity, at_peak.fists[which] - at_peak.shoulders[which])
    way = _fists(database, frames, hands) - _fists(database, np.maximum(peaks - round(_BEFORE * rate), first), hands)
    upward = _cosine(way, np.array([0.0, 1.0, 0.0]))
    straight = (outward > _OUTWARD) & (_stretch(database, frames, hands) > _STRETCHED)
    kinds = np.where(straight, 0, np.where(upward > _UPWARD, 2, 1))
    for group, kind in _OTHERS.items():
        kinds[np.isin(limbs, GROUPS[group])] = KINDS.index(kind)
    return kinds.astype(np.uint8)


def strike_heights(database: MotionDatabase) -> Array:
    """Return where each strike goes, as numbers of ``HEIGHTS``: to the head from the neck's height on. (S,), uint8."""
    necks = np.asarray(database.necks)[np.asarray(database.strike_frames, dtype=np.int64), 1]
    return (np.asarray(database.strike_positions)[:, 1] < necks).astype(np.uint8)


def _pose(database: MotionDatabase, frames: Array) -> tuple[Tracks, Array]:
    """Return the points of the body in some playback frames, and positions of its joints [m]. Shape (S, J, 3)."""
    roots = np.asarray(database.root_positions, dtype=float)[frames]
    rotations = np.asarray(database.rotations, dtype=float)[frames]
    positions, joint_rotations = forward_kinematics(database.skeleton, roots, rotations)
    return build_tracks(database.body, positions, joint_rotations), positions


def _fists(database: MotionDatabase, frames: Array, hands: Array) -> Array:
    """Return the striking fists in some playback frames, relative to the pelvis [m]. Shape (S, 3)."""
    tracks, _ = _pose(database, frames)
    return np.asarray(tracks.fists[np.arange(len(frames)), hands] - tracks.pelvises)


def _stretch(database: MotionDatabase, frames: Array, hands: Array) -> Array:
    """Return to what share of their length striking arms are stretched in some playback frames. Shape (S,)."""
    tracks, positions = _pose(database, frames)
    which, roles = np.arange(len(frames)), database.body.roles
    elbows = positions[which, np.array([roles["left_elbow"], roles["right_elbow"]])[hands]]
    fists, shoulders = tracks.fists[which, hands], tracks.shoulders[which, hands]
    lengths = np.linalg.norm(elbows - shoulders, axis=-1) + np.linalg.norm(fists - elbows, axis=-1)
    return np.asarray(np.linalg.norm(fists - shoulders, axis=-1) / np.maximum(lengths, 1e-9))


def _cosine(a: Array, b: Array) -> Array:
    """Return the cosine of the angles between vectors (S, 3) and others."""
    lengths = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    return np.asarray(np.sum(a * b, axis=-1) / np.maximum(lengths, 1e-12))
