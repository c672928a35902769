"""How far elbows, hands, knees, and feet in the air give way to other bodies, some 60 times a second."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.body import PARTS
from crowdsim.motion.strikers import CARRIERS
from crowdsim.poses.capsule_weights import ride_along
from crowdsim.poses.capsules import PosedBodies, capsule_body, capsule_order, size_capsules
from crowdsim.poses.down_state import fallen_rows, near_fallen
from crowdsim.poses.hits import by_column
from crowdsim.poses.kept import Kept
from crowdsim.poses.kernels.bending import Deflections, bend_limbs, smooth_moves
from crowdsim.poses.kernels.capsules import Capsules, place_bodies
from crowdsim.poses.kernels.deflection import MovingLimbs, deflect_limbs
from crowdsim.poses.kernels.limb_bounds import LIMBS
from crowdsim.poses.kernels.limb_moves import END, MOVED
from crowdsim.poses.kernels.records import Offsets, Posed
from crowdsim.poses.layer import Block, Part, Reader, Scheduler
from crowdsim.poses.layers.fists import Fists
from crowdsim.poses.layers.kicks import Kicks
from crowdsim.poses.neighbours import near_avatars
from crowdsim.poses.outlines import GLOVE_PADDING
from crowdsim.poses.together import each

_LANDS = 0.1
"""Time around a strike that lands in which the fist may be in what it hits [s]."""
_RATE = 60.0
"""How many times a second limbs are pushed out of bodies, nearly [Hz]: fists pass each other between control frames."""
_LIMBS = 1.4 * np.array([1.0, 12.0, 66.0, 220.0, 495.0, 792.0, 924.0, 792.0, 495.0, 220.0, 66.0, 12.0, 1.0]) / 4096.0
_FEET = 1.4 * np.array([1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0]) / 256.0
"""Weights of what is found for arms and knees, and for feet, at times that follow one another; it is exaggerated, since
smoothing lowers its peaks. A knee may have to go to one side of a leg at one time, to the other side at the next."""
_SPARSE, _FAR_OFF = np.array([-4, -2, 0, 2, 4]), 1.4 * np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
"""Times of the grid around one that is shown at which limbs are pushed out of bodies from far away, and their weights:
nearly the others' at half as many times."""
_CREEP, _WIDE = 0.06, 2
"""How far they go at the most [m], and how long they stay where they have to go, before and after [control frames]."""
_ASIDE, _BESIDE = 0.25, 1.4
"""How far they move at the most that a body is near which is down; and how near that is [m]."""
POSES_AT_ONCE, _TIMES_AT_ONCE, _FRAMES_AT_ONCE = 8_000, 4, 1024
"""Most poses that limbs are deflected in at once, but for so many times; and most frames for which others are posed."""


class _Bodies(NamedTuple):
    """What limbs are pushed out of, and what they are, at any time; n avatars of K capsules.

    Attributes:
        bodies: Those of each block, not posed.
        sizes: Radii, bounds and counts of their capsules.
        limbs: See ``MovingLimbs``. Shape (n, K).
        weights: Likewise. Shape (n, K, 2, 2).
    """

    bodies: list[PosedBodies]
    sizes: tuple[Array, Array, Array]
    limbs: Array
    weights: Array


class Deflection(Reader):
    """How far limbs give way.

    At each time of a grid limbs are pushed out of the bodies that are around; they follow a smooth path along these.
    What that leaves, since limbs do not follow it to the full or others do not do their part, is for another round.
    From far away they are pushed out of bodies half as often, and only around the times that are shown.

    Attributes:
        planted: How readily planted feet move, of feet in the air; 0 if they do not.
    """

    name = "deflection"
    size = 0.12
    sparse = 0.04
    needs = ("fists",)
    hops = 0
    planted = 0.3

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        take = poser.take
        self._riding = [ride_along(motion) for motion in poser.motions]
        self._shapes = [capsule_body(motion) for motion in poser.motions]
        self._fine = max(1, round(_RATE / take.control_rate))
        frames = max(take.frame_count - 1, 0) * self._fine + 1
        rate, shape = float(take.control_rate * self._fine), (LIMBS, MOVED, 3)
        self.moves = Kept(frames, rate, take.avatar_count, shape, self._find)
        self._sparse = self.name in poser.coarse
        self._is_on = take.collision_avoidance and take.avatar_count > 1

    def lacking(self, avatars: Array, times: Array) -> tuple[Array, Array]:
        """Return those nearby, and times of the grid, at which poses before it are needed."""
        if not self._is_on:
            return avatars, times
        if self._sparse:
            frames = np.unique(self._around(times))
            rows = frames[[0, -1]] // self._fine
            near = near_avatars(self.poser.take, avatars, int(rows[0]), int(rows[1]) + 2)
            return near, np.union1d(times, frames / self.moves.rate)
        frames, avatars_missing = self.moves.missing(self._frames(float(times[0]), float(times[-1])), avatars)
        if not len(frames):
            return avatars, times
        rows = frames // self._fine
        near = near_avatars(self.poser.take, avatars_missing, int(rows.min()), int(rows.max()) + 1)
        return np.union1d(avatars, near), np.union1d(times, frames / self.moves.rate)

    def note(self, avatars: Array, posed: Array, times: Array, blocks: list[Block]) -> None:
        """Find moves of avatars (n,) from poses of those around them (m,) at times of the grid among others (T,)."""
        if not self._is_on:
            return
        if self._sparse:
            self._note_shown(avatars, posed, times, blocks)
            return
        frames = np.rint(times * self.moves.rate).astype(np.int64)
        some = np.flatnonzero((frames / self.moves.rate == times) & (frames < self.moves.frames))
        if not len(some):
            return
        missing, avatars_missing = self.moves.missing(frames[some], avatars)
        if not len(missing):
            return
        some = some[np.isin(frames[some], missing, assume_unique=True)]

        known = self._bodies_of(posed, blocks)

        def find(here: Array) -> None:
            moves = self._deflect(times[here], avatars_missing, posed, blocks, here, known)
            self.moves.note(frames[here], avatars_missing, moves)

        at_once = max(_TIMES_AT_ONCE, POSES_AT_ONCE // len(posed))
        each(find, [some[low : low + at_once] for low in range(0, len(some), at_once)], self.poser.threads)

    def _note_shown(self, avatars: Array, posed: Array, times: Array, blocks: list[Block]) -> None:
        """Note moves of avatars (n,) at times (T,) from poses of those around them (m,) at times of the grid."""
        frames = np.rint(times * self.moves.rate).astype(np.int64)
        some = np.flatnonzero(frames / self.moves.rate == times)
        moves = np.empty((len(some), len(avatars), LIMBS, MOVED, 3), np.float32)
        known, at_once = self._bodies_of(posed, blocks), max(_TIMES_AT_ONCE, POSES_AT_ONCE // len(posed))

        def find(low: int) -> None:
            here = some[low : low + at_once]
            moves[low : low + at_once] = self._deflect(times[here], avatars, posed, blocks, here, known)

        each(find, range(0, len(some), at_once), self.poser.threads)
        # Those that are not shown may lack times around them.
        around = self._around(times)
        rows = np.flatnonzero(np.isin(around, frames[some]).all(axis=1))
        smooth = np.zeros((len(times), *moves.shape[1:]), np.float32)
        for place, weight in zip(np.searchsorted(frames[some], around[rows]).T, _FAR_OFF, strict=True):
            smooth[rows] += np.float32(weight) * moves[place]
        for block in blocks:
            own = posed[block.which]
            asked = np.isin(own, avatars, assume_unique=True)
            noted = np.zeros((len(times), len(own), LIMBS, MOVED, 3), np.float32)
            noted[:, asked] = smooth[:, np.searchsorted(avatars, own[asked])]
            block.part.noted[self.name] = noted

    def _around(self, times: Array) -> Array:
        """Return the frames of the grid around times (T,) at which limbs are looked at from far away. Shape (T, 5)."""
        nearest = np.rint(times * self.moves.rate).astype(np.int64)
        return np.clip(nearest[:, None] + _SPARSE, 0, self.moves.frames - 1)

    def plan(self, part: Part) -> list[tuple[slice, Deflections]]:
        """Return how far limbs go in stretches of the times; nothing where none does."""
        if not self._is_on:
            return []
        return self._plan_shown(part) if self._sparse else self._plan_smooth(part)

    def _plan_shown(self, part: Part) -> list[tuple[slice, Deflections]]:
        found, strikes, planned = part.noted[self.name], self._strikes(part), []
        frames = np.floor(part.moments.times[:, 0] * self.poser.take.control_rate).astype(int)
        for row in np.flatnonzero(found.any(axis=(1, 2, 3, 4))):
            here, creeps = slice(row, row + 1), np.zeros((1, found.shape[1], 2, 3), found.dtype)
            if self.planted:
                furthest = self._furthest(frames[here], part.window.avatars[part.columns])
                creeps = _creep(found[here, :, 2:, END], furthest)
            # Of one row a spline is what is in that, at any time.
            moves, slow = (Offsets(_spread(values, part), 0, 1.0) for values in (found[here], creeps))
            planned.append((here, Deflections(moves, slow, *strikes)))
        return planned

    def _plan_smooth(self, part: Part) -> list[tuple[slice, Deflections]]:
        window, (first, last) = part.window, part.span
        avatars, frames = window.avatars[part.columns], self._frames(first, last)
        found = self.moves.rows(frames, avatars)
        if not found.any():
            return []
        # Where a take begins and ends, its first and its last time stand for those beyond.
        grid, slow, rate = self._grid(first, last), self._slow(first, last), self.poser.take.control_rate
        fast = found if len(grid) == len(frames) else found[np.searchsorted(frames, grid)]
        shown = self.moves.around(first, last)
        moves = np.zeros((len(shown), len(window.avatars), LIMBS, MOVED, 3), np.float32)
        numbers = fast.reshape(len(fast), len(avatars), -1), moves.reshape(len(shown), len(window.avatars), -1)
        share(len(avatars), smooth_moves, numbers[0], shown - grid[0], _LIMBS, _FEET, part.columns, numbers[1],
              threads=window.threads)  # fmt: skip
        if len(slow):
            feet = found[np.searchsorted(frames, slow * self._fine)][:, :, 2:, END]
            creeps = _creep(feet, self._furthest(slow, avatars))
        else:
            slow, creeps = np.zeros(1, np.int64), np.zeros((1, found.shape[1], 2, 3), found.dtype)
        deflections = Deflections(
            Offsets(moves, int(shown[0]), self.moves.rate),
            Offsets(_spread(creeps, part), int(slow[0]), float(rate)),
            *self._strikes(part),
        )
        return [(slice(None), deflections)]

    def _strikes(self, part: Part) -> tuple[Array, Array, Array]:
        """Return strikes that land, as ``Deflections`` has them."""
        columns = part.window.columns()
        near = self.poser.landed.around(*part.span, columns)
        near = near.of(~near.missed)
        order, starts = by_column(columns[near.attackers], len(part.window.avatars), near.times)
        return starts, near.times[order], CARRIERS[near.limbs[order]]

    def _furthest(self, rows: Array, avatars: Array) -> Array:
        """Return how far planted feet of avatars (n,) go at the most at control frames (R,) [m]. Shape (R, n)."""
        beside = near_fallen(self.poser.take, self.poser.motions, rows[0], rows[-1] + 1, avatars, _BESIDE)
        return np.where(beside, _ASIDE, _CREEP)

    def apply(self, part: Part, poses: Posed) -> None:
        """Let limbs go."""
        window, motion = part.window, part.window.motion
        for rows, deflections in part.plans[self.name]:
            moments, some = part.moments._replace(times=part.moments.times[rows]), Posed(*(one[rows] for one in poses))
            share(len(moments.columns), bend_limbs, moments, deflections, window.foot_plants,
                  window.rows.sizes, motion.arms, motion.legs, some, threads=window.threads)  # fmt: skip

    def _grid(self, first: float, last: float) -> Array:
        """Frames of the grid that limbs depend on from a time to another one."""
        shown, around = self.moves.around(first, last), len(_LIMBS) // 2
        return np.arange(max(int(shown[0]) - around, 0), min(int(shown[-1]) + 1 + around, self.moves.frames))

    def _slow(self, first: float, last: float) -> Array:
        """Control frames that planted feet depend on, if they move."""
        if not self.planted:
            return np.zeros(0, np.int64)
        rate = self.poser.take.control_rate
        low, high = int(first * rate) - 1 - _WIDE, int(last * rate) + 2 + _WIDE
        return np.arange(max(low, 0), min(high, self.poser.take.frame_count - 1) + 1)

    def _frames(self, first: float, last: float) -> Array:
        """Frames of the grid that poses depend on from a time to another one."""
        return np.union1d(self._grid(first, last), self._slow(first, last) * self._fine)

    def _find(self, frames: Array, avatars: Array) -> Array:
        """Find moves of avatars (n,) at frames of the grid (R,). Shape (R, n, 4, 2, 3), float32."""
        found = np.zeros((len(frames), len(avatars), LIMBS, MOVED, 3), np.float32)
        rows = frames // self._fine
        for low in range(0, len(frames), _FRAMES_AT_ONCE):
            here = slice(low, low + _FRAMES_AT_ONCE)
            times = frames[here] / self.moves.rate
            near = near_avatars(self.poser.take, avatars, int(rows[here].min()), int(rows[here].max()) + 1)
            blocks = self.poser.stretch(lambda block: block, near, times, self.needs[0])
            at_once, known = max(_TIMES_AT_ONCE, POSES_AT_ONCE // len(near)), self._bodies_of(near, blocks)
            for at in range(0, len(times), at_once):
                some = np.arange(at, min(at + at_once, len(times)))
                found[here][some] = self._deflect(times[some], avatars, near, blocks, some, known)
        return found

    def _bodies_of(self, near: Array, blocks: list[Block]) -> _Bodies:
        """What there is to know of avatars (n,), however they are posed."""
        cast, bodies, unknown = self.poser.take.cast, [], np.empty(0)
        scales, girths = np.asarray(cast.scales, dtype=np.float64)[near], np.asarray(cast.girths, dtype=float)[near]
        for block in blocks:
            which, body = block.which, self.poser.motions[block.part.policy].body
            lengths = cast.stretches[near[which]]
            bodies.append(PosedBodies(body, which, scales[which], girths[which], lengths, unknown, unknown))
        sizes = size_capsules(bodies, len(near))
        for block in blocks:
            body = self.poser.motions[block.part.policy].body
            padded = np.flatnonzero(body.capsule_parts[capsule_order(body)] == PARTS.index("glove"))
            gloved = block.which[~cast.bare[near[block.which]], None]
            for values in sizes[:2]:
                values[gloved, padded] += (GLOVE_PADDING * scales[gloved]).reshape(-1, 1, *(1,) * (values.ndim - 2))
        limbs, weights = np.full(sizes[1].shape, -1, np.int64), np.zeros((*sizes[1].shape, MOVED, 2))
        for block in blocks:
            riding, along = self._riding[block.part.policy]
            own = np.arange(len(riding))
            limbs[block.which[:, None], own], weights[block.which[:, None], own] = riding, along
        return _Bodies(bodies, sizes, limbs, weights)

    def _deflect(
        self, times: Array, asked: Array, near: Array, blocks: list[Block], rows: Array, known: _Bodies
    ) -> Array:
        """Moves of avatars (M,) among those near them (n,) at times (T,), rows of blocks. Shape (T, M, 4, 2, 3)."""
        moves = np.zeros((len(times), len(asked), LIMBS, MOVED, 3), np.float32)
        if len(near) < 2:
            return moves
        take, motions, threads = self.poser.take, self.poser.motions, self.poser.threads
        frames = np.clip(np.rint(times * take.control_rate).astype(np.int64), 0, take.frame_count - 1)
        down = fallen_rows(take, motions, int(frames.min()), int(frames.max()) + 1, near)
        # What bodies have no capsules for, or are in no block, is no number.
        ends = np.full((2, len(times), *known.sizes[1].shape, 3), np.nan, np.float32)
        joints = np.empty((len(times), len(near), LIMBS, 3, 3), np.float32)
        landed = self.poser.landed.between(times[0] - _LANDS, times[-1] + _LANDS)
        landed = landed.of(~landed.missed & (CARRIERS[landed.limbs] >= 0))
        limbs = MovingLimbs(
            joints,
            known.limbs,
            known.weights,
            _closeness(landed.attackers, CARRIERS[landed.limbs], landed.times, near, times),
            _closeness(*_struck_arms(blocks), near, times),
            np.ones((len(times), len(near), LIMBS)),
            np.ascontiguousarray(down[frames - frames.min()]),
        )
        for block, bodies in zip(blocks, known.bodies, strict=True):
            share(len(times) * len(block.which), place_bodies, rows, block.poses, self._shapes[block.part.policy],
                  bodies.scales, bodies.stretches, block.which, ends, joints, threads=threads)  # fmt: skip
            moments = block.part.moments
            freedom = block.part.window.free_feet(moments._replace(times=moments.times[rows]))
            limbs.freedom[:, block.which, 2:] = self.planted + (1.0 - self.planted) * freedom
        capsules = Capsules(ends[0], ends[1], *known.sizes)
        order = np.argsort(capsules.starts[:, :, 0, 0], axis=1, kind="stable")
        ranks, columns = np.empty_like(order), np.searchsorted(near, asked)
        np.put_along_axis(ranks, order, np.arange(len(near))[None], axis=1)
        # Those near one another come after one another, since they read the same.
        along = np.argsort(ranks[len(times) // 2, columns])
        columns = columns[along]
        share(len(times) * len(asked), deflect_limbs, capsules, limbs, order, ranks, columns, moves, threads=threads)
        return moves[:, np.argsort(along)]


class SecondDeflection(Deflection):
    """How far limbs give way to what the first round leaves; planted feet stay."""

    name = "second deflection"
    size = 0.04
    needs = ("deflection",)
    planted = 0.0


def _spread(values: Array, part: Part) -> Array:
    """Numbers of all avatars of a window, of those that are posed (R, n, ...)."""
    count = len(part.window.avatars)
    if len(part.columns) == count:
        return np.ascontiguousarray(values)
    result = np.zeros((len(values), count, *values.shape[2:]), values.dtype)
    result[:, part.columns] = values
    return result


def _creep(moves: Array, furthest: Array) -> Array:
    """How far planted feet go: the longest of moves (R, n, 2, 3) in the rows around each, at the most ``furthest``."""
    longest, lengths = moves.copy(), np.sum(moves**2, axis=-1)
    most = lengths.copy()
    for apart in range(1, min(_WIDE, len(moves) - 1) + 1):
        for one, other in ((slice(apart, None), slice(None, -apart)), (slice(None, -apart), slice(apart, None))):
            further = lengths[other] > most[one]
            longest[one] = np.where(further[..., None], moves[other], longest[one])
            most[one] = np.maximum(lengths[other], most[one])
    far = np.sqrt(most)[..., None] / furthest[:, :, None, None].astype(moves.dtype)
    return np.asarray(longest * (1.0 + far**4) ** -0.25)


def _struck_arms(blocks: list[Block]) -> tuple[Array, Array, Array]:
    """Return avatars on whose upper arms strikes land, which of their arms that are, and when [s]. Shapes (E,)."""
    planned = [block.part.plans.get(name) for block in blocks for name in (Kicks.name, Fists.name)]
    none = np.zeros(0, np.int64), np.zeros(0)
    found = [none, *((one.struck, one.times) for one in planned if one is not None)]
    struck, times = (np.concatenate(values) for values in zip(*found, strict=True))
    return struck[struck >= 0] // 2, struck[struck >= 0] % 2, times[struck >= 0]


def _closeness(struck: Array, limbs: Array, when: Array, avatars: Array, times: Array) -> Array:
    """Return how close limbs of avatars (n,) are at times (T,) to what happens to them, from 0 to 1. Shape (T, n, 4).

    Args:
        struck: Avatars to which something happens. Shape (E,).
        limbs: To which of their limbs. Shape (E,).
        when: When [s]. Shape (E,).
        avatars: Those that are asked for, ascending.
        times: Likewise [s].
    """
    near = np.zeros((len(times), len(avatars), LIMBS))
    column = np.minimum(np.searchsorted(avatars, struck), len(avatars) - 1)
    around = (when > times[0] - _LANDS) & (when < times[-1] + _LANDS)
    known = np.flatnonzero((avatars[column] == struck) & around)
    if not len(known):
        return near
    limbs, which = np.unique(LIMBS * column[known] + limbs[known], return_inverse=True)
    known = known[np.argsort(which, kind="stable")]
    close = np.clip(2.0 - 2.0 * np.abs(times[:, None] - when[known]) / _LANDS, 0.0, 1.0)
    firsts = np.searchsorted(np.sort(which), np.arange(len(limbs)))
    near[:, limbs // LIMBS, limbs % LIMBS] = np.maximum.reduceat(close, firsts, axis=1)
    return near
