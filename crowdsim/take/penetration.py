"""How deep avatars of a run are in one another, measured on the bodies that pictures and clouds show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.core.workers import share
from crowdsim.crowd.record import TakeData
from crowdsim.motion.body import Body
from crowdsim.motion.skeleton import Skeleton
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules
from crowdsim.poses.sampler import Poses, PoseSampler
from crowdsim.take.kernels.penetration import find_penetrations

DEEP, VERY_DEEP = 0.06, 0.08
"""Depth that counts as penetration, and the depth of an episode [m]."""
_RATE = 20.0
"""Measured frames in a second; they lie between control frames too, where limbs are not deflected exactly."""
_MOST_POSES, _POSES_AT_ONCE = 150_000, 8_000
_LONGEST, _STRETCHES = 100, 3
"""Frames of a stretch of a run that is too long to be measured whole, and how many stretches there are at least."""


@dataclass(frozen=True)
class Penetration:
    """Figures of a run; None where there is nothing to measure.

    Attributes:
        penetration_share: Share of avatar-frames in which trunk, head or legs are deeper than ``DEEP`` in another's.
        penetration_share_with_arms: Likewise, arms included.
        penetration_deepest: Greatest depth of trunk, head or legs [m].
        penetrations_per_minute: Episodes of trunk, head or legs deeper than ``VERY_DEEP``, per avatar per minute; None
            where not every frame could be measured.
    """

    penetration_share: float | None
    penetration_share_with_arms: float | None
    penetration_deepest: float | None
    penetrations_per_minute: float | None


def measure_penetration(sampler: PoseSampler, threads: int = 1, progress: Progress | None = None) -> Penetration:
    """Measure all avatars at 20 frames a second; in stretches evenly picked where these are too many poses.

    Args:
        sampler: Poses of the run's take.
        threads: Threads that share the work.
        progress: Called with ("penetration", frames done, frames).
    """
    take = sampler.take
    frames, most, depths = take.output_frames(_RATE), _most_frames(take), Depths(sampler, threads)
    if frames < 1 or take.avatar_count < 2:
        return depths.figures()
    stretches = _stretches(frames, most)
    sampler.expect(np.concatenate([np.arange(*stretch) for stretch in stretches]) / _RATE)
    at_once, done = max(1, _POSES_AT_ONCE // take.avatar_count), 0
    for start, stop in stretches:
        for low in range(start, stop, at_once):
            high = min(low + at_once, stop)
            depths.add(sampler.sample(low, high, _RATE))
            done += high - low
            if progress is not None:
                progress("penetration", done, min(frames, most))
    return depths.figures()


class Depths:
    """Depths of all avatars in poses that come one after another.

    Args:
        sampler: What gives the poses.
        threads: Threads that share the work.
    """

    def __init__(self, sampler: PoseSampler, threads: int = 1) -> None:
        self._sampler, self._threads = sampler, threads
        self._found: list[Array] = []

    def add(self, groups: Sequence[Poses]) -> None:
        """Measure all avatars over some times, by their policies."""
        if self._sampler.take.avatar_count > 1:
            self._found.append(_depths(self._sampler, groups, self._threads))

    def figures(self) -> Penetration:
        """Return what has been measured; episodes where that are all frames at 20 frames a second."""
        depths = np.concatenate(self._found) if self._found else np.full((1, 1, 2), np.nan)
        there = np.isfinite(depths[..., 0])
        if not there.any():
            return Penetration(None, None, None, None)
        bodies, arms = depths[..., 0][there], depths[..., 1][there]
        deep = depths[..., 0] > VERY_DEEP
        episodes = np.count_nonzero(deep[1:] & ~deep[:-1]) + np.count_nonzero(deep[0])
        whole = len(depths) == self._sampler.take.output_frames(_RATE)
        return Penetration(
            float(np.mean(bodies > DEEP)),
            float(np.mean(np.maximum(bodies, arms) > DEEP)),
            float(bodies.max()),
            float(episodes / (there.sum() / _RATE / 60.0)) if whole else None,
        )


def is_sampled(take: TakeData) -> bool:
    """Return whether a take is too long for all of its frames to be measured."""
    return take.output_frames(_RATE) > _most_frames(take)


def _most_frames(take: TakeData) -> int:
    return max(_MOST_POSES // max(take.avatar_count, 1), 1)


def _stretches(frames: int, most: int) -> list[tuple[int, int]]:
    """Return all frames, or where there are more than ``most``, stretches evenly picked: first, and one past last."""
    if frames <= most:
        return [(0, frames)]
    length = min(_LONGEST, max(1, most // _STRETCHES))
    starts = np.linspace(0, frames - length, max(1, most // length)).astype(int)
    return [(start, start + length) for start in starts.tolist()]


def _depths(sampler: PoseSampler, groups: Sequence[Poses], threads: int) -> Array:
    """Depths of all avatars, NaN while absent. Shape (T, N, 2)."""
    times, count = len(groups[0].rotations), sampler.take.avatar_count
    motions = [sampler.motions[group.policy] for group in groups]
    bodies = [
        PosedBodies(motion.body, group.avatars, group.scales, group.girths, group.stretches, *group.joints())
        for group, motion in zip(groups, motions, strict=True)
    ]
    capsules = place_capsules(bodies, times, count, threads)
    arms = np.zeros(capsules.bounds.shape, bool)
    for group, motion in zip(groups, motions, strict=True):
        joints = motion.body.capsule_joints[capsule_order(motion.body)]
        arms[group.avatars[:, None], np.arange(len(joints))] = _of_arms(motion.skeleton, motion.body)[joints]
    middles = capsules.starts[:, :, 0, 0]
    order, depths = np.argsort(middles, axis=1, kind="stable"), np.empty((times, count, 2))
    share(times, find_penetrations, capsules, arms, order, depths, threads=threads)
    depths[~np.isfinite(middles)] = np.nan
    return depths


def _of_arms(skeleton: Skeleton, body: Body) -> Array:
    """Whether each joint belongs to an arm. Shape (J,), bool."""
    found = np.zeros(skeleton.joint_count, bool)
    found[[body.roles[f"{side}_shoulder"] for side in ("left", "right")]] = True
    for joint, parent in enumerate(skeleton.parents):
        found[joint] |= parent >= 0 and bool(found[parent])
    return found
