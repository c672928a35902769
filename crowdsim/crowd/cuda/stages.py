"""One control frame on a GPU, stage by stage; the avatars stay there while nothing else asks for them.

What only happens now and then is done by the processor, on its own copy of the avatars: they are sorted, events change
them, and strikes hurt them. ``fetch`` makes that copy valid, and the next frame begins with sending it back.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter_ns
from typing import Any

import numpy as np
from numba import cuda

from crowdsim.core.types import Array, Progress
from crowdsim.crowd.arrays import Avatars, Model, Record, World
from crowdsim.crowd.buffers import empty_record, empty_scratch, empty_strikes
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.cuda.binaries import launch, load_threads
from crowdsim.crowd.cuda.memory import all_to_device, empty, free_memory, read, size_of, to_device, write
from crowdsim.crowd.cuda.threads import COUNTERS, DUE, LOST, THROWN, Search, Work
from crowdsim.crowd.kernels.layout import Now, Observed
from crowdsim.crowd.kernels.record import write_record
from crowdsim.crowd.kernels.records import STRIKE
from crowdsim.crowd.kernels.shown_motion import RENEWED
from crowdsim.crowd.opponents import GROWN, SORT_EVERY, TreeIndex, sides_of
from crowdsim.crowd.stages import Stages, lost_avatar
from crowdsim.crowd.workers import Workers
from crowdsim.errors import RunError

_TOGETHER = 1 << 16
"""Most avatars that decide at a time, each with scratch space of its own, about 5 kB."""
_LEAST = 32
"""Room for fewer would have another order in memory, for which threads would be compiled again."""
_NODES = 64
"""Nodes of a tree that a search has still to look at, at the most."""
_BLOCK_OF_NODES = 256
"""Threads of the block that fits inner nodes."""


class SortingIndex(TreeIndex):
    """A tree by which the processor sorts avatars; the GPU fits a tree of its own to where they are."""

    @property
    def is_planned(self) -> bool:
        """Whether avatars are sorted by the tree."""
        return self._tree is not None

    def extents(self) -> float:
        """Return the length of all sides of the leaves' boxes."""
        return self._extents()


class _OnProcessor(Stages):
    """The stages of a frame on the processor, of which a GPU leaves some to it."""

    def strike(self, world: World, now: Now) -> Array:
        """List the strikes thrown since the frame before, and hurt those whom they hit."""
        return self._strike(world, now)


class CudaStages:
    """The stages of a frame on a GPU; they do what ``stages.Stages`` does, to the same bytes.

    Args:
        crowd: The crowd.
        model: Its policies.
        avatars: Its avatars, the processor's copy.
        index: The tree by which that copy is sorted.
        workers: Threads of the processor.
        progress: Called with stage, done and total while kernels are compiled.

    Raises:
        RunError: The GPU does not have enough memory.
    """

    def __init__(
        self,
        crowd: Crowd,
        model: Model,
        avatars: Avatars,
        index: SortingIndex,
        workers: Workers,
        progress: Progress | None = None,
    ) -> None:
        self._crowd, self._model, self._avatars, self._index = crowd, model, avatars, index
        self._on_processor = _OnProcessor(crowd, model, avatars, index, workers)
        self._progress = progress
        # What hits do to avatars then is the processor's.
        self._hits_tell = len(avatars.conditions) > 0 or (len(model.falls) > 0 and crowd.crowding.back > 0.0)
        self._is_fetched = True
        self._depth, self._age, self._extent = -1, 0, 0.0
        self._work: Work | None = None
        self._threads: dict[str, Any] = {}

    @property
    def nbytes(self) -> int:
        """Memory of the stages."""
        return self._on_processor.nbytes + (
            0 if self._work is None else size_of(self._work) - size_of(self._work.model)
        )

    def fetch(self) -> None:
        """Make the processor's copy of the avatars valid, for others to read and to change before the next frame."""
        if not self._is_fetched:
            assert self._work is not None
            with _errors_of_gpu():
                for device, values in zip(self._work.avatars, self._avatars, strict=True):
                    read(device, values)
            self._is_fetched = True

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
            RunError: An avatar's position or values are not finite, or the GPU is lost; the message names the frame.
        """
        with _errors_of_gpu(now.frame):
            return self._run(world, now, fresh, rows, timings, moves)

    def _run(self, world: World, now: Now, fresh: Array, rows: Record, timings: Array, moves: bool) -> Array:
        clock = _Clock(len(timings) > 0)
        fresh = self._sort(now.present, fresh)
        work = self._begin(world, now, fresh)
        clock.lap()
        self._launch("renew_mark", len(self._avatars.marks) // RENEWED)
        everyone_decides = not moves or len(fresh) == now.present
        if everyone_decides:
            self._count(DUE, len(fresh))
            work = self._work = work._replace(due=work.fresh, fresh=work.due)
        else:
            self._launch("advance_avatar", now.present)
            self._launch("hold_avatar", len(fresh))
        deciding = int(self._counters(now)[DUE])
        clock.lap()
        self._launch("fit_leaf", 1 << self._depth)
        self._launch("fit_inner_nodes", 1, _BLOCK_OF_NODES)
        clock.lap()
        self._decide(deciding, clock)
        self._counters(now)
        self._launch("start_action", deciding)
        clock.lap()
        thrown = self._strike(now) if moves else empty_strikes(0)
        if len(thrown) and self._hits_tell:
            thrown = self._hurt(world, now)
        clock.lap()
        self._record(now, rows)
        clock.lap()
        if len(timings):
            begin, advance, index, observe, choose, switch, strikes, record = clock.laps
            timings[0] = begin + index, observe, choose, advance + switch, strikes, record
        return thrown

    def _sort(self, present: int, fresh: Array) -> Array:
        """Sort the avatars where the tree has grown, or others are present; return the slots of ``fresh`` then."""
        self._age += 1
        if self._index.is_planned and (self._age <= SORT_EVERY or self._extents() <= GROWN * self._extent):
            return fresh
        self.fetch()
        numbers = self._avatars.number[fresh]
        self._index.reset()
        self._index.update(self._avatars, present)
        self._depth, self._extent, self._age = self._index.fitted().depth, self._index.extents(), 0
        return np.sort(self._avatars.slot_of[numbers])

    def _extents(self) -> float:
        """Return the length of all sides of the leaves' boxes."""
        assert self._work is not None
        boxes = np.empty(self._work.search.boxes.shape, np.float32)
        read(self._work.search.boxes, boxes)
        return sides_of(boxes[1 << self._depth : 2 << self._depth])

    def _begin(self, world: World, now: Now, fresh: Array) -> Work:
        """Send what the frame needs that the GPU does not have yet."""
        if self._work is None:
            self._work = self._allocate(world)
            self._threads = load_threads(self._work, self._progress)
        elif self._is_fetched:
            for device, values in zip(self._work.avatars, self._avatars, strict=True):
                write(device, values)
        work = self._work
        shared = work.world
        for name in ("weights", "cohorts", "rules"):
            write(getattr(shared, name), getattr(world, name))
        if shared.targets.shape == world.targets.shape:
            write(shared.targets, world.targets)
        else:
            shared = shared._replace(targets=to_device(world.targets))
        search = work.search
        if len(search.boxes) != 2 << self._depth:
            search = search._replace(
                boxes=to_device(np.zeros((2 << self._depth, 4), np.float32)),
                box_teams=to_device(np.zeros(2 << self._depth, np.int32)),
            )
        if len(fresh):
            slots = np.zeros(self._crowd.count, np.int32)
            slots[: len(fresh)] = fresh
            write(work.fresh, slots)
        write(work.counters, np.zeros(COUNTERS, np.int32))
        self._is_fetched = False
        self._work = work._replace(world=shared, now=now, entered=len(fresh), search=search._replace(depth=self._depth))
        return self._work

    def _allocate(self, world: World) -> Work:
        """Return memory for all that threads read and write, once it is known that there is enough."""
        count, most = self._crowd.count, self._crowd.crowding.most
        rows = min(max(count, _LEAST), _TOGETHER)
        scratch = empty_scratch(self._model, most, 1)
        scratch = scratch._replace(starts=scratch.starts[:1])
        room = max(1024, count // 3)
        lists = 5 * 4 * count + (STRIKE.itemsize + 8) * room
        searching = (4 + 4 + 12 * most + 16 * _NODES) * rows
        needed = size_of((self._model, self._avatars, empty_record(1, count), world))
        needed += rows * size_of(scratch) + lists + searching + 40 * (2 << self._depth)
        if needed > free_memory():
            free = f"{free_memory() / 1e9:.1f} GB are free"
            raise RunError(
                f"{count:,} avatars need {needed / 1e9:.1f} GB of the GPU's memory, of which {free}; "
                "expected fewer avatars, or --device cpu"
            )

        def slots(value: int = 0) -> Any:
            return to_device(np.full(count, value, np.int32))

        return Work(
            model=all_to_device(self._model),
            avatars=all_to_device(self._avatars),
            world=all_to_device(world),
            now=Now(0, 1, 0),
            record=all_to_device(empty_record(1, count)),
            counters=to_device(np.zeros(COUNTERS, np.int32)),
            due=slots(),
            chosen=slots(),
            spare=slots(),
            fresh=slots(),
            entered=0,
            first=0,
            reach=float(self._crowd.crowding.reach),
            observed=Observed(empty((rows,), np.int32), empty((rows,), np.int32), empty((rows, most), np.int32)),
            search=Search(
                self._depth,
                to_device(np.zeros((2 << self._depth, 4), np.float32)),
                to_device(np.zeros(2 << self._depth, np.int32)),
                empty((rows, most), np.float64),
                empty((rows, _NODES), np.int64),
                empty((rows, _NODES), np.float64),
            ),
            scratch=type(scratch)(*(empty((rows, *values.shape), values.dtype) for values in scratch)),
            strikes=to_device(empty_strikes(room)),
            last_hits=slots(-1),
            hits_before=to_device(np.zeros(room, np.int32)),
        )

    def _launch(self, name: str, count: int, *block: int) -> None:
        assert self._work is not None
        launch(self._threads[name], self._work, count, *block)

    def _count(self, counter: int, value: int) -> None:
        """Set a counter, and the others to 0."""
        assert self._work is not None
        counters = np.zeros(COUNTERS, np.int32)
        counters[counter] = value
        write(self._work.counters, counters)

    def _counters(self, now: Now) -> Array:
        """Return the counters, as soon as all threads are done.

        Raises:
            RunError: An avatar's position or values are not finite.
        """
        assert self._work is not None
        counters = np.empty(COUNTERS, np.int32)
        read(self._work.counters, counters)
        if counters[LOST] > 0:
            self.fetch()
            raise lost_avatar(self._avatars, int(counters[LOST]) - 1, now.frame)
        return counters

    def _decide(self, deciding: int, clock: _Clock) -> None:
        """Let avatars observe and choose, as many at a time as there is scratch space for."""
        assert self._work is not None
        rows = len(self._work.observed.counts)
        spent = [0, 0]
        for first in range(0, deciding, rows):
            self._work = self._work._replace(first=first)
            count = min(rows, deciding - first)
            self._launch("find_neighbours", count)
            clock.lap()
            self._launch("observe_avatar", count)
            self._launch("evaluate_actions", count)
            self._launch("choose_action", count)
            clock.lap()
            choosing, finding = clock.laps.pop(), clock.laps.pop()
            spent[0], spent[1] = spent[0] + finding, spent[1] + choosing
        clock.laps += spent

    def _strike(self, now: Now) -> Array:
        """List the strikes thrown since the frame before; let those note them whom they hit, where that is all."""
        assert self._work is not None
        self._count(THROWN, 0)
        self._launch("throw_strikes", now.present)
        held = int(self._counters(now)[THROWN])
        if held > len(self._work.strikes):
            self._work = self._work._replace(
                strikes=to_device(empty_strikes(held)), hits_before=to_device(np.zeros(held, np.int32))
            )
            self._count(THROWN, 0)
            self._launch("throw_strikes", now.present)
        thrown = empty_strikes(held)
        if held:
            read(self._work.strikes[:held], thrown)
            if not self._hits_tell:
                self._launch("link_hit", held)
                self._launch("note_hits_of_avatar", held)
        return thrown

    def _hurt(self, world: World, now: Now) -> Array:
        """Let the processor work out what strikes do to those whom they hit; return the strikes that are left."""
        self.fetch()
        self._index.fitted()
        return self._on_processor.strike(world, now)

    def _record(self, now: Now, rows: Record) -> None:
        """Record the frame, by whichever has the avatars."""
        assert self._work is not None
        if self._is_fetched:
            write_record(self._model, self._avatars, rows, 0, 0, now.present)
            return
        if now.present < self._crowd.count:
            # What is written of absent avatars stays.
            for device, values in zip(self._work.record, rows, strict=True):
                write(device, values[:1])
        self._launch("record_avatar", now.present)
        for device, values in zip(self._work.record, rows, strict=True):
            read(device, values[:1])


class _Clock:
    """The time of stages, for which it waits until threads are done, if anyone wants to know.

    Attributes:
        laps: The time of each stage so far [ns].
    """

    def __init__(self, wanted: bool) -> None:
        self._wanted = wanted
        self.laps: list[int] = []
        self._since = perf_counter_ns()

    def lap(self) -> None:
        """Note the time since the last lap."""
        if self._wanted:
            cuda.synchronize()
        now = perf_counter_ns()
        self.laps.append(now - self._since)
        self._since = now


@contextmanager
def _errors_of_gpu(frame: int | None = None) -> Iterator[None]:
    """Raise as ``RunError`` what a GPU or its driver reports."""
    from crowdsim.crowd.cuda.device import driver_errors

    try:
        yield
    except driver_errors() as error:
        where = "" if frame is None else f" at control frame {frame}"
        raise RunError(
            f"the GPU failed{where}: {error}; the same command goes on from the last checkpoint, also with --device cpu"
        ) from error
