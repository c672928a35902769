"""What moves are made of: parts that single channels play, in phases of the move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.performer.score import Channel


@dataclass(frozen=True)
class Part:
    """A part that one channel plays: up from ``start`` to ``peak``, held until ``fall``, gone at ``end``, in phases.

    Phase 0 is the beginning of a move, 1 its height (a punch's hit), 2 its end.
    """

    channel: Channel
    size: float
    start: float
    peak: float
    fall: float
    end: float


@dataclass(frozen=True)
class Punch:
    """A kind of punch.

    Attributes:
        hand: LEAD or REAR.
        parts: What the body does.
        bearing: Middle and spread of the target's bearing in the stance frame [rad].
        distance: Least and greatest distance of the target from the pelvis over the ground [m].
        inside: Its least distance at close quarters, where the trunk leans back from it [m].
        head: Least and greatest height of a target at the head [m].
        body: Least and greatest height of a target at the body [m].
        speed: Middle and spread of the fist's highest speed relative to the pelvis [m/s].
        extra: Length of the path out beyond the straight line from guard to target [m].
        skew: How late the fist is fastest.
        early: How long before phase 0 the arm begins to unfold, as a share of the path out.
    """

    hand: int
    parts: tuple[Part, ...]
    bearing: tuple[float, float]
    distance: tuple[float, float]
    head: tuple[float, float]
    body: tuple[float, float]
    speed: tuple[float, float]
    extra: float
    skew: float
    early: float
    inside: float = np.inf


@dataclass(frozen=True)
class Guarding:
    """A kind of defence: what the body does, and how long it takes to its height, there, and back [s]."""

    parts: tuple[Part, ...]
    seconds: tuple[float, float, float]
