"""A crowd before its first frame: its avatars, where they start, how they choose, and what is planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, Model
from crowdsim.crowd.cast import Cast
from crowdsim.crowd.distributions import EVEN_TEMPERED
from crowdsim.crowd.initial_states import first_actions
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.records import CONDITION, FIGHT, MOTION, PLAYBACK, RULE, SLIDE, empty_records, records
from crowdsim.crowd.kernels.shown_motion import LATEST, LONG_AGO, NONE
from crowdsim.errors import RunError
from crowdsim.places.kernels.records import PART
from crowdsim.scenario.parts import MAXIMUM_FRAMES

if TYPE_CHECKING:
    from crowdsim.crowd.script import Change, End, TargetPath, Travel
    from crowdsim.policy.policy import Policy

ANYONE, SCRIPTED = -1, -2
"""Values of ``Crowd.skip`` beside a team: the nearest of any team; the one in ``Crowd.fixed``."""

_MARKS, _LEAST_MARKS = 32, 1 << 14
"""Marks of shown motion for each avatar, and for a crowd at the least."""


@dataclass(frozen=True)
class Crowding:
    """How avatars see one another, keep out of one another, and in the arena.

    Attributes:
        end: What an action costs that ends in the middle of a neighbour, in normalised values; less towards its edge.
        path: What it costs to pass through there.
        radius: Radius of the disc that a body takes up [m], for a scale of 1.
        gap: How far discs of avatars that fight should stay apart [m], where strikes reach far (``model.space_of``).
        outside: What a metre beyond the arena's border costs.
        turn: How far outside avatars go for the middle instead of their opponent [m].
        reach: How far neighbours are seen, as opponents too [m].
        most: How many neighbours count, the nearest ones.
        back: What a metre is worth that a hit pushes an avatar along; 0 where hits do not.
        unseen: What a strike costs at an opponent that looks away.
        wasted: What one costs that is drawn though it would end far from the opponent.
        stunned: What a strike costs that an avatar would throw before it has recovered from a hit.
    """

    end: float = 16.0
    path: float = 2.0
    radius: float = 0.2
    gap: float = 0.3
    outside: float = 10.0
    turn: float = 0.25
    reach: float = 1.5
    most: int = 12
    back: float = 4.0
    unseen: float = 1.5
    wasted: float = 2.0
    stunned: float = 4.0

    @classmethod
    def none(cls) -> Crowding:
        """Return rules without collision avoidance; neighbours still count as opponents, and the arena stays."""
        return cls(end=0.0, path=0.0, back=0.0, unseen=0.0, wasted=0.0, stunned=0.0)

    def numbers(self) -> Array:
        """Return what kernels read. Shape (11,)."""
        space = self.end, self.path, self.radius, self.gap, self.outside, self.turn, self.reach
        return np.array([*space, self.back, self.unseen, self.wasted, self.stunned])


@dataclass(frozen=True)
class Crowd:
    """All that a simulation begins with; N avatars, M cohorts (ways to choose, one a group and type).

    ``draw.draw_crowd`` draws that of a scenario, ``build_crowd`` makes one of plain arrays.

    Attributes:
        cast: Names, teams, bodies and temperaments of the avatars, which takes record.
        policies: The policies, in the order of ``cast.policy_names``.
        x: Positions at the start [m]. Shape (N,).
        z: Likewise. Shape (N,).
        heading: Where avatars look at the start [rad]. Shape (N,).
        group: Shape (N,).
        cohort: Row of ``weights`` and the like. Shape (N,).
        skip: Team that an avatar does not fight, ``ANYONE`` or ``SCRIPTED``. Shape (N,).
        fixed: With ``SCRIPTED``: an avatar, -2 - k for target k, or -1 for none. Shape (N,).
        present: Whether it is there from the start. Shape (N,), bool.
        weights: Weight of each behaviour of the policy. Shape (M, B).
        margins: How far below the best value a candidate may lie. Shape (M,).
        most: How many candidates there are at most. Shape (M,).
        temperatures: Randomness of the draw. Shape (M,).
        hysteresis: How much nearer another opponent must be [m]. Shape (M,).
        intervals: How long it takes to recover from a strike [control frames]; 0 no time. Shape (M,).
        varieties: How much avatars care for variety. Shape (M,).
        defences: Weight of the behaviour ``defend``; 0 for none where it is empty. Shape (M,) or (0,).
        reactions: Time that it takes to see what an opponent has decided [control frames]. Shape (M,) or (0,).
        arena: Kind (0 none, 1 circle, 2 rectangle), centre x and z, half the sizes along x and z [m]. Shape (5,).
        parts: Parts of obstacles, ``places.arrays.pack_parts``. Shape (n,), ``PART``.
        crowding: How avatars keep out of one another.
        seed: Seed of every draw.
        rules: What hurts and tires avatars, see ``World.rules``; nothing where it is empty. Shape (M, 12) or (0, 12).
        conditioned: Whether avatars can be hurt, tire, watch, flee, wait or travel, or have temperaments or stances.
        temperaments: See ``distributions.temperaments_of``; where it is empty, all are even-tempered. Shape (N, 3) or
            (0, 3).
        targets: Paths of scripted targets.
        travels: Paths by which avatars enter and leave.
        entries: Index into ``travels`` of the path by which each group enters, -1 for none. Shape (groups,) or (0,).
        changes: Events, in this order where several happen at once.
        until: What ends the run before its duration.
        frames: Planned duration [control frames].
        pre_roll: For how long avatars stand on guard before the first frame [control frames], see ``pre_roll``.
    """

    cast: Cast
    policies: Sequence[Policy]
    x: Array
    z: Array
    heading: Array
    group: Array
    cohort: Array
    skip: Array
    fixed: Array
    present: Array
    weights: Array
    margins: Array
    most: Array
    temperatures: Array
    hysteresis: Array
    intervals: Array
    varieties: Array
    defences: Array = field(default_factory=lambda: np.zeros(0))
    reactions: Array = field(default_factory=lambda: np.zeros(0))
    arena: Array = field(default_factory=lambda: np.zeros(5))
    parts: Array = field(default_factory=lambda: np.zeros(0, PART))
    crowding: Crowding = field(default_factory=Crowding)
    seed: int = 0
    rules: Array = field(default_factory=lambda: np.zeros((0, len(RULE))))
    conditioned: bool = False
    temperaments: Array = field(default_factory=lambda: np.zeros((0, 3)))
    targets: tuple[TargetPath, ...] = ()
    travels: tuple[Travel, ...] = ()
    entries: Array = field(default_factory=lambda: np.zeros(0, np.int32))
    changes: tuple[Change, ...] = ()
    until: End | None = None
    frames: int = MAXIMUM_FRAMES
    pre_roll: int = 0

    @property
    def count(self) -> int:
        """Number of avatars N."""
        return len(self.x)

    @property
    def rate(self) -> float:
        """Control frames a second."""
        return float(self.policies[0].database.control_rate)


class Cohort(NamedTuple):
    """How the avatars of a crowd of one cohort choose; see ``Crowd``."""

    weights: ArrayLike = (1.0, 1.0)
    margin: float = 0.1
    most: int = 4
    temperature: float = 0.05
    hysteresis: float = 0.3
    interval: float = 0.0
    variety: float = 0.0


def build_crowd(
    x: ArrayLike,
    z: ArrayLike,
    heading: ArrayLike = 0.0,
    policy: ArrayLike = 0,
    team: ArrayLike | None = None,
    scale: ArrayLike = 1.0,
    speed: ArrayLike = 1.0,
    girth: ArrayLike = 1.0,
    stances: ArrayLike = 0,
    policies: Sequence[Policy] = (),
    **other: Any,
) -> Crowd:
    """Return a crowd of one cohort; without teams everyone fights anyone.

    ``other`` are fields of ``Cohort``, or further ones of ``Crowd``.
    """
    xs = np.asarray(x, dtype=float)
    cohort = Cohort(**{name: other.pop(name) for name in Cohort._fields if name in other})

    def each(values: ArrayLike, dtype: Any) -> Array:
        return np.broadcast_to(np.asarray(values), xs.shape).astype(dtype)

    teams = each(0 if team is None else team, np.int16)
    fields: dict[str, Any] = {
        "cast": Cast(
            names=np.arange(len(xs)).astype(str),
            types=np.zeros(len(xs), np.int16),
            teams=teams,
            policies=each(policy, np.int16),
            scales=each(scale, np.float32),
            speeds=each(speed, np.float32),
            type_names=("avatar",),
            team_names=tuple(map(str, range(int(teams.max(initial=0)) + 1))),
            policy_names=tuple(one.name for one in policies),
            colours=np.full((1, 3), np.nan),
            girths=each(girth, np.float32),
            stances=each(stances, np.uint8),
        ),
        "policies": policies,
        "x": xs,
        "z": each(z, float),
        "heading": each(heading, float),
        "group": np.zeros(len(xs), np.int32),
        "cohort": np.zeros(len(xs), np.int16),
        "skip": each(ANYONE, np.int32) if team is None else teams.astype(np.int32),
        "fixed": each(-1, np.int32),
        "present": np.ones(len(xs), bool),
        "weights": np.atleast_2d(np.asarray(cohort.weights, dtype=float)),
        "margins": np.array([cohort.margin]),
        "most": np.array([cohort.most], np.int32),
        "temperatures": np.array([cohort.temperature]),
        "hysteresis": np.array([cohort.hysteresis]),
        "intervals": np.array([cohort.interval]),
        "varieties": np.array([cohort.variety]),
    }
    return Crowd(**{**fields, **other})


def build_avatars(crowd: Crowd, model: Model, order: Array | None = None) -> Avatars:
    """Return the avatars at their positions, each in a state drawn from its policy's, about to take its first decision.

    Args:
        crowd: The crowd.
        model: Its policies.
        order: Number of the avatar in each slot; by default the present ones come first. Shape (N,).

    Raises:
        RunError: A position is not finite.
    """
    count = crowd.count
    numbers = np.argsort(~crowd.present, kind="stable") if order is None else np.asarray(order)
    numbers = numbers[np.argsort(~crowd.present[numbers], kind="stable")].astype(np.int32)
    slot_of = np.empty(count, np.int32)
    slot_of[numbers] = np.arange(count, dtype=np.int32)

    avatars = Avatars(
        x=np.zeros(count, np.float32),
        z=np.zeros(count, np.float32),
        heading=np.zeros(count, np.float32),
        number=numbers,
        policy=np.asarray(crowd.cast.policies)[numbers].astype(np.int16),
        team=np.asarray(crowd.cast.teams)[numbers].astype(np.int16),
        skip=np.asarray(crowd.skip)[numbers].astype(np.int16),
        fixed=np.asarray(crowd.fixed)[numbers].astype(np.int32),
        opponent=np.zeros(count, np.int32),
        motion=empty_records(count, MOTION),
        playback=empty_records(count, PLAYBACK),
        slides=empty_records(count if crowd.conditioned else 0, SLIDE),
        free=np.zeros(count if len(crowd.parts) else 0, np.float32),
        fight=empty_records(count, FIGHT),
        slot_of=slot_of,
        shown=np.empty((count, LATEST), np.uint8),
        conditions=np.zeros(count if crowd.conditioned else 0, CONDITION),
        marks=np.full(1 << (max(_LEAST_MARKS, _MARKS * count) - 1).bit_length(), LONG_AGO, np.uint8),
        seen=np.zeros((count, 2), np.uint8),
    )
    motion, playback, cast = avatars.motion, avatars.playback, crowd.cast
    playback["cohort"] = np.asarray(crowd.cohort)[numbers]
    playback["scale"], motion["speed"] = cast.scales[numbers], cast.speeds[numbers]
    motion["width"] = playback["scale"] * cast.girths[numbers]
    enter(avatars, crowd, model, np.arange(count))
    return avatars


def enter(
    avatars: Avatars,
    crowd: Crowd,
    model: Model,
    slots: Array,
    at: Array | None = None,
    heading: Array | None = None,
    is_calm: bool = False,
) -> None:
    """Put avatars where they start, in the last frame of an action that ends in their first state.

    Args:
        avatars: Changed.
        crowd: Their crowd.
        model: Its policies.
        slots: Slots of the avatars. Shape (n,).
        at: Positions, x and z [m]; those of the crowd when None. Shape (n, 2).
        heading: Headings [rad]; those of the crowd when None. Shape (n,).
        is_calm: Whether they begin where no strike has to follow.

    Raises:
        RunError: A position is not finite.
    """
    numbers = avatars.number[slots]
    x, z = (crowd.x[numbers], crowd.z[numbers]) if at is None else at.T
    heading = crowd.heading[numbers] if heading is None else heading
    bad = np.flatnonzero(~np.isfinite(x + z + heading))
    if len(bad):
        i = bad[0]
        raise RunError(
            f"avatar {numbers[i]} starts at ({x[i]}, {z[i]}) with heading {heading[i]}, expected finite numbers"
        )
    policy = avatars.policy[slots]
    action = first_actions(crowd.seed, crowd.cast.stances, model, numbers, policy, is_calm)
    length = model.actions["length"][action]
    ground = model.ground[model.actions["origin"][action] + length * model.policies["stride"][policy]]
    avatars.x[slots], avatars.z[slots], avatars.heading[slots], avatars.opponent[slots] = x, z, heading, -1
    began = {
        "motion": {
            **{"end_x": x, "end_z": z, "halt_x": x, "halt_z": z},
            **{"phase": length, "action": action},
        },
        "playback": {
            **{"base_turn": heading - ground["heading"], "phase_before": length},
            **{"action_before": layout.ENTERED, "pending": layout.NO_STRIKE},
        },
        "fight": {"next_opponent": -1, "hit_by": -1, "thrown": -1, "hit_frame": layout.NEVER},
    }
    for part, fields in began.items():
        for name, values in fields.items():
            getattr(avatars, part)[name][slots] = values
    if len(avatars.free):
        avatars.free[slots] = -1.0
    avatars.shown[numbers] = NONE
    if len(avatars.conditions):
        rows = avatars.conditions[numbers]
        for name in ("standing", "standing_next", "fall", "downs", "hurt", "piece", "travel", "leg"):
            rows[name] = 0.0
        rows["mode"][rows["mode"] == layout.TRAVELS] = layout.FIGHTS
        rows["health"] = records(crowd.rules, RULE)["full_health"][crowd.cohort[numbers]]
        rows["hurt_frame"], rows["stamina"] = -np.inf, 1.0
        tempered = len(crowd.temperaments) > 0
        temperaments = crowd.temperaments[numbers] if tempered else np.tile(EVEN_TEMPERED, (len(numbers), 1))
        rows["tempo"], rows["aggression"], rows["range"] = temperaments.T
        rows["stance"] = crowd.cast.stances[numbers]
        avatars.conditions[numbers] = rows
        avatars.slides["x"][slots] = avatars.slides["z"][slots] = 0.0
