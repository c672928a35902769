"""Recordings: motion of a crowd at a frame rate with all that the player shows of it, posed block by block."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from crowdsim.body.palette import EYES
from crowdsim.core.types import Array, Progress
from crowdsim.motion.body import Body
from crowdsim.motion.skeleton import Skeleton
from crowdsim.poses.capsules import swelling_capsules
from crowdsim.poses.facing import face_direction
from crowdsim.render.camera import build_track
from crowdsim.render.crowd_path import Crowd
from crowdsim.render.figure import Figure, dress, figure_segments
from crowdsim.render.source import PoseSource
from crowdsim.render.view import View
from crowdsim.scenario.camera import Camera
from crowdsim.view.blocks import STEP, deflate, pack_block, pack_tables, rotation_bits

FORMAT, VERSION = "crowdsim-recording", 1
OUTSIDE = -1_000_000
"""Number of an avatar that the recording does not hold."""
HAIR = EYES + 1
"""Number of the paint of hair, which comes after that of eyes."""
_AVATAR_FRAMES, _LEAST_FRAMES = 200_000, 10
"""Most avatar-frames of a block, and its least number of frames."""
_TRACK_STEP, _SIZE = 0.2, (1280, 720)
"""Time between the moments of a camera's track [s], and size of the picture that cameras frame the crowd for."""
_CAMERAS = ("auto", "side", "front", "top", "orbit")
_FEW = range(2, 5)
"""Numbers of avatars for which ``auto`` is ``fight``, whose plan takes seconds."""
_TURN = 0.985
"""Cosine of how far a camera turns from one moment of its track to the next where that may be a cut."""


class Motion(Protocol):
    """Motion that is recorded.

    Attributes:
        fps: Frames a second.
        first: First frame, at the time ``first / fps``.
        frames: Number of frames.
        bits: Bits of the rotations of each figure's joints. Length of figures, each (J,).
        avatars: Number of avatars.
    """

    fps: float
    first: int
    frames: int
    bits: list[Array]
    avatars: int

    def poses(self, start: int, stop: int) -> list[tuple[Array, Array]]:
        """Return poses of frames ``start`` to ``stop``, counted from the first: see ``blocks.pack_block``."""

    def describe(self) -> tuple[dict[str, Any], dict[str, Array]]:
        """Return what the player shows beside motion: a document, and tables by name."""


class PlannedCamera:
    """A camera over a recording, which is planned when its track is first asked for.

    Args:
        source: What it films.
        camera: The camera, or its kind.
        crowd: Where those avatars are that are recorded.
        first: First frame that is recorded.
        frames: Number of frames.
        keys: Its keys in a scenario.
        slow: Whether its plan takes seconds.
    """

    def __init__(
        self, source: PoseSource, camera: str | Camera, crowd: Crowd, first: int, frames: int,
        keys: Mapping[str, Any], slow: bool,
    ) -> None:  # fmt: skip
        self._source, self._camera, self._crowd = source, camera, crowd
        self._first, self._frames = first, frames
        self.keys, self.slow = keys, slow

    @cached_property
    def track(self) -> Array:
        """Eye, direction, field [rad] and haze [m] at every ``_TRACK_STEP``, and the cut before the next one.

        The cut is the share of the time to the next moment that is before it; -1 where there is none. Shape (M, 9).
        """
        view = build_track(self._source, self._camera, _SIZE, self._crowd).view
        step, end = _TRACK_STEP * self._source.fps, self._first + self._frames - 1
        moments = np.minimum(self._first + np.arange(0.0, self._frames + step, step), end)
        views = [view(float(moment)) for moment in moments]
        rows = np.array([[*one.eye, *one.ahead, one.field, one.haze, -1.0] for one in views], np.float32)
        for row in np.flatnonzero((rows[1:, 3:6] * rows[:-1, 3:6]).sum(axis=1) < _TURN):
            cut = _find_cut(view, float(moments[row]), float(moments[row + 1]))
            rows[row, 8] = -1.0 if cut is None else (cut - moments[row]) / step
        return rows

    def packed(self) -> bytes:
        """Return the track, packed for a player that asks for it."""
        return deflate(self.track.tobytes())


def _find_cut(view: Callable[[float], View], low: float, high: float) -> float | None:
    """Return the frame before which a camera cuts between two frames; None where it only turns."""

    def turn(start: float, end: float) -> float:
        return 1.0 - float(np.dot(view(start).ahead, view(end).ahead))

    whole = turn(low, high)
    while high - low > 0.1:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if turn(low, middle) > turn(middle, high) else (middle, high)
    return high if turn(low, high) > 0.5 * whole else None


@dataclass(frozen=True)
class Recording:
    """Motion in blocks.

    Attributes:
        motion: The motion.
        name: What it is called.
        cameras: Cameras by name, beside those that the viewer moves.
        block_seconds: Length of a block [s], where that is not too much for a large crowd. Long ones take less room,
            short ones are there sooner.
        more: Further plain data for the player.
    """

    motion: Motion
    name: str
    cameras: Mapping[str, PlannedCamera]
    block_seconds: float = 5.0
    more: Mapping[str, Any] = field(default_factory=dict)

    @property
    def block_frames(self) -> int:
        """Number of frames of a block."""
        most = _AVATAR_FRAMES // max(1, self.motion.avatars)
        return max(_LEAST_FRAMES, min(round(self.block_seconds * self.motion.fps), most))

    @property
    def block_count(self) -> int:
        """Number of blocks."""
        return -(-self.motion.frames // self.block_frames)

    def scene(self, slow: bool = True) -> bytes:
        """Return what the player shows beside motion, packed.

        Args:
            slow: Whether tracks of cameras are in it whose plan takes seconds; the player asks for others.
        """
        motion = self.motion
        document, tables = motion.describe()
        tracks = {f"camera_{i}": one.track for i, one in enumerate(self.cameras.values()) if slow or not one.slow}
        return pack_tables(
            {
                "format": FORMAT,
                "version": VERSION,
                "name": self.name,
                "fps": motion.fps,
                "first": motion.first,
                "frames": motion.frames,
                "block": self.block_frames,
                "step": STEP,
                "track_step": _TRACK_STEP,
                "cameras": [{"name": name, **one.keys} for name, one in self.cameras.items()],
                **document,
                **self.more,
            },
            {**tables, **tracks},
        )

    def block(self, number: int) -> bytes:
        """Return a block of poses, packed; numbers begin at 0."""
        return pack_block(self._poses(number))

    def _poses(self, number: int) -> list[tuple[Array, Array, Array]]:
        start = number * self.block_frames
        poses = self.motion.poses(start, min(start + self.block_frames, self.motion.frames))
        return [(bits, *one) for bits, one in zip(self.motion.bits, poses, strict=True)]

    def blocks(self, threads: int = 1, progress: Progress | None = None) -> Iterator[str]:
        """Yield all blocks in base64, the next ones posed while one is packed."""
        count = self.block_count
        with ThreadPoolExecutor(max(1, min(threads, 2))) as pool:
            waiting = [pool.submit(_encode, self._poses(0))]
            for number in range(count):
                if number + 1 < count:
                    waiting.append(pool.submit(_encode, self._poses(number + 1)))
                yield waiting.pop(0).result()
                if progress is not None:
                    progress("page", number + 1, count)


def _encode(parts: list[tuple[Array, Array, Array]]) -> str:
    return base64.b64encode(pack_block(parts)).decode("ascii")


def joint_reaches(skeleton: Skeleton, figure: Figure, held: Array | None = None) -> Array:
    """Return how far a body, and what it holds (``PROP``), reaches beyond each of its joints [m]. Shape (J,)."""
    reaches = np.zeros(skeleton.joint_count)
    ends = np.maximum(
        np.linalg.norm(figure.capsule_starts, axis=1), np.linalg.norm(figure.capsule_ends, axis=1)
    ) + np.max(figure.capsule_radii, axis=1, initial=0.0)
    np.maximum.at(reaches, figure.capsule_joints, ends)
    if held is not None:
        ends = np.maximum(np.linalg.norm(held["start"], axis=1), np.linalg.norm(held["end"], axis=1)) + held["radius"]
        np.maximum.at(reaches, held["joint"], ends)
    if len(skeleton.end_parents):
        np.maximum.at(reaches, skeleton.end_parents, np.linalg.norm(skeleton.end_offsets, axis=1))
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    for joint in range(skeleton.joint_count - 1, 0, -1):
        parent = int(skeleton.parents[joint])
        reaches[parent] = max(reaches[parent], lengths[joint] + reaches[joint])
    return reaches


def describe_figure(
    skeleton: Skeleton,
    figure: Figure,
    segments: Array,
    moving: Sequence[int],
    skinned: bool = False,
    held: Array | None = None,
) -> dict[str, Any]:
    """Return a figure as the player wants it: its joints, and its capsules with the largest first.

    Args:
        skeleton: Its skeleton.
        figure: Its capsules, a ``Body`` with face and trunks.
        segments: Which bones each of its joints carries, see ``builds.joint_segments``. Shape (J,).
        moving: Joints whose positions are recorded.
        skinned: Whether it has a skin when it is seen from near; its capsules have hair instead of a headguard.
        held: What avatars of this figure carry, see ``Cast.held``.
    """
    dressed, lie_on = dress(figure), figure_segments(figure)
    lengths = np.linalg.norm(dressed.capsule_ends - dressed.capsule_starts, axis=1)
    wide = np.max(dressed.capsule_radii, axis=1)
    order = np.argsort(-(lengths + 1.6 * wide) * wide, kind="stable")
    parts = np.array(dressed.capsule_parts)
    if skinned:
        parts[len(figure.capsule_parts)] = HAIR
    parts = parts[order]
    described = {
        "joints": list(skeleton.names),
        "parents": [int(parent) for parent in skeleton.parents],
        "offsets": _flat(skeleton.offsets),
        "segments": [int(segment) for segment in segments],
        "bits": rotation_bits(joint_reaches(skeleton, dressed, held)).tolist(),
        "moving": list(moving),
        "capsules": {
            "joints": dressed.capsule_joints[order].tolist(),
            "starts": _flat(dressed.capsule_starts[order]),
            "ends": _flat(dressed.capsule_ends[order]),
            "radii": _flat(dressed.capsule_radii[order]),
            "parts": parts.tolist(),
            "segments": lie_on[order].tolist(),
            "swells": swelling_capsules(parts).astype(int).tolist(),
        },
    }
    if isinstance(figure, Body):
        roles = figure.roles
        described["face"] = {
            "joint": int(roles["head"]),
            "offset": _flat(figure.head_offset),
            "ahead": _flat(face_direction(figure)),
        }
        described["feet"] = [int(roles["left_foot"]), int(roles["right_foot"])]
    return described


def pack_paints(paints: Array) -> Array:
    """Return paints (..., 4) as bytes, of which those of light are its square roots."""
    shades = np.concatenate([np.sqrt(np.clip(paints[..., :3], 0.0, 1.0)), np.clip(paints[..., 3:], 0.0, 1.0)], -1)
    return np.rint(255.0 * shades).astype(np.uint8)


def _flat(values: Array) -> list[float]:
    return [round(float(value), 5) for value in np.asarray(values, float).ravel()]


def plan_cameras(
    source: PoseSource, crowd: Crowd, first: int, frames: int, whole: bool
) -> tuple[dict[str, PlannedCamera], Array]:
    """Return the cameras that frame the crowd by name, those of its scenario too, and the direction to the sun.

    Args:
        source: The crowd, at the rate of the recording.
        crowd: Where those avatars are that are recorded.
        first: First frame that is recorded.
        frames: Number of frames.
        whole: Whether all avatars are recorded; other cameras are left out where they are not.
    """
    few = len(crowd.present) in _FEW
    named: dict[str, tuple[str | Camera, dict[str, Any]]] = {
        name: (name, {"kind": name}) for name in _CAMERAS if whole or name != "auto"
    }
    for name, camera in source.cameras.items() if whole else ():
        keys = camera.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        named[name] = camera, {**keys, "kind": camera.kind}
    found = {
        name: PlannedCamera(source, camera, crowd, first, frames, keys, keys["kind"] == "fight" or (
            few and keys["kind"] == "auto"))
        for name, (camera, keys) in named.items()
    }  # fmt: skip
    return found, build_track(source, "side", _SIZE, crowd).sun
