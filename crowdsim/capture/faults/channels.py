"""Position channels of joints that are no positions in their parents' frames, as BVH wants them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.bvh.io import Bvh
from crowdsim.capture.columns import position_columns, rotation_columns
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array

_SAMPLES = 256
_SMALL = 0.2
"""Share of an offset below which a position is a displacement from it."""
_MOST = 0.8
"""Share of all bones' length for which something has to hold."""
_ALONG, _ALIKE = 0.999, 0.05
"""Cosine and spread of ratios for which positions are offsets in another unit."""


class Channels:
    """Positions that are displacements from the offsets, offsets in another unit, or places in the world."""

    name = "channels"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Hold the positions of joints against their offsets and their parents' positions."""
        bvh = reading.bvh
        joints = [
            joint
            for joint in range(bvh.joint_count)
            if bvh.parents[joint] >= 0 and (position_columns(bvh, joint) >= 0).all()
        ]
        if len(joints) < 4 or not bvh.frame_count:
            return None
        rows = np.unique(np.linspace(0, bvh.frame_count - 1, _SAMPLES).astype(int))
        sample = bvh.motion[rows][:, np.array([position_columns(bvh, joint) for joint in joints])]
        sample = sample[np.isfinite(sample).all(axis=(1, 2))]
        offsets = bvh.offsets[joints]
        lengths = np.linalg.norm(offsets, axis=1)
        if not len(sample) or lengths.sum() <= 0.0:
            return None
        bones = lengths > 0.02 * lengths.max()
        weights = lengths[bones] / lengths[bones].sum()
        middle = np.median(np.linalg.norm(sample, axis=-1), axis=0)[bones] / lengths[bones]
        if weights[middle < _SMALL].sum() > _MOST:
            return _displaced(reading, joints, sample[:, bones], offsets[bones])
        roots = np.linalg.norm(np.median(sample, axis=0) - offsets, axis=-1)[bones] / lengths[bones]
        between = _from_parents(bvh, joints, bvh.motion[rows])
        if between is None:
            return None
        # Children of the root tell places against the root, which are against their parent already, from those in the
        # world.
        first = np.array([bvh.parents[bvh.parents[joint]] < 0 for joint in joints])[bones]
        ratio = np.median(np.linalg.norm(between, axis=-1), axis=0)[bones] / lengths[bones]
        placed = (roots > 0.5) & (np.abs(ratio - 1.0) < 0.15)
        if first.all() or weights[placed & ~first].sum() < _MOST * weights[~first].sum():
            return None
        from_root = bool(np.median(np.abs(middle[first] - 1.0)) < np.median(np.abs(ratio[first] - 1.0)))
        still = float(np.abs(bvh.motion[:, rotation_columns(bvh)]).max(initial=0.0)) < 1e-6
        return Diagnosis(
            self.name,
            f"the positions of {len(joints)} joints are places {'against the root' if from_root else 'in the world'}, "
            "not in their parents' frames",
            0.98,
            "repair",
            "differences to the parents are taken" if still else "their offsets are taken",
            lambda: replace(reading, bvh=_local(bvh, joints, from_root) if still else _with_offsets(bvh, joints)),
        )


def _displaced(reading: Reading, joints: list[int], sample: Array, offsets: Array) -> Diagnosis:
    bvh = reading.bvh
    mean = sample.mean(axis=0)
    lengths = np.linalg.norm(mean, axis=1), np.linalg.norm(offsets, axis=1)
    along = np.sum(mean * offsets, axis=1) / np.maximum(lengths[0] * lengths[1], 1e-12)
    ratios = lengths[0] / lengths[1]
    ratio = float(np.median(ratios))
    if ratio > 1e-4 and (along > _ALONG).mean() > _MOST and np.abs(ratios / ratio - 1.0).max() < _ALIKE:
        what = f"the positions of {len(joints)} joints are their offsets in another unit, {ratio:.4g} times as long"
        return Diagnosis(
            "channels",
            what,
            0.98,
            "repair",
            "they are brought to the unit of the offsets",
            lambda: replace(reading, bvh=_moved(bvh, joints, 1.0 / ratio, False)),
        )
    share = float(np.median(np.median(np.linalg.norm(sample, axis=-1), axis=0) / lengths[1]))
    return Diagnosis(
        "channels",
        f"the positions of {len(joints)} joints are displacements from their offsets, {share:.2%} as long",
        0.98,
        "repair",
        "the offsets are added",
        lambda: replace(reading, bvh=_moved(bvh, joints, 1.0, True)),
    )


def _from_parents(bvh: Bvh, joints: list[int], rows: Array, from_root: bool = False) -> Array | None:
    """Positions of joints minus those of their parents, or of all parents but roots; None where a parent has none."""
    parts = []
    for joint in joints:
        parent = int(bvh.parents[joint])
        own, parents = position_columns(bvh, joint), position_columns(bvh, parent)
        if (parents < 0).any():
            return None
        parts.append(rows[:, own] - (0.0 if from_root and bvh.parents[parent] < 0 else rows[:, parents]))
    return np.stack(parts, axis=1)


def _moved(bvh: Bvh, joints: list[int], factor: float, add: bool) -> Bvh:
    motion = bvh.motion.copy()
    for joint in joints:
        columns = position_columns(bvh, joint)
        motion[:, columns] = motion[:, columns] * factor + (bvh.offsets[joint] if add else 0.0)
    return replace(bvh, motion=motion)


def _with_offsets(bvh: Bvh, joints: list[int]) -> Bvh:
    motion = bvh.motion.copy()
    for joint in joints:
        motion[:, position_columns(bvh, joint)] = bvh.offsets[joint]
    return replace(bvh, motion=motion)


def _local(bvh: Bvh, joints: list[int], from_root: bool) -> Bvh:
    between = _from_parents(bvh, joints, bvh.motion, from_root)
    assert between is not None
    motion = bvh.motion.copy()
    for index, joint in enumerate(joints):
        motion[:, position_columns(bvh, joint)] = between[:, index]
    return replace(bvh, motion=motion)
