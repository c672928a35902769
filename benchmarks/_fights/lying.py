"""Bodies that are down: how they meet the floor, who treads on them, and whether they lie in one another.

Measured on complete poses, on the capsules that pictures and clouds show. Feet whose soles face the floor meet it with
heel and ball: toes bend where a foot stands on its ball, which capsules do not show.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from _exported.capsules import capsule_depths

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.database import MotionDatabase
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules
from crowdsim.poses.kernels.records import Moments
from crowdsim.poses.sampler import Poses, PoseSampler

FPS = 20.0
"""Measured frames a second."""
CLEAR = 0.01
"""How far the lowest point of a body that is down may be from the floor [m]."""
DEEP = 0.06
"""How deep lying bodies may be in one another [m]."""
NEAR = 2.4
"""Distance of pelvises beyond which bodies do not touch [m]."""
STANDS, FALLS, LIES, RISES = range(4)
_FACES_FLOOR = 0.26
"""Least cosine of the angle between the sole's direction and straight down."""
_DOWN = np.array([0.0, -1.0, 0.0])
"""Direction of a sole in the frame of its joint."""
_AT_ONCE = 400


class _Stretch(NamedTuple):
    """Some frames of a run; N avatars, C capsules.

    Attributes:
        phases: What each avatar does: ``STANDS``, ``FALLS``, ``LIES`` or ``RISES``. Shape (T, N).
        ends: Both ends of capsules [m]. Shape (2, T, N, C, 3).
        lowest: Height of the lowest point of each body that should be above the floor, and of the lowest that may rest
            on it [m]. Shape (2, T, N).
    """

    phases: Array
    ends: Array
    lowest: Array


def measure_lying(samplers: Sequence[PoseSampler]) -> dict[str, Any]:
    """Return how bodies fall, lie and get up in runs of one policy with falls, whose avatars are there all the time.

    Returns:
        ``frames``, avatar-frames from the start of a fall to standing; ``lowest`` and ``highest``, extremes of a
        body's lowest point [m]; ``sunk_share`` and ``floating_share``, of frames in which it is further than ``CLEAR``
        below or above the floor. ``lying_frames``; ``trodden_share``, of lying frames in which the axis of another's
        foot is inside a capsule of the body; ``touched_share``, in which a foot touches one. ``lying_pairs``, frames of
        pairs of lying bodies nearer than ``NEAR``; ``overlap_share``, of these deeper than ``DEEP`` in one another,
        and ``overlap_frames_share``, of lying frames.
    """
    lows, trodden, pairs, lying, overlapping = [], [], [], 0, 0
    for sampler in samplers:
        body = sampler.motions[0].body
        order = capsule_order(body)
        feet = [
            int(np.flatnonzero(body.capsule_joints[order] == body.roles[f"{s}_foot"])[0]) for s in ("left", "right")
        ]
        scales, radii = np.asarray(sampler.take.cast.scales), body.capsule_radii[order]
        for stretch in _stretches(sampler):
            lows.append(stretch.lowest[:, stretch.phases != STANDS])
            lies = stretch.phases == LIES
            lying += int(lies.sum())
            trodden.append(_depths_of_feet(stretch, radii, scales, feet)[lies])
            found, deep = _overlaps(stretch, radii, scales)
            pairs.append(found)
            overlapping += deep
    (low, high), steps, overlaps = np.concatenate(lows, axis=1), np.concatenate(trodden), np.concatenate(pairs)

    def share(flags: Array) -> float | None:
        return float(np.mean(flags)) if len(flags) else None

    return {
        "frames": len(low),
        "lowest": float(low.min()) if len(low) else None,
        "highest": float(high.max()) if len(high) else None,
        "sunk_share": share(low < -CLEAR),
        "floating_share": share(high > CLEAR),
        "lying_frames": lying,
        "trodden_share": share(steps[:, 1] > 0.0),
        "touched_share": share(steps[:, 0] > 0.0),
        "lying_pairs": len(overlaps),
        "overlap_share": share(overlaps > DEEP),
        "overlap_frames_share": overlapping / lying if lying else None,
    }


def lines(outcome: Mapping[str, Any]) -> Iterator[str]:
    """Yield the figures, a line each."""
    yield f"bodies that are down, {outcome['frames']} frames, of which lying {outcome['lying_frames']}"
    for name in ("lowest", "highest"):
        if outcome[name] is not None:
            yield f"  {name + ' point [cm]':<28}{100.0 * outcome[name]:8.2f}"
    for name in ("sunk", "floating", "trodden", "touched", "overlap", "overlap_frames"):
        share = outcome[f"{name}_share"]
        if share is not None:
            yield f"  {name.replace('_', ' '):<28}{share:8.3%}"


def _phases(database: MotionDatabase) -> Array:
    """Return what a body does in each playback frame."""
    falls, stride = database.falls, database.stride
    phases = np.full(database.frame_count * stride, STANDS, np.int8)
    for one in zip(falls.starts, falls.downs, falls.rises, falls.stops, strict=True):
        start, down, rise, stop = (int(frame) * stride for frame in one)
        phases[start + 1 : down], phases[down : rise + 1], phases[rise + 1 : stop] = FALLS, LIES, RISES
    return phases


def _stretches(sampler: PoseSampler) -> Iterator[_Stretch]:
    take, motion = sampler.take, sampler.motions[0]
    frames, count, phases = take.output_frames(FPS), take.avatar_count, _phases(sampler.policies[0].database)
    for start in range(0, frames, _AT_ONCE):
        stop = min(start + _AT_ONCE, frames)
        (poses,) = sampler.sample(start, stop, FPS)
        times = (np.arange(start, stop) / FPS)[:, None]
        shown = sampler.window(0, np.arange(count), times).playback(Moments(np.arange(count), times)).frames
        posed = PosedBodies(motion.body, poses.avatars, poses.scales, poses.girths, poses.stretches, *poses.joints())
        capsules = place_capsules([posed], stop - start, count, 2)
        ends = np.stack([capsules.starts, capsules.ends])
        low = np.minimum(*(one[..., 1] - capsules.radii[..., k] for k, one in enumerate(ends)))
        yield _Stretch(phases[np.maximum(shown, 0)], ends, _lowest(posed, low, poses))


def _lowest(posed: PosedBodies, low: Array, poses: Poses) -> Array:
    """Return the height of the lowest point of each body, from those of its capsules (T, N, C). Shape (2, T, N).

    Where a sole faces the floor its toes may be below it, and they may rest on it.
    """
    body, above, resting = posed.body, low.copy(), low.copy()
    order = capsule_order(body)
    for foot, side in enumerate(("left", "right")):
        joint = body.roles[f"{side}_foot"]
        (shoe,) = np.flatnonzero(body.capsule_joints[order] == joint)
        rotations = posed.rotations[:, :, joint]
        points = quaternion.rotate(rotations[:, :, None], body.sole_offsets[foot]) * poses.scales[:, None, None]
        sole = (posed.positions[:, :, joint, None] + points)[..., 1].min(axis=-1)
        faces = quaternion.rotate(rotations, _DOWN)[..., 1] < -_FACES_FLOOR
        above[..., shoe] = np.where(faces, np.maximum(sole, low[..., shoe]), low[..., shoe])
        resting[..., shoe] = np.minimum(sole, low[..., shoe])
    return np.stack([above.min(axis=-1), resting.min(axis=-1)])


def _near(stretch: _Stretch, one: Array, other: int, own: int) -> Array:
    """Return the frames (n,) of given ones in which pelvises of two avatars are near one another."""
    pelvises = stretch.ends[0, one][:, :, 0][:, [own, other]]
    return np.asarray(one[np.linalg.norm(pelvises[:, 0] - pelvises[:, 1], axis=-1) < NEAR])


def _between(stretch: _Stretch, frames: Array, radii: Array, scales: Array, pair: tuple[int, int], some: Any) -> Array:
    """Return how deep some capsules of one avatar are in those of another in frames (n,). Shape (n, some, C)."""
    own, other = pair
    first, second = stretch.ends[:, frames, own][:, :, some], stretch.ends[:, frames, other]
    shape = first.shape[1], first.shape[2], second.shape[2]
    p, q = (np.broadcast_to(end[:, :, None], (*shape, 3)).reshape(-1, 3) for end in first)
    r, s = (np.broadcast_to(end[:, None], (*shape, 3)).reshape(-1, 3) for end in second)
    a = np.broadcast_to((radii[some] * scales[own])[None, :, None], (*shape, 2)).reshape(-1, 2)
    b = np.broadcast_to((radii * scales[other])[None, None], (*shape, 2)).reshape(-1, 2)
    return capsule_depths(*(np.asarray(x, float) for x in (p, q, a, r, s, b))).reshape(shape)


def _depths_of_feet(stretch: _Stretch, radii: Array, scales: Array, feet: list[int]) -> Array:
    """Return how deep feet of others, and axes of these, are in each lying body at most [m]. Shape (T, N, 2)."""
    count = stretch.phases.shape[1]
    out = np.full((*stretch.phases.shape, 2), -np.inf)
    shoe = radii[feet].max()
    for lying in range(count):
        for other in range(count):
            frames = np.flatnonzero((stretch.phases[:, lying] == LIES) & (stretch.phases[:, other] == STANDS))
            frames = _near(stretch, frames, other, lying) if other != lying else frames[:0]
            if len(frames):
                depth = _between(stretch, frames, radii, scales, (other, lying), feet).max(axis=(1, 2))
                out[frames, lying, 0] = np.maximum(out[frames, lying, 0], depth)
                out[frames, lying, 1] = np.maximum(out[frames, lying, 1], depth - shoe * scales[other])
    return out


def _overlaps(stretch: _Stretch, radii: Array, scales: Array) -> tuple[Array, int]:
    """Return how deep pairs of lying bodies that are near are in one another [m], and how many bodies are deep."""
    lies = stretch.phases == LIES
    found, deep = [np.zeros(0)], np.zeros(lies.shape, bool)
    for one in range(lies.shape[1]):
        for other in range(one):
            frames = _near(stretch, np.flatnonzero(lies[:, one] & lies[:, other]), one, other)
            if len(frames):
                depth = _between(stretch, frames, radii, scales, (one, other), slice(None)).max(axis=(1, 2))
                found.append(depth)
                for avatar in (one, other):
                    deep[frames, avatar] |= depth > DEEP
    return np.concatenate(found), int(deep.sum())
