"""What the graph's actions do, seen from the state in which they start: paths over the ground and strikes thrown."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.strikers import LEGS
from crowdsim.policy.alignment import Alignment, align_actions

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.motion.database import MotionDatabase


class Actions(NamedTuple):
    """The actions of a motion graph as flat arrays, each in the ground frame that the avatar has in the action's state.

    A is the number of actions, S of states, K of strikes in actions (one strike of the database may lie in several). A
    named tuple, so that compiled code can be handed all of it.

    Attributes:
        offsets: CSR: actions of state s are ``offsets[s]:offsets[s + 1]``. Shape (S + 1,), int32. Those behind
            ``offsets[S]`` are falls.
        next: State in which each action ends. Shape (A,), int32.
        lengths: Length T of each action [control frames]. Shape (A,), int32.
        shifts: Where the ground transform of the motion's frame lies when each action starts, as seen from the
            avatar's; see ``align_actions``. Shape (A, 3), float32.
        costs: How visible the transition into each action is: its cost over the graph's threshold, times
            ``stillness``, and ``STEP`` for each foot that makes a step for it; 0 where it goes on with the capture.
            Shape (A,), float32.
        path_offsets: CSR: the path of action a is ``paths[path_offsets[a]:path_offsets[a + 1]]``. Shape (A + 1,),
            int32.
        paths: Ground transform at control frames 1 to T of each action, the last being its displacement [m, rad].
            Shape (sum of T, 3), float32.
        strike_offsets: CSR over the strikes of each action, by time. Shape (A + 1,), int32.
        strike_times: When each strike reaches furthest, in (0, T] [control frames from the state]. Shape (K,), float32.
        strike_positions: Position of fist or foot then [m]. Shape (K, 3), float32.
        strike_origins: Where a kick comes from over the ground, that is, where the avatar is then; of a punch, which
            may come from any side, the position of the fist itself [m]. Shape (K, 2), float32.
        strike_speeds: Its highest speed before that, over the mean of all punches of the database, and ``LEG`` times
            as much for a kick; over that of all kicks where there are no punches. Shape (K,), float32.
        strike_ids: Number of the strike in the database. Shape (K,), int32.
    """

    offsets: Array
    next: Array
    lengths: Array
    shifts: Array
    costs: Array
    path_offsets: Array
    paths: Array
    strike_offsets: Array
    strike_times: Array
    strike_positions: Array
    strike_origins: Array
    strike_speeds: Array
    strike_ids: Array

    @property
    def state_count(self) -> int:
        """Number of states S."""
        return len(self.offsets) - 1

    @property
    def action_count(self) -> int:
        """Number of actions A."""
        return len(self.next)

    @property
    def choice_count(self) -> int:
        """Number of actions that belong to states; those behind them are falls."""
        return int(self.offsets[-1])

    @property
    def mean_length(self) -> float:
        """Mean length of the actions that belong to states [control frames]."""
        return float(np.mean(self.lengths[: self.choice_count]))

    @property
    def displacements(self) -> Array:
        """Ground transform at the end of each action. Shape (A, 3)."""
        return self.paths[self.path_offsets[1:] - 1]


def leading_actions(actions: Actions, states: int) -> Actions:
    """Return the actions of the first states of a graph; they may end in states that come later."""
    count = int(actions.offsets[states])
    paths, strikes = int(actions.path_offsets[count]), int(actions.strike_offsets[count])
    return Actions(
        offsets=actions.offsets[: states + 1],
        next=actions.next[:count],
        lengths=actions.lengths[:count],
        shifts=actions.shifts[:count],
        costs=actions.costs[:count],
        path_offsets=actions.path_offsets[: count + 1],
        paths=actions.paths[:paths],
        strike_offsets=actions.strike_offsets[: count + 1],
        strike_times=actions.strike_times[:strikes],
        strike_positions=actions.strike_positions[:strikes],
        strike_origins=actions.strike_origins[:strikes],
        strike_speeds=actions.strike_speeds[:strikes],
        strike_ids=actions.strike_ids[:strikes],
    )


def build_actions(database: MotionDatabase, graph: MotionGraph, alignment: Alignment | None = None) -> Actions:
    """Return the actions of a graph over a database.

    The ground transform of control frame ``action_first - 1`` lies on the avatar's when the action starts, but for its
    shift; actions are laid on their states as ``align_actions`` finds unless an alignment is given.
    """
    stride = database.stride
    first = np.asarray(graph.action_first, dtype=np.int64)
    lengths = np.asarray(graph.action_lengths, dtype=np.int64)
    path_offsets = np.concatenate([[0], np.cumsum(lengths)])
    owner = np.repeat(np.arange(len(first)), lengths)
    frames = first[owner] + np.arange(path_offsets[-1]) - path_offsets[owner]
    alignment = alignment or align_actions(database, graph)
    shifts = np.asarray(alignment.shifts, dtype=np.float32)
    undo = ground.compose(shifts, ground.inverse(database.ground[stride * (first - 1)]))
    paths = ground.compose(undo[owner], database.ground[stride * frames])

    low = np.searchsorted(database.strike_frames, stride * (first - 1), side="right")
    high = np.searchsorted(database.strike_frames, stride * (first + lengths - 1), side="right")
    strike_offsets = np.concatenate([[0], np.cumsum(high - low)])
    striker = np.repeat(np.arange(len(first)), high - low)
    ids = low[striker] + np.arange(strike_offsets[-1]) - strike_offsets[striker]
    at = database.strike_frames[ids]
    stances = ground.compose(undo[striker], database.ground[at])
    places = ground.to_world(stances, database.strike_positions[ids]).reshape(-1, 3).astype(np.float32)
    kicks = np.isin(database.strike_limbs, LEGS)
    punches = ~kicks
    if not punches.any():
        punches[:] = True
    mean = float(np.mean(database.strike_speeds[punches])) if len(punches) else 1.0
    heft = np.where(punches, np.float32(1.0), np.float32(LEG))
    return Actions(
        offsets=np.asarray(graph.action_offsets, dtype=np.int32),
        next=np.asarray(graph.action_next, dtype=np.int32),
        lengths=lengths.astype(np.int32),
        shifts=shifts,
        costs=(graph.action_costs / graph.threshold * stillness(database, graph) + STEP * alignment.steps).astype(
            np.float32
        ),
        path_offsets=path_offsets.astype(np.int32),
        paths=paths.astype(np.float32),
        strike_offsets=strike_offsets.astype(np.int32),
        strike_times=(at / stride - (first[striker] - 1)).astype(np.float32),
        strike_positions=places,
        strike_origins=np.where(kicks[ids, None], stances[:, :2], places[:, [0, 2]]).astype(np.float32),
        strike_speeds=(database.strike_speeds[ids] * heft[ids] / mean).astype(np.float32),
        strike_ids=ids.astype(np.int32),
    )


LEG = 3.2
"""Mass of a leg over that of an arm (Winter 2009, table 4.1): at one speed a kick counts as much more than a punch."""

STEP = 1.0
"""Cost of a step that a foot makes only for a transition, where the most costly transition of the graph costs 1."""

QUIET = 0.1
"""Speed that is added where costs are divided by speeds, since people are never quite still [m/s]."""

STILLEST = 4.0
"""Greatest factor of stillness."""


Stillness = Callable[[Array, Array], Array]


def stillness(database: MotionDatabase, graph: MotionGraph) -> Array:
    """Return how much more visible each action's transition is than one at median speed. Shape (A,), float64.

    The same gap is visible in a body at rest, and hardly in a moving one: a classifier that separates transitions from
    capture is little better than chance on the tenth with the least ratio of gap to speed, and best on the tenth with
    the least gap, because those are at rest.
    """
    before = graph.state_frames[graph.action_states]
    return stillness_between(database)(before, np.asarray(graph.action_first, dtype=np.int64) - 1)


def stillness_between(database: MotionDatabase) -> Stillness:
    """Return a function of frames left and frames entered, which tells the same of transitions between them."""
    speeds = joint_speeds(database)
    usual = float(np.median(speeds[~database.rests.mask(database.frame_count)])) + QUIET

    def factor(left: Array, entered: Array) -> Array:
        return np.asarray(np.minimum(usual / (np.minimum(speeds[left], speeds[entered]) + QUIET), STILLEST))

    return factor


def joint_speeds(database: MotionDatabase, around: float = 0.2) -> Array:
    """Return the root mean square of the joints' speeds around each control frame [m/s]. Shape (F,), float64.

    The mean goes ``around`` to either side, inside a clip [s].
    """
    starts = np.asarray(database.clip_starts, dtype=np.int64)
    last = np.repeat(starts[1:], np.diff(starts)) * database.stride - 1
    here = np.minimum(np.arange(database.frame_count) * database.stride, last - 1)
    positions = [
        forward_kinematics(database.skeleton, database.root_positions[rows], database.rotations[rows])[0]
        for rows in (here, here + 1)
    ]
    steps = np.linalg.norm(positions[1].astype(float) - positions[0], axis=-1) * database.playback_rate
    squares = np.concatenate([[0.0], np.cumsum((steps**2).mean(axis=-1))])
    reach = round(around * database.control_rate)
    frames = np.arange(database.frame_count)
    clip = np.searchsorted(starts, frames, side="right") - 1
    low, high = np.maximum(frames - reach, starts[clip]), np.minimum(frames + reach + 1, starts[clip + 1])
    return np.sqrt((squares[high] - squares[low]) / (high - low))
