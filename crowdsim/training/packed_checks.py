"""What a packed policy must hold, so that nothing in one is used unchecked: what a bundle does, and tables that fit."""

from __future__ import annotations

import lzma
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from crowdsim.array_checks import ArrayFault
from crowdsim.config.documents import DocumentModel, document_fault
from crowdsim.core.types import Array
from crowdsim.errors import PolicyError
from crowdsim.policy.behind_checks import BEHIND, GROUPS
from crowdsim.policy.checks import DEFENCE, TABLE
from crowdsim.policy.document import PolicyDocument
from crowdsim.policy.document_parts import Hash
from crowdsim.policy.flattening import STATE_VALUES, STORED, check_flattened
from crowdsim.policy.reported import Timings

_KINDS = frozenset(f"{order}{code}" for order, code in (("|", "b1"), ("|", "u1"), ("|", "i1"))) | {
    f"<{letter}{size}" for letter, sizes in (("i", (2, 4, 8)), ("u", (2, 4, 8)), ("f", (2, 4, 8))) for size in sizes
}
_MOST_BYTES = 1 << 33
"""Most bytes that the arrays of one file may have."""
_MOST_ENTRIES = 1 << 31
_KEPT = "values_"


def _check_listed(item: list[Any]) -> list[Any]:
    name, kind, shape = item
    if not (isinstance(name, str) and isinstance(kind, str) and kind in _KINDS and isinstance(shape, list)):
        raise ValueError("expected name, type and shape of an array")
    if len(shape) > 8 or not all(type(size) is int and 0 <= size <= _MOST_BYTES for size in shape):
        raise ValueError("expected a shape of whole numbers")
    return item


class _Part(DocumentModel):
    """A file of compressed arrays."""

    file: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,250}\.xz$")]
    sha256: Hash
    arrays: list[Annotated[list[Any], Field(min_length=3, max_length=3), AfterValidator(_check_listed)]]


class _Packed(DocumentModel):
    """The JSON file of a packed policy."""

    kind: str
    version: int
    checksum: str
    policy: dict[str, Any]
    timings: Timings
    parts: list[_Part] = Field(min_length=1, max_length=8)


def check_packed(path: Path, packed: Mapping[str, Any]) -> None:
    """Hold the JSON file of a packed policy against what it must be.

    Raises:
        PolicyError: It is something else.
    """
    fault = document_fault(_Packed, dict(packed))
    if fault:
        raise PolicyError(f"{path}: {fault}")
    of_bundle: dict[str, Any] = {"kind": "", "version": 0, "checksum": "", "files": {}}
    more = sorted(set(packed["policy"]) & set(of_bundle))
    fault = f"unknown key {more[0]!r}" if more else document_fault(PolicyDocument, {**packed["policy"], **of_bundle})
    if fault:
        raise PolicyError(f"{path}: policy: {fault}")
    for behaviour in packed["policy"]["behaviours"]:
        if behaviour.get("state_values", behaviour) is None:
            raise PolicyError(f"{path}: policy: behaviours: state_values is empty, expected a mapping or no such key")
    names = [item[0] for part in packed["parts"] for item in part["arrays"]]
    if len(set(names)) < len(names):
        raise PolicyError(f"{path}: parts: two arrays have one name, expected each once")
    kept = {f"{_KEPT}{behaviour['name']}" for behaviour in packed["policy"]["behaviours"]}
    optional = {name for group in GROUPS if set(group) & set(names) for name in group}
    optional |= {DEFENCE} & set(names)
    wanted = {name for name in TABLE if name not in ("values", STATE_VALUES, DEFENCE, *BEHIND)} | kept | optional
    if set(names) != wanted:
        odd = sorted(set(names) ^ wanted)[0]
        what = "lack" if odd in wanted else "hold"
        raise PolicyError(f"{path}: parts: {what} an array {odd!r}, expected every array of a packed policy")


def check_unpacked(path: Path, document: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Hold all arrays of a packed policy against what they must be, before any is used.

    Raises:
        PolicyError: One is something else.
    """
    stored = np.dtype(STORED[document["recipe"]["precision"]])
    entries = sum(behaviour["entries"] for behaviour in document["behaviours"])
    if entries > _MOST_ENTRIES:
        raise PolicyError(f"{path}: policy: behaviours: have {entries:,} entries, expected at most {_MOST_ENTRIES:,}")
    plain = {name: array for name, array in arrays.items() if name in TABLE}
    try:
        # The tables are checked when the bundle is read; only their lengths matter here.
        check_flattened(document, {**plain, "values": np.zeros(entries, stored)})
        for behaviour in document["behaviours"]:
            _check_kept(behaviour, arrays, stored)
    except ArrayFault as fault:
        raise PolicyError(f"{path}: array {fault}") from None


def _check_kept(behaviour: Mapping[str, Any], arrays: Mapping[str, Array], stored: np.dtype[Any]) -> None:
    """Hold what is kept of a behaviour's table against what it must be."""
    name = f"{_KEPT}{behaviour['name']}"
    kept, states = arrays[name], arrays["graph_state_frames"].size
    shape = tuple(axis["count"] for axis in behaviour["axes"])
    computed = "state_values" in behaviour
    halves = [] if states % 2 else [(states // 2, *shape)]
    shapes = [(states, *shape), *halves]
    if not computed:
        shapes = [(behaviour["entries"],), *(shapes if behaviour["entries"] == states * math.prod(shape) else [])]
    kinds = {np.dtype(np.uint16)} if computed else {stored}
    if kept.shape not in shapes or kept.dtype not in kinds:
        words = " or ".join(map(str, shapes))
        raise ArrayFault(name, f"is {kept.dtype}{kept.shape}, expected {min(map(str, kinds))} of shape {words}")


def decompress(file: Path, content: bytes, size: int) -> bytes:
    """Return what a compressed file holds; no more of it is read than should be there.

    Raises:
        PolicyError: It is damaged, or holds another number of bytes.
    """
    if size > _MOST_BYTES:
        raise PolicyError(f"{file}: would hold {size:,} bytes, expected at most {_MOST_BYTES:,}")
    stream = lzma.LZMADecompressor(lzma.FORMAT_XZ)
    try:
        data = stream.decompress(content, size + 1)
        # The end of the stream may be behind the last byte.
        data += b"" if stream.eof else stream.decompress(b"", 1)
    except (lzma.LZMAError, EOFError) as error:
        raise PolicyError(f"{file}: damaged: {error}") from None
    if len(data) != size or not stream.eof or stream.unused_data:
        raise PolicyError(f"{file}: damaged: holds another number of bytes than {size:,}, which its arrays have")
    return data
