"""One control frame of a large crowd, stage by stage, each stage shared out among threads."""

from __future__ import annotations

from time import perf_counter_ns

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, Model, Record, World
from crowdsim.crowd.buffers import Scratch, empty_scratch, empty_strikes
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.kernels.advance import advance, switch
from crowdsim.crowd.kernels.decide import decide
from crowdsim.crowd.kernels.knock_downs import empty_room, knock_down
from crowdsim.crowd.kernels.layout import ENTERED, Now, Observed
from crowdsim.crowd.kernels.record import write_record
from crowdsim.crowd.kernels.records import THROWN
from crowdsim.crowd.kernels.resolve import list_strikes, resolve
from crowdsim.crowd.kernels.shown_motion import renew_marks
from crowdsim.crowd.kernels.staggers import NEIGHBOURS, SEES, list_thrown, stagger
from crowdsim.crowd.opponents import Index
from crowdsim.crowd.workers import Workers
from crowdsim.errors import RunError

_TOGETHER = 512
"""Most avatars of one thread that observe and choose together; what they read and note stays in a processor's cache."""

_DECISIONS = 256
"""Fewest decisions that are worth a range of their own, about 0.3 ms."""
_STARTS = 0.4
"""How far avatars move at the most as they start an action [m]."""


class Stages:
    """The stages of a frame.

    Args:
        crowd: The crowd.
        model: Its policies.
        avatars: Its avatars.
        index: Finds opponents and neighbours.
        workers: Threads.
    """

    def __init__(self, crowd: Crowd, model: Model, avatars: Avatars, index: Index, workers: Workers) -> None:
        self._crowding, self._model, self._avatars = crowd.crowding, model, avatars
        self._index, self._workers = index, workers
        self._rooms: list[tuple[Observed, Scratch]] = []

    @property
    def nbytes(self) -> int:
        """Memory of the stages."""
        return sum(values.nbytes for room in self._rooms for part in room for values in part)

    def run(self, world: World, now: Now, fresh: Array, rows: Record, timings: Array, moves: bool = True) -> Array:
        """Run a frame into the first of ``rows``, and return the strikes thrown since the frame before.

        Args:
            world: What avatars share.
            now: The frame.
            fresh: Slots of avatars that have just entered; they decide and do not move.
            rows: Where the frame is recorded.
            timings: Where the time of each stage is written [ns]. Shape (1 or more, 6), or (0, 6) for nowhere.
            moves: Whether the others move, and strike.

        Raises:
            RunError: An avatar's position or values are not finite; the message names avatar and frame.
        """
        avatars, model, workers = self._avatars, self._model, self._workers
        clock = [perf_counter_ns()]
        renew_marks(avatars.marks, now.frame)
        due = self._find_due(world, now, fresh) if moves else fresh
        clock.append(perf_counter_ns())
        before = avatars.number[due] if len(due) else due
        self._index.update(avatars, now.present)
        due = avatars.slot_of[before]
        due.sort()
        clock.append(perf_counter_ns())
        chosen = np.empty(len(due), np.int32)
        observing = self._decide(world, now, due, chosen)
        clock.append(perf_counter_ns())
        workers.each(lambda first, last: switch(model, avatars, world, now.frame, due, chosen, first, last), len(due))
        clock.append(perf_counter_ns())
        thrown = self._strike(world, now) if moves else empty_strikes(0)
        clock.append(perf_counter_ns())
        workers.each(lambda first, last: write_record(model, avatars, rows, 0, first, last), now.present)
        clock.append(perf_counter_ns())
        if len(timings):
            spent = np.diff(clock)
            timings[0] = (
                spent[1], int(spent[2] * observing), spent[2] - int(spent[2] * observing), spent[0] + spent[3],
                spent[4], spent[5],
            )  # fmt: skip
        return thrown

    def _find_due(self, world: World, now: Now, fresh: Array) -> Array:
        """Move everyone but ``fresh`` by one frame; return the slots of avatars that decide."""
        if len(fresh) == now.present:
            return fresh
        due = self._advance(world, now)
        if len(fresh):
            # They have not moved yet: they are at the end of the action that brings them in.
            motion, playback = self._avatars.motion, self._avatars.playback
            motion["phase"][fresh] = playback["phase_before"][fresh]
            playback["action_before"][fresh] = ENTERED
            due = np.union1d(due, fresh).astype(np.int32)
        return due

    def _advance(self, world: World, now: Now) -> Array:
        """Move everyone by one frame; return the slots of those whose action has ended."""
        found: dict[int, Array] = {}
        lost: list[int] = []

        def move(first: int, last: int) -> None:
            due = np.empty(last - first, np.int32)
            held = advance(self._model, self._avatars, world, now.frame, first, last, due, False)
            if held < 0:
                lost.append(-1 - held)
            found[first] = due[: max(held, 0)].copy()

        self._workers.each(move, now.present)
        if lost:
            raise lost_avatar(self._avatars, min(lost), now.frame)
        return np.concatenate([found[first] for first in sorted(found)])

    def _decide(self, world: World, now: Now, due: Array, chosen: Array) -> float:
        """Let avatars observe and choose; return the share of the time that observing took."""
        near = self._crowding
        lost: list[int] = []
        spent = [0, 1]

        def decide_some(first: int, last: int) -> None:
            observed, scratch = self._take_room()
            for start in range(first, last, _TOGETHER):
                some = due[start : min(start + _TOGETHER, last)]
                begun = perf_counter_ns()
                self._index.observe(self._avatars, some, near.reach, observed)
                seen = perf_counter_ns()
                slot = decide(
                    self._model, self._avatars, world, now, some, len(some), observed, scratch, chosen[start:last]
                )
                if slot >= 0:
                    lost.append(slot)
                spent[0] += seen - begun
                spent[1] += perf_counter_ns() - begun
            self._rooms.append((observed, scratch))

        self._workers.each(decide_some, len(due), grain=_DECISIONS)
        if lost:
            raise lost_avatar(self._avatars, min(lost, key=lambda slot: self._avatars.number[slot]), now.frame)
        return spent[0] / spent[1]

    def _take_room(self) -> tuple[Observed, Scratch]:
        """Return room for what avatars of one thread observe, and scratch space for their decisions."""
        try:
            return self._rooms.pop()
        except IndexError:  # other threads have all there are
            pass
        room, most = _TOGETHER, self._crowding.most
        observed = Observed(np.empty(room, np.int32), np.empty(room, np.int32), np.empty((room, most), np.int32))
        return observed, empty_scratch(self._model, most, room)

    def _strike(self, world: World, now: Now) -> Array:
        """List the strikes thrown since the frame before."""
        found: dict[int, Array] = {}

        def throw(first: int, last: int) -> None:
            room, who = 64 + (last - first) // 3, np.empty(last - first, np.int32)
            while True:
                strikes = empty_strikes(room)
                held = list_strikes(self._model, self._avatars, world, now, first, last, who, strikes, 0)
                if held <= room:
                    found[first] = strikes[:held]
                    return
                room = held

        self._workers.each(throw, now.present)
        thrown = np.concatenate([empty_strikes(0), *(found[first] for first in sorted(found))])
        felled, held = resolve(self._model, self._avatars, world, now.frame, thrown, 0, len(thrown))
        if felled > 0:
            observed, scratch = self._take_room()
            room = empty_room(self._model, self._crowding.most)
            knock_down(self._model, self._avatars, world, now, thrown, 0, held, self._index.fitted(), observed, room)
            self._rooms.append((observed, scratch))
        self._stagger(world, now, thrown[:held])
        return thrown[:held]

    def _stagger(self, world: World, now: Now, strikes: Array) -> None:
        """Let avatars stagger that strikes throw off their feet."""
        thrown = np.empty(len(strikes), THROWN)
        count = list_thrown(self._model, self._avatars, world, now, strikes, 0, len(strikes), thrown)
        if count:
            some = np.sort(thrown[:count], order="slot")
            neighbours = np.empty((count, NEIGHBOURS), np.int32)
            room = Observed(np.empty(count, np.int32), np.empty(count, np.int32), neighbours)
            # The index knows where avatars were before some of them started an action in this frame.
            self._index.observe(self._avatars, some["slot"], SEES + _STARTS, room)
            stagger(self._model, self._avatars, world, now, some, room)


def lost_avatar(avatars: Avatars, slot: int, frame: int) -> RunError:
    """Return the error of an avatar whose position or values are not finite."""
    avatar = int(avatars.number[slot])
    x, z = avatars.x[slot], avatars.z[slot]
    return RunError(
        f"avatar {avatar} at control frame {frame}: its position ({x:g}, {z:g}) or the values of its actions are not "
        "finite numbers; the policy's tables or motion are damaged"
    )
