"""Writes BVH files, whole or in chunks of frames, by fixed-point text in compiled code."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from crowdsim.bvh.clip import channel_motion, file_order, from_clip
from crowdsim.bvh.file import Bvh
from crowdsim.bvh.kernels import format_numbers
from crowdsim.bvh.scanner import Scanner
from crowdsim.core.types import Array, FileName
from crowdsim.errors import BvhError, OutputError
from crowdsim.motion.skeleton import Clip, Skeleton

_MOST_DECIMALS = 12
_DEEPEST_INDENT = 64
_BLOCK_NUMBERS = 1 << 16


def format_header(bvh: Bvh, frames: int | None = None) -> bytes:
    """Return the text of a file up to its first row of motion.

    Args:
        bvh: The file, whose motion does not matter.
        frames: Number of rows that follow; by default those of the motion.

    Raises:
        BvhError: A name cannot be written, or the rate is no positive number.
    """
    frames = bvh.frame_count if frames is None else frames
    if not (np.isfinite(bvh.fps) and bvh.fps > 0.0):
        raise BvhError(f"{bvh.fps!r} frames a second cannot be written, expected a number above 0")
    if not np.array_equal(file_order(bvh.parents), np.arange(bvh.joint_count)):
        raise BvhError("joints are out of order, expected each with all that hangs on it before the next")
    children: list[list[int]] = [[] for _ in bvh.names]
    for joint, parent in enumerate(bvh.parents):
        if parent >= 0:
            children[parent].append(joint)
    ends: list[list[int]] = [[] for _ in bvh.names]
    for end, parent in enumerate(bvh.end_parents):
        ends[parent].append(end)
    lines = ["HIERARCHY"]
    todo: list[tuple[int, int]] = [(int(root), 0) for root in np.flatnonzero(bvh.parents < 0)[::-1]]
    while todo:
        joint, depth = todo.pop()
        pad = "  " * min(depth, _DEEPEST_INDENT)
        if joint < 0:
            lines.append(pad + "}")
            continue
        lines.append(f"{pad}{'JOINT' if bvh.parents[joint] >= 0 else 'ROOT'} {_writable(bvh.names[joint])}")
        lines.append(pad + "{")
        lines.append(f"{pad}  OFFSET {_plain(bvh.offsets[joint])}")
        own = bvh.channels[joint]
        lines.append(" ".join([f"{pad}  CHANNELS {len(own)}", *own]))
        for end in ends[joint]:
            lines.append(f"{pad}  End {_writable(bvh.end_names[end])}")
            lines.append(pad + "  {")
            lines.append(f"{pad}    OFFSET {_plain(bvh.end_offsets[end])}")
            lines.append(pad + "  }")
        todo.append((-1, depth))
        todo.extend((child, depth + 1) for child in reversed(children[joint]))
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {1.0 / bvh.fps:.10f}", ""]
    return "\n".join(lines).encode()


def format_motion(motion: Array, decimals: int = 6) -> bytes | bytearray:
    """Return rows of numbers as text, a line each, with fixed decimals, correctly rounded.

    Args:
        motion: Positions in file units and angles in degrees. Shape (F, C).
        decimals: Digits after the point, 0 to 12.

    Raises:
        BvhError: A value is not finite (says which), or the decimals are out of range.
    """
    if not 0 <= decimals <= _MOST_DECIMALS:
        raise BvhError(f"{decimals} decimals cannot be written, expected 0 to {_MOST_DECIMALS}")
    motion = np.ascontiguousarray(motion, dtype=float)
    if motion.size == 0:
        return b"\n" * len(motion)
    largest = max(float(motion.max()), -float(motion.min()))
    if not np.isfinite(largest):
        frame, column = np.argwhere(~np.isfinite(motion))[0]
        raise BvhError(f"frame {frame}, column {column} is {motion[frame, column]}, which no BVH file can hold")
    if largest * 10.0**decimals >= 2.0**52:
        return "".join(" ".join(_fixed(value, decimals) for value in row) + "\n" for row in motion.tolist()).encode()
    text = bytearray(motion.size * (len(str(int(largest) + 1)) + decimals + 3) + 8)
    del text[int(format_numbers(motion, 0, len(motion), decimals, np.frombuffer(text, np.uint8))) :]
    return text


def format_bvh(bvh: Bvh, decimals: int = 6) -> bytes:
    """Return a whole file as text; its motion is written unchanged.

    Raises:
        BvhError: A value is not finite (says the frame, joint and channel), or a name cannot be written.
    """
    return b"".join(_blocks(bvh, decimals))


def _blocks(bvh: Bvh, decimals: int) -> Iterator[bytes | bytearray]:
    """Yield the text of a file in blocks, the header first."""
    if not np.isfinite(bvh.motion).all():
        frame, column = (int(number) for number in np.argwhere(~np.isfinite(bvh.motion))[0])
        value = bvh.motion[frame, column]
        raise BvhError(f"frame {frame}, {bvh.describe_column(column)} is {value}, which no BVH file can hold")
    yield format_header(bvh)
    rows = max(1, _BLOCK_NUMBERS // max(1, bvh.motion.shape[1]))
    for start in range(0, bvh.frame_count, rows):
        yield format_motion(bvh.motion[start : start + rows], decimals)


def write_bvh(
    path: FileName, motion: Bvh | Clip, order: str | Sequence[str] = "ZXY", unit_scale: float = 0.01, decimals: int = 6
) -> None:
    """Write a file in one go, under a temporary name that is renamed when it is complete.

    Args:
        path: The file.
        motion: A clip, which is written y up with angles that do not jump, or a ``Bvh``, which is written unchanged.
        order: Rotation order of all joints, or one for each; for a clip.
        unit_scale: Metres in one file unit, centimetres by default; for a clip.
        decimals: Digits after the point.

    Raises:
        BvhError: A value is not finite, or something else no BVH file can hold.
        OutputError: The file cannot be written.
    """
    bvh = from_clip(motion, order, unit_scale) if isinstance(motion, Clip) else motion
    temporary = _temporary_beside(path)
    try:
        with open(temporary, "wb") as file:
            for block in _blocks(bvh, decimals):
                file.write(block)
        os.replace(temporary, path)
    except OSError as error:
        raise _cannot_write(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


class BvhWriter:
    """Writes one file in chunks of frames, whose number is known from the start.

    Holds no open file between chunks, so any number of writers may live at once. Use it as a context manager: the file
    takes its name when the block ends well and the frames are all there, and leaves no trace otherwise.
    """

    def __init__(
        self,
        path: FileName,
        skeleton: Skeleton,
        fps: float,
        frames: int,
        order: str | Sequence[str] = "ZXY",
        unit_scale: float = 0.01,
        decimals: int = 6,
        moving: bool = False,
    ) -> None:
        """Begin a file.

        Args:
            path: The file.
            skeleton: The skeleton, J joints [m].
            fps: Frames a second.
            frames: Number of frames that will be appended.
            order: Rotation order of all joints, or one for each.
            unit_scale: Metres in one file unit, centimetres by default.
            decimals: Digits after the point.
            moving: Whether all joints have positions, as chunks with translations need.
        """
        self.path = Path(path)
        self.frames = frames
        self.written = 0
        self._unit_scale = unit_scale
        self._decimals = decimals
        self._joints = file_order(skeleton.parents)
        self._angles = np.full((skeleton.joint_count, 3), np.nan)
        joints = skeleton.joint_count
        moved = np.zeros((0, joints, 3)) if moving else None
        clip = Clip(self.path.stem, skeleton, fps, np.zeros((0, 3)), np.zeros((0, joints, 4)), moved)
        bvh = from_clip(clip, order, unit_scale)
        self._channels = bvh.channels
        header = format_header(bvh, frames)
        self._temporary = _temporary_beside(path)
        self._append(header)

    def append(self, root_positions: Array, rotations: Array, translations: Array | None = None) -> None:
        """Write the next frames: roots [m] (F, 3), local rotations (F, J, 4), and (F, J, 3) [m] when joints move.

        Raises:
            BvhError: A value is not finite, or there are more frames than announced.
            OutputError: The file cannot be written.
        """
        if self.written + len(rotations) > self.frames:
            raise BvhError(f"{self.path}: {self.written + len(rotations)} frames, {self.frames} were announced")
        if not np.array_equal(self._joints, np.arange(len(self._joints))):
            rotations = rotations[:, self._joints]
            translations = None if translations is None else translations[:, self._joints]
        rows = channel_motion(self._channels, root_positions, rotations, translations, self._unit_scale, self._angles)
        self._append(format_motion(rows, self._decimals))
        self.written += len(rows)

    def close(self) -> None:
        """Give the file its name.

        Raises:
            BvhError: Frames are missing.
            OutputError: The file cannot be renamed.
        """
        if self.written != self.frames:
            self.abandon()
            raise BvhError(f"{self.path}: {self.written} frames, {self.frames} were announced")
        try:
            os.replace(self._temporary, self.path)
        except OSError as error:
            self.abandon()
            raise _cannot_write(self.path, error) from error

    def abandon(self) -> None:
        """Remove what was written so far."""
        self._temporary.unlink(missing_ok=True)

    def __enter__(self) -> BvhWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    def _append(self, text: bytes | bytearray) -> None:
        try:
            with open(self._temporary, "ab") as file:
                file.write(text)
        except OSError as error:
            self.abandon()
            raise _cannot_write(self.path, error) from error


def _temporary_beside(path: FileName) -> Path:
    """Create an empty file in the folder of ``path``, so that renaming stays on one disk."""
    temporary = Path(path).parent / f".{Path(path).name[:100]}.{uuid.uuid4().hex}.part"
    try:
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise _cannot_write(path, error) from error
    return temporary


def _cannot_write(path: FileName, error: OSError) -> OutputError:
    return OutputError(f"{os.fspath(path)}: cannot be written: {error.strerror or error}")


def _fixed(number: float, decimals: int) -> str:
    """Return a number of any size with fixed decimals, zero without a sign."""
    text = f"{number:.{decimals}f}"
    return text if text.strip("-0.") else text.lstrip("-")


def _plain(vector: Array) -> str:
    """Return numbers without exponents, to nine digits after the point."""
    return " ".join(np.format_float_positional(number + 0.0, precision=9, trim="-") for number in vector)


def _writable(name: str) -> str:
    """Return a name if it reads back as itself; not if it is empty, breaks the line, or has blanks at its ends."""
    try:
        text = name.encode()
        if text and Scanner(text + b"\n{", "").name() == text:
            return name
    except (BvhError, UnicodeEncodeError):
        pass
    raise BvhError(f"joint name {name!r} cannot be written, expected one line without blanks at its ends")
