"""The flat arrays that a simulation is made of, as named tuples, which compiled code can be handed whole.

Rows and columns have their names in ``kernels/layout.py``. Few arrays with many rows, rather than many arrays:
compiling a kernel takes time in proportion to the number of arrays that it is handed.
"""

from __future__ import annotations

from typing import NamedTuple

from crowdsim.core.types import Array
from crowdsim.crowd.kernels import layout


class Model(NamedTuple):
    """All policies of a run, one after another: states, actions, frames and tables have numbers of the whole run.

    A is the number of actions, S of states, K of strikes in actions, L of playback frames, P of policies.

    Attributes:
        offsets: CSR: actions of state s are ``offsets[s]:offsets[s + 1]``. Behind the states of a policy each of its
            falls and staggers has a state of its own, to which no action leads: no avatar chooses it. (S + 1,), int32.
        reaches: How far the actions of each state lead at most, and until the body can halt [m]. Shape (S,), float64.
        halts: Where a body halts after each action at the earliest, seen from its start: x, z [m]. (A, 2), float32.
        legs: Left knee and sole, right knee and sole in each state, in the ground frame, and how far from the
            position these are at most [m]. Shape (S, 13), float32.
        calm: Share of the frames of each action in which the body is still. Shape (A,), float32.
        actions: For each action the state in which it ends, its length T [control frames], the playback frame that lies
            on the avatar when it starts, and its first row in ``paths`` and in ``strikes``, which the last row closes;
            and the last whole frame before its first strike. Shape (A + 1, 6), int32.
        moves: Where each action ends, seen from its start: x, z [m], cosine and sine of the turn; the cost of the
            transition into it (``policy.Actions.costs``), and what it takes from each behaviour of the policy as its
            transition terms say; then room, so that few lines of memory are read. Shape (A, 8 or more), float32.
        paths: Where each action leads in control frames 1 to T: x, z [m], cosine and sine of the turn, and the frame;
            then room to read beyond the last one. Shape (5, .), float32.
        strikes: For each strike its time [control frames from the state], the position of fist or foot seen from the
            action's start [m], its speed [m/s], the limb, which of its state's actions it is in, where it comes
            from (``Actions.strike_origins``), and what it earns where it lands by each strike term of the policy; then
            room. Shape (K, 8 or more), float32.
        behaviours: As in ``policy.LookupTables``, places moved. Shape (B,), ``records.BEHAVIOUR``.
        discounts: Powers of each behaviour's discount: row 0 from 0 on; row T for frames 1 to T, and zeros behind them.
            Shape (B, longest T + 1, longest T + 1 or more), float64.
        grids: For each behaviour its axes, in the order of ``policy.axes.registry.AXES``; one that it does not have is
            a single point. Shape (B, axes), ``layout.GRID_AXIS``.
        terms: As in ``policy.LookupTables``, with the column of ``strikes`` that holds what a strike earns; in the one
            behind it is what it costs where it is wasted. Shape (n,), ``terms.registry.TERM``.
        table: Likewise; float32 where policies of a run differ. Flat, float32, uint8 or uint16.
        ground: Ground transform of each playback frame in its clip's world. Shape (L, 3), float64.
        starts: What lies on the avatar's ground transform as actions start, in the clip's world. Shape (A, 3), float64.
        bodies: Centre of the head, upper and lower end of the torso, in the frame's ground frame [m]. (L, 9), float32.
        arms: Left and right elbow, left and right fist, likewise. Shape (L, 12), float32.
        ways: Where fist or foot is 0.1 s and 0.05 s before each strike, seen from the action's start [m]. Shape (K, 6),
            float32.
        policies: For each policy the playback frames in a control frame, its first row in ``behaviours``, its first
            action and its first state; the last row closes these three. Shape (P + 1, 4), int32.
        sizes: Radius of head and torso, drop from the head to neck and pelvis, a strike's tolerance; how far the
            surface of head and torso is from the body's position at most, and how far it moves in a control frame at
            most; the distance beyond which all grids end [m]; how much later moving targets are seen, as in
            ``policy.LookupTables`` [control frames]; the speed from which on a strike is strong [m/s];
            the share of ``Crowding``'s gap that bodies keep; radius of forearm and glove. Shape (P, 14), float64.
        twins: For each state the one of the captured motion that it is, or is the mirror image of. Shape (S,), int32.
        falls: What knocks avatars down: policy, kind (0 falls, 1 lies, 2 rises, 3 staggers, 4 goes on staggering),
            action, and the row of the fall that it belongs to, of a stagger that of its first piece; pieces of a
            stagger follow one another. Shape (n, 4), int32.
        stances: How many actions lead from each state to an orthodox and to a southpaw stance
            (``stances.stance_actions``). Shape (S, 2), or (0, 2) where no avatar has a stance, uint8.
        fall_directions: Bearing of the trunk's way in the avatar's ground frame at the start of that fall or stagger:
            0 forward, pi / 2 to the left [rad]. Shape (n,), float64.
        fall_axes: Where a body of size 1 lies after that fall: head x, z and feet x, z [m], seen from the fall's first
            frame, then from its last one; 0 of staggers. Shape (n, 8), float64.
        fall_capsules: The capsules of that body, seen from the fall's last frame: both ends, the radius, and that of a
            sphere around the capsule [m]; 0 of staggers. Shape (n, K, 8), float64.
        soles: Left heel and ball, right heel and ball, in the frame's ground frame [m]. Shape (L, 12), or (0, 12) where
            no policy has falls, float32.
        rests: Pieces of standing at ease, and parts of walks: the action that shows one, the action that leads from its
            end to the guard or -1 for none, the row that follows it, and the first row in ``walks`` of those that begin
            at its end, and one past the last. Shape (n, 5), int32.
        walks: For each walk the action that shows its first part, the row of ``rests`` in the pose of whose end that
            ends, how far it leads at most [m], and the points x, z about half a metre apart to its end, seen from where
            it begins [m]. Shape (n, 3 + two for each point), float64.
        ways_to_rest: For each state the action that leads from it to standing at ease, or -1; the row of ``rests`` in
            the pose of whose end that ends; and how many actions lead to a state that has one
            (``resting.NO_WAY``: none do). Shape (S, 3), or (0, 3) where no policy has rests, int32.
    """

    offsets: Array
    reaches: Array
    halts: Array
    legs: Array
    calm: Array
    actions: Array
    moves: Array
    paths: Array
    strikes: Array
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
    fall_directions: Array
    fall_axes: Array
    fall_capsules: Array
    soles: Array
    rests: Array
    walks: Array
    ways_to_rest: Array
    defence: Array


class Avatars(NamedTuple):
    """What changes, a struct of arrays: an avatar's *slot* is its column, its *number* identifies it.

    Slots follow the index, so that neighbours in space are neighbours in memory; those of absent avatars come last.
    Nothing that is computed depends on slots. "Before" is one control frame ago.

    Rows of ``whole``: number; policy; cohort (row of ``World.cohorts``); team, -2 less it while the avatar is down;
    skip, the team that the opponent may not be of (-1 nearest of anyone, -2 ``fixed`` says); fixed (number of the
    opponent, -2 - k for target k, -1 for none); opponent, likewise; opponent before the last decision; decisions taken;
    action; action before, negative when there was no decision in this frame; pending, the last whole frame of the
    action before its next strike, or -1 where the action before may still have one; burst, strikes left of the present
    burst, 0 for an avatar that rests; the opponent from the next action on, of avatars that have just decided; number
    of the avatar that hit it last, or -1; motion of its latest action with strikes (``Model.twins``), or -1, and the
    frame in which that ends; what it saw coming when it decided (``core.threats``), or -1.

    Rows of ``real``: scale of the body; speed [frames of motion in a control frame]; phase, frames of the action done
    (an action shows its frame ``min(phase, T)``; what goes beyond is motion that the next action starts with); phase
    before, in the action before; base, on which the ground transforms of playback frames are set (x, z, cosine and
    sine times scale, turn); x, z [m] and heading [rad] of its ground frame; x and z where its action ends; the
    frame in which it has recovered from all strikes that it threw; the last hit, along x and z away from whoever hit,
    as long as it was strong (``strikes.note_hits``), and its frame; how thick the body is, its scale times its girth; x
    and z where it can halt after its action.

    Attributes:
        whole: Shape (18, N), int32.
        real: Shape (21, N), float64.
        slot_of: Slot of each number. Shape (N,), int32.
        shown: Motion (``Model.twins``) of each number's latest actions, a ring by decisions; ``variety.NONE`` for none.
            Shape (N, 16), uint16.
        marks: Frames in which motion was last shown around cells of the ground (``variety``). Shape (a power of 2,),
            uint16.
        conditions: The state of each number in a fight, by the columns of ``layout``: its mode towards its opponent
            (``FIGHTS``, ``WATCHES``, ``FLEES`` or ``RESTS``) as set by groups and events, in its present action, and in
            its next one; the distance that it keeps while it watches [m]; its standing (``UP`` to ``OUT``) now and from
            its next action on; its row of ``Model.falls``; the number of its knock-downs; the frame in which it gets
            up; its health; the damage of recent hits, and the frame of the last one; its stamina, 0 to 1. Then its
            temperament: time to recover from a strike as a factor of the cohort's, aggression in doublings, and how
            much further away than others it stays while it rests [m]; its stance, 1 orthodox, 2 southpaw, 0 any; 1 more
            than its row of ``Model.rests`` while it stands at ease, else 0. Shape (N, 18), or (0, 18) where nothing of
            this is used, float64.
        seen: What each number's opponent was like when it decided on its latest actions with strikes, those of
            even and of odd decisions: x, z [m], heading [rad] and playback frame, of scripted targets the height [m]
            instead of the heading; the frame is -1 where there was none. Shape (N, 8), float64.
    """

    whole: Array
    real: Array
    slot_of: Array
    shown: Array
    marks: Array
    conditions: Array
    seen: Array

    @property
    def number(self) -> Array:
        """Number of the avatar in each slot. Shape (N,)."""
        return self.whole[layout.NUMBER]

    @property
    def team(self) -> Array:
        """Team of each slot. Shape (N,)."""
        return self.whole[layout.TEAM]

    @property
    def skip(self) -> Array:
        """Team that the opponent of each slot may not be of. Shape (N,)."""
        return self.whole[layout.SKIP]

    @property
    def opponent(self) -> Array:
        """Opponent of each slot. Shape (N,)."""
        return self.whole[layout.OPPONENT]

    @property
    def x(self) -> Array:
        """Position of each slot [m]. Shape (N,)."""
        return self.real[layout.X]

    @property
    def z(self) -> Array:
        """Position of each slot [m]. Shape (N,)."""
        return self.real[layout.Z]


class World(NamedTuple):
    """What avatars share: how they choose, the arena, and scripted targets; M cohorts, G targets.

    Attributes:
        weights: Weight of each behaviour of the policy. Shape (M, B), float64.
        cohorts: How far below the best value a candidate may lie, how many candidates there are at most, the randomness
            of the draw, how much nearer another opponent must be [m], how long it takes to recover from a strike
            [control frames], 0 no time, how much avatars care for variety, how much they defend themselves, and how
            long it takes them to see what an opponent has decided [control frames]. Shape (M, 8), float64.
        rules: Health at the start (0: nothing hurts), what a strong hit to the head takes, the shares of hits to the
            body and of blocked ones; what hits must take to make an avatar stagger, and to knock it down; for how long
            it is down [control frames], and how often until it stays down; what a strike and a metre take from its
            stamina, what a frame restores; how many may attack it (0: all). Shape (M, 12), float64.
        pauses: Whether a call ends in a frame with strikes, since events wait for them. Shape (1,).
        arena: Kind (0 none, 1 circle, 2 rectangle), centre x and z, half the sizes along x and z [m]. Shape (5,).
        crowding: The numbers of ``Crowding``. Shape (8,), float64.
        targets: Positions of scripted targets, from the frame before the first that is run on [m]. Shape
            (frames, G, 3), float64.
        stream: What seed and purpose contribute to draws of actions and of bursts. Shape (2,), uint64.
    """

    weights: Array
    cohorts: Array
    rules: Array
    pauses: Array
    arena: Array
    crowding: Array
    targets: Array
    stream: Array


class Record(NamedTuple):
    """The record of each avatar in a chunk of frames, by number.

    Attributes:
        whole: Action and opponent. Shape (2, frames, N), int32.
        real: Frame of the action, x, z, heading. Shape (4, frames, N), float32.
    """

    whole: Array
    real: Array

    def rows(self, first: int, last: int) -> Record:
        """Return some of the frames, as views."""
        return Record(self.whole[:, first:last], self.real[:, first:last])


class Strikes(NamedTuple):
    """Strikes thrown.

    Attributes:
        whole: Attacker, victim, limb, outcome (``kernels.outcomes``), whether it has knocked its victim down. Shape
            (S, 5), int32.
        real: Frame, position x, y, z [m], speed [m/s], what it takes from its victim's health. Shape (S, 6), float64.
    """

    whole: Array
    real: Array
