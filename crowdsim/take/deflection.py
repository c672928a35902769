"""How far elbows, hands, knees, and feet in the air give way to other bodies, some 60 times a second."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.ndimage import correlate1d
from scipy.spatial import cKDTree

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.take.capsule_weights import ride_along
from crowdsim.take.capsules import PosedBodies, place_capsules
from crowdsim.take.data import TakeData
from crowdsim.take.down_state import fallen_rows, near_fallen
from crowdsim.take.hits import Landed, by_column
from crowdsim.take.kernels.bending import Deflections, bend_limbs
from crowdsim.take.kernels.deflection import MovingLimbs, deflect_limbs
from crowdsim.take.kernels.limb_bounds import LIMBS
from crowdsim.take.kernels.limb_moves import END, MOVED
from crowdsim.take.kernels.records import Moments, Posed
from crowdsim.take.motion import PoseMotion
from crowdsim.take.window import Window

AllJoints = list[tuple[int, Array, Array, Array, Array]]
"""Of some avatars at some times, for each policy its number, which of them (m,), positions (T, m, J, 3) [m] and
rotations (T, m, J, 4) of joints in the world, and how free their feet are to move (T, m, 2)."""
PoseAll = Callable[[Array, Array, Landed], AllJoints]
"""Poses avatars (n,), ascending, at times (T,), given the strikes that land."""

_AROUND = 3.1
"""Distance on the ground beyond which no two avatars touch [m]."""
_LANDS = 0.1
"""Time around a strike that lands in which the fist may be in what it hits [s]."""
_RATE = 60.0
"""How many times a second limbs are pushed out of bodies, nearly [Hz]: fists pass each other between control frames."""
_LIMBS = 1.4 * np.array([1.0, 12.0, 66.0, 220.0, 495.0, 792.0, 924.0, 792.0, 495.0, 220.0, 66.0, 12.0, 1.0]) / 4096.0
_FEET = 1.4 * np.array([1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0]) / 256.0
"""Weights of what is found for arms and knees, and for feet, at times that follow one another; it is exaggerated, since
smoothing lowers its peaks. A knee may have to go to one side of a leg at one time, to the other side at the next."""
PLANTED = 0.3, 0.0
"""How readily planted feet move, of feet in the air, in the first round of deflection and in the second."""
_CREEP, _WIDE = 0.06, 2
"""How far they go at the most [m], and how long they stay where they have to go, before and after [control frames]."""
_ASIDE, _BESIDE = 0.25, 1.4
"""How far they move at the most that a body is near which is down; and how near that is [m]."""
POSES_AT_ONCE = 16_000
"""Most poses that limbs are deflected in at once."""
_KEPT, _FEW = 64_000_000, 16
"""Numbers that are kept at the most; and frames that are kept of a crowd that is larger than that."""


class Deflection:
    """How far limbs give way.

    At each time of a grid limbs are pushed out of the bodies that are around; they follow a smooth path along these.
    What that leaves, since limbs do not follow it to the full or others do not do their part, is for another round.

    Args:
        take: The take.
        motions: The motion of each of its policies.
        pose_all: Poses avatars before limbs give way, or after the round before.
        threads: Threads that share the work.
        planted: How readily planted feet move, of feet in the air; 0 if they do not.
    """

    def __init__(
        self, take: TakeData, motions: Sequence[PoseMotion], pose_all: PoseAll, threads: int, planted: float
    ) -> None:
        self._take, self._pose_all, self._threads, self._planted = take, pose_all, threads, planted
        self._motions = motions
        self._scales = np.asarray(take.cast.scales, dtype=np.float64)
        self._girths = np.asarray(take.cast.girths, dtype=np.float64)
        self._stretches = take.cast.stretches
        self._riding = [ride_along(motion) for motion in motions]
        self._kept: dict[int, Array] = {}
        self._fine = max(1, round(_RATE / take.control_rate))
        self._rate = take.control_rate * self._fine
        self._count = max(take.frame_count - 1, 0) * self._fine + 1
        row = max(take.avatar_count * LIMBS * MOVED * 3, 1)
        self._whole = self._count * row <= _KEPT
        self._frames = self._count if self._whole else max(_KEPT // row, _FEW)

    def lacking(self, times: Array) -> Array:
        """Return times of the grid that limbs depend on at some times (T,), where moves are not known yet [s]."""
        frames = np.union1d(self._fast_frames(times), self._control_frames(times) * self._fine)
        return np.array([frame for frame in frames.tolist() if frame not in self._kept], float) / self._rate

    def note(self, times: Array, landed: Landed, posed: Callable[[Array], AllJoints]) -> None:
        """Find moves at those of some times (T,), ascending, that are of the grid, from poses that are there.

        Args:
            times: The times [s].
            landed: Strikes that land.
            posed: Returns the joints of all avatars at some of the times, given by index, before limbs give way.
        """
        frames = np.rint(times * self._rate).astype(np.int64)
        some = np.flatnonzero((frames / self._rate == times) & (frames < self._count))
        some = some[[int(frame) not in self._kept for frame in frames[some]]]
        everyone = np.arange(self._take.avatar_count)
        if not len(some) or len(some) * len(everyone) > POSES_AT_ONCE:
            return
        moves = self._deflect(times[some], everyone, everyone, posed(some), landed)
        self._kept.update(zip(frames[some].tolist(), moves, strict=True))

    def bend(self, window: Window, landed: Landed, moments: Moments, poses: Posed) -> None:
        """Deflect limbs of poses, in place.

        Args:
            window: The stretch of the take.
            landed: Strikes that land.
            moments: Who is posed, and when.
            poses: Their poses; rotations are changed.
        """
        times, columns = moments.times, window.columns()
        low, high = self._span(times)
        grid, slow = self._fast_frames(times), self._control_frames(times)
        frames = np.union1d(grid, slow * self._fine)
        found = self._rows(frames, window.avatars, landed)
        if not found.any():
            return
        # Where a take begins and ends, its first and its last time stand for those beyond.
        fast, first = found[np.searchsorted(frames, grid)], int(grid[0])
        moves = correlate1d(fast, _LIMBS, axis=0, mode="nearest")
        moves[:, :, 2:, END] = correlate1d(fast[:, :, 2:, END], _FEET, axis=0, mode="nearest")
        moves = moves[low - first : high - first]
        if len(slow):
            beside = near_fallen(self._take, self._motions, int(slow[0]), int(slow[-1]) + 1, window.avatars, _BESIDE)
            feet = found[np.searchsorted(frames, slow * self._fine)][:, :, 2:, END]
            creeps = _creep(feet, np.where(beside, _ASIDE, _CREEP))
        else:
            slow, creeps = np.zeros(1, np.int64), np.zeros((1, found.shape[1], 2, 3), found.dtype)
        near = landed.around(float(times.min()), float(times.max()), columns)
        near = near.of(~near.missed)
        order, starts = by_column(columns[near.attackers], len(window.avatars), near.times)
        control = float(self._take.control_rate)
        deflections = Deflections(
            moves, low, self._rate, creeps, int(slow[0]), control, starts, near.times[order], near.limbs[order]
        )
        motion, sizes, plants = window.motion, window.rows.sizes, window.foot_plants()

        def work(first: int, stop: int) -> None:
            bend_limbs(first, stop, moments, deflections, plants, sizes, motion.arms, motion.legs, poses)

        share(len(moments.columns), work, threads=window.threads)

    def _span(self, times: Array) -> tuple[int, int]:
        """First time of the grid that splines reach at some times, and one past the last."""
        return max(int(times.min() * self._rate) - 1, 0), min(int(times.max() * self._rate) + 3, self._count)

    def _fast_frames(self, times: Array) -> Array:
        """Times of the grid that limbs depend on at some times."""
        (low, high), around = self._span(times), len(_LIMBS) // 2
        return np.arange(max(low - around, 0), min(high + around, self._count))

    def _control_frames(self, times: Array) -> Array:
        """Control frames that planted feet depend on at some times, if they move."""
        if not self._planted:
            return np.zeros(0, np.int64)
        rate = self._take.control_rate
        low, high = int(times.min() * rate) - 1 - _WIDE, int(times.max() * rate) + 2 + _WIDE
        return np.arange(max(low, 0), min(high, self._take.frame_count - 1) + 1)

    def _rows(self, frames: Array, avatars: Array, landed: Landed) -> Array:
        """Moves of avatars (n,) at times of the grid (R,). Shape (R, n, 4, 2, 3), float32."""
        everyone = np.arange(self._take.avatar_count)
        if not self._whole and len(avatars) < len(everyone):
            return self._find(frames, avatars, landed)
        found = {frame: self._kept[frame] for frame in frames.tolist() if frame in self._kept}
        missing = np.array([frame for frame in frames.tolist() if frame not in found], np.int64)
        if len(missing):
            for frame, moves in zip(missing.tolist(), self._find(missing, everyone, landed), strict=True):
                found[frame] = self._kept[frame] = moves
        for frame in list(self._kept)[: max(len(self._kept) - self._frames, 0)]:
            self._kept.pop(frame, None)
        return np.stack([found[frame][avatars] for frame in frames.tolist()])

    def _find(self, frames: Array, avatars: Array, landed: Landed) -> Array:
        """Find moves of avatars (n,) at times of the grid (R,), some of these and neighbouring avatars at once."""
        moves = np.zeros((len(frames), len(avatars), LIMBS, MOVED, 3), np.float32)
        at_once = max(1, POSES_AT_ONCE // max(len(avatars), 1))
        for first in range(0, len(frames), at_once):
            chunk = frames[first : first + at_once]
            rows = np.unique(chunk // self._fine)
            span = slice(int(rows[0]), int(rows[-1]) + 1)
            places = np.stack([np.asarray(values[span], dtype=float) for values in (self._take.x, self._take.z)], -1)
            places[np.asarray(self._take.action[span]) < 0] = np.nan
            # Neighbours by x come one after another.
            some = avatars[np.argsort(places[0, avatars, 0], kind="stable")]
            for at in range(0, len(some), POSES_AT_ONCE):
                chosen = np.sort(some[at : at + POSES_AT_ONCE])
                rows = np.searchsorted(avatars, chosen)
                near, times = _around(places, chosen), chunk / self._rate
                if len(near) > 1:
                    posed = self._pose_all(near, times, landed)
                    moves[first : first + len(chunk), rows] = self._deflect(times, chosen, near, posed, landed)
        return moves

    def _build_of(self, avatars: Array) -> tuple[Array, Array, Array]:
        """Sizes, girths and stretches of some avatars."""
        return self._scales[avatars], self._girths[avatars], self._stretches[avatars]

    def _deflect(self, times: Array, asked: Array, near: Array, joints: AllJoints, landed: Landed) -> Array:
        """Moves of avatars (M,) at times (T,) among those near them (n,), both ascending. Shape (T, M, 4, 2, 3)."""
        moves = np.zeros((len(times), len(asked), LIMBS, MOVED, 3), np.float32)
        posed = [
            (index, PosedBodies(self._motions[index].body, which, *self._build_of(near[which]), positions, rotations))
            for index, which, positions, rotations, _ in joints
        ]
        capsules = place_capsules([bodies for _, bodies in posed], len(times), len(near), self._threads)
        rows = np.clip(np.rint(times * self._take.control_rate).astype(np.int64), 0, self._take.frame_count - 1)
        down = fallen_rows(self._take, self._motions, int(rows.min()), int(rows.max()) + 1)
        limbs = MovingLimbs(
            np.full((len(times), len(near), LIMBS, 3, 3), np.nan, np.float32),
            np.full(capsules.bounds.shape, -1, np.int64),
            np.zeros((*capsules.bounds.shape, MOVED, 2)),
            _landing(landed, near, times),
            np.ones((len(times), len(near), LIMBS)),
            np.ascontiguousarray(down[rows - rows.min()][:, near]),
        )
        for _, which, _, _, freedom in joints:
            limbs.freedom[:, which, 2:] = self._planted + (1.0 - self._planted) * freedom
        for index, bodies in posed:
            motion, (riding, weights) = self._motions[index], self._riding[index]
            moving = np.concatenate([motion.arms.joints, motion.legs.joints])
            limbs.joints[:, bodies.columns] = bodies.positions[:, :, moving]
            own = np.arange(len(riding))
            limbs.limbs[bodies.columns[:, None], own] = riding
            limbs.weights[bodies.columns[:, None], own] = weights
        order = np.argsort(capsules.starts[:, :, 0, 0], axis=1, kind="stable")
        ranks, columns = np.argsort(order, axis=1, kind="stable"), np.searchsorted(near, asked)
        share(len(times) * len(asked), deflect_limbs, capsules, limbs, order, ranks, columns, moves,
              threads=self._threads)  # fmt: skip
        return moves


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


def _around(places: Array, avatars: Array) -> Array:
    """Avatars that are near some of avatars (n,) at any of T times, and these, ascending; places (T, N, 2)."""
    near = np.zeros(places.shape[1], bool)
    near[avatars] = True
    for now in places:
        own = now[avatars[np.isfinite(now[avatars, 0])]]
        if not len(own):
            continue
        low, high = own.min(axis=0) - _AROUND, own.max(axis=0) + _AROUND
        others = np.flatnonzero(~near & (now >= low).all(axis=1) & (now <= high).all(axis=1))
        if len(others):
            near[others] = np.isfinite(cKDTree(own).query(now[others], distance_upper_bound=_AROUND)[0])
    return np.flatnonzero(near)


def _landing(landed: Landed, avatars: Array, times: Array) -> Array:
    """How close to strikes that land limbs of avatars (n,) are at times (T,), from 0 to 1. Shape (T, n, 4)."""
    near = np.zeros((len(times), len(avatars), LIMBS))
    some = landed.between(times[0] - _LANDS, times[-1] + _LANDS)
    some = some.of(~some.missed)
    column = np.minimum(np.searchsorted(avatars, some.attackers), len(avatars) - 1)
    known = np.flatnonzero(avatars[column] == some.attackers)
    close = np.clip(2.0 - 2.0 * np.abs(times[:, None] - some.times[known]) / _LANDS, 0.0, 1.0)
    rows = np.broadcast_to(np.arange(len(times))[:, None], close.shape)
    np.maximum.at(near, (rows, *(np.broadcast_to(one[known], close.shape) for one in (column, some.limbs))), close)
    return near
