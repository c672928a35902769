"""What events of a run wait for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from crowdsim.core.types import Array

EVERY_FRAME, STRIKES, KNOCK_DOWNS, NOTHING = range(4)
"""What a trigger must be looked at after: every frame, strikes, knock-downs; or it is known when it is due."""


class Observations(Protocol):
    """What triggers read of a run, see ``progress.Progress``."""

    frame: int
    landed: Array
    landed_on: Array
    ended: bool

    def downs_of(self, group: int) -> int:
        """Return how often avatars of a group, or of all with -1, have been knocked down."""

    def health_of(self, group: int) -> float:
        """Return the least health of an avatar of a group [points]."""

    def distance_of(self, one: int, other: int) -> float:
        """Return the least distance between avatars of two groups [m]."""


@dataclass(frozen=True)
class AtFrame:
    """At a control frame."""

    frame: int
    after: ClassVar[int] = NOTHING

    def is_due(self, now: Observations) -> bool:
        """Return whether it is time."""
        return now.frame >= self.frame


@dataclass(frozen=True)
class Landed:
    """When strikes have landed; of a team, or of all with -1."""

    count: int
    team: int = -1
    after: ClassVar[int] = STRIKES

    def is_due(self, now: Observations) -> bool:
        """Return whether it is time."""
        return _count(now.landed, self.team) >= self.count


@dataclass(frozen=True)
class LandedOn:
    """When strikes have landed on a group."""

    group: int
    count: int
    after: ClassVar[int] = STRIKES

    def is_due(self, now: Observations) -> bool:
        """Return whether it is time."""
        return _count(now.landed_on, self.group) >= self.count


@dataclass(frozen=True)
class Downs:
    """When avatars have been knocked down; of a group, or all with -1."""

    count: int
    group: int = -1
    after: ClassVar[int] = KNOCK_DOWNS

    def is_due(self, now: Observations) -> bool:
        """Return whether it is time."""
        return now.downs_of(self.group) >= self.count


@dataclass(frozen=True)
class HealthBelow:
    """When the health of an avatar of a group is below a number of points."""

    group: int
    points: float
    after: ClassVar[int] = STRIKES

    def is_due(self, now: Observations) -> bool:
        """Return whether it is time."""
        return now.health_of(self.group) < self.points


@dataclass(frozen=True)
class Near:
    """When avatars of two groups are nearer to each other than a distance [m]."""

    one: int
    other: int
    below: float
    after: ClassVar[int] = EVERY_FRAME

    def is_due(self, now: Observations) -> bool:
        """Return whether it is time."""
        return now.frame > 0 and now.distance_of(self.one, self.other) < self.below


@dataclass(frozen=True)
class Ended:
    """When what ends the run has come."""

    after: ClassVar[int] = NOTHING

    def is_due(self, now: Observations) -> bool:
        """Return whether it has."""
        return now.ended


Trigger = AtFrame | Landed | LandedOn | Downs | HealthBelow | Near | Ended


def _count(counts: Array, which: int) -> int:
    return int(counts.sum() if which < 0 else counts[which])
