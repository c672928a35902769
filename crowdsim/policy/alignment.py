"""Where the motion that an action goes on with is laid: on the feet that stand before and after the cut.

Ground transforms lie between the feet, so that a cut shares what the feet are apart by between both of them. Where one
foot is about to go, or has just come, it can take all of that with it, and the foot that stands on stays where it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground, quaternion
from crowdsim.motion.contacts import stand_spans
from crowdsim.motion.kinematics import forward_kinematics

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.motion.database import MotionDatabase


SETTLED = (0.1, 0.72)
"""Time before a cut within which a foot that stands came down, and after it within which it comes up, so that it needs
no step for the cut [s]."""
_UNSURE = 0.15
"""How much earlier than that a foot that comes up begins to count [s], since paces differ from the capture's."""
_TRUNK, _FREE, _TURN = 2e-5, 1e-4, 1e-3
"""How much hips and shoulders count, and a foot that goes or comes, where one that stands on counts 1, so that it stays
exactly where it is; and how much how a foot is turned counts beside where it stands."""
_ARM = 0.15
"""Length over which feet are turned [m]."""
HARDLY = 0.003
"""Way that is so short that a foot needs no step for it [m]."""


class Alignment(NamedTuple):
    """How actions are laid on the state that they start in; A actions.

    Attributes:
        shifts: Where the ground transform of the action's motion lies when it starts, seen from the avatar's [m, rad].
            Shape (A, 3), float32.
        steps: How many feet have to make a step for it, that stand long before it and after it and are elsewhere: 0 to
            2, and in between where it is not sure. Shape (A,), float32.
    """

    shifts: Array
    steps: Array


def align_actions(database: MotionDatabase, graph: MotionGraph) -> Alignment:
    """Return how the actions of a graph are laid on their states; what continues the capture is not shifted.

    Mirror images of actions are laid in mirror image.
    """
    stride, images = database.stride, graph.action_images(database.captured_frames)
    chosen = np.flatnonzero(graph.action_cuts[: len(images) or graph.action_count])
    before = graph.state_frames[graph.action_states[chosen]].astype(np.int64) * stride
    after = (np.asarray(graph.action_first, dtype=np.int64)[chosen] - 1) * stride
    shifts, steps = np.zeros((graph.action_count, 3), np.float32), np.zeros(graph.action_count, np.float32)
    if len(chosen):
        shifts[chosen], steps[chosen] = align_cuts(database, before, after)
    shifts[images], steps[images] = shifts[: len(images)] * [-1.0, 1.0, -1.0], steps[: len(images)]
    return Alignment(shifts, steps)


def align_cuts(database: MotionDatabase, before: Array, after: Array) -> Alignment:
    """Return the turn and shift that bring feet, and a little the trunk, nearest to where they were, for C cuts.

    Weighted least squares. Of two feet that stand on the one counts that stands longer, so that the other makes the
    step alone.

    Args:
        database: The motion.
        before: Playback frame that each cut leaves. Shape (C,).
        after: Playback frame that is laid on it. Shape (C,).
    """
    since, until = _stands(database)
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


def _stands(database: MotionDatabase) -> tuple[Array, Array]:
    """For how long each foot has been standing, and will be [s]; 0 in the air, and for ever at the edge of its clip.

    Shapes (P, 2).
    """
    contacts = np.asarray(database.contacts, dtype=bool)
    starts = np.asarray(database.clip_starts, dtype=np.int64) * database.stride
    spans = stand_spans(contacts, starts)
    frames = np.arange(len(contacts))
    clip = np.searchsorted(starts, frames, side="right") - 1
    result = []
    for k, edge in enumerate((starts[clip], starts[clip + 1] - 1)):
        lasts = (np.abs(frames[:, None] - spans[..., k]) + 1) / database.playback_rate
        result.append(np.where(contacts, np.where(spans[..., k] == edge[:, None], np.inf, lasts), 0.0))
    return result[0], result[1]


def _points(database: MotionDatabase, frames: Array) -> Array:
    """Places over the ground, seen from the ground transform: both feet, what lies behind them, hips and shoulders.

    Shape (n, 8, 2), x and z [m].
    """
    body, skeleton = database.body, database.skeleton
    unique, back = np.unique(frames, return_inverse=True)
    places, turns = forward_kinematics(skeleton, database.root_positions[unique], database.rotations[unique])
    role = body.roles
    feet = [role["left_foot"], role["right_foot"]]
    balls = places[:, feet] + quaternion.rotate(turns[:, feet], body.sole_offsets[:, 1])
    toes = [role[name] for name in ("left_toe", "right_toe") if name in role]
    holds = places[:, toes] if len(toes) == 2 else balls
    along = quaternion.rotate(turns[:, feet], body.sole_offsets[:, 1] - body.sole_offsets[:, 0])
    along /= np.maximum(np.linalg.norm(along[..., [0, 2]], axis=-1), 1e-6)[..., None]
    trunk = places[:, [role[name] for name in ("left_hip", "right_hip", "left_shoulder", "right_shoulder")]]
    points = np.concatenate([holds, holds - _ARM * along, trunk], axis=1)
    return ground.to_local(database.ground[unique][:, None], points)[..., [0, 2]][back]


def _nearest(points: Array, wanted: Array, weights: Array) -> Array:
    """The turn and shift that bring points (n, K, 2) nearest to others, by weights (n, K). Shape (n, 3)."""
    whole = weights.sum(axis=1)[:, None]
    middle, goal = (np.sum(weights[..., None] * p, axis=1) / whole for p in (points, wanted))
    p, q = points - middle[:, None], wanted - goal[:, None]
    # A heading turns z towards x.
    cross = np.sum(weights * (p[..., 1] * q[..., 0] - p[..., 0] * q[..., 1]), axis=1)
    turn = np.arctan2(cross, np.sum(weights * np.sum(p * q, axis=-1), axis=1))
    cos, sin = np.cos(turn), np.sin(turn)
    x = goal[:, 0] - (middle[:, 0] * cos + middle[:, 1] * sin)
    z = goal[:, 1] - (middle[:, 1] * cos - middle[:, 0] * sin)
    return np.stack([x, z, turn], axis=1)
