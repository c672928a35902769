"""How far bodies give way to others that lean or go into them, at each control frame of a take."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.body import Body
from crowdsim.motion.strikers import LEGS
from crowdsim.poses.capsules import trunk_capsules
from crowdsim.poses.down_state import fallen_rows
from crowdsim.poses.kept import Kept
from crowdsim.poses.kernels.bending import FOOT_LANDS
from crowdsim.poses.kernels.body_points import BodyPoints, place_points
from crowdsim.poses.kernels.records import Offsets, Posed
from crowdsim.poses.kernels.separation import (
    AROUND,
    HEAD_POINT,
    LEG_POINT,
    NECK_POINT,
    PELVIS_POINT,
    PIECES,
    POINTS,
    SHOULDER_POINT,
    find_touching,
    push_trunks,
    shift_roots,
)
from crowdsim.poses.layer import Block, Layer, Part, Scheduler
from crowdsim.poses.limbs import chain_of
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.neighbours import near_avatars

FINE = 2
"""How often bodies are looked for in a control frame: heads move fast, and further with blends than in the motion."""
_FRAMES_AT_ONCE = 512


class Separation(Layer):
    """How far bodies give way.

    It depends on how the avatars near an avatar are posed, with blends alone, from five control frames before to five
    after.
    """

    name = "separation"
    size = 0.4
    sparse = 0.04
    needs = ("blend",)

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        take = poser.take
        self._radii = np.zeros((take.avatar_count, len(PIECES), 2))
        for index, motion in enumerate(poser.motions):
            self._radii[take.cast.policies == index] = piece_radii(motion.body)
        self._trunks, self._bodies = zip(*(trunk_points(motion) for motion in poser.motions), strict=True)
        landed = poser.recorded
        self._kicks = landed.of(~landed.missed & (np.isin(landed.limbs, LEGS)))
        self._radii[:, 0] *= np.asarray(take.cast.scales, float)[:, None]
        self._radii[:, 1:] *= np.asarray(take.cast.widths, float)[:, None, None]
        # From far away control frames will do.
        self._fine = 1 if self.name in poser.coarse else FINE
        self.pushes = Kept(take.frame_count, take.control_rate, take.avatar_count, (2,), self._find)

    def prepare(self, avatars: Array, first: float, last: float) -> None:
        """Find how far avatars give way."""
        self.pushes.rows(self.pushes.around(first, last), avatars)

    def plan(self, part: Part) -> Offsets:
        """Return how far trunks give way, x and z [m]."""
        return self.pushes.track(*part.span, part.window.avatars)

    def apply(self, part: Part, poses: Posed) -> None:
        """Move whole bodies, but where they stand on feet that stay: these let them go aside themselves."""
        if "feet" not in part.layers:
            share(len(part.moments.columns), shift_roots, part.moments, part.plans[self.name], poses, threads=1)

    def _find(self, frames: Array, avatars: Array) -> Array:
        """Find how far avatars (n,) give way at control frames (T,), x and z [m]. Shape (T, n, 2), float32."""
        found = np.zeros((len(frames), len(avatars), 2), np.float32)
        if not self.poser.take.collision_avoidance:
            return found
        for at in range(0, len(frames), _FRAMES_AT_ONCE):
            some = frames[at : at + _FRAMES_AT_ONCE]
            found[at : at + len(some)] = self._find_some(some, avatars)
        return found

    def _find_some(self, frames: Array, avatars: Array) -> Array:
        take, fine = self.poser.take, self._fine
        last, around = fine * (take.frame_count - 1), AROUND * fine // FINE
        rows = _around(fine * frames, fine, last)
        near = near_avatars(take, avatars, int(rows[0]) // fine, -(-int(rows[-1]) // fine) + 1)
        points, found = self._points(rows, near), np.zeros((len(frames), len(avatars), 2), np.float32)
        touching = np.zeros(len(near), bool)
        self._share(find_touching, len(rows), points, self._radii[near], _by_x(points), touching)
        # Which way bodies go depends on how they meet, before and after; most of a crowd touch nobody.
        touch = np.flatnonzero(touching)
        if not len(touch):
            return found
        path, near, points = _around(rows, around, last), near[touch], points[:, touch]
        here = np.isin(path, rows)
        paths = np.empty((len(path), *points.shape[1:]), np.float32)
        paths[here] = points
        if not here.all():
            paths[~here] = self._points(path[~here], near)
        pushes, pushed = np.empty((*points.shape[:2], 2), np.float32), np.zeros((*paths.shape[:2], 2), np.float32)
        self._share(push_trunks, len(rows), paths, self._radii[near], _by_x(points), np.flatnonzero(here), around,
                    pushes)  # fmt: skip
        pushed[here] = pushes
        asked, columns = np.flatnonzero(np.isin(avatars, near)), np.flatnonzero(np.isin(near, avatars))
        found[:, asked] = _widest(pushed, fine)[np.searchsorted(path, fine * frames)][:, columns]
        return found

    def _share(self, kernel: Callable[..., None], times: int, *arguments: Any) -> None:
        share(times, kernel, *arguments, threads=self.poser.threads, least=2)

    def _points(self, rows: Array, avatars: Array) -> Array:
        """Points of bodies in the world, NaN of who is down, ``_fine`` times a control frame. (R, n, 11, 3)."""
        poser, before, after = self.poser, rows // self._fine, -(-rows // self._fine)
        first, stop = int(before[0]), int(after[-1]) + 1
        absent = np.asarray(poser.take.action[first:stop])[:, avatars] < 0
        absent |= fallen_rows(poser.take, poser.motions, first, stop, avatars)
        absent = absent[before - first] | absent[after - first]
        points = np.empty((*absent.shape, POINTS, 3), np.float32)
        there = np.flatnonzero(~absent.all(axis=0))

        def note(block: Block) -> None:
            part, some = block.part, there[block.which]
            scales = np.asarray(poser.take.cast.scales, dtype=float)[avatars[some]]
            share(len(some), place_points, self._bodies[part.policy], block.poses, scales,
                  poser.take.cast.stretches[avatars[some]], some, points, threads=poser.threads)  # fmt: skip

        poser.stretch(note, avatars[there], rows / (self._fine * poser.take.control_rate), self.needs[0], (),
                      self._trunks)  # fmt: skip
        points[absent] = np.nan
        self._fold_kicking_legs(rows, avatars, points)
        return points

    def _fold_kicking_legs(self, rows: Array, avatars: Array, points: Array) -> None:
        """Shrink legs to their hips around the kicks that they land, so that they do not push away whom they hit."""
        times = rows / (self._fine * self.poser.take.control_rate)
        kicks = self._kicks.between(times[0] - FOOT_LANDS, times[-1] + FOOT_LANDS)
        kicks = kicks.of(np.isin(kicks.attackers, avatars))
        for time, attacker, limb in zip(kicks.times, kicks.attackers, kicks.limbs, strict=True):
            low, high = np.searchsorted(times, [time - FOOT_LANDS, time + FOOT_LANDS])
            hip = LEG_POINT + 3 * (limb % 2)
            leg = points[low:high, np.searchsorted(avatars, attacker), hip : hip + 3]
            leg[:, 1:] = leg[:, :1]


def trunk_points(motion: PoseMotion) -> tuple[PoseMotion, BodyPoints]:
    """Return the motion of the joints that the ``POINTS`` of bodies hang on, and these points."""
    body, roles = motion.body, motion.body.roles
    joints, ends = np.empty(POINTS, np.int64), np.zeros((POINTS, 3))
    joints[[HEAD_POINT, NECK_POINT, PELVIS_POINT]] = roles["head"], roles["neck"], roles["pelvis"]
    joints[LEG_POINT:SHOULDER_POINT] = motion.legs.joints.reshape(-1)
    joints[SHOULDER_POINT:] = roles["chest"]
    across = trunk_capsules(body)[-1]
    ends[HEAD_POINT], ends[SHOULDER_POINT:] = body.head_offset, (body.capsule_starts[across], body.capsule_ends[across])
    chain = chain_of(motion.skeleton, joints.tolist())
    trunk = motion.of_joints(chain)
    parents, offsets = trunk.skeleton.parents.astype(np.int64), np.ascontiguousarray(trunk.skeleton.offsets, np.float32)
    return trunk, BodyPoints(parents, offsets, trunk.segments, np.searchsorted(chain, joints), ends)


def piece_radii(body: Body) -> Array:
    """Return the radii of a body's ``PIECES`` at both ends [m]. Shape (7, 2)."""
    joints, radii = body.capsule_joints, body.capsule_radii
    trunk = trunk_capsules(body)
    thigh, shin = (_taper(radii[joints == body.roles[joint]]) for joint in ("left_hip", "left_knee"))
    upright, across = [radii[trunk[0], 0]] * 2, radii[trunk[-1]]
    return np.array([[body.head_radius] * 2, upright, across, thigh, thigh, shin, shin])


def _taper(radii: Array) -> list[float]:
    """Radii of a bone with such capsules at its upper and its lower end, 0 where it has none."""
    widest = float(radii.max(initial=0.0))
    return [widest, float(radii.min(initial=widest))]


def _around(rows: Array, away: int, last: int) -> Array:
    """Return rows (R,), ascending, and those no further away from one, from 0 to the last. Ascending."""
    near = np.unique(rows[:, None] + np.arange(-away, away + 1))
    return near[(near >= 0) & (near <= last)]


def _by_x(points: Array) -> Array:
    """Return avatars by x of the pelvis, absent ones last, at each time. Shape (T, n)."""
    return np.argsort(points[:, :, PELVIS_POINT, 0], axis=1, kind="stable")


def _widest(pushes: Array, fine: int) -> Array:
    """The longest push of each row and of those up to ``fine`` rows around it: poses read them smoothed."""
    longest, length = pushes.copy(), np.sum(pushes**2, axis=-1)
    for away in range(1, fine + 1):
        for one, other in ((slice(away, None), slice(None, -away)), (slice(None, -away), slice(away, None))):
            further = length[other] > np.sum(longest[one] ** 2, axis=-1)
            longest[one] = np.where(further[..., None], pushes[other], longest[one])
    return longest
