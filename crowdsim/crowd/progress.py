"""What has happened in a run so far, as far as events may wait for it, and the events that have still to happen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, World, positions_of
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.entering import AGAIN, Arrival
from crowdsim.crowd.kernels.layout import LANDED, TRAVELS
from crowdsim.crowd.script import Change
from crowdsim.crowd.triggers import EVERY_FRAME, STRIKES, AtFrame

LED_EVERY = 3
"""After how many control frames avatars that travel are led on."""


class Progress:
    """What has happened in a run so far.

    Args:
        crowd: Its crowd.
        avatars: Its avatars.
        world: What they share.

    Attributes:
        frame: The control frame.
        present: How many avatars are there; these are in the first slots.
        landed: Strikes that each team has landed. Shape (teams,), int64.
        landed_on: Strikes that have landed on each group. Shape (groups,), int64.
        ended: Whether what ends the run has come.
    """

    def __init__(self, crowd: Crowd, avatars: Avatars, world: World) -> None:
        self._crowd, self._avatars, self._world = crowd, avatars, world
        self.frame, self.present, self.ended = 0, int(np.count_nonzero(crowd.present)), False
        self.landed = np.zeros(int(crowd.cast.teams.max(initial=0)) + 1, np.int64)
        self.landed_on = np.zeros(int(crowd.group.max(initial=0)) + 1, np.int64)

    def count(self, thrown: Array) -> None:
        """Count strikes (``records.STRIKE``) that have landed."""
        landed = thrown[thrown["outcome"] == LANDED]
        self.landed += np.bincount(self._crowd.cast.teams[landed["attacker"]], minlength=len(self.landed))
        victims = landed["victim"][landed["victim"] >= 0]
        self.landed_on += np.bincount(self._crowd.group[victims], minlength=len(self.landed_on))

    @property
    def downs(self) -> Array:
        """How often each avatar has been knocked down, by number. Shape (N,), or (0,) where none can be."""
        return self._avatars.conditions["downs"]

    def downs_of(self, group: int) -> int:
        """Return how often avatars of a group, or of all with -1, have been knocked down."""
        downs = self.downs
        if group >= 0 and len(downs):
            downs = downs[self._crowd.group == group]
        return int(downs.sum())

    @property
    def out(self) -> Array:
        """Which avatars are down for good, by number. Shape (N,), bool."""
        now = self._avatars.conditions
        if len(now) == 0:
            return np.zeros(self._crowd.count, bool)
        rules = self._world.rules[self._crowd.cohort]
        spent = (now["health"] <= 0.0) | (now["downs"] >= rules["most_downs"])
        out: Array = (rules["full_health"] > 0.0) & spent
        return out

    @property
    def travellers(self) -> Array:
        """Numbers of the avatars that travel along a path. Shape (n,)."""
        if not self._crowd.travels:
            return np.zeros(0, np.int64)
        return np.flatnonzero(self._avatars.conditions["mode"] == TRAVELS)

    @property
    def watches_out(self) -> bool:
        """Whether an avatar travels that fights as soon as it is attacked."""
        paths = np.unique(self._avatars.conditions["travel"][self.travellers]).astype(int)
        return any(self._crowd.travels[path - 1].ends_attacked for path in paths)

    @property
    def here(self) -> Array:
        """Which avatars are there, by number. Shape (N,), bool."""
        here = np.zeros(self._crowd.count, bool)
        here[self._avatars.number[: self.present]] = True
        return here

    def health_of(self, group: int) -> float:
        """Return the least health of an avatar of a group that can be hurt [points], inf where none can."""
        now = self._avatars.conditions
        if len(now) == 0:
            return float("inf")
        hurt = (self._crowd.group == group) & (self._world.rules["full_health"][self._crowd.cohort] > 0.0)
        return float(now["health"][hurt].min(initial=np.inf))

    def distance_of(self, one: int, other: int) -> float:
        """Return the least distance between avatars of two groups that are there [m]."""
        from scipy.spatial import cKDTree

        group = self._crowd.group[self._avatars.number[: self.present]]
        points = positions_of(self._avatars, slice(self.present))
        if not (group == one).any() or not (group == other).any():
            return float("inf")
        return float(cKDTree(points[group == one]).query(points[group == other])[0].min())


class Agenda:
    """The changes that have not happened yet, and what has happened in a run so far.

    Args:
        crowd: The crowd that they are planned for.
        progress: What has happened.

    Attributes:
        pending: Numbers of the changes that have not happened yet.
        waiting: Avatars that were added and have no room yet, and since which control frame.
        arrivals: Those that entered, or were put, later or elsewhere than they were to.
        expected: Avatars that are to enter later, and in which control frame.
        places: Of those that are put somewhere else: x and z [m], and the heading that they keep [rad].
        standing: Numbers of the changes by which avatars leave as soon as their health is low.
        progress: What has happened.
    """

    def __init__(self, crowd: Crowd, progress: Progress) -> None:
        self._changes, self._until = crowd.changes, crowd.until
        self.pending = list(range(len(self._changes)))
        self.waiting: dict[int, int] = {}
        self.arrivals: list[Arrival] = []
        self.expected: dict[int, int] = {}
        self.places: dict[int, tuple[float, float, float]] = {}
        self.standing: list[int] = []
        self.progress = progress

    def add(self, change: Change) -> None:
        """Plan another change, after those that are planned."""
        self.pending.append(len(self._changes))
        self._changes = (*self._changes, change)

    def until_next(self, frame: int, most: int) -> int:
        """Return how many frames can be run from ``frame`` on before something may happen, at most ``most``.

        What waits for strikes or knock-downs may happen earlier: a call ends in a frame that has any.
        """
        if self.waiting:
            most = min(most, AGAIN - frame % AGAIN)
        if self.expected:
            most = min(most, max(min(self.expected.values()) - frame, 1))
        if len(self.progress.travellers):
            most = min(most, LED_EVERY - frame % LED_EVERY)
        for number in self.pending:
            when = self._changes[number].when
            if when.after == EVERY_FRAME:
                return 1
            if isinstance(when, AtFrame):
                most = min(most, max(when.frame - frame, 1))
        return most

    def is_quiet(self, frame: int) -> bool:
        """Whether nothing can happen in a control frame, whatever avatars have done."""
        if self._until is not None or self.waiting or self.expected or self.standing:
            return False
        whens = (self._changes[number].when for number in self.pending)
        return all(isinstance(when, AtFrame) and when.frame > frame for when in whens)

    @property
    def waits_for_strikes(self) -> bool:
        """Whether something may happen because of a strike."""
        if self._until is not None and self._until.kind == "landed":
            return True
        if self.standing or self.progress.watches_out:
            return True
        return any(self._changes[number].when.after == STRIKES for number in self.pending)

    def due(self, kind: type = object) -> Iterator[Change]:
        """Yield each change that is due, once; the next one is checked after it has been made.

        ``kind`` is the class of triggers that are looked at.
        """
        for number in list(self.pending):
            change = self._changes[number]
            if isinstance(change.when, kind) and change.when.is_due(self.progress):
                self.pending.remove(number)
                if change.health_below is not None:
                    self.standing.append(number)
                yield change

    def expect(self, frame: int) -> bool:
        """Let avatars wait for room whose time to enter has come; return whether there are any."""
        due = [number for number, at in self.expected.items() if at <= frame]
        for number in due:
            self.waiting.setdefault(number, self.expected.pop(number))
        return bool(due)

    def forget(self, numbers: Iterable[int]) -> None:
        """Let avatars no longer enter."""
        for number in numbers:
            self.waiting.pop(number, None)
            self.expected.pop(number, None)
            self.places.pop(number, None)

    def retiring(self) -> Iterator[Change]:
        """Yield the changes by which avatars leave as soon as their health is low."""
        return (self._changes[number] for number in self.standing)

    def awaited(self, count: int) -> Array:
        """Return which of ``count`` avatars have still to enter. Shape (count,), bool."""
        awaited = np.zeros(count, bool)
        awaited[[*self.waiting, *self.expected]] = True
        for number in self.pending:
            change = self._changes[number]
            if change.present and change.who is not None:
                awaited |= change.who
        return awaited
