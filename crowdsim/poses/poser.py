"""Poses avatars layer by layer, and those first that a layer reads.

Where a fist goes depends on the pose of whom it hits, and that on blows and on fists of its own. With each hop from one
avatar to the next fewer layers count, so that a pose depends on no more than a stretch of the take around it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.poses.hits import Landed, find_landed
from crowdsim.poses.kernels.records import Moments, Posed
from crowdsim.poses.layer import Block, Joints, Layer, Part, Reader, reading_of, times_of
from crowdsim.poses.layers import LAYERS
from crowdsim.poses.layers.blend import Blend
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.neighbours import near_avatars, tiles
from crowdsim.poses.together import each, threads_left
from crowdsim.poses.window import Window

Result = TypeVar("Result")
POSES_AT_ONCE, _TOGETHER = 64_000, 300_000
"""Most poses that layers work on at once, and most whose neighbours are posed with them at once."""
_AROUND = 40
"""Times around those asked for at which neighbours are posed, about."""
_STRETCH = 8.0
"""Length of stretches in which avatars are posed together, each at its own time [s]."""


class Poser:
    """Poses avatars of a take.

    Args:
        take: The take.
        motions: The motion of each of its policies.
        threads: Threads that share the work.
        reactions: Whether landed strikes move those whom they hit.
        without: Names of layers to leave out, also where a layer reads other avatars, and ``reading_of`` and
            ``times_of`` others.
        base: A poser of the same take with all layers; those that read none that is left out are shared with it.
        kinds: The layers, in the order in which they are added.

    Attributes:
        recorded: Strikes that land by the record.
        landed: These, and those that are found to be embedded in a body.
        coarse: Names of layers that are planned at fewer times.
    """

    def __init__(
        self,
        take: TakeData,
        motions: Sequence[PoseMotion],
        threads: int = 1,
        reactions: bool = True,
        without: frozenset[str] = frozenset(),
        base: Poser | None = None,
        kinds: Sequence[type[Layer]] = LAYERS,
    ) -> None:
        self.take, self.motions, self.reactions, self._threads = take, motions, reactions, threads
        self.recorded: Landed = find_landed(take) if base is None else base.recorded
        self.landed: Landed = self.recorded if base is None else base.landed
        self.coarse = frozenset(kind.name for kind in kinds if times_of(kind.name) in without)
        self._places = {name: place for place, kind in enumerate(kinds) for name in _names_of(kind)}
        self.layers: dict[str, Layer] = {}
        for kind in kinds:
            last, blind = max((self._places[need] for need in kind.needs), default=-1), reading_of(kind.name) in without
            shares = base is not None and not blind and kind.name not in self.coarse
            shares &= all(self._places[name] > last for name in without)
            if kind.name not in without:
                self.layers[kind.name] = base.layers[kind.name] if base is not None and shares else kind(self)
            if blind and kind.name not in without:
                self.layers[kind.name].needs = (Blend.name,)
        self._last = kinds[-1].name
        # How long before and after a time layers of others are read, one by way of another.
        self._read = {name: (0.0, 0.0) for name in self.layers}
        for name, layer in reversed(self.layers.items()):
            last = max((self._places[need] for need in layer.needs), default=-1)
            for other in self.layers:
                if other != name and self._places[other] <= last:
                    before, after = (on + more for on, more in zip(self._read[name], layer.looks, strict=True))
                    known = self._read[other]
                    self._read[other] = max(known[0], before), max(known[1], after)

    @property
    def threads(self) -> int:
        """Threads that work on avatars may use here."""
        return threads_left(self._threads)

    def part(
        self,
        policy: int,
        avatars: Array,
        moments: Moments,
        through: str = "",
        hops: int = 0,
        without: tuple[str, ...] = (),
        motions: Sequence[PoseMotion] | None = None,
    ) -> Part:
        """Return a policy's avatars (n,), ascending, as they are posed.

        Args:
            policy: Number of the policy.
            avatars: Avatars of the window.
            moments: Which of them are posed, and when.
            through: The last layer; that of all layers by default.
            hops: How many avatars lie between them and those that are shown.
            without: Layers that are left out.
            motions: Motion of each policy; that of all joints by default.
        """
        last = self._places[through or self._last]
        names = tuple(
            name
            for name, layer in self.layers.items()
            if self._places[name] <= last and layer.hops >= hops and name not in without
        )
        reach = max(self.layers[name].reach for name in names)
        return Part(policy, self.window(policy, avatars, moments.times, reach, motions), moments, names, hops, without)

    def window(
        self,
        policy: int,
        avatars: Array,
        times: Array,
        reach: float | None = None,
        motions: Sequence[PoseMotion] | None = None,
    ) -> Window:
        """Return the stretch of the take that poses of a policy's avatars (n,), ascending, at times [s] read."""
        reach = max(layer.reach for layer in self.layers.values()) if reach is None else reach
        rate = self.take.control_rate
        first = max(0, int(np.floor((times.min() - reach) * rate)))
        stop = min(self.take.frame_count, int(np.ceil((times.max() + reach) * rate)) + 2)
        return Window(self.take, (motions or self.motions)[policy], avatars, first, stop, self.threads)

    def pose(self, part: Part) -> Posed:
        """Return the poses of a part."""
        shape = part.playback.frames.shape
        joints = part.window.motion.skeleton.joint_count
        poses = Posed(np.empty((*shape, 3), np.float32), np.empty((*shape, joints, 4), np.float32))
        self._add(part, part.layers, poses)
        return poses

    def joints(self, avatars: Array, times: Array, through: str = "", hops: int = 0) -> list[Joints]:
        """Return joints of avatars (E,) at times (E,), each at its own, with the layers up to one of them."""
        found = []
        for which, policy, numbers, moments in self.moments(avatars, times):
            part = self.part(policy, numbers, moments, through, hops)
            positions, rotations = part.window.world_joints(self.pose(part), moments.columns)
            scales = part.window.rows.scales[moments.columns]
            found.append((which, part.window.motion.body, scales, positions[0], rotations[0]))
        return found

    def each_at(
        self,
        avatars: Array,
        times: Array,
        through: str = "",
        without: tuple[str, ...] = (),
        motions: Sequence[PoseMotion] | None = None,
    ) -> Iterator[tuple[Part, Array]]:
        """Yield parts of avatars (n,) at times (T, n), each at its own, ascending, and which of them they are."""
        for which, policy, numbers, moments in self.moments(avatars, times):
            yield self.part(policy, numbers, moments, through, without=without, motions=motions), which

    def moments(self, avatars: Array, times: Array) -> Iterator[tuple[Array, int, Array, Moments]]:
        """For each policy which of avatars (n,) at times (T, n) or (n,) are its own, its number, these, and when."""
        owners = self.take.cast.policies[avatars]
        for policy in np.unique(owners):
            which = np.flatnonzero(owners == policy)
            numbers, columns = np.unique(avatars[which], return_inverse=True)
            own = np.ascontiguousarray(np.atleast_2d(times)[:, which])
            yield which, int(policy), numbers, Moments(columns, np.maximum(own, 0.0))

    def shown(self, avatars: Array, times: Array) -> list[Joints]:
        """Return joints of avatars (E,) at times (E,), each at its own, as they are shown."""
        found, stretches = [], np.floor(times / _STRETCH)
        for stretch in np.unique(stretches):
            some = np.flatnonzero(stretches == stretch)
            for which, body, scales, positions, rotations in self.joints(avatars[some], times[some]):
                found.append((some[which], body, scales, positions, rotations))
        return found

    def stretch(
        self,
        use: Callable[[Block], Result],
        avatars: Array,
        times: Array,
        through: str = "",
        without: tuple[str, ...] = (),
        motions: Sequence[PoseMotion] | None = None,
    ) -> list[Result]:
        """Pose avatars (n,), ascending, at the same times (T,), some at once, with the layers up to one of them.

        Returns what ``use`` makes of each block of them; several are posed and used at a time. For blends and feet,
        ``motions`` of fewer joints will do, one for each policy.
        """
        owners, at_once = self.take.cast.policies[avatars], max(1, POSES_AT_ONCE // max(len(times), 1))
        # Those near one another read the same others.
        pieces = [
            (int(policy), some)
            for policy in np.unique(owners)
            for some in tiles(self.take, avatars[owners == policy], self._frame_at(times), at_once)
        ]

        def pose(piece: tuple[int, Array]) -> Result:
            policy, some = piece
            moments = Moments(np.arange(len(some)), times[:, None])
            part = self.part(policy, some, moments, through, without=without, motions=motions)
            return use(Block(np.searchsorted(avatars, some), part, self.pose(part)))

        return each(pose, pieces, self._threads)

    def captured(self, avatars: Array, times: Array) -> list[Block]:
        """Pose avatars (n,), ascending, at the same times (T,), as they were captured."""

        def capture(block: Block) -> Block:
            none = np.zeros(len(block.which) + 1, np.int64)
            block.part.plans[Blend.name] = block.part.window.transitions._replace(starts=none)
            self.layers[Blend.name].apply(block.part, block.poses)
            return block

        return self.stretch(capture, avatars, times, Blend.name)

    def sample(self, avatars: Array, times: Array) -> Iterator[Block]:
        """Pose avatars (n,), ascending, at the same times (T,), ascending, as they are shown; some at once."""
        if not len(times) or not len(avatars):
            return
        pieces = tiles(self.take, avatars, self._frame_at(times), max(_TOGETHER // (len(times) + _AROUND), 1))

        def pose(some: Array) -> list[Block]:
            which = np.searchsorted(avatars, some)
            return [block._replace(which=which[block.which]) for block in self._sample(some, times)]

        # A few at once: of all together the blocks take much memory.
        at_once = 4 * self._threads
        for low in range(0, len(pieces), at_once):
            for blocks in each(pose, pieces[low : low + at_once], self._threads):
                yield from blocks

    def _sample(self, avatars: Array, times: Array) -> list[Block]:
        """Pose avatars and, along with them, those nearby that layers read."""
        names = tuple(self.layers)
        readers = [(name, layer) for name in names if isinstance(layer := self.layers[name], Reader)]
        stages = [(avatars, times)]
        for _, reader in reversed(readers):
            stages.insert(0, reader.lacking(*stages[0]))
        starts = [*(names.index(name) for name, _ in readers), len(names)]
        self._prepare(*stages[0])
        blocks = self.stretch(lambda block: block, *stages[0], names[starts[0] - 1])
        for place, (_, reader) in enumerate(readers):
            now, then, added = stages[place], stages[place + 1], names[starts[place] : starts[place + 1]]
            reader.note(then[0], *now, blocks)
            blocks = [one for block in blocks if (one := _narrowed(block, now, then)) is not None]
            for block in blocks:
                block.part.layers += added
            each(lambda block: self._add(block.part, added, block.poses), blocks, self._threads)  # noqa: B023
        return blocks

    def _prepare(self, avatars: Array, times: Array) -> None:
        """Let layers plan at once what is read of avatars (n,) and of those around them about times (T,)."""
        rate, last = self.take.control_rate, self.take.frame_count - 1
        rows = np.clip([times[0] * rate, times[-1] * rate + 1.0], 0, last).astype(int)
        near = near_avatars(self.take, avatars, rows[0], rows[1] + 1)
        for name, layer in self.layers.items():
            before, after = self._read[name]
            first, stop = max(float(times[0]) - before, 0.0), min(float(times[-1]) + after, last / rate)
            layer.prepare(near, first, max(stop, first))

    def _frame_at(self, times: Array) -> int:
        """The control frame in the middle of times (T,)."""
        return min(int(times[len(times) // 2] * self.take.control_rate), self.take.frame_count - 1)

    def _add(self, part: Part, names: Sequence[str], poses: Posed) -> None:
        """Add layers to poses, in place."""
        for name in names:
            part.plans[name] = self.layers[name].plan(part)
            self.layers[name].apply(part, poses)


def _names_of(kind: type[Layer]) -> tuple[str, ...]:
    """Return the names by which a layer, or something of it, is left out."""
    return kind.name, reading_of(kind.name), times_of(kind.name)


def _narrowed(block: Block, now: tuple[Array, Array], then: tuple[Array, Array]) -> Block | None:
    """Return of a block of avatars and times ``now`` those that are wanted ``then``."""
    mine = now[0][block.which]
    columns = np.flatnonzero(np.isin(mine, then[0], assume_unique=True))
    if not len(columns):
        return None
    if len(columns) == len(mine) and len(now[1]) == len(then[1]):
        return block._replace(which=np.searchsorted(then[0], mine))
    return block.of(np.searchsorted(now[1], then[1]), columns, np.searchsorted(then[0], mine[columns]))
