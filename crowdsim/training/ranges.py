"""Ranges of grids from the data: where strikes reach, and how high heads are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError
from crowdsim.motion import ground
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.strikers import LEGS
from crowdsim.motion.strikes import describe_strikes_needed
from crowdsim.policy.axes.axis import UNSEEN_STRIKE
from crowdsim.policy.axes.registry import kind_named
from crowdsim.policy.environment import Axis, Grid, build_grid
from crowdsim.policy.rewards import HitTerm, ProximityTerm, StrikeTerm, Term
from crowdsim.training.recipe import BehaviourSpec


@dataclass(frozen=True)
class Reach:
    """The region that strikes reach, in the ground frame at the strike: 5th to 95th percentiles (paper, section 6).

    Attributes:
        distance: Of the fist over the ground [m].
        bearing: Of the fist [rad].
        height: Of the fist [m].
        head_height: Of heads, at all times [m].
    """

    distance: tuple[float, float]
    bearing: tuple[float, float]
    height: tuple[float, float]
    head_height: tuple[float, float]


def strike_reach(database: MotionDatabase) -> Reach:
    """Return the region that the strikes of a database reach."""
    check_strikes(database)
    x, y, z = np.asarray(database.strike_positions, dtype=float).T
    heads = np.asarray(database.head_heights, dtype=float)
    return Reach(_range(np.hypot(x, z)), _range(np.arctan2(x, z)), _range(y), _range(heads))


def check_strikes(database: MotionDatabase) -> None:
    """Raise a ``MotionError`` if motion has no strikes."""
    if len(database.strike_frames):
        return
    raise MotionError(
        f"no strikes found in {own_seconds(database):.1f} s of motion, but a behaviour needs them; "
        f"{describe_strikes_needed(database.body.height)}"
    )


def own_seconds(database: MotionDatabase) -> float:
    """Return the length of the clips, mirror images left out [s]."""
    frames = np.diff(np.asarray(database.clip_starts))
    mirrored = np.array([name.endswith("~mirror") for name in database.clip_names])
    return float(frames[~mirrored].sum() / database.control_rate)


SWING = 0.3
"""Time from the moment from which a kick's distance counts to its furthest reach [s]: the leg swings out meanwhile, and
takes the ground frame between the feet along.
"""


def striking_range(database: MotionDatabase) -> tuple[float, float]:
    """Return the distances from which strikes reach a head: from the lower to the upper quartile of strikes [m].

    Over the ground, to the centre of the head that the fist or foot touches, from the avatar's ground frame: where a
    punch lands, and ``SWING`` before a kick does.
    """
    check_strikes(database)
    frames, limbs = np.asarray(database.strike_frames, np.int64), np.asarray(database.strike_limbs)
    starts = np.asarray(database.clip_starts, np.int64) * database.stride
    swung = frames - round(SWING * database.playback_rate)
    swung = np.maximum(swung, starts[np.searchsorted(starts, frames, side="right") - 1])
    before = np.where(np.isin(limbs, LEGS), swung, frames)
    moved = ground.compose(ground.inverse(database.ground[before]), database.ground[frames])
    points = np.asarray(database.strike_positions, dtype=float)
    kicked = (before < frames)[:, None]
    x, _, z = np.where(kicked, ground.to_world(moved, points), points).T
    near, far = np.percentile(np.hypot(x, z), [25.0, 75.0]) + float(database.body.head_radius)
    return round(float(near), 3), round(float(far), 3)


def resolve_terms(spec: BehaviourSpec, database: MotionDatabase) -> tuple[Term, ...]:
    """Return the reward terms of a behaviour; a distance that its recipe leaves out is where strikes reach."""
    terms: list[Term] = []
    for term in spec.rewards:
        if isinstance(term, ProximityTerm | HitTerm) and term.distance is None:
            term = term.model_copy(update={"distance": striking_range(database)})
        terms.append(term)
    return tuple(terms)


TARGETS = 96
"""Places of the target over which actions are compared, half of them in the region that strikes reach."""

FAR = 4.0
"""The other half lie up to this far away [m]."""

PACE = 1.0
"""Speed of the fastest of them [m/s]."""

WARNING = 0.8
"""How long before a strike reaches furthest it is seen at most, where a recipe does not say [s]."""

_PACES = (0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 1.0, 0.5)
_GOLDEN, _ROOT_TWO, _ROOT_THREE = 0.6180339887498949, 1.4142135623730951, 1.7320508075688772

_SPREAD = (0.8191725133961645, 0.6710436067037893, 0.5497004779019703)
"""Steps of a sequence that fills a cube evenly (the plastic number's, in three dimensions)."""


def sample_targets(database: MotionDatabase, count: int = TARGETS) -> Array:
    """Return where a target may be, all around an avatar and half of them within reach, how it moves and faces.

    Returns:
        The head's place in the ground frame [m], and how far it moves in a control frame along x and z [m]: half of
        the targets are at rest, the others move at up to ``PACE`` in any direction. Then which way it faces [rad], all
        ways, and how soon its strike reaches furthest [control frames]; half of them do not strike. Shape (count, 7),
        the fields of a ``Target``.
    """
    near, high = (0.3, 1.3), np.percentile(np.asarray(database.head_heights, dtype=float), [5.0, 95.0])
    if len(database.strike_frames):
        near = strike_reach(database).distance
    shares = (0.5 + np.outer(np.arange(count), _SPREAD)) % 1.0
    ends = np.where((np.arange(count) % 2 == 0)[:, None], near, (near[0], FAR))
    distance = ends[:, 0] + shares[:, 0] * (ends[:, 1] - ends[:, 0])
    bearing = math.pi * (2.0 * shares[:, 1] - 1.0)
    height = high[0] + shares[:, 2] * (high[1] - high[0])
    pace = np.resize(_PACES, count) * PACE / database.control_rate
    way = 2.0 * math.pi * ((0.5 + np.arange(count) * _GOLDEN) % 1.0)
    heading = 2.0 * math.pi * ((0.5 + np.arange(count) * _ROOT_TWO) % 1.0) - math.pi
    columns = distance * np.sin(bearing), height, distance * np.cos(bearing), pace * np.sin(way), pace * np.cos(way)
    soon = WARNING * database.control_rate * ((0.5 + np.arange(count) * _ROOT_THREE) % 1.0)
    impact = np.where(np.arange(count) % 4 < 2, soon, UNSEEN_STRIKE)
    return np.stack([*columns, heading, impact], axis=-1)


@dataclass(frozen=True)
class Observed:
    """What axes take their ranges from where a recipe names none: a behaviour and the motion."""

    spec: BehaviourSpec
    database: MotionDatabase

    def beyond_strikes(self) -> float:
        """Return how far away a target is worth seeing: what strikes reach, and a step [m]."""
        check_strikes(self.database)
        places = np.asarray(self.database.strike_positions, dtype=float)
        reach = float(np.percentile(np.hypot(places[:, 0], places[:, 2]), 98.0))
        tolerance = max((term.tolerance for term in self.spec.rewards if isinstance(term, StrikeTerm)), default=0.0)
        return round(reach + self.database.body.torso_radius + tolerance + self.spec.beyond, 3)

    def head_heights(self) -> tuple[float, float]:
        """Return how low and how high heads are, but for the lowest and the highest hundredth [m]."""
        low, high = np.percentile(np.asarray(self.database.head_heights, dtype=float), [1.0, 99.0])
        return round(float(low), 3), round(float(high), 3)

    def pace(self) -> float:
        """Return how fast bodies move over the ground, but for the fastest twentieth [m a control frame]."""
        ground, stride = np.asarray(self.database.ground, dtype=float), self.database.stride
        steps = np.hypot(*(ground[stride:, :2] - ground[:-stride, :2]).T)
        inside = np.ones(len(steps), bool)
        for start in np.asarray(self.database.clip_starts[1:-1], np.int64) * stride:
            inside[max(start - stride, 0) : start] = False
        return round(float(np.percentile(steps[inside], 95.0)), 4)

    def longest_warning(self) -> float:
        """Return how long before a strike reaches furthest it is seen at most [control frames]."""
        return WARNING * self.database.control_rate


def resolve_grid(spec: BehaviourSpec, database: MotionDatabase) -> Grid:
    """Return the grid of a behaviour; ranges that its recipe leaves out come from the motion."""
    axes, motion = [], Observed(spec, database)
    for name, axis in spec.axes.given().items():
        kind = kind_named(name)
        unit = kind.grid_units(database.control_rate) if kind.time else 1.0
        low, high = (None if end is None else end * unit for end in (axis.minimum, axis.maximum))
        if axis.reach:
            least, greatest = getattr(strike_reach(database), name)
            low, high = (round(least, 3) if low is None else low), (round(greatest, 3) if high is None else high)
        wraps = kind.period > 0.0 and low is None and high is None and axis.count > 1
        low = kind.lowest(motion) if low is None else low
        high = kind.highest(motion) if high is None else high
        axes.append(Axis(name, low, high, axis.count, wraps, axis.fade * unit, (axis.stretch or 0.0) * unit))
    return build_grid(axes)


def _range(values: Array) -> tuple[float, float]:
    low, high = np.percentile(values, [5.0, 95.0])
    return float(low), float(high)
