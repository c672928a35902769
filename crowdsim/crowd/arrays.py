"""The flat arrays that a simulation is made of, as named tuples, which compiled code can be handed whole.

Rows are records, see ``kernels/records.py``: what is read together lies together, and compiling a kernel takes time in
proportion to the number of arrays that it is handed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.places.arrays import Places


class Paths(NamedTuple):
    """Where each action leads in its control frames 1 to T, one action after another; room to read beyond the last one.

    Attributes:
        x: Position seen from the action's start [m]. float32.
        z: Likewise.
        cos: Cosine of the turn.
        sin: Sine likewise.
        time: The control frame.
    """

    x: Array
    z: Array
    cos: Array
    sin: Array
    time: Array


class Model(NamedTuple):
    """All policies of a run, one after another: states, actions, frames and tables have numbers of the whole run.

    A is the number of actions, S of states, K of strikes in actions, L of playback frames, P of policies.

    Attributes:
        offsets: CSR: actions of state s are ``offsets[s]:offsets[s + 1]``. Behind the states of a policy each of its
            falls and staggers has a state of its own, to which no action leads: no avatar chooses it. (S + 1,), int32.
        reaches: How far the actions of each state lead at most, and until the body can halt [m]. Shape (S,), float64.
        halts: Where a body halts after each action at the earliest, seen from its start. Shape (A,), ``POINT``.
        legs: Knee and sole of the left and of the right leg in each state, in the ground frame [m]. Shape
            (S, 2, 2, 3), float32.
        leg_reaches: How far from the position these are at most [m]. Shape (S,), float32.
        calm: Share of the frames of each action in which the body is still. Shape (A,), float32.
        unguarded: How long hands hang in each action and behind it [s], see ``model_guard``. Shape (A,), float32.
        actions: The actions, and a record that closes their paths and strikes. Shape (A + 1,), ``ACTION``.
        moves: Where each action ends. Shape (A,), ``MOVE``.
        prices: What each action takes from each behaviour of the policy, wherever the target is. Shape (A, most
            behaviours), float32.
        paths: Where each action leads.
        strikes: The strikes in actions. Shape (K,), ``REACH``.
        earnings: What each strike earns where it lands, and costs where it is wasted, by each strike term of the
            policy. Shape (K, two for each term), float32.
        behaviours: As in ``policy.LookupTables``, places moved. Shape (B,), ``policy.records.BEHAVIOUR``.
        discounts: Powers of each behaviour's discount: row 0 from 0 on; row T for frames 1 to T, and zeros behind them.
            Shape (B, longest T + 1, longest T + 1 or more), float64.
        grids: For each behaviour its axes, in the order of ``policy.axes.registry.AXES``; one that it does not have is
            a single point. Shape (B, axes), ``GRID_AXIS``.
        terms: As in ``policy.LookupTables``, with the column of ``earnings`` that holds what a strike earns; in the one
            behind it is what it costs where it is wasted. Shape (n,), ``terms.registry.TERM``.
        table: Likewise; float32 where policies of a run differ. Flat, float32, uint8 or uint16.
        ground: Ground transform of each playback frame in its clip's world. Shape (L,), ``PLACE``.
        starts: What lies on the avatar's ground transform as actions start, in the clip's world. Shape (A,), ``PLACE``.
        bodies: Centre of the head, upper and lower end of the torso, in the frame's ground frame [m], by ``HEAD``,
            ``NECK`` and ``PELVIS``. Shape (L, 3, 3), float32.
        arms: Left and right elbow, left and right fist, likewise. Shape (L, 4, 3), float32.
        ways: Where fist or foot is 0.1 s and 0.05 s before each strike, seen from the action's start [m]. Shape
            (K, 2, 3), float32.
        policies: The policies, and a record that closes their behaviours, actions and states. (P + 1,), ``POLICY``.
        sizes: Sizes of each policy's bodies. Shape (P,), ``SIZE``.
        twins: For each state the one of the captured motion that it is, or is the mirror image of. Shape (S,), int32.
        falls: What knocks avatars down, or throws them off their feet. Shape (n,), ``FALL``.
        stances: How many actions lead from each state to an orthodox and to a southpaw stance
            (``stances.stance_actions``). Shape (S, 2), or (0, 2) where no avatar has a stance, uint8.
        fall_axes: Where a body of size 1 lies after that fall, seen from the fall's first frame (``FROM_START``) and
            from its last one (``FROM_END``); 0 of staggers. Shape (n, 2), ``LINE``.
        fall_capsules: The capsules of that body, seen from the fall's last frame; 0 of staggers. (n, K), ``CAPSULE``.
        soles: Heel and ball of the left and of the right sole, in the frame's ground frame [m]. Shape (L, 2, 2, 3), or
            (0, 2, 2, 3) where no policy has falls, float32.
        outlines: Head, neck, pelvis, fists, heels and balls in the frame's ground frame [m]. Shape (L, 9, 3), or
            (0, 9, 3) where there are no obstacles, float32.
        extents: How far from the position these are at most, and the room that they need [m]. Shape (L,), float32.
        spans: Octagon around all outlines of an action with the room that they need: how far it reaches along +x, -x,
            +z, -z and along (1, 1), (1, -1), (-1, 1), (-1, -1), not normalised, in the frame of ``ground``; then a
            bound of the distance of its corners from its middle [m]. Shape (A + 1, 9), float32.
        rests: Pieces of standing at ease, and parts of walks. Shape (n,), ``REST``.
        walks: The walks, and the ways into rests that lead away. Shape (n,), ``WALK``.
        walk_points: Points of each walk about half a metre apart to its end, seen from where it begins; the last one
            fills the places that a walk does not need. Shape (n, most points, 2), float64.
        ways_to_rest: How each state leads to a rest. Shape (S,), or (0,) where no policy has rests, ``REST_ENTRY``.
        defence: Hits that follow each action by what an avatar sees (``policy.defence``). Shape (A, cells), float32.
        shields: Radii of forearms and gloves of each avatar that shields make (``attachments.shield_radii``). Shape
            (N, 4), or (0, 4) where there are no shields, float32.
    """

    offsets: Array
    reaches: Array
    halts: Array
    legs: Array
    leg_reaches: Array
    calm: Array
    unguarded: Array
    actions: Array
    moves: Array
    prices: Array
    paths: Paths
    strikes: Array
    earnings: Array
    behaviours: Array
    discounts: Array
    grids: Array
    terms: Array
    table: Array
    ground: Array
    starts: Array
    bodies: Array
    arms: Array
    ways: Array
    policies: Array
    sizes: Array
    twins: Array
    stances: Array
    falls: Array
    fall_axes: Array
    fall_capsules: Array
    soles: Array
    outlines: Array
    extents: Array
    spans: Array
    rests: Array
    walks: Array
    walk_points: Array
    ways_to_rest: Array
    defence: Array
    shields: Array


class Avatars(NamedTuple):
    """What changes of each avatar: its *slot* is where it is stored, its *number* identifies it.

    Slots follow the index, so that neighbours in space are neighbours in memory; those of absent avatars come last.
    Nothing that is computed depends on slots. "Before" is one control frame ago.

    Positions, angles and phases are stored in single precision, as takes record them: a kilometre from the origin
    positions are multiples of 6e-5 m. Errors do not add up while an action lasts, since each frame follows from where
    it ends, and one action hands on no more than the rounding of its end. Kernels compute in double precision, and
    convert what they read. In double precision is what there is one of in each cohort, or less (``World``), and
    ``conditions``: sums of damage in parts of a point, numbers of avatars and of control frames are exact there.

    Attributes:
        x: Position of each slot [m]. Shape (N,), float32.
        z: Likewise.
        heading: Where it looks [rad]. Shape (N,), float32.
        number: Number of the avatar in each slot. Shape (N,), int32.
        policy: Its policy. Shape (N,), int16.
        team: Its team, -2 less it while the avatar is down. Shape (N,), int16.
        skip: Team that its opponent may not be of, -1 nearest of anyone, -2 ``fixed`` says. Shape (N,), int16.
        fixed: Opponent that a script gives it, as ``opponent``. Shape (N,), int32.
        opponent: Number of its opponent, -2 - k for scripted target k, -1 for none. Shape (N,), int32.
        motion: What others see of its motion. Shape (N,), ``MOTION``.
        playback: How its action is played back. Shape (N,), ``PLAYBACK``.
        slides: How far it slides while it falls. Shape (N,), or (0,) where no avatar falls, ``SLIDE``.
        free: Phase of its action up to which its body is in no obstacle. Shape (N,), or (0,) where there are none,
            float32.
        fight: What its decisions read. Shape (N,), ``FIGHT``.
        slot_of: Slot of each number. Shape (N,), int32.
        shown: Motion (``Model.twins``) of each number's latest actions, a ring by decisions;
            ``shown_motion.NONE`` for none. Shape (N, 16), uint8.
        marks: Frames in which motion was last shown around cells of the ground (``shown_motion``). Shape (a power of
            2,), uint8.
        conditions: The state of each number in a fight. Shape (N,), or (0,) where nothing of this is used,
            ``CONDITION``.
        seen: Which strikes of each number's latest actions with strikes, those of even and of odd decisions, would have
            landed on its opponent as that was when it decided, a bit each. Shape (N, 2), uint8.
    """

    x: Array
    z: Array
    heading: Array
    number: Array
    policy: Array
    team: Array
    skip: Array
    fixed: Array
    opponent: Array
    motion: Array
    playback: Array
    slides: Array
    free: Array
    fight: Array
    slot_of: Array
    shown: Array
    marks: Array
    conditions: Array
    seen: Array


def positions_of(avatars: Avatars, slots: Any) -> Array:
    """Return the positions of some slots: x and z [m]. Shape (n, 2), or (2,) of one slot, float64."""
    return np.stack([avatars.x[slots], avatars.z[slots]], axis=-1).astype(float)


BY_SLOT = Avatars._fields[: Avatars._fields.index("slot_of")]
"""Arrays of ``Avatars`` with an entry for each slot, or none; the others do not depend on slots."""


class Arena(NamedTuple):
    """The arena: its kind (0 none, 1 circle, 2 rectangle), its centre, and half its sizes along x and z [m]."""

    kind: float
    x: float
    z: float
    half_x: float
    half_z: float


class CrowdingRules(NamedTuple):
    """How avatars keep out of one another: the numbers of ``crowd.Crowding``, which says what they mean."""

    end_cost: float
    path_cost: float
    disc: float
    gap: float
    outside_cost: float
    turn_back: float
    sight: float
    back: float
    unseen: float
    at_air: float
    stunned: float


class Streams(NamedTuple):
    """What seed and purpose contribute to draws of actions and of bursts."""

    choice: np.uint64
    burst: np.uint64


class World(NamedTuple):
    """What avatars share: how they choose, the arena, and scripted targets; M cohorts, G targets.

    Attributes:
        weights: Weight of each behaviour of the policy. Shape (M, B), float64.
        cohorts: How avatars choose. Shape (M,), ``COHORT``.
        rules: What hurts and tires them. Shape (M,), ``RULE``.
        pauses: Whether a call ends in a frame with strikes, since events wait for them. Shape (1,).
        arena: The arena.
        places: Obstacles.
        crowding: How avatars keep out of one another.
        targets: Positions of scripted targets, from the frame before the first that is run on [m]. Shape
            (frames, G, 3), float64.
        streams: Where draws begin.
    """

    weights: Array
    cohorts: Array
    rules: Array
    pauses: Array
    arena: Arena
    places: Places
    crowding: CrowdingRules
    targets: Array
    streams: Streams


class Record(NamedTuple):
    """The record of each avatar in a chunk of frames, by number; arrays (frames, N).

    Attributes:
        action: Action, a number of its policy's graph; -1 where it is absent. int32.
        action_frame: Frames of that action done. float32.
        x: Position [m]. float32.
        z: Likewise.
        heading: Where it looks [rad], in -pi..pi. float32.
        opponent: Avatar that it fights, -2 - k for scripted target k, -1 for none. int32.
    """

    action: Array
    action_frame: Array
    x: Array
    z: Array
    heading: Array
    opponent: Array

    def rows(self, first: int, last: int) -> Record:
        """Return some of the frames, as views."""
        return Record(*(values[first:last] for values in self))
