"""What runs take before they are begun: room on disk, memory and time, from measured costs."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from crowdsim.errors import BatchError
from crowdsim.preparation.prepare import estimate_needs
from crowdsim.scenario.frame_ranges import output_frames
from crowdsim.scenario.outputs import Outputs

# Bytes that a run takes beside its take, of an avatar and frame of BVH, a point of a cloud, a pixel of a PNG and of
# a frame of video. Measured with the shipped scenarios, rounded up.
_RUN_BYTES, _BVH_BYTES, _POINT_BYTES, _PNG_BYTES, _VIDEO_BYTES = 100e3, 650.0, 50.0, 1.0, 0.1
# Seconds that one core takes for a run beside its frames, a control frame of an avatar, a pose in BVH, a point of a
# cloud, and a picture: for itself, an avatar and a pixel. Measured likewise.
_RUN_SECONDS, _CONTROL_SECONDS, _POSE_SECONDS, _POINT_SECONDS = 0.2, 2e-6, 25e-6, 1e-7
_PICTURE_SECONDS, _FIGURE_SECONDS, _PIXEL_SECONDS = 0.02, 4e-4, 8e-8


@dataclass(frozen=True)
class Estimate:
    """What a run takes.

    Attributes:
        bytes: Room on disk, outputs included [bytes].
        memory: Memory of the process [bytes].
        seconds: Time on one core [s].
    """

    bytes: float
    memory: float
    seconds: float


def estimate(avatars: int, control_frames: int, control_rate: float, outputs: Outputs) -> Estimate:
    """Return what a run takes.

    Args:
        avatars: Number of avatars.
        control_frames: Control frames.
        control_rate: Control frames a second.
        outputs: Its outputs, resolved.
    """
    memory, size = estimate_needs(avatars, control_frames)
    size += _RUN_BYTES
    seconds = _RUN_SECONDS + _CONTROL_SECONDS * avatars * control_frames
    if outputs.bvh is not None:
        count = avatars if outputs.bvh.avatars is None else len(outputs.bvh.avatars)
        poses = count * _count(control_frames, control_rate, outputs.bvh.fps or 60.0, outputs.bvh.frames)
        size += _BVH_BYTES * poses
        seconds += _POSE_SECONDS * poses
    for cloud in (outputs.ply, outputs.pcd):
        if cloud is not None:
            count = avatars if cloud.avatars is None else len(cloud.avatars)
            clouds = _count(control_frames, control_rate, cloud.fps or 60.0, cloud.frames) / cloud.every
            size += _POINT_BYTES * cloud.points * count * clouds
            seconds += (_POINT_SECONDS * cloud.points + _POSE_SECONDS) * count * clouds
    render = outputs.render
    if render is not None:
        moving = _count(control_frames, control_rate, render.fps, render.frames) if render.mp4 or render.png else 0
        pixels = render.size[0] * render.size[1]
        still = render.contact_sheet or 0
        size += pixels * (moving * (_PNG_BYTES * render.png + _VIDEO_BYTES * render.mp4) + _PNG_BYTES * (still > 0))
        seconds += (moving + still) * (_PICTURE_SECONDS + _FIGURE_SECONDS * avatars + _PIXEL_SECONDS * pixels)
    return Estimate(size, memory, seconds)


def _count(control_frames: int, control_rate: float, fps: float, frames: object) -> int:
    """Return how many output frames are written."""
    count = output_frames(control_frames, control_rate, fps)
    first, stop = frames if isinstance(frames, tuple) else (0, count)
    return max(0, min(stop, count) - first)


def check_disk(folder: Path, estimates: Iterable[Estimate]) -> None:
    """Refuse runs for which the disk has no room.

    Raises:
        BatchError: It has not.
    """
    needed = sum(one.bytes for one in estimates)
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free
    if needed > free:
        what = f"the runs take about {needed / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free in {existing}"
        raise BatchError(f"{folder}: {what}; expected fewer runs or outputs, or --out on another disk")
