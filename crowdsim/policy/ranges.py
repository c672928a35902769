"""Ranges of grids from the data: where strikes reach, and how high heads are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.errors import MotionError, RecipeError
from crowdsim.motion.database import MotionDatabase
from crowdsim.policy.environment import Axis, Grid, build_grid
from crowdsim.policy.recipe import BehaviourSpec
from crowdsim.policy.rewards import StrikeTerm

Array = NDArray[Any]


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
    """Return the region that the strikes of a database reach.

    Raises:
        MotionError: There are no strikes; the message tells the highest speeds of the fists.
    """
    check_strikes(database)
    x, y, z = np.asarray(database.strike_places, dtype=float).T
    heads = np.asarray(database.heads[:, 1], dtype=float)
    return Reach(_range(np.hypot(x, z)), _range(np.arctan2(x, z)), _range(y), _range(heads))


def check_strikes(database: MotionDatabase) -> None:
    """Refuse motion without strikes.

    Raises:
        MotionError: There are none.
    """
    if len(database.strike_frames):
        return
    steps = np.linalg.norm(np.diff(np.asarray(database.fists, dtype=float), axis=0), axis=-1) * database.playback_rate
    inside = np.ones(len(steps), bool)
    inside[np.asarray(database.clip_starts[1:-1], dtype=np.int64) * database.stride - 1] = False
    fastest = steps[inside].max(axis=0) if inside.any() else np.zeros(2)
    raise MotionError(
        f"no strikes found in {database.seconds:.1f} s of motion, but a behaviour is rewarded for them: the fists move "
        f"at up to {fastest[0]:.1f} m/s (left) and {fastest[1]:.1f} m/s (right) in the body's frame"
    )


def resolve_grid(spec: BehaviourSpec, database: MotionDatabase) -> Grid:
    """Return the grid of a behaviour; ranges that its recipe leaves out come from the motion."""
    axes = []
    for name, axis in spec.axes.given().items():
        low, high = axis.minimum, axis.maximum
        wraps = name == "bearing" and low is None and high is None and axis.count > 1
        if name == "bearing":
            low, high = -math.pi if low is None else low, math.pi if high is None else high
        elif name == "distance":
            low = 0.0 if low is None else low
            high = _far(spec, database) if high is None else high
        elif name == "height":
            heads = np.percentile(np.asarray(database.heads[:, 1], dtype=float), [1.0, 99.0])
            low = round(float(heads[0]), 3) if low is None else low
            high = round(float(heads[1]), 3) if high is None else high
        if low is None or high is None:
            raise RecipeError(f"axis {name!r} has no range in the motion, expected a minimum and a maximum")
        axes.append(Axis(name, low, high, axis.count, wraps, axis.fade))
    return build_grid(axes)


def _far(spec: BehaviourSpec, database: MotionDatabase) -> float:
    """Return how far away a target is worth seeing: what strikes reach, and a step."""
    if not len(database.strike_places):
        check_strikes(database)
    places = np.asarray(database.strike_places, dtype=float)
    reach = float(np.percentile(np.hypot(places[:, 0], places[:, 2]), 98.0))
    tolerance = max((term.tolerance for term in spec.rewards if isinstance(term, StrikeTerm)), default=0.0)
    return round(reach + database.body.torso_radius + tolerance + spec.beyond, 3)


def _range(values: Array) -> tuple[float, float]:
    low, high = np.percentile(values, [5.0, 95.0])
    return float(low), float(high)
