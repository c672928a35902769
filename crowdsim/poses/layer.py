"""A layer of poses: what it reads of other avatars, what it plans for a part of a take, how it adds that to poses."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.motion.body import Body
from crowdsim.poses.hits import Landed
from crowdsim.poses.kernels.records import Moments, Playback, Posed
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.window import Window

Joints = tuple[Array, Body, Array, Array, Array]
"""Joints of some of the avatars asked for: which of them (n,), body, sizes (n,), positions (n, J, 3) [m] and rotations
(n, J, 4) in the world."""
Result = TypeVar("Result")
EVERYWHERE = 1_000
"""Hops of a layer that counts however far away an avatar is."""


class Part:
    """Avatars of one policy, each at its own time or all at the same times, that are to be posed.

    Attributes:
        policy: Number of the policy.
        window: The stretch of the take.
        moments: Which of its avatars, and when.
        layers: Names of the layers that pose them.
        hops: How many avatars lie between these and those that are shown: 0 for these themselves, 1 for those that
            their fists hit.
        without: Names of layers that are planned from these poses.
        plans: What each layer so far has planned, by its name.
        noted: What a ``Reader`` has noted of each time and avatar that is posed, by its name. Shape (T, n, ...) each.
    """

    def __init__(
        self,
        policy: int,
        window: Window,
        moments: Moments,
        layers: tuple[str, ...],
        hops: int,
        without: tuple[str, ...] = (),
    ) -> None:
        self.policy, self.window, self.moments, self.layers, self.hops = policy, window, moments, layers, hops
        self.without = without
        self.plans: dict[str, Any] = {}
        self.noted: dict[str, Array] = {}

    @cached_property
    def playback(self) -> Playback:
        """Where the avatars are."""
        return self.window.playback(self.moments)

    @cached_property
    def columns(self) -> Array:
        """Columns of the window that are posed, ascending."""
        return np.unique(self.moments.columns)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        return float(self.moments.times.min()), float(self.moments.times.max())

    def of(self, times: Array, columns: Array) -> Part:
        """Return some of it: rows of times and places of avatars, both by index."""
        part = Part(self.policy, self.window, self.moments, self.layers, self.hops, self.without)
        part.moments = Moments(self.moments.columns[columns], self.moments.times[times])
        part.playback = Playback(*(narrowed(values, times, columns) for values in self.playback))
        part.plans = self.plans.copy()
        part.noted = {name: narrowed(values, times, columns) for name, values in self.noted.items()}
        return part


class Scheduler(Protocol):
    """What layers ask for: the take, and poses of others; see ``poser.Poser``."""

    take: TakeData
    motions: Sequence[PoseMotion]
    reactions: bool
    coarse: frozenset[str]
    recorded: Landed
    landed: Landed

    @property
    def threads(self) -> int:
        """Threads that work on avatars may use here."""

    def joints(self, avatars: Array, times: Array, through: str = "", hops: int = 0) -> list[Joints]:
        """Return joints of avatars (E,) at times (E,), each at its own, with the layers up to one of them."""

    def each_at(
        self,
        avatars: Array,
        times: Array,
        through: str = "",
        without: tuple[str, ...] = (),
        motions: Sequence[PoseMotion] | None = None,
    ) -> Iterator[tuple[Part, Array]]:
        """Yield parts of avatars (n,) at times (T, n), each at its own, and which of them they are."""

    def pose(self, part: Part) -> Posed:
        """Return the poses of a part."""

    def stretch(
        self,
        use: Callable[[Block], Result],
        avatars: Array,
        times: Array,
        through: str = "",
        without: tuple[str, ...] = (),
        motions: Sequence[PoseMotion] | None = None,
    ) -> list[Result]:
        """Pose avatars (n,), ascending, at the same times (T,), with the layers up to one of them."""


class Layer:
    """Something that is added to poses.

    Attributes:
        name: Its name.
        reach: How far around its time a pose reads the take for it [s].
        needs: Which layers of other avatars it reads: each stands for itself and all layers before it. A layer that
            reads itself does so one hop further on.
        looks: How long before and after its time it reads them [s].
        hops: Up to how many hops away it counts.
        size: How far this layer moves any point of 99 of 100 bodies at most [m]; measured on ``crowd_10k``, as the next
            two are.
        reading: How far it moves them at most that others are read with more than their blends; ``reading_of`` its
            name stands for that where layers are left out.
        sparse: How far it moves them at most that it is planned at all times rather than at fewer ones; ``times_of``
            its name stands for that where layers are left out.
    """

    name: ClassVar[str]
    reach: ClassVar[float] = 0.0
    needs: tuple[str, ...] = ()
    looks: ClassVar[tuple[float, float]] = (0.0, 0.0)
    hops: ClassVar[int] = EVERYWHERE
    size: ClassVar[float] = math.inf
    reading: ClassVar[float] = math.inf
    sparse: ClassVar[float] = math.inf

    def __init__(self, poser: Scheduler) -> None:
        self.poser = poser

    def prepare(self, avatars: Array, first: float, last: float) -> None:
        """Find out at once what many parts need to know of avatars (n,), ascending, from a time to another one [s]."""

    def plan(self, part: Part) -> Any:
        """Return what ``apply`` and later layers need to know of a part of the take."""

    def apply(self, part: Part, poses: Posed) -> None:
        """Add the layer to poses, in place; ``part.plans[self.name]`` is what was planned."""


def reading_of(name: str) -> str:
    """Return the name under which what a layer reads of others is left out, but for their blends."""
    return f"{name} of others"


def times_of(name: str) -> str:
    """Return the name under which the times are left out at which a layer is planned from far away without them."""
    return f"times of {name}"


class Block(NamedTuple):
    """Some of the avatars asked for, all at the same times, and their poses.

    Attributes:
        which: Which of them. Shape (n,).
        part: Who and when.
        poses: Their poses.
    """

    which: Array
    part: Part
    poses: Posed

    def joints(self, times: Array) -> tuple[Array, Array]:
        """Return positions (T, n, J, 3) [m] and rotations (T, n, J, 4) of joints at some of the times."""
        poses = Posed(self.poses.roots[times], self.poses.rotations[times])
        return self.part.window.world_joints(poses, self.part.moments.columns)

    def of(self, times: Array, columns: Array, which: Array) -> Block:
        """Return some of it: rows of times, and places of avatars that are ``which`` of those asked for."""
        poses = Posed(*(narrowed(values, times, columns) for values in self.poses))
        return Block(which, self.part.of(times, columns), poses)


def narrowed(values: Array, times: Array, columns: Array) -> Array:
    """Return rows and columns of values (T, n, ...), both by strictly ascending index; a view where all follow."""
    if len(columns) < values.shape[1]:
        return values[times[:, None], columns]
    first, stop = int(times[0]), int(times[-1]) + 1
    return values[first:stop] if stop - first == len(times) else values[times]


class Reader(Layer, ABC):
    """A layer that reads avatars nearby at times of its own around a pose, as the layers before it leave them.

    The poser has these posed along with those that are asked for.
    """

    @abstractmethod
    def lacking(self, avatars: Array, times: Array) -> tuple[Array, Array]:
        """Return avatars and times, both ascending, that have to be posed before it for avatars (n,) at times (T,)."""

    @abstractmethod
    def note(self, avatars: Array, posed: Array, times: Array, blocks: list[Block]) -> None:
        """Plan for avatars (n,) from poses of others (m,) around them at times (T,), both ascending."""
