"""What a scenario has planned: scripted targets, and events at a frame or on a condition."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crowdsim.core.types import Array


class TargetPath(Protocol):
    """Where a scripted target is."""

    def positions(self, seconds: Array) -> Array:
        """Return the target at given times [s] as points [m]. Shape (n, 3)."""


@dataclass(frozen=True)
class CirclePath:
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
class LinePath:
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


@dataclass(frozen=True)
class Change:
    """An event that happens once, before decisions, and changes the arrays of a crowd.

    Attributes:
        frame: Control frame at which it happens; None where a condition decides.
        strikes: With a condition: strikes that must have landed; 0 for none.
        team: Team that must have landed them, -1 for all together.
        near: With a condition: two groups, and the distance between them [m] that must be undercut.
        weights: New weights of behaviours; NaN leaves one as it is. Shape (M, B).
        temperatures: New temperatures, likewise. Shape (M,).
        hysteresis: New hysteresis [m], likewise. Shape (M,).
        who: Avatars that ``skip``, ``fixed`` and ``present`` concern. Shape (N,), bool.
        skip: Their new ``Crowd.skip``. Shape (N,).
        fixed: Their new ``Crowd.fixed``. Shape (N,).
        present: Whether they enter (True) or leave (False).
    """

    frame: int | None = None
    strikes: int = 0
    team: int = -1
    near: tuple[int, int, float] | None = None
    weights: Array | None = None
    temperatures: Array | None = None
    hysteresis: Array | None = None
    who: Array | None = None
    skip: Array | None = None
    fixed: Array | None = None
    present: bool | None = None


@dataclass(frozen=True)
class Script:
    """What a run has planned.

    Attributes:
        targets: Paths of scripted targets.
        changes: What happens during the run, in this order where several things happen at once.
    """

    targets: tuple[TargetPath, ...] = ()
    changes: tuple[Change, ...] = ()


class Agenda:
    """The changes of a script that have not happened yet, and what they wait for.

    Args:
        changes: The changes.
        teams: Number of teams.

    Attributes:
        pending: Numbers of the changes that have not happened yet.
        landed: Strikes that each team has landed. Shape (teams,).
    """

    def __init__(self, changes: Sequence[Change], teams: int) -> None:
        self._changes = tuple(changes)
        self.pending = list(range(len(self._changes)))
        self.landed = np.zeros(teams, np.int64)

    def until_next(self, frame: int, most: int) -> int:
        """Return how many frames can be run from ``frame`` on before something may happen, at most ``most``."""
        for number in self.pending:
            planned = self._changes[number].frame
            most = min(most, 1 if planned is None else max(planned - frame, 1))
        return most

    def count(self, teams: Array) -> None:
        """Count strikes that have landed, by the teams of their attackers. Shape (n,)."""
        if self.pending:
            self.landed += np.bincount(teams, minlength=len(self.landed))

    def due(self, frame: int, distance: Callable[[int, int], float]) -> Iterator[Change]:
        """Yield each change that is due, once; the next one is checked after it has been made.

        Args:
            frame: The control frame.
            distance: Returns the least distance between avatars of two groups [m].
        """
        for number in list(self.pending):
            change = self._changes[number]
            if self._is_time(change, frame, distance):
                self.pending.remove(number)
                yield change

    def _is_time(self, change: Change, frame: int, distance: Callable[[int, int], float]) -> bool:
        if change.frame is not None:
            return frame >= change.frame
        if change.near is not None:
            return frame > 0 and distance(change.near[0], change.near[1]) < change.near[2]
        landed = self.landed.sum() if change.team < 0 else self.landed[change.team]
        return bool(landed >= change.strikes > 0)


def target_positions(paths: Sequence[TargetPath], first: int, count: int, rate: float) -> Array:
    """Return where scripted targets are in ``count`` control frames from ``first`` on [m]. Shape (count, G, 3)."""
    seconds = np.arange(first, first + count) / rate
    if not paths:
        return np.zeros((count, 0, 3))
    return np.stack([path.positions(seconds) for path in paths], axis=1)
