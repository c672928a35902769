"""What a scenario has planned: scripted targets, and events at a frame or on a condition."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.triggers import Trigger
from crowdsim.scenario.fitness import LINGERS


class TargetPath(Protocol):
    """Where a scripted target is."""

    def positions(self, seconds: Array) -> Array:
        """Return the target at given times [s] as points [m]. Shape (n, 3)."""

    def at_first(self) -> TargetPath:
        """Return the path as it is known before the run begins."""

    def foreseen(self, seconds: Array, now: float) -> Array:
        """Return the target at given times [s] as far as avatars know it at a time [s]. Shape (n, 3)."""


class _KnownPath:
    """A path that everyone knows beforehand."""

    def at_first(self) -> TargetPath:
        """Return the path."""
        return self  # type: ignore[return-value]

    def foreseen(self, seconds: Array, now: float) -> Array:
        """Return the target at given times [s] as points [m]. Shape (n, 3)."""
        positions: Array = self.positions(seconds)  # type: ignore[attr-defined]
        return positions


@dataclass(frozen=True)
class CirclePath(_KnownPath):
    """A target that moves along a circle, from +z towards +x.

    Attributes:
        radius: Radius [m].
        speed: Speed along the circle [m/s].
        centre: Centre, x and z [m].
        height: Height [m].
    """

    radius: float
    speed: float
    centre: tuple[float, float]
    height: float

    def positions(self, seconds: Array) -> Array:
        """Return the target at given times [s] as points [m]. Shape (n, 3)."""
        angle = np.maximum(seconds, 0.0) * self.speed / self.radius
        x = self.centre[0] + self.radius * np.sin(angle)
        z = self.centre[1] + self.radius * np.cos(angle)
        return np.stack([x, np.full_like(x, self.height), z], axis=-1)


@dataclass(frozen=True)
class LinePath(_KnownPath):
    """A target that moves from point to point on straight lines.

    Attributes:
        points: Points, x and z each [m]. Shape (K, 2).
        speed: Speed along the lines [m/s].
        loop: Whether it goes on to the first point after the last.
        height: Height [m].
    """

    points: Array
    speed: float
    loop: bool
    height: float

    def positions(self, seconds: Array) -> Array:
        """Return the target at given times [s] as points [m]. Shape (n, 3)."""
        corners = np.asarray(self.points, dtype=float)
        if self.loop:
            corners = np.concatenate([corners, corners[:1]])
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        distance = np.maximum(seconds, 0.0) * self.speed
        if self.loop and along[-1] > 0.0:
            distance = np.mod(distance, along[-1])
        x, z = np.interp(distance, along, corners[:, 0]), np.interp(distance, along, corners[:, 1])
        return np.stack([x, np.full_like(x, self.height), z], axis=-1)


@dataclass
class KeyPath:
    """A target that goes straight from key to key, and that keys may be added to while it is followed.

    Attributes:
        rate: Control frames a second.
        frames: Control frames of its keys, ascending.
        points: Where it is then [m].
        before: How it moves before the first key.
    """

    rate: float
    frames: list[int]
    points: list[tuple[float, float, float]]
    before: TargetPath | None = None

    def positions(self, seconds: Array) -> Array:
        """Return the target at given times [s] as points [m]. Shape (n, 3)."""
        if not self.frames:
            assert self.before is not None
            return self.before.positions(seconds)
        # Times of control frames are exactly at keys.
        at = np.round(np.asarray(seconds) * self.rate, 6)
        found = np.stack([np.interp(at, self.frames, axis) for axis in zip(*self.points, strict=True)], axis=-1)
        if self.before is not None:
            early = at < self.frames[0]
            found[early] = self.before.positions(seconds[early])
        return found

    def at_first(self) -> TargetPath:
        """Return the path as it is known before the run begins."""
        return self.before or KeyPath(self.rate, self.frames[:1], self.points[:1])

    def foreseen(self, seconds: Array, now: float) -> Array:
        """Return the target at given times [s] where it is taken to stay where it is now. Shape (n, 3)."""
        if self.before is not None and (not self.frames or round(now * self.rate, 6) < self.frames[0]):
            return self.before.positions(seconds)
        return self.positions(np.minimum(seconds, now))

    def add(self, frame: int, point: tuple[float, float, float]) -> None:
        """Let the target be at a point from a control frame on; later keys are cut, earlier positions stay."""
        kept, first = bisect_left(self.frames, frame), max(0, frame - 1)
        if kept:
            # On its way to a key that is cut it has a key in each frame, so that positions stay to the last bit.
            first = self.frames[kept - 1] + 1 if kept < len(self.frames) else max(first, self.frames[-1] + 1)
        elif self.before is not None:
            first = frame
        way = self.positions(np.arange(first, frame) / self.rate).tolist() if first < frame else []
        self.frames[kept:] = range(first, frame + 1)
        self.points[kept:] = [*((x, y, z) for x, y, z in way), point]


@dataclass(frozen=True)
class Travel:
    """A path that avatars travel along, to enter or to leave.

    Attributes:
        points: Points of the path, x and z each [m]. Shape (K, 2).
        pace: How fast avatars of scale 1 travel [m in a control frame].
        ends_attacked: Whether an avatar fights as soon as another strikes at it.
        leaves: Whether avatars leave at the end; else they fight from there on.
        interval: Time between two avatars that enter [control frames].
        forms_up: Whether each avatar goes to where it is placed (``Crowd.x``), behind the last point.
    """

    points: Array
    pace: float
    ends_attacked: bool
    leaves: bool
    interval: float = 0.0
    forms_up: bool = False


@dataclass(frozen=True)
class Change:
    """An event that happens once, before decisions, and changes the arrays of a crowd.

    Attributes:
        when: What it waits for.
        weights: New weights of behaviours; NaN leaves one as it is. Shape (M, B).
        temperatures: New temperatures, likewise. Shape (M,).
        defences: New weights of the behaviour ``defend``, likewise. Shape (M,).
        intervals: New times to recover from a strike [control frames], likewise. Shape (M,).
        reactions: New times to see what an opponent has decided [control frames], likewise. Shape (M,).
        hysteresis: New hysteresis [m], likewise. Shape (M,).
        attackers: How many may attack one avatar from now on, likewise. Shape (M,).
        who: Avatars that what follows concerns. Shape (N,), bool.
        skip: Their new ``Crowd.skip``. Shape (N,).
        fixed: Their new ``Crowd.fixed``. Shape (N,).
        present: Whether they enter (True) or leave (False).
        mode: What they do about their opponents: ``layout.FIGHTS``, ``WATCHES``, ``FLEES`` or ``RESTS``.
        distance: The distance that those keep who watch or rest [m].
        travel: Index into ``Crowd.travels`` of the path that they leave by.
        health_below: Of those who leave: each does as soon as its health is below this [points]; at once when None.
        point: Where the one avatar is put, x and z [m].
        heals: Whether their health is restored.
    """

    when: Trigger
    weights: Array | None = None
    temperatures: Array | None = None
    defences: Array | None = None
    intervals: Array | None = None
    reactions: Array | None = None
    hysteresis: Array | None = None
    attackers: Array | None = None
    who: Array | None = None
    skip: Array | None = None
    fixed: Array | None = None
    present: bool | None = None
    mode: float | None = None
    distance: float = 0.0
    travel: int | None = None
    health_below: float | None = None
    point: tuple[float, float] | None = None
    heals: bool = False


@dataclass(frozen=True)
class End:
    """What ends a run early.

    Attributes:
        kind: ``last_standing``, ``last_team``, ``down`` or ``landed``.
        count: Of ``down`` and ``landed``: how many.
        lingers: For how long the run goes on once that is met [s].
    """

    kind: str
    count: int = 0
    lingers: float = LINGERS


def seen_targets(paths: Sequence[TargetPath], first: int, known: int, count: int, rate: float) -> Array:
    """Return where avatars take scripted targets to be in ``count`` control frames from ``first`` on [m].

    In the first ``known`` of them they know where all targets are; what comes then is foreseen from the last of these.
    Shape (count, G, 3).
    """
    now = np.arange(first, first + known)[-1] / rate
    seconds = np.arange(first, first + count) / rate
    return np.stack([path.foreseen(seconds, now) for path in paths], axis=1)


def target_positions(paths: Sequence[TargetPath], first: int, count: int, rate: float) -> Array:
    """Return where scripted targets are in ``count`` control frames from ``first`` on [m]. Shape (count, G, 3)."""
    seconds = np.arange(first, first + count) / rate
    if not paths:
        return np.zeros((count, 0, 3))
    return np.stack([path.positions(seconds) for path in paths], axis=1)
