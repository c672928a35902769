"""Avatars at ease and on the floor breathe: the quicker and deeper, the more they have thrown of late."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.poses.kept import Kept
from crowdsim.poses.kernels.records import Offsets, Posed
from crowdsim.poses.kernels.turning import Turning, turn_joints
from crowdsim.poses.layer import Layer, Part, Scheduler
from crowdsim.poses.limbs import chain_of, turning_of
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.smoothing import smooth

_SHARES = {"spine": 0.4, "chest": 0.6, "neck": -0.5, "head": -0.5}
"""Shares of a breath; a joint with two roles has both."""
_LASTS, _EXHAUSTING = 20.0, 8.0
"""For how long a strike tires [s], less as time passes, and how many thrown just now exhaust an avatar."""
_RATES, _DEPTHS = (0.27, 0.62), np.deg2rad((1.6, 4.2))
"""Breaths a second of an avatar at rest and of an exhausted one, and how far they bend the trunk [rad]."""
_UNLIKE = 0.12
"""How much quicker than others an avatar breathes at the most, or slower."""
_SPREAD = 6
"""Control frames before and after over which breaths begin and end."""
_SMOOTH = np.hanning(2 * _SPREAD + 3)[1:-1] / (_SPREAD + 1)
"""Weights of that."""


def build_chest(motion: PoseMotion) -> Turning:
    """Return what a body breathes with: it bends about the way from the right hip to the left one."""
    roles, skeleton = motion.body.roles, motion.skeleton
    offsets = np.asarray(skeleton.offsets, dtype=float)
    left, right = (offsets[chain_of(skeleton, [roles[f"{side}_hip"]])[1:]].sum(axis=0) for side in ("left", "right"))
    across = (left - right) / np.linalg.norm(left - right)
    return turning_of(skeleton, motion.body, _SHARES, across, of_root=True)


class Breathing(Layer):
    """Bends trunks as bodies breathe."""

    name = "breathing"

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        take = poser.take
        self._chests = [build_chest(motion) for motion in poser.motions]
        order = np.lexsort((take.events.frame, take.events.attacker))
        self._frames = np.asarray(take.events.frame, float)[order]
        self._starts = np.searchsorted(np.asarray(take.events.attacker)[order], np.arange(take.avatar_count + 1))
        self.breaths = Kept(take.frame_count, take.control_rate, take.avatar_count, (), self._find)

    def prepare(self, avatars: Array, first: float, last: float) -> None:
        """Find how avatars breathe."""
        if self.poser.reactions:
            self.breaths.rows(self.breaths.around(first, last), avatars)

    def plan(self, part: Part) -> Offsets | None:
        """Return how far trunks are bent [rad]; None where reactions do not show."""
        return self.breaths.track(*part.span, part.window.avatars) if self.poser.reactions else None

    def apply(self, part: Part, poses: Posed) -> None:
        """Bend them."""
        breaths, chest = part.plans[self.name], self._chests[part.policy]
        if breaths is not None and breaths.values.any():
            share(
                len(part.moments.columns), turn_joints, part.moments, breaths, chest, poses, threads=part.window.threads
            )

    def _find(self, frames: Array, avatars: Array) -> Array:
        """Find how far trunks of avatars (n,) are bent at control frames (T,) [rad]. Shape (T, n)."""
        take, first, stop = self.poser.take, int(frames[0]), int(frames[-1]) + 1
        low, high = max(first - _SPREAD, 0), min(stop + _SPREAD, take.frame_count)
        action, done = (np.asarray(values[low:high])[:, avatars] for values in (take.action, take.action_frame))
        ways = np.zeros(action.shape)
        for index, motion in enumerate(self.poser.motions):
            here = (action >= 0) & (take.cast.policies[avatars] == index)
            ways[here] = motion.breathes[motion.frames_at(action[here], done[here].astype(float))]
        ways = smooth(ways, _SMOOTH)[frames - low]
        found = np.zeros(ways.shape)
        for column in np.flatnonzero(ways.any(axis=0)):
            number, times = int(avatars[column]), frames / take.control_rate
            found[:, column] = ways[:, column] * breath(times, self._efforts(number, frames), number)
        return found

    def _efforts(self, avatar: int, frames: Array) -> Array:
        """Return how exhausted an avatar is at control frames (T,): 0 to 1. Shape (T,)."""
        thrown = self._frames[self._starts[avatar] : self._starts[avatar + 1]]
        ago = (frames[:, None] - thrown) / (_LASTS * self.poser.take.control_rate)
        result: Array = np.minimum(np.sum(np.where(ago >= 0.0, np.maximum(1.0 - ago, 0.0), 0.0), axis=1), _EXHAUSTING)
        return result / _EXHAUSTING


def breath(times: Array, efforts: Array, avatar: int) -> Array:
    """Return how far a trunk is bent by its breath at times (T,) [s], by efforts (T,) from 0 to 1 [rad]. Shape (T,).

    Each avatar has a rate and a phase of its own. A slow breath passes into a quick one, whose rates do not change, so
    that a breath depends on nothing long before it.
    """
    drawn, phase = np.mod((avatar + 1) * 0.6180339887498949, 1.0), np.mod((avatar + 1) * 0.7548776662466927, 1.0)
    own = 1.0 + _UNLIKE * (2.0 * drawn - 1.0)
    slow, quick = (0.5 - 0.5 * np.cos(2.0 * np.pi * (own * rate * times + phase)) for rate in _RATES)
    result: Array = (1.0 - efforts) * _DEPTHS[0] * slow + efforts * _DEPTHS[1] * quick
    return result
