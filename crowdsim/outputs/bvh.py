"""Avatars of a take as BVH files, one each, in the world: centimetres, y up, end sites."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from crowdsim.core.types import Array, Progress
from crowdsim.errors import OutputError
from crowdsim.export.avatar_files import AvatarFiles
from crowdsim.export.stream import Block, stream_poses
from crowdsim.files import make_folder

if TYPE_CHECKING:
    from crowdsim.bvh.writer import BvhWriter
    from crowdsim.poses.sampler import PoseSampler

_DECIMALS = 5
"""Of a centimetre and of a degree: far finer than what is blended and carried."""


class BvhOutput(AvatarFiles):
    """One BVH file per avatar."""

    name = "bvh"
    about = "Motion as BVH, one file per avatar."
    kernels = "bvh"

    def pose_bytes(self) -> float:
        """Return about how much room an avatar takes at a time [bytes]; measured with the shipped scenarios."""
        return 650.0

    def begin(self, sampler: PoseSampler, avatar: int, path: Path, frames: int) -> BvhWriter:
        """Begin the file of an avatar, with the skeleton of its build."""
        from crowdsim.bvh.io import BvhWriter
        from crowdsim.poses.builds import build_skeleton

        cast = sampler.take.cast
        motion = sampler.motions[int(cast.policies[avatar])]
        sizes = float(cast.scales[avatar]) * cast.stretches[avatar]
        skeleton = build_skeleton(motion.skeleton, motion.segments, sizes)
        return BvhWriter(path, skeleton, self.rate, frames, decimals=_DECIMALS)

    def append(self, writer: Any, block: Block, policy: int, column: int, rows: Array) -> None:
        """Append rows of a block of poses."""
        poses = block.poses[policy]
        writer.append(poses.root_positions[rows, column], poses.rotations[rows, column])


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
