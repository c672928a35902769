"""How the motion of an action is aligned at its start: with the feet that are planted before and after the transition.

Ground frames lie between the feet, so aligning them would divide the difference between both feet. Where one foot is
about to leave the floor, or has just touched it, it takes the whole difference, and the other foot does not slide.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground, quaternion
from crowdsim.motion.contacts import plant_spans
from crowdsim.motion.kinematics import forward_kinematics

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.motion.database import MotionDatabase


SETTLED = (0.1, 0.72)
"""A planted foot needs no step if it touched the floor within the first time before the transition, or leaves it within
the second after it [s]."""
_UNSURE = 0.15
"""Time over which the second of them sets in [s], since paces differ from the capture's."""
_TRUNK, _FREE, _TURN = 2e-5, 1e-4, 1e-3
"""Weights of hips and shoulders, of a foot that is free to move, and of a foot's heading beside its position; a foot
that stays planted has weight 1, so that it does not slide."""
_ARM = 0.15
"""Lever over which headings of feet count as lengths [m]."""
HARDLY = 0.003
"""Distance so short that a foot needs no step for it [m]."""


class Alignment(NamedTuple):
    """How actions are aligned with the state that they start in; A actions.

    Attributes:
        shifts: Ground frame of the action's motion at its start, in the avatar's ground frame [m, rad]. Shape (A, 3),
            float32.
        steps: Number of feet that need a step, since they are planted before and after but elsewhere: 0 to 2, with
            fractions near the limits of ``SETTLED``. Shape (A,), float32.
    """

    shifts: Array
    steps: Array


def align_actions(database: MotionDatabase, graph: MotionGraph) -> Alignment:
    """Return how the actions of a graph are aligned with their states; captured continuations are not shifted.

    Mirror images of actions have mirrored shifts.
    """
    stride, images = database.stride, graph.action_images(database.captured_frames)
    chosen = np.flatnonzero(graph.action_has_transition[: len(images) or graph.action_count])
    before = graph.state_frames[graph.action_states[chosen]].astype(np.int64) * stride
    after = (np.asarray(graph.action_first, dtype=np.int64)[chosen] - 1) * stride
    shifts, steps = np.zeros((graph.action_count, 3), np.float32), np.zeros(graph.action_count, np.float32)
    if len(chosen):
        shifts[chosen], steps[chosen] = align_transitions(database, before, after)
    shifts[images], steps[images] = shifts[: len(images)] * [-1.0, 1.0, -1.0], steps[: len(images)]
    return Alignment(shifts, steps)


def align_transitions(database: MotionDatabase, before: Array, after: Array) -> Alignment:
    """Return the rotation and shift that bring feet, and a little the trunk, nearest to where they were.

    Weighted least squares, for C transitions. If both feet stay planted, the one that stays longer counts, so that only
    the other steps.

    Args:
        database: The motion.
        before: Playback frame that each transition leaves. Shape (C,).
        after: Playback frame that is aligned with it. Shape (C,).
    """
    since, until = _plant_times(database)
    late = (until[after] - (SETTLED[1] - _UNSURE)) / _UNSURE
    stays = np.clip(late, 0.0, 1.0) * (since[before] > SETTLED[0])
    stays *= np.asarray(database.contacts)[before] & np.asarray(database.contacts)[after]
    lasting = np.where(stays > 0.0, until[after], -1.0)
    first = lasting[:, 0] >= lasting[:, 1]
    firm = np.maximum(stays * np.stack([first, ~first], axis=1), _FREE)
    weights = np.concatenate([firm, _TURN * firm, np.full((len(before), 4), _TRUNK)], axis=1)
    points, wanted = _points(database, after), _points(database, before)
    moved = _nearest(points, wanted, weights)
    cos, sin = np.cos(moved[:, 2:]), np.sin(moved[:, 2:])
    x, z = points[:, :2, 0], points[:, :2, 1]
    away = np.hypot(moved[:, :1] + x * cos + z * sin - wanted[:, :2, 0],
                    moved[:, 1:2] + z * cos - x * sin - wanted[:, :2, 1])  # fmt: skip
    return Alignment(moved.astype(np.float32), np.sum(stays * (away > HARDLY), axis=1).astype(np.float32))


def _plant_times(database: MotionDatabase) -> tuple[Array, Array]:
    """Times since each foot touched the floor and until it leaves it [s]; 0 in the air, infinite at edges of clips.

    Shapes (P, 2).
    """
    contacts = np.asarray(database.contacts, dtype=bool)
    starts = np.asarray(database.clip_starts, dtype=np.int64) * database.stride
    spans = plant_spans(contacts, starts)
    frames = np.arange(len(contacts))
    clip = np.searchsorted(starts, frames, side="right") - 1
    result = []
    for k, edge in enumerate((starts[clip], starts[clip + 1] - 1)):
        lasts = (np.abs(frames[:, None] - spans[..., k]) + 1) / database.playback_rate
        result.append(np.where(contacts, np.where(spans[..., k] == edge[:, None], np.inf, lasts), 0.0))
    return result[0], result[1]


def _points(database: MotionDatabase, frames: Array) -> Array:
    """Positions over the ground, in the ground frame: both feet, points behind them, hips and shoulders.

    Shape (n, 8, 2), x and z [m].
    """
    body, skeleton = database.body, database.skeleton
    unique, back = np.unique(frames, return_inverse=True)
    positions, rotations = forward_kinematics(skeleton, database.root_positions[unique], database.rotations[unique])
    role = body.roles
    feet = [role["left_foot"], role["right_foot"]]
    balls = positions[:, feet] + quaternion.rotate(rotations[:, feet], body.sole_offsets[:, 1])
    toes = [role[name] for name in ("left_toe", "right_toe") if name in role]
    holds = positions[:, toes] if len(toes) == 2 else balls
    along = quaternion.rotate(rotations[:, feet], body.sole_offsets[:, 1] - body.sole_offsets[:, 0])
    along /= np.maximum(np.linalg.norm(along[..., [0, 2]], axis=-1), 1e-6)[..., None]
    trunk = positions[:, [role[name] for name in ("left_hip", "right_hip", "left_shoulder", "right_shoulder")]]
    points = np.concatenate([holds, holds - _ARM * along, trunk], axis=1)
    return ground.to_local(database.ground[unique][:, None], points)[..., [0, 2]][back]


def _nearest(points: Array, wanted: Array, weights: Array) -> Array:
    """The shift and rotation that bring points (n, K, 2) nearest to others, by weights (n, K). Shape (n, 3)."""
    whole = weights.sum(axis=1)[:, None]
    middle, goal = (np.sum(weights[..., None] * p, axis=1) / whole for p in (points, wanted))
    p, q = points - middle[:, None], wanted - goal[:, None]
    # A heading rotates z towards x.
    cross = np.sum(weights * (p[..., 1] * q[..., 0] - p[..., 0] * q[..., 1]), axis=1)
    angle = np.arctan2(cross, np.sum(weights * np.sum(p * q, axis=-1), axis=1))
    cos, sin = np.cos(angle), np.sin(angle)
    x = goal[:, 0] - (middle[:, 0] * cos + middle[:, 1] * sin)
    z = goal[:, 1] - (middle[:, 1] * cos - middle[:, 0] * sin)
    return np.stack([x, z, angle], axis=1)
