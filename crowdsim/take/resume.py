"""Takes that go on: what a writer holds beside the chunks on disk, and a writer that continues from there."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from crowdsim.array_checks import ArrayFault, Column, Within, check_table
from crowdsim.core.types import Array
from crowdsim.crowd.events import VARIABLES, Events
from crowdsim.errors import TakeError
from crowdsim.files import entries, is_folder, move_plain, remove_plain, remove_tree, stat_plain
from crowdsim.take.array_files import GrowingArray
from crowdsim.take.checks import check_rows
from crowdsim.take.layout import DTYPES, EVENTS
from crowdsim.take.metadata import check_files


class Writing(Protocol):
    """What a writer holds, see ``store.TakeWriter``."""

    names: tuple[str, ...]
    chunk: int
    done: int
    events_done: int
    kept: list[dict[str, Array]]
    kept_events: list[Events]
    arrays: dict[str, GrowingArray]


def read_writer(writer: Writing) -> dict[str, Array]:
    """Return what a writer holds beside the chunks on disk.

    Returns:
        ``chunk`` and ``frames``: control frames of a chunk, and those that are on disk; ``events``: strikes on disk;
        then the frames and strikes that wait for a whole chunk, by the names of their variables.
    """
    waiting: dict[str, Array] = {
        "chunk": np.array(writer.chunk),
        "frames": np.array(writer.done),
        "events": np.array(writer.events_done),
    }
    for name in writer.names if writer.kept else VARIABLES:
        parts = [kept[name] for kept in writer.kept]
        waiting[f"frames.{name}"] = np.concatenate(parts) if parts else np.zeros((0, 0), DTYPES[name])
    for name, kind in EVENTS.items():
        parts = [getattr(kept, name) for kept in writer.kept_events]
        none = np.zeros((0, 3) if name == "point" else 0)
        waiting[f"events.{name}"] = np.concatenate(parts or [none]).astype(kind)
    return waiting


def written_frames(writer: Writing, path: Path, counts: Array) -> Iterator[dict[str, Array]]:
    """Yield what a writer has been handed, on disk or not, some control frames at a time.

    Args:
        writer: The writer.
        path: The take's final name.
        counts: How many actions each avatar's policy has. Shape (N,).

    Raises:
        TakeError: They are no frames of these avatars.
    """
    sizes = {"N": len(counts), "G": writer.arrays["target"].shape[1] if "target" in writer.names else 0}
    arrays = {name: writer.arrays[name].read() for name in VARIABLES}
    blocks = range(0, writer.done, writer.chunk)
    stored = ({name: array[low : low + writer.chunk] for name, array in arrays.items()} for low in blocks)
    for rows in itertools.chain(stored, writer.kept):
        try:
            check_rows(rows, sizes, counts)
        except ArrayFault as fault:
            raise TakeError(f"{path}: cannot be continued: {fault}") from None
        yield rows


def written_strikes(writer: Writing) -> tuple[Array, Array]:
    """Return of all strikes that a writer has been handed what became of them, uint8, and whether they knocked down."""
    outcome, down = (
        np.concatenate([array.read()[:], *(getattr(kept, name) for kept in writer.kept_events)])
        for name, array in ((name, writer.arrays[f"events/{name}"]) for name in ("outcome", "down"))
    )
    return outcome, down


def restore_writer(writer: Writing, state: Mapping[str, Array]) -> None:
    """Give a writer what another one held, see ``check_writer``; the chunks on disk are those that this one wrote.

    Raises:
        ArrayFault: Frames are not of its avatars and targets.
    """
    writer.done, writer.events_done = int(state["frames"]), int(state["events"])
    if len(state["frames.action"]):
        writer.kept = [{name: state.get(f"frames.{name}", np.zeros((0, 0))) for name in writer.names}]
        for name, rows in writer.kept[0].items():
            if rows.shape[1:] != writer.arrays[name].shape[1:]:
                what = f"has {rows.shape[1:]} values a frame, expected {writer.arrays[name].shape[1:]}"
                raise ArrayFault(f"frames.{name}", what)
    writer.kept_events = [Events(**{name: state[f"events.{name}"] for name in EVENTS})]


def check_writer(state: Mapping[str, Array]) -> None:
    """Check what a writer held by its table, but for what depends on avatars and policies.

    Raises:
        ArrayFault: It is something else.
    """
    events = {f"events.{name}": Column(np.dtype(kind).name, _SHAPES.get(name, ("E",))) for name, kind in EVENTS.items()}
    rows = {f"frames.{name}": Column(np.dtype(kind).name, ("W", "N")) for name, kind in DTYPES.items()}
    rows["frames.target"] = Column("float32", ("W", "G", 3))
    check_table({**_COUNTS, **rows, **events}, state, {}, ("frames.target",))


_COUNT = Column("int64", (), (Within(0, 2**40),))
_COUNTS = {"chunk": Column("int64", (), (Within(1, 2**40),)), "frames": _COUNT, "events": _COUNT}
_SHAPES: dict[str, tuple[int | str, ...]] = {"point": ("E", 3)}


def reopen_take(path: Path, partial: Path, names: Sequence[str], state: Mapping[str, Array]) -> dict[str, GrowingArray]:
    """Open an unfinished take, finished ones too, for writing on, without what was written behind a checkpoint.

    Args:
        path: The take's final name.
        partial: Its name while it grows.
        names: Names of what is written for every control frame.
        state: What ``read_writer`` returned.

    Returns:
        Its arrays that grow, by name.

    Raises:
        TakeError: There is no such take, or chunks are missing.
        OSError: It cannot be read or written.
    """
    if not partial.exists():
        if not path.exists():
            raise TakeError(f"{path}: is missing")
        move_plain(path.parent, path.name, partial.parent, partial.name)
    # Written when a take is finished, and then anew.
    check_files(partial)
    remove_plain(partial, [".zmetadata"])
    if is_folder(partial, "time"):
        remove_tree(partial, "time")
    arrays = {name: GrowingArray.existing(partial, name) for name in (*names, *(f"events/{name}" for name in EVENTS))}
    for name, array in arrays.items():
        _cut(array, int(state["events" if name.startswith("events/") else "frames"]))
    return arrays


def _cut(array: GrowingArray, count: int) -> None:
    """Remove chunks from an entry on; those before must all be there."""
    folder, size = array.take / array.name, array.chunks[0]
    if count > array.shape[0] or count % size:
        raise TakeError(f"{folder}: has {array.shape[0]} entries in chunks of {size}, expected {count} or more")
    chunks = [(int(name.split(".")[0]), name) for name in entries(folder) if name[:1].isdecimal()]
    across = -(-array.shape[1] // array.chunks[1]) if len(array.shape) == 2 else 1
    remove_plain(folder, [name for number, name in chunks if number >= count // size])
    left = sum(number < count // size and stat_plain(folder, name).st_size > 0 for number, name in chunks)
    if left != across * (count // size):
        raise TakeError(f"{folder}: holds {left} chunks, expected {across * (count // size)}")
    array.resize(count)
