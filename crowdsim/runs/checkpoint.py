"""Checkpoints: all that a run needs to go on from a control frame, beside the chunks of its take; ``take/FORMAT.md``.

A checkpoint is written as often as a small share of the run's time allows, and replaces the one before as a whole. The
last one stays in a finished run, which can be extended from there.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from crowdsim.config.documents import DocumentModel, document_fault, parse_json
from crowdsim.core.types import Array
from crowdsim.crowd.chunk import STAGES
from crowdsim.errors import OutputError, TakeError
from crowdsim.files import open_plain, sync_disk, sync_folder, write_plain

NAME = "checkpoint.bin"
FORMAT = "crowdsim-checkpoint"
VERSION = 4

SHARE = 0.005
"""Share of a run's time that checkpoints may take."""

AT_ONCE, AT_FIRST = 1 << 24, 4e-9
"""Size of a first checkpoint that does not wait [bytes], and what a byte of it is taken to cost [s]."""

LASTS_AFTER = 10.0
"""How long a run must have taken for its checkpoints to survive a power cut [s]; the wait for the disk costs 50 ms."""

_HEAD = 1 << 20
"""Longest first line [bytes]."""
_AN_AVATAR, _A_FRAME, _ELSE = 1 << 16, 1 << 6, 1 << 26
"""Most bytes of arrays that an avatar, a control frame and all else have, a multiple of what they take."""
_KIND = re.compile(r"<f[48]|<[iu][248]|<U[1-9]\d{0,2}|\|[bu]1|\|i1")
"""Types of its arrays."""


def _check_listed(item: list[Any]) -> list[Any]:
    name, kind, shape = item
    is_sound = isinstance(name, str) and isinstance(kind, str) and _KIND.fullmatch(kind) and isinstance(shape, list)
    if not is_sound or not all(type(size) is int and 0 <= size < 2**40 for size in shape):
        raise ValueError("expected name, type and shape of an array")
    return item


class _Head(DocumentModel):
    """The first line of a checkpoint."""

    format: str
    version: int
    frame: Annotated[int, Field(ge=0, le=2**40)]
    origin: str
    arrays: list[Annotated[list[Any], Field(min_length=3, max_length=3), AfterValidator(_check_listed)]]
    sha256: str


@dataclass(frozen=True)
class Checkpoint:
    """A run at the beginning of a control frame.

    Attributes:
        frame: Number of control frames done.
        origin: Checksum of what the run was made from, see ``provenance.Origin``.
        simulation: State of the simulation, see ``crowd.state``.
        take: State of the take's writer, see ``take.resume``.
        timings: Cost of control so far where it is measured [ns]. Shape (frame, 6), int64.
    """

    frame: int
    origin: str
    simulation: Mapping[str, Array]
    take: Mapping[str, Array]
    timings: Array | None = None


def write_checkpoint(folder: Path, checkpoint: Checkpoint, lasts: bool = True) -> None:
    """Write a run's checkpoint in the place of the one before.

    Args:
        folder: The run folder.
        checkpoint: The checkpoint.
        lasts: Whether to wait until it, and the chunks of the take that it counts on, are on disk.

    Raises:
        OutputError: It cannot be written; the one before stays.
    """
    arrays = {f"simulation.{name}": values for name, values in checkpoint.simulation.items()}
    arrays.update({f"take.{name}": values for name, values in checkpoint.take.items()})
    if checkpoint.timings is not None:
        arrays["timings"] = checkpoint.timings
    blocks = {name: np.ascontiguousarray(values).reshape(-1).view("u1").data for name, values in sorted(arrays.items())}
    document = {
        "format": FORMAT,
        "version": VERSION,
        "frame": checkpoint.frame,
        "origin": checkpoint.origin,
        "arrays": [[name, arrays[name].dtype.str, list(arrays[name].shape)] for name in blocks],
    }
    head = json.dumps({**document, "sha256": _checksum(document, *blocks.values())}).encode() + b"\n"
    # After a power cut it must count on no chunk that is not there.
    write_plain(folder, NAME, (head, *blocks.values()), settle=sync_disk if lasts else None)
    if lasts:
        try:
            sync_folder(folder)
        except OSError as error:
            raise OutputError(f"{folder / NAME}: cannot be written: {error.strerror or error}") from None


def read_checkpoint(folder: Path, avatars: int, frames: int) -> Checkpoint:
    """Return a run's checkpoint once it has passed its checks.

    Args:
        folder: The run folder.
        avatars: How many avatars the run has.
        frames: How many control frames it has at the most.

    Raises:
        TakeError: There is none, or it is damaged or of another version.
    """
    path = folder / NAME
    try:
        with open_plain(folder, NAME) as file:
            document = _read_document(path, file.readline(_HEAD))
            listed = sum(np.dtype(kind).itemsize * math.prod(shape) for _, kind, shape in document["arrays"])
            held = os.fstat(file.fileno()).st_size - file.tell()
            # Before memory is taken: a file with holes has any size.
            most = avatars * _AN_AVATAR + min(document["frame"], frames) * _A_FRAME + _ELSE
            if held != listed or held > most:
                limit = f"at most {most:,}" if held == listed else f"{listed:,}"
                raise ValueError(f"has {held:,} bytes of arrays, expected {limit}")
            body = file.read()
        if document.pop("sha256") != _checksum(document, body):
            raise ValueError("its checksum does not fit what it holds")
        arrays = _cut(document["arrays"], body)
        frame, origin = document["frame"], document["origin"]
    except FileNotFoundError:
        raise TakeError(f"{folder}: no {NAME} here") from None
    except (OSError, ValueError) as error:
        raise TakeError(f"{path}: is damaged: {error}") from None
    parts: dict[str, dict[str, Array]] = {"simulation": {}, "take": {}, "timings": {}}
    for name, values in arrays.items():
        part, _, rest = name.partition(".")
        if part not in parts:
            raise TakeError(f"{path}: holds an array {name!r}, expected those of a checkpoint")
        parts[part][rest] = values
    timings = parts["timings"].get("")
    if timings is not None and (timings.dtype != np.int64 or timings.shape != (frame, len(STAGES))):
        what = f"is {timings.dtype}{timings.shape}, expected int64{(frame, len(STAGES))}"
        raise TakeError(f"{path}: timings: {what}")
    return Checkpoint(frame, origin, parts["simulation"], parts["take"], timings)


def _cut(listed: list[list[Any]], body: bytes) -> dict[str, Array]:
    """Return the arrays that lie one behind the other in a checkpoint, as long as they together, by name."""
    arrays: dict[str, Array] = {}
    place = 0
    for name, kind, shape in listed:
        if name in arrays:
            raise ValueError(f"array {name!r} is there twice")
        # A copy, which can be written to and lies in memory as the processor wants it.
        arrays[name] = np.frombuffer(body, kind, math.prod(shape), place).reshape(shape).copy()
        place += arrays[name].nbytes
    return arrays


def frames_done(folder: Path) -> int:
    """Return how many control frames a run's checkpoint says are done; 0 where there is none, or it is damaged."""
    try:
        with open_plain(folder, NAME) as file:
            return int(_read_document(folder / NAME, file.readline(_HEAD))["frame"])
    except (OSError, ValueError, TakeError):
        return 0


def _read_document(path: Path, line: bytes) -> dict[str, Any]:
    """Return what the first line of a checkpoint says; a ``ValueError`` says that it is damaged."""
    document = parse_json(line.decode("utf-8"))
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise TakeError(f"{path}: is no checkpoint of a run")
    if document.get("version") != VERSION:
        raise TakeError(f"{path}: is a checkpoint of version {document.get('version')!r}, expected {VERSION}")
    fault = document_fault(_Head, document)
    if fault:
        raise ValueError(fault)
    return document


def _checksum(document: Mapping[str, Any], *parts: bytes | memoryview) -> str:
    """Return the SHA-256 of a checkpoint: of what its first line says, without its own, and of all arrays."""
    digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode())
    for part in parts:
        digest.update(part)
    return digest.hexdigest()


class Pace:
    """Says when the next checkpoint may be written, so that all of them take no more than ``SHARE`` of the time.

    A byte is taken to cost as much as in the one before: a small checkpoint, at the end of a chunk, may come sooner.
    The first one comes at once, unless it is large: then it waits like the others, since it would save little.

    Args:
        lasts: Whether the first one is to survive a power cut already, since the one that it replaces does.
    """

    def __init__(self, lasts: bool = False) -> None:
        self._wrote, self._seconds_per_byte, self._written = perf_counter(), AT_FIRST, False
        self._lasting = 0.0 if lasts else perf_counter() + LASTS_AFTER

    @property
    def lasts(self) -> bool:
        """Whether a checkpoint that is written now is to survive a power cut."""
        return perf_counter() >= self._lasting

    def is_due(self, size: int) -> bool:
        """Whether a checkpoint of about so many bytes may be written now."""
        at_once = not self._written and size <= AT_ONCE
        return at_once or perf_counter() >= self._wrote + size * self._seconds_per_byte / SHARE

    def wrote(self, since: float, size: int) -> None:
        """Note that one of so many bytes has been written, begun at a time of ``perf_counter``."""
        self._wrote, self._written = perf_counter(), True
        self._seconds_per_byte = (self._wrote - since) / size
