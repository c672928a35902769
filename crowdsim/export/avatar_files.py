"""Outputs of one file for each avatar, with the frames in which it is there."""

from __future__ import annotations

import os
import uuid
from abc import abstractmethod
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from crowdsim.config.files import Finding
from crowdsim.core.types import Array
from crowdsim.errors import OutputError
from crowdsim.export.posed import POSE_SECONDS, PosedOutput, extent_of
from crowdsim.export.stream import Block, run_all
from crowdsim.scenario.output import Extent, Series

if TYPE_CHECKING:
    from crowdsim.poses.sampler import PoseSampler

MAXIMUM_FILES = 10_000
_FILES_AT_ONCE = 128


class Writer(Protocol):
    """Writes one file in pieces; it has its name once it is closed."""

    path: Path

    def close(self) -> None:
        """Give the file its name."""

    def abandon(self) -> None:
        """Remove what was written so far."""


class AvatarFiles(PosedOutput):
    """An output of one file for each avatar: ``NAME/AVATAR.NAME``. A subclass begins files and appends to them."""

    reads_joints: ClassVar[bool] = False

    @abstractmethod
    def begin(self, sampler: PoseSampler, avatar: int, path: Path, frames: int) -> Writer:
        """Begin the file of an avatar, of which so many output frames will be appended."""

    @abstractmethod
    def append(self, writer: Writer, block: Block, policy: int, column: int, rows: Array) -> None:
        """Append rows (R,) of a column of one policy's poses to a file; there may be none.

        Rows in which the avatar is absent are left out, unless the output ``covers_absence``.
        """

    @abstractmethod
    def pose_bytes(self) -> float:
        """Return about how much room an avatar takes at a time [bytes]."""

    @property
    def covers_absence(self) -> bool:
        """Whether files cover all frames, also those in which their avatar is absent."""
        return False

    @property
    def step(self) -> int:
        """Every how manyth output frame is written."""
        return 1

    @classmethod
    def posed_pattern(cls) -> str:
        """Return the regular expression of the names of its files."""
        return rf"{cls.name}/[^/]+\.{cls.name}"

    def findings(self, avatars: int) -> Iterator[Finding]:
        """Yield a finding for each avatar that there is not, and where there are too many."""
        if self.avatars is None and avatars > MAXIMUM_FILES:
            what = f"asks for {avatars:,} files, expected at most {MAXIMUM_FILES:,}; choose some by 'avatars'"
            yield Finding((), what)
        yield from super().findings(avatars)

    def posed_files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the names of the files, in the order of the avatars."""
        yield from (f"{self.name}/{self.file_of(names[avatar])}" for avatar in self.chosen(len(names)))

    def file_of(self, avatar: str) -> str:
        """Return the file in its folder that holds an avatar of a name."""
        return f"{avatar}.{self.name}"

    def cost(self, extent: Extent) -> tuple[float, float]:
        """Return about how much room its files take [bytes], and how long one core writes them [s]."""
        poses = len(self.chosen(extent.avatars)) * -(-self.frame_count(extent) // self.step)
        return self.pose_bytes() * poses, POSE_SECONDS * poses

    def sink(self, sampler: PoseSampler, folder: Path, missing: Collection[str] | None = None) -> AvatarSink:
        """Return what writes files of avatars."""
        names = sampler.take.cast.names.tolist()
        chosen = self.chosen(len(names))
        avatars = [one for one in chosen if missing is None or f"{self.name}/{self.file_of(names[one])}" in missing]
        return AvatarSink(self, sampler, folder, np.array(avatars, int))


class AvatarSink:
    """Writes the files of some avatars; a ``Sink``.

    Args:
        output: What it writes.
        sampler: Poses of the take.
        folder: Folder for the files, which is there when the first is written.
        avatars: Numbers of the avatars, ascending.
    """

    margin = 0

    def __init__(self, output: AvatarFiles, sampler: PoseSampler, folder: Path, avatars: Array) -> None:
        self.kind, self.reads_joints, self.avatars, self.done = output.name, output.reads_joints, avatars, 0
        self.start, self.stop = output.frames_of(extent_of(sampler.take))
        self._output, self._sampler, self._folder = output, sampler, folder
        self._writers: dict[int, Writer] | None = None

    @property
    def total(self) -> int:
        """Number of files, those of avatars that are never there included."""
        return len(self.avatars)

    def split(self, most: int) -> list[AvatarSink]:
        """Return sinks of at most ``most`` avatars each, and of no more files than are written at once."""
        size = min(most, _FILES_AT_ONCE)
        parts = [self.avatars[low : low + size] for low in range(0, len(self.avatars), size)]
        return [AvatarSink(self._output, self._sampler, self._folder, part) for part in parts]

    def write(self, block: Block, pool: ThreadPoolExecutor) -> None:
        """Append a block of frames to every file."""
        if self._writers is None:
            self._writers = self._open()
        writers, step = self._writers, self._output.step
        low, high = max(block.first_output, self.start), min(block.stop_output, self.stop)
        rows = np.arange(low + (self.start - low) % step, high, step) - block.first

        def append(policy: int, column: int) -> None:
            poses = block.poses[policy]
            writer = writers.get(int(poses.avatars[column]))
            if writer is not None:
                there = self._output.covers_absence | np.isfinite(poses.root_positions[rows, column, 0])
                self._output.append(writer, block, policy, column, rows[there])

        work = [(policy, column) for policy, poses in enumerate(block.poses) for column in range(len(poses.avatars))]
        run_all(pool, lambda item: append(*item), work)
        self.done = self.total * (high - self.start) // (self.stop - self.start)

    def close(self) -> list[Path]:
        """Give the files their names and return them, in the order of the avatars."""
        writers = self._writers or {}
        for writer in writers.values():
            writer.close()
        return [writer.path for writer in writers.values()]

    def abandon(self) -> None:
        """Remove what is half-written."""
        for writer in (self._writers or {}).values():
            writer.abandon()

    def _open(self) -> dict[int, Writer]:
        """Return writers of the avatars that are there at some time."""
        sampler, output, writers = self._sampler, self._output, {}
        names = sampler.take.cast.names
        for avatar in map(int, self.avatars):
            present = int(np.count_nonzero(sampler.present(avatar, self.start, self.stop, output.rate)))
            if present:
                path = self._folder / output.file_of(str(names[avatar]))
                count = self.stop - self.start if output.covers_absence else present
                writers[avatar] = output.begin(sampler, avatar, path, count)
        return writers


class GrowingFile:
    """A file that is written in pieces under a temporary name; no open file is held between them.

    Raises:
        OutputError: It cannot be written, also of ``append`` and ``close``.
    """

    def __init__(self, path: Path, head: bytes) -> None:
        self.path = path
        self._part = path.with_name(f".{path.name[:100]}.{uuid.uuid4().hex}.part")
        self.append(head)

    def append(self, text: bytes) -> None:
        """Write the next piece."""
        try:
            with open(self._part, "ab") as file:
                file.write(text)
        except OSError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        """Give the file its name."""
        try:
            os.replace(self._part, self.path)
        except OSError as error:
            raise self._failure(error) from error

    def abandon(self) -> None:
        """Remove what was written so far."""
        self._part.unlink(missing_ok=True)

    def _failure(self, error: OSError) -> OutputError:
        self.abandon()
        return OutputError(f"{self.path}: cannot be written: {error.strerror or error}")
