"""Arrays of a take on disk: read chunk by chunk when they are sliced, and checked as they are read.

Of Zarr's format 2 this reads what ``store.TakeWriter`` writes, and nothing else: a stranger's metadata can name codecs
that run code, and chunks that claim to hold more than memory.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.array_checks import ArrayFault, Column
from crowdsim.core.types import Array
from crowdsim.errors import TakeError
from crowdsim.files import read_plain
from crowdsim.take.checks import check_absent, check_actions

_MAGIC = b"\x28\xb5\x2f\xfd"
_SIZES = (0, 2, 4, 8)
_RECENT_BYTES = 1 << 22
_MOST_BYTES = 1 << 27
"""Chunks of which parts were read and that an array keeps, at least one [bytes]."""


class Recent:
    """Chunks that were unpacked last, since most readers ask for a stretch that is next to the one before.

    Attributes:
        chunks: Number along each axis and entries of each, the latest first. They are never written to, and threads
            replace them as a whole.
    """

    chunks: tuple[tuple[tuple[int, ...], Array], ...] = ()


@dataclass(frozen=True)
class StoredColumn:
    """An array on disk; slice it to read it. Its first axis is cut into chunks, and maybe others.

    Attributes:
        folder: The folder of its chunks.
        shape: Its shape.
        chunks: Shape of a chunk; those at the ends are whole, too. Chunks of zeros may be missing.
        dtype: Type of its entries.
        column: What must be true of them.
        sizes: Sizes of dimensions that this refers to.
        action: The actions of the take, where entries are not numbers while avatars are absent.
        counts: Of the actions of a take: how many there are for each avatar, where policies are known. Shape (N,).
        recent: The chunks that were read last.
    """

    folder: Path
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: np.dtype[Any]
    column: Column
    sizes: dict[str, int] = field(repr=False)
    action: StoredColumn | None = field(default=None, repr=False)
    counts: Array | None = field(default=None, repr=False, compare=False)
    recent: Recent = field(default_factory=Recent, repr=False, compare=False)

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def __len__(self) -> int:
        """Length of the first axis."""
        return self.shape[0]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Read all of it."""
        return self[:].astype(dtype or self.dtype, copy=False)

    def __getitem__(self, key: Any) -> Array:
        """Read some of it, by the rules of NumPy.

        Raises:
            TakeError: A chunk is damaged, or holds what it must not.
            IndexError: There is no such entry.
        """
        first, *rest = key if isinstance(key, tuple) else (key,)
        if first is Ellipsis or (isinstance(first, slice) and (first.step or 1) < 0):
            low, high = 0, self.shape[0]
        elif isinstance(first, slice):
            low, high, step = first.indices(self.shape[0])
            first = slice(None, None, step)
        else:
            rows = np.asarray(first)
            rows = np.flatnonzero(rows) if rows.dtype == bool else np.where(rows < 0, rows + self.shape[0], rows)
            low, high = (int(rows.min()), int(rows.max()) + 1) if rows.size else (0, 0)
            if low < 0 or high > self.shape[0]:
                raise IndexError(f"{first} is out of range, expected an index into {self.shape[0]} control frames")
            first = rows - low
        index = (first, *rest)
        found: Array = self.read(low, max(low, high))[index]
        return found

    def limited(self, counts: Array) -> StoredColumn:
        """Return the actions of a take, held against how many there are for each avatar (N,) as they are read."""
        return replace(self, counts=counts)

    def read(self, low: int, high: int) -> Array:
        """Return entries ``low`` to ``high`` along the first axis.

        Raises:
            TakeError: A chunk is damaged, or holds what it must not.
        """
        rows = np.empty((high - low, *self.shape[1:]), self.dtype)
        size = self.chunks[0]
        inner = [range(-(-count // chunk)) for count, chunk in zip(self.shape[1:], self.chunks[1:], strict=True)]
        for number in range(low // size, -(-high // size) if high > low else low // size):
            begin = number * size
            wanted = slice(max(low - begin, 0), min(high - begin, size))
            for places in itertools.product(*inner):
                spans = [
                    slice(k * chunk, min((k + 1) * chunk, count))
                    for k, chunk, count in zip(places, self.chunks[1:], self.shape[1:], strict=True)
                ]
                index = (slice(begin + wanted.start - low, begin + wanted.stop - low), *spans)
                self._read_chunk((number, *places), wanted, rows[index])
        self._check(rows, low, high)
        return rows

    def _read_chunk(self, number: tuple[int, ...], wanted: slice, target: Array) -> None:
        """Write some rows of a chunk to where they go."""
        if target.shape == self.chunks and target.flags.c_contiguous:
            self._decode(number, target)
            return
        recent = self.recent.chunks
        whole = next((values for which, values in recent if which == number), None)
        if whole is None:
            whole = np.empty(self.chunks, self.dtype)
            self._decode(number, whole)
            others = max(_RECENT_BYTES // whole.nbytes - 1, 0)
            self.recent.chunks = ((number, whole), *recent[:others])
        index = (wanted, *(slice(0, count) for count in target.shape[1:]))
        target[...] = whole[index]

    def _decode(self, number: tuple[int, ...], out: Array) -> None:
        from numcodecs.zstd import Zstd

        name = ".".join(map(str, number))
        path = self.folder / name
        try:
            data = read_plain(self.folder, name, _MOST_BYTES)
        except FileNotFoundError:
            out[...] = np.zeros((), self.dtype)
            return
        except OSError as error:
            raise TakeError(f"{path}: cannot be read: {error.strerror or error}") from None
        if content_size(data) != out.nbytes:
            raise TakeError(f"{path}: is damaged: is no chunk of {out.nbytes} bytes")
        try:
            # With room for so much and no more, whatever else it claims to hold.
            Zstd().decode(data, out)
        except (RuntimeError, ValueError) as error:
            raise TakeError(f"{path}: is damaged: {error}") from None

    def _check(self, rows: Array, low: int, high: int) -> None:
        """Hold entries against what must be true of them."""
        if not rows.size:
            return
        name = self.folder.name
        try:
            for check in self.column.checks:
                what = check(rows, self.sizes)
                if what:
                    raise ArrayFault(name, what)
            if self.counts is not None:
                check_actions(rows, self.counts)
            if self.action is not None and math.isnan(rows.min()):
                check_absent(name, rows, self.action.read(low, high))
        except ArrayFault as fault:
            since = f"from [{low}] on, " if low else ""
            raise TakeError(f"{self.folder}: {since}{fault.what}") from None


def content_size(data: bytes) -> int:
    """Return how many bytes a frame of Zstandard says that it holds; -1 where it does not, or is none (RFC 8878)."""
    if len(data) < 6 or data[:4] != _MAGIC:
        return -1
    flag, single, dictionary = data[4] >> 6, data[4] >> 5 & 1, data[4] & 3
    count = _SIZES[flag] or single
    start = 5 + (1 - single)
    if not count or dictionary:
        return -1
    return int.from_bytes(data[start : start + count], "little") + (256 if count == 2 else 0)
