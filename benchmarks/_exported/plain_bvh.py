"""A small reader of BVH files and the forward kinematics of what they hold, in plain numpy: a witness of its own.

It shares no code with the package, so that figures that both find are found twice. Positions are in metres. A file of
another unit than centimetres and of another up axis than y is beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

CENTIMETRE = 0.01


@dataclass(frozen=True)
class PlainBvh:
    """What a BVH file says; F frames, J joints.

    Attributes:
        names: Names of the joints. Length J.
        parents: Parent of each joint, -1 for the root. Shape (J,).
        offsets: Position of each joint in its parent's frame [m]. Shape (J, 3).
        channels: Channels of each joint, in the order of the file.
        fps: Frames a second.
        values: Numbers of the file, a row a frame. Shape (F, C).
    """

    names: tuple[str, ...]
    parents: Array
    offsets: Array
    channels: tuple[tuple[str, ...], ...]
    fps: float
    values: Array


def read_plain(path: Path, frames: Array | None = None) -> PlainBvh:
    """Read a BVH file, some frames of it where they are given."""
    head, _, rest = path.read_text().partition("MOTION")
    words = iter(head.split())
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[tuple[str, ...]] = []
    # What is open: joints by number, -1 for an end site.
    opened: list[int] = []
    coming = -1
    for word in words:
        if word in ("ROOT", "JOINT"):
            names.append(next(words))
            parents.append(opened[-1] if opened else -1)
            channels.append(())
            coming = len(names) - 1
        elif word == "End":
            next(words)
            coming = -1
        elif word == "{":
            opened.append(coming)
        elif word == "}":
            opened.pop()
        elif word == "OFFSET":
            offset = [float(next(words)) for _ in range(3)]
            if opened[-1] >= 0:
                offsets.append(offset)
        elif word == "CHANNELS":
            channels[opened[-1]] = tuple(next(words) for _ in range(int(next(words))))
    lines = rest.strip().split("\n", 2)
    count, seconds = int(lines[0].split()[-1]), float(lines[1].split()[-1])
    written = lines[2].split("\n")[:count]
    chosen = written if frames is None else [written[frame] for frame in frames]
    values = np.array(" ".join(chosen).split(), dtype=float).reshape(len(chosen), -1)
    return PlainBvh(
        tuple(names), np.array(parents), np.array(offsets) * CENTIMETRE, tuple(channels), 1.0 / seconds, values
    )


def turn(axis: str, degrees: Array) -> Array:
    """Matrices that turn about an axis. Shape (F, 3, 3)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.zeros((len(degrees), 3, 3))
    k = "XYZ".index(axis)
    a, b = (k + 1) % 3, (k + 2) % 3
    matrix[:, k, k] = 1.0
    matrix[:, a, a], matrix[:, b, b] = c, c
    matrix[:, a, b], matrix[:, b, a] = -s, s
    return matrix


def local_turns(bvh: PlainBvh) -> tuple[Array, Array]:
    """Positions (F, J, 3) [m] and turns (F, J, 3, 3) of joints in their parents' frames."""
    frames, column = len(bvh.values), 0
    positions = np.broadcast_to(bvh.offsets, (frames, *bvh.offsets.shape)).copy()
    turns = np.broadcast_to(np.eye(3), (frames, len(bvh.names), 3, 3)).copy()
    for joint, channels in enumerate(bvh.channels):
        # A joint that has positions is where they say, offset or not.
        for channel in channels:
            value = bvh.values[:, column]
            column += 1
            axis, kind = channel[0], channel[1:]
            if kind == "position":
                positions[:, joint, "XYZ".index(axis)] = value * CENTIMETRE
            else:
                turns[:, joint] = turns[:, joint] @ turn(axis, value)
    return positions, turns


def pose(bvh: PlainBvh, turned: dict[int, Array] | None = None) -> tuple[Array, Array]:
    """Positions (F, J, 3) [m] and turns (F, J, 3, 3) of joints in the world.

    Joints of ``turned`` turn as if half a turn about an axis (3,) of their parent's frame lay before it and after it.
    """
    positions, turns = local_turns(bvh)
    for joint, axis in (turned or {}).items():
        half = 2.0 * np.outer(axis, axis) / np.dot(axis, axis) - np.eye(3)
        turns[:, joint] = half @ turns[:, joint] @ half
    for joint, parent in enumerate(bvh.parents):
        if parent >= 0:
            positions[:, joint] = positions[:, parent] + np.einsum("fij,fj->fi", turns[:, parent], positions[:, joint])
            turns[:, joint] = turns[:, parent] @ turns[:, joint]
    return positions, turns
