"""Takes on disk: a Zarr group that is written in chunks of frames during a run; FORMAT.md beside this file."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.core.types import Array, FileName
from crowdsim.errors import OutputError, TakeError
from crowdsim.files import UNFINISHED, exists_plain, is_folder, make_folder, move_plain, remove_tree, walk, write_plain
from crowdsim.take.array_files import GROUP, GrowingArray, write_json
from crowdsim.take.header import TakeHeader
from crowdsim.take.layout import (
    AVATARS_A_CHUNK,
    CAST,
    CAST_FLAGS,
    DTYPES,
    EVENT_FLAGS,
    EVENT_LABELS,
    EVENTS,
    EVENTS_A_CHUNK,
    LABELS,
    chunk_frames,
)
from crowdsim.take.metadata import check_files, read_metadata
from crowdsim.take.reading import read_take
from crowdsim.take.resume import check_writer, read_writer, reopen_take, restore_writer
from crowdsim.take.take import VARIABLES, Cast, Events, Take


class TakeWriter:
    """Writes a take chunk by chunk under a temporary name and gives it its own at the end.

    Args:
        path: Where the take goes, ``RUN/take.zarr``; while it grows it is called ``take.zarr.partial``.
        header: What is known of the take beforehand.
        frames: Control frames that are planned.
        chunk: Control frames in a chunk on disk; about 1 MiB of each variable when None.

    Attributes:
        names: Names of what is written for every control frame.
        chunk: Control frames in a chunk on disk.
        done: Control frames on disk.
        events_done: Strikes on disk.
        arrays: What is on disk, by name; strikes as ``events/frame``.
        kept: Frames that wait for a whole chunk, by name; ``kept_events`` likewise.
    """

    def __init__(self, path: Path, header: TakeHeader, frames: int, chunk: int | None = None) -> None:
        self.path = path
        self._partial = path.with_name(path.name + ".partial")
        self.names = (*VARIABLES, *(["target"] if header.target_names else []))
        self.chunk = chunk_frames(len(header.cast.names), chunk)
        self._frames = frames
        self._header = header
        self._attributes = header.attributes(frames)
        self.arrays: dict[str, GrowingArray] = {}
        self.done = self.events_done = 0
        self.kept: list[dict[str, Array]] = []
        self.kept_events: list[Events] = []

    def open(self, anew: bool = False) -> TakeWriter:
        """Make the folder, write what is constant, and return the writer; ``anew`` removes what an earlier one left.

        Raises:
            OutputError: The folder cannot be written, or a take is there already.
        """
        with self._writing():
            for taken in (self.path, self._partial):
                if os.path.lexists(taken) and not anew:
                    raise OutputError(f"{taken}: is there already, expected a new name for the take")
                if os.path.lexists(taken):
                    remove_tree(taken.parent, taken.name)
            make_folder(self._partial)
            self._begin()
        return self

    def reopen(self, state: Mapping[str, Array]) -> TakeWriter:
        """Go on with the take that is there, from what ``state`` returned, and return the writer.

        Raises:
            TakeError: It is missing, or chunks of it are, or the state is of no take; it stays.
            OutputError: It cannot be written.
        """
        try:
            check_writer(state)
            if int(state["frames"]) == int(state["events"]) == 0:
                # Nothing on disk is needed, and chunks may have been made for a shorter run.
                self.open(anew=True)
            else:
                self.chunk = int(state["chunk"])
            with self._writing():
                self.arrays = reopen_take(self.path, self._partial, self.names, state)
                write_json(self._partial, ".zattrs", self._attributes)
            restore_writer(self, state)
        except ValueError as error:
            raise TakeError(f"{self.path}: cannot be continued: {error}") from None
        return self

    @property
    def nbytes(self) -> int:
        """Memory of the frames and strikes that wait for a whole chunk."""
        kept = [*self.kept, *({name: getattr(events, name) for name in EVENTS} for events in self.kept_events)]
        return sum(values.nbytes for rows in kept for values in rows.values())

    def state(self) -> dict[str, Array]:
        """Return what is held beside the chunks on disk, see ``resume.read_writer``."""
        return read_writer(self)

    def _begin(self) -> None:
        """Write what is constant, and arrays without values."""
        cast, targets = self._header.cast, len(self._header.target_names)
        chunk, avatars = min(self.chunk, self._frames), len(cast.names)
        self.arrays = {}
        for group, attributes in (("", self._attributes), ("events/", {})):
            write_json(self._partial, f"{group}.zgroup", GROUP)
            write_json(self._partial, f"{group}.zattrs", attributes)
        for name in VARIABLES:
            chunks = (chunk, max(1, min(avatars, AVATARS_A_CHUNK)))
            self._create(name, (0, avatars), chunks, DTYPES[name], ["frame", "avatar"])
        for name, field in CAST.items():
            values = np.asarray(getattr(cast, field))
            if name == "group" and not cast.group_names:
                continue
            kind = f"<U{max(1, np.char.str_len(values).max(initial=1))}" if name == "name" else _little(values.dtype)
            self._create(name, (0,), (max(1, avatars),), kind, ["avatar"], values)
        if targets:
            dimensions = ["frame", "target", "component"]
            self._create("target", (0, targets, 3), (chunk, targets, 3), "<f4", dimensions)
        for name, kind in EVENTS.items():
            more = (3,) if name == "point" else ()
            dimensions = ["event", "component"] if name == "point" else ["event"]
            self._create(f"events/{name}", (0, *more), (EVENTS_A_CHUNK, *more), kind, dimensions)

    def _create(
        self,
        name: str,
        shape: tuple[int, ...],
        chunks: tuple[int, ...],
        dtype: str,
        dimensions: list[str],
        values: Array | None = None,
    ) -> None:
        group, _, label = name.rpartition("/")
        units, long_name = (EVENT_LABELS if group else LABELS)[label]
        attributes: dict[str, Any] = {"_ARRAY_DIMENSIONS": dimensions, "units": units, "long_name": long_name}
        meanings = (EVENT_FLAGS if group else CAST_FLAGS).get(label)
        if meanings is not None:
            attributes |= {"flag_values": list(range(len(meanings))), "flag_meanings": " ".join(meanings)}
        array = self.arrays[name] = GrowingArray(self._partial, name, shape, chunks, np.dtype(dtype))
        array.describe(attributes)
        array.append(np.zeros(shape, dtype) if values is None else values)

    def append(self, chunk: dict[str, Array], events: Events, targets: Array | None = None) -> None:
        """Add control frames: an array (n, N) for each of ``VARIABLES``, the strikes thrown, and positions of targets.

        Raises:
            OutputError: They cannot be written.
        """
        rows = {name: np.asarray(chunk[name], dtype=DTYPES[name]) for name in VARIABLES}
        if self._header.target_names:
            rows["target"] = np.asarray(targets, dtype=np.float32)
        self.kept.append(rows)
        self.kept_events.append(events)
        with self._writing():
            self._flush(whole=False)

    def _flush(self, whole: bool) -> None:
        """Write whole chunks of what is kept, everything when ``whole``, so that no chunk is written twice."""
        ready = sum(len(kept["action"]) for kept in self.kept)
        count = ready if whole else ready // self.chunk * self.chunk
        if whole or count:
            self._flush_events(whole)
        if count == 0:
            return
        rest = {}
        for name in self.names:
            joined = np.concatenate([kept[name] for kept in self.kept])
            self.arrays[name].append(joined[:count])
            rest[name] = joined[count:].copy()
        self.kept = [rest] if ready > count else []
        self.done += count

    def _flush_events(self, whole: bool) -> None:
        """Write whole chunks of the strikes that are kept, everything when ``whole``."""
        if not self.kept_events:
            return
        kept = Events(**{name: np.concatenate([getattr(e, name) for e in self.kept_events]) for name in EVENTS})
        ready = len(kept.frame)
        count = ready if whole else ready // EVENTS_A_CHUNK * EVENTS_A_CHUNK
        if count:
            for name in EVENTS:
                self.arrays[f"events/{name}"].append(getattr(kept, name)[:count])
            self.events_done += count
        self.kept_events = [Events(**{name: getattr(kept, name)[count:] for name in EVENTS})]

    def close(self, status: str = "done") -> None:
        """Finish the take and give it its final name; ``status`` is ``done`` or ``interrupted``.

        Raises:
            OutputError: It cannot be written.
        """
        with self._writing():
            self._flush(whole=True)
            time = np.arange(self.done, dtype="<f8") / self._header.control_rate
            self._create("time", (0,), (max(1, len(time)),), "<f8", ["frame"], time)
            write_json(self._partial, ".zattrs", {**self._attributes, "status": status})
            self._consolidate()
            move_plain(self.path.parent, self._partial.name, self.path.parent, self.path.name)

    def _consolidate(self) -> None:
        """Write all metadata into one file as well, from which other programs open a take at once."""
        names = [name for name in walk(self._partial) if name.rpartition("/")[2].startswith(".z")]
        found = {name: read_metadata(self._partial, name) for name in names}
        document = {"metadata": found, "zarr_consolidated_format": 1}
        write_plain(self._partial, ".zmetadata", json.dumps(document))

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Report errors of writing by the take's own name."""
        try:
            yield
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written: {error.strerror or error}") from None


def _little(dtype: Any) -> str:
    return np.dtype(dtype).newbyteorder("<").str


def open_take(path: FileName, cast: Cast | None = None) -> Take:
    """Open a take for reading; what is recorded per frame is read when it is sliced.

    Args:
        path: The take, or the run folder that holds ``take.zarr``.
        cast: What is constant for each avatar, where this process has written it; read and checked when None.

    Raises:
        TakeError: There is no take, it is damaged, foreign or of another version, or its run is not finished; it holds
            links or devices; or its names are none that a scenario could have.
    """
    folder = Path(path)
    if not exists_plain(folder, ".zgroup"):
        if (folder / "take.zarr").is_symlink():
            raise TakeError(
                f"{folder / 'take.zarr'}: is a symbolic link, expected the take itself; links are not followed"
            )
        inside = ("take.zarr", f"{UNFINISHED}/take.zarr")
        folder = next((folder / name for name in inside if is_folder(folder, name)), folder)
    if not exists_plain(folder, ".zgroup"):
        found = "; expected take.zarr"
        if any(is_folder(folder, name) for name in ("take.zarr.partial", f"{UNFINISHED}/take.zarr.partial")):
            found = ", only what a run left that was killed; run its scenario again with --force or another --out"
        raise TakeError(f"{folder}: no take here{found}")
    try:
        check_files(folder)
        return read_take(folder, cast)
    except OSError as error:
        raise TakeError(f"{folder}: cannot be read: {error.strerror or error}") from None
    except MemoryError:
        raise TakeError(f"{folder}: needs more memory than there is") from None
