"""Several people in one BVH file, each a tree of its own, as motion capture of sparring exports them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crowdsim.bvh.io import Bvh, from_clip
from crowdsim.motion import quaternion
from crowdsim.motion.skeleton import Clip


def placed(clip: Clip, x: float, z: float, heading: float) -> Clip:
    """Return a clip turned about the vertical through the origin, then moved."""
    turn = quaternion.about_y(heading)
    rotations = clip.rotations.copy()
    rotations[:, 0] = quaternion.multiply(turn, rotations[:, 0])
    return replace(
        clip, root_positions=quaternion.rotate(turn, clip.root_positions) + np.array([x, 0.0, z]), rotations=rotations
    )


def together(clips: Sequence[Clip], prefixes: Sequence[str]) -> Bvh:
    """Return clips of equal length as one file, whose names begin with prefixes."""
    parts = [from_clip(clip) for clip in clips]
    starts = np.cumsum([0, *(part.joint_count for part in parts)])
    names = [tuple(prefix + name for name in part.names) for prefix, part in zip(prefixes, parts, strict=True)]
    parents = [
        np.where(part.parents < 0, -1, part.parents + start) for part, start in zip(parts, starts[:-1], strict=True)
    ]
    return replace(
        parts[0],
        names=sum(names, ()),
        parents=np.concatenate(parents).astype(np.int32),
        offsets=np.concatenate([part.offsets for part in parts]),
        channels=sum((part.channels for part in parts), ()),
        end_parents=np.concatenate(
            [part.end_parents + start for part, start in zip(parts, starts[:-1], strict=True)]
        ).astype(np.int32),
        end_offsets=np.concatenate([part.end_offsets for part in parts]),
        end_names=sum((part.end_names for part in parts), ()),
        motion=np.concatenate([part.motion for part in parts], axis=1),
    )
