"""Arrays of a take as they are written: of Zarr's format 2, what ``lazy_arrays`` reads."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.array_checks import Column
from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.files import write_plain
from crowdsim.take.lazy_arrays import StoredColumn
from crowdsim.take.metadata import ArrayFacts, read_model

GROUP = {"zarr_format": 2}
_LEVEL = 1
"""Level of Zstandard, the fastest one."""


@dataclass
class GrowingArray:
    """An array on disk that grows along its first axis; all but what is written last must be whole chunks.

    Attributes:
        take: Folder of the take.
        name: Name of the array in it, with ``/`` between groups.
        shape: Its shape so far.
        chunks: Shape of a chunk; those at the ends are filled up with zeros.
        dtype: Type of its entries.
    """

    take: Path
    name: str
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: np.dtype[Any]

    @classmethod
    def existing(cls, take: Path, name: str) -> GrowingArray:
        """Return an array that is there already.

        Raises:
            TakeError: It is missing, or none of a take.
        """
        facts = read_model(take, f"{name}/.zarray", ArrayFacts)
        return cls(take, name, tuple(facts["shape"]), tuple(facts["chunks"]), np.dtype(facts["dtype"]))

    def describe(self, attributes: Mapping[str, Any]) -> None:
        """Write what there is to know of its entries.

        Raises:
            OutputError: It cannot be written.
        """
        write_json(self.take, f"{self.name}/.zattrs", attributes)

    def resize(self, length: int) -> None:
        """Give it another length, for which its chunks are there.

        Raises:
            OutputError: It cannot be written.
        """
        self.shape = length, *self.shape[1:]
        # Without a fill value: xarray reads it as the mark of missing values and would turn every 0 and False into NaN.
        facts = {
            "shape": self.shape,
            "chunks": self.chunks,
            "dtype": self.dtype.str,
            "fill_value": None,
            "order": "C",
            "filters": None,
            "dimension_separator": ".",
            "compressor": {"id": "zstd", "level": _LEVEL},
            **GROUP,
        }
        write_json(self.take, f"{self.name}/.zarray", facts)

    def append(self, values: Array) -> None:
        """Write entries behind those that are there, in several threads where they are many chunks.

        Raises:
            OutputError: They cannot be written.
        """
        from numcodecs.zstd import Zstd

        first, codec = self.shape[0] // self.chunks[0], Zstd(level=_LEVEL)
        counts = [-(-count // size) for count, size in zip(values.shape, self.chunks, strict=True)]
        places = list(itertools.product(*map(range, counts)))

        def write(low: int, high: int) -> None:
            for place in places[low:high]:
                spans = (slice(k * size, (k + 1) * size) for k, size in zip(place, self.chunks, strict=True))
                part = values[tuple(spans)]
                whole = np.ascontiguousarray(part, self.dtype)
                if whole.shape != self.chunks:
                    whole = np.zeros(self.chunks, self.dtype)
                    whole[tuple(map(slice, part.shape))] = part
                number = ".".join(map(str, (first + place[0], *place[1:])))
                write_plain(self.take, f"{self.name}/{number}", codec.encode(whole))

        share(len(places), write, least=1)
        self.resize(self.shape[0] + len(values))

    def read(self) -> StoredColumn:
        """Return it for reading; entries are not checked."""
        column = Column(str(self.dtype), self.shape)
        return StoredColumn(self.take / self.name, self.shape, self.chunks, self.dtype, column, {})


def write_json(folder: Path, name: str, document: Mapping[str, Any]) -> None:
    """Write a file of metadata.

    Raises:
        OutputError: It cannot be written.
    """
    write_plain(folder, name, json.dumps(document, indent=2))
