"""Avatars of a take as BVH files, one each, in the world: centimetres, y up, end sites."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field, ValidationError

from crowdsim.core.types import Array, Progress
from crowdsim.errors import OutputError
from crowdsim.export.avatar_files import AvatarFiles
from crowdsim.export.stream import Block, stream_poses
from crowdsim.files import make_folder

if TYPE_CHECKING:
    from crowdsim.bvh.writer import BvhWriter
    from crowdsim.motion.body import Body
    from crowdsim.motion.skeleton import Skeleton
    from crowdsim.poses.sampler import PoseSampler

_DECIMALS, _ROWS = 5, 512
"""Digits of a centimetre and of a degree, far finer than what is blended and carried; and rows written at once."""
_WHOLE = (
    "All frames in every file: an absent avatar stands as it will come, and after that as it was last seen. Without it "
    "a file has the frames in which its avatar is there."
)
_T_POSE = (
    "Begin every file with one frame more, the rest pose: no rotation, at the origin, soles on the floor; a T where "
    "the skeleton's rest pose is one, as the embedded boxer's is."
)


class BvhOutput(AvatarFiles):
    """One BVH file per avatar."""

    name = "bvh"
    about = "Motion as BVH, one file per avatar."
    kernels = "bvh"

    whole: bool = Field(default=False, description=_WHOLE)
    t_pose: bool = Field(default=False, description=_T_POSE)

    @property
    def covers_absence(self) -> bool:
        """Whether files cover all frames, also those in which their avatar is absent."""
        return self.whole

    def pose_bytes(self) -> float:
        """Return about how much room an avatar takes at a time [bytes]; measured with the shipped scenarios."""
        return 650.0

    def begin(self, sampler: PoseSampler, avatar: int, path: Path, frames: int) -> _Standing:
        """Begin the file of an avatar, with the skeleton of its build, and in rest pose where that is asked for."""
        from crowdsim.bvh.io import BvhWriter
        from crowdsim.poses.builds import build_skeleton

        cast = sampler.take.cast
        motion = sampler.motions[int(cast.policies[avatar])]
        sizes = float(cast.scales[avatar]) * cast.stretches[avatar]
        skeleton = build_skeleton(motion.skeleton, motion.segments, sizes)
        writer = BvhWriter(path, skeleton, self.rate, frames + self.t_pose, decimals=_DECIMALS)
        if self.t_pose:
            root = [0.0, _root_height(skeleton, motion.body, float(cast.scales[avatar])), 0.0]
            writer.append(np.array([root]), np.tile([1.0, 0.0, 0.0, 0.0], (1, skeleton.joint_count, 1)))
        return _Standing(writer)

    def append(self, writer: Any, block: Block, policy: int, column: int, rows: Array) -> None:
        """Append rows of a block of poses."""
        poses = block.poses[policy]
        writer.append(poses.root_positions[rows, column], poses.rotations[rows, column])


class _Standing:
    """A file in which an avatar stands while it is absent: as it comes, before it has come, then as it was last seen.

    Args:
        writer: Writes the file.
    """

    def __init__(self, writer: BvhWriter) -> None:
        self.path, self.close, self.abandon = writer.path, writer.close, writer.abandon
        self._writer, self._waiting = writer, 0
        self._last: tuple[Array, Array] | None = None

    def append(self, roots: Array, rotations: Array) -> None:
        """Write the next frames: roots [m] (F, 3), local rotations (F, J, 4); NaN while it is absent."""
        if not len(roots):
            return
        there = np.isfinite(roots[:, 0])
        if not there.all():
            if self._last is None and not there.any():
                self._waiting += len(roots)
                return
            first = int(np.argmax(there))
            last = self._last or (roots[first], rotations[first])
            seen = np.maximum.accumulate(np.where(there, np.arange(1, len(roots) + 1), 0))
            roots, rotations = (
                np.concatenate([one[None], rows])[seen] for one, rows in zip(last, (roots, rotations), strict=True)
            )
        for low in range(0, self._waiting, _ROWS):
            count = min(_ROWS, self._waiting - low)
            self._writer.append(*(np.repeat(rows[:1], count, axis=0) for rows in (roots, rotations)))
        self._waiting, self._last = 0, (roots[-1], rotations[-1])
        self._writer.append(roots, rotations)


def _root_height(skeleton: Skeleton, body: Body, scale: float) -> float:
    """Return how high the root is in the rest pose of a body that stands on the floor [m]."""
    rest, feet = skeleton.rest_positions(), [body.roles["left_foot"], body.roles["right_foot"]]
    return float(rest[0, 1] - (rest[feet, None, 1] + scale * body.sole_offsets[..., 1]).min())


def export_bvh(
    sampler: PoseSampler,
    folder: Path,
    fps: float,
    frames: tuple[int, int] | None = None,
    avatars: Sequence[int] | Array | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> list[Path]:
    """Write ``<avatar name>.bvh`` for avatars of a take.

    An avatar that is absent for a time, because its group comes late or leaves, has the frames in which it is there.

    Args:
        sampler: Poses of the take.
        folder: Folder for the files; made when missing.
        fps: Output frames a second.
        frames: First output frame and one past the last; all when None.
        avatars: Numbers of the avatars; all when None.
        threads: Threads that write.
        progress: Called with ("bvh", files done, files).

    Returns:
        The files, in the order of the avatars.

    Raises:
        OutputError: The folder cannot be made, a file cannot be written, or rate or frames are none.
    """
    make_folder(folder)
    try:
        output = BvhOutput(fps=fps, frames=frames, avatars=None if avatars is None else tuple(map(int, avatars)))
    except ValidationError as error:
        found = error.errors()[0]
        raise OutputError(f"bvh: {'.'.join(map(str, found['loc']))}: {found['msg']}") from None
    return stream_poses(sampler, fps, [output.sink(sampler, folder)], threads, progress)[0]


OUTPUT = BvhOutput
