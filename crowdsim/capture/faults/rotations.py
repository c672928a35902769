"""Rotation channels in another order or another sense than the file says, and root channels that are mixed up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from crowdsim.bvh.clip import from_clip, to_clip
from crowdsim.bvh.io import Bvh
from crowdsim.capture.columns import rotation_columns
from crowdsim.capture.evidence import Evidence
from crowdsim.capture.faults.diagnosis import Diagnosis, by_confidence
from crowdsim.capture.faults.root_path import RootPath
from crowdsim.capture.reading import Reading
from crowdsim.motion import quaternion

_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
_RELATED, _REST = 0.6, 0.35
"""A body whose root follows its feet at least so, and whose bearing foot moves no more than this, needs no other
reading."""
_BETTER, _PLAINLY = 1.7, 2.5
"""How much less what bears the body moves in the right reading: at the least, and beyond doubt."""
_KNEES = 0.03
_SAMPLES = 4000
"""Frames on which readings are tried."""


class Rotations:
    """Angles that make a body's motion in another order of axes, in the other sense, or as the root's positions."""

    name = "rotations"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Try other readings of the channels where feet slide and float, and take the one in which they stand."""
        evidence = reading.evidence
        if evidence is None or np.count_nonzero(evidence.inside) < 20:
            return None
        if evidence.relation > _RELATED and evidence.unrest < _REST and evidence.knee_sense > _KNEES:
            return None
        short = replace(reading.bvh, motion=reading.bvh.motion[:_SAMPLES])
        before = replace(reading, bvh=short, lost=None).evidence
        found = []
        for words, bvh in _readings(short):
            after = replace(reading, bvh=bvh, lost=None).evidence
            if before is not None and after is not None and _is_better(before, after):
                found.append((after.unrest, words))
        if not found or before is None:
            return None
        unrest, words = min(found)
        path = RootPath().examine(reading)
        if path is not None and path.action == "repair" and path.repair is not None:
            other = path.repair().evidence
            if other is not None and other.unrest < unrest:
                return None
        confidence = 0.96 if unrest * _PLAINLY < before.unrest else 0.91
        return Diagnosis(
            self.name,
            f"feet slide and float, and do not where {words}",
            confidence,
            by_confidence(confidence),
            "they are read so",
            lambda: replace(reading, bvh=dict(_readings(reading.bvh))[words]),
        )


def _is_better(before: Evidence, after: Evidence) -> bool:
    return (
        after.unrest * _BETTER < before.unrest
        and after.relation > _RELATED
        and after.knee_sense > _KNEES
        and float(np.quantile(after.speeds, 0.95)) < 1.2 * float(np.quantile(before.speeds, 0.95))
    )


def _readings(bvh: Bvh) -> Iterator[tuple[str, Bvh]]:
    """Other readings of a file's channels, in words."""
    for order in _ORDERS:
        channels = tuple(_ordered(names, order) for names in bvh.channels)
        if channels != bvh.channels:
            yield f"rotations of all joints are in the order {order}", replace(bvh, channels=channels)
        if channels[0] != bvh.channels[0] and bvh.joint_count > 1:
            only = (channels[0], *bvh.channels[1:])
            yield f"rotations of the root alone are in the order {order}", replace(bvh, channels=only)
    channels = tuple(_reversed(names) for names in bvh.channels)
    yield "rotations of all joints are in the opposite order", replace(bvh, channels=channels)
    motion = bvh.motion.copy()
    motion[:, rotation_columns(bvh)] *= -1.0
    yield "angles have the opposite sense", replace(bvh, motion=motion)
    yield "rotations of joints are those in the world", _local(bvh)
    root = bvh.channels[0]
    angles, places = ([name for name in root if name.endswith(kind)] for kind in ("rotation", "position"))
    if len(angles) == len(places) == 3:
        first = root[0].endswith("rotation")
        swapped = (*places, *angles) if first else (*angles, *places)
        words = f"{'positions' if first else 'rotations'} come first among the root's channels"
        yield words, replace(bvh, channels=(swapped, *bvh.channels[1:]))


def _local(bvh: Bvh) -> Bvh:
    """The file with its rotations, which are those in the world, against each joint's parent."""
    clip = to_clip(bvh)
    rotations = clip.rotations.copy()
    below = np.flatnonzero(clip.skeleton.parents >= 0)
    above = clip.rotations[:, clip.skeleton.parents[below]]
    rotations[:, below] = quaternion.multiply(quaternion.conjugate(above), clip.rotations[:, below])
    local = from_clip(replace(clip, rotations=rotations), unit_scale=1.0)
    return replace(bvh, channels=local.channels, motion=local.motion)


def _ordered(names: tuple[str, ...], order: str) -> tuple[str, ...]:
    """Channel names with their three rotations in an order."""
    if sum(name.endswith("rotation") for name in names) != 3:
        return names
    letters = iter(order)
    return tuple(f"{next(letters)}rotation" if name.endswith("rotation") else name for name in names)


def _reversed(names: tuple[str, ...]) -> tuple[str, ...]:
    angles = [name for name in names if name.endswith("rotation")]
    return tuple(angles.pop() if name.endswith("rotation") else name for name in names)
