"""Chunks of takes: large ones whatever the number of avatars, all of them on disk, and each read once."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from test_store import AVATARS, HEADER, NO_EVENTS, chunk, events

from crowdsim.errors import TakeError
from crowdsim.take import store
from crowdsim.take.layout import chunk_frames
from crowdsim.take.lazy_arrays import StoredColumn
from crowdsim.take.store import TakeWriter, open_take
from crowdsim.take.take import VARIABLES


@pytest.mark.parametrize(
    ("avatars", "chosen", "frames"),
    [
        (1, None, 262_144),
        (30, None, 8738),
        (65_536, None, 4),
        (1_000_000, None, 4),
        (30, 64, 64),
        (1_000_000, 64, 4),
        (10_000_000, 64, 1),
    ],
)
def test_a_chunk_is_a_mebibyte_of_each_variable_unless_its_length_is_chosen(
    avatars: int, chosen: int | None, frames: int
) -> None:
    assert chunk_frames(avatars, chosen) == frames


def targets(frames: int) -> np.ndarray:
    return np.zeros((frames, 1, 3))


def zeros(frames: int) -> dict[str, np.ndarray]:
    rows = {name: np.zeros((frames, AVATARS)) for name in VARIABLES}
    return {**rows, "opponent": chunk(0, frames)["opponent"]}


def all_files(take: Path) -> dict[str, bytes]:
    return {path.relative_to(take).as_posix(): path.read_bytes() for path in take.rglob("*") if path.is_file()}


def test_a_long_take_has_few_files(tmp_path: Path) -> None:
    frames = 200_000
    writer = TakeWriter(tmp_path / "take.zarr", HEADER, frames).open()
    for _ in range(frames // 10_000):
        writer.append(zeros(10_000), NO_EVENTS, targets(10_000))
    writer.close()
    facts = json.loads((tmp_path / "take.zarr" / "x" / ".zarray").read_text(encoding="utf-8"))
    assert facts["chunks"] == [262_144 // AVATARS, AVATARS]
    assert sorted(path.name for path in (tmp_path / "take.zarr" / "x").iterdir() if path.name[0] != ".") == [
        "0.0", "1.0", "2.0", "3.0"
    ]  # fmt: skip
    take = open_take(tmp_path)
    np.testing.assert_array_equal(take.opponent[199_990:], chunk(0, 10)["opponent"])


@pytest.mark.parametrize("done", [8, 9, 11])
def test_a_take_of_zeros_goes_on_from_any_frame_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: int
) -> None:
    monkeypatch.setattr(store, "EVENTS_A_CHUNK", 2)

    def append(writer: TakeWriter, frames: int) -> None:
        for _ in range(frames):
            writer.append(zeros(1), events(0.5), targets(1))

    undisturbed = TakeWriter(tmp_path / "undisturbed.zarr", HEADER, 20, 4).open()
    append(undisturbed, 20)
    undisturbed.close()
    killed = TakeWriter(tmp_path / "take.zarr", HEADER, 20, 4).open()
    append(killed, done)
    state = killed.state()
    assert (int(state["frames"]), len(state["frames.x"])) == (8, done - 8)
    # What was written behind the checkpoint is written again.
    append(killed, 9)
    # A chunk is as long as that of the frames that are there.
    writer = TakeWriter(tmp_path / "take.zarr", HEADER, 20).reopen(state)
    append(writer, 20 - done)
    assert {name: values.tolist() for name, values in writer.state().items()} == {
        name: values.tolist() for name, values in undisturbed_state(tmp_path, append).items()
    }
    writer.close()
    assert all_files(tmp_path / "take.zarr") == all_files(tmp_path / "undisturbed.zarr")


def undisturbed_state(folder: Path, append) -> dict[str, np.ndarray]:
    """Return what a writer holds that was never closed."""
    writer = TakeWriter(folder / "open.zarr", HEADER, 20, 4).open()
    append(writer, 20)
    return writer.state()


def test_frames_that_wait_must_have_the_targets_of_the_take(tmp_path: Path) -> None:
    writer = TakeWriter(tmp_path / "take.zarr", HEADER, 20, 4).open()
    writer.append(zeros(6), events(0.5), targets(6))
    state = writer.state()
    three = {**state, "frames.target": np.zeros((2, 3, 3), "<f4")}
    none = {name: values for name, values in state.items() if name != "frames.target"}
    for found, wrong in (("(3, 3)", three), ("(0,)", none)):
        what = re.escape(f"cannot be continued: frames.target: has {found} values a frame, expected (1, 3)")
        with pytest.raises(TakeError, match=what):
            TakeWriter(tmp_path / "take.zarr", HEADER, 20, 4).reopen(wrong)


def test_takes_without_their_chunks_of_zeros_are_read(tmp_path: Path) -> None:
    writer = TakeWriter(tmp_path / "take.zarr", HEADER, 20, 4).open()
    writer.append(zeros(20), events(0.5, 1.5), targets(20))
    writer.close()
    before = open_take(tmp_path)
    expected = [before.x[:], before.action[:], before.events.damage]
    for name in ("x/0.0", "x/3.0", "action/1.0", "target/4.0.0", "events/damage/0"):
        (tmp_path / "take.zarr" / name).unlink()
    take = open_take(tmp_path)
    for values, other in zip(expected, [take.x[:], take.action[:], take.events.damage], strict=True):
        np.testing.assert_array_equal(values, other)


def test_a_stretch_is_read_as_it_was_written_and_each_chunk_is_unpacked_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = TakeWriter(tmp_path / "take.zarr", HEADER, 100, 40).open()
    writer.append(chunk(0, 100), NO_EVENTS, targets(100))
    writer.close()
    unpacked = []
    decode = StoredColumn._decode

    def note(self: StoredColumn, number: tuple[int, ...], out: np.ndarray) -> None:
        unpacked.append((self.folder.name, number))
        decode(self, number, out)

    take = open_take(tmp_path)
    monkeypatch.setattr(StoredColumn, "_decode", note)
    expected = chunk(0, 100)
    for first in range(95):
        np.testing.assert_array_equal(take.x[first : first + 5], expected["x"][first : first + 5])
        np.testing.assert_array_equal(take.z[first], expected["z"][first])
    assert sorted(unpacked) == [(name, (number, 0)) for name in ("x", "z") for number in range(3)]


def test_a_stretch_belongs_to_its_reader(tmp_path: Path) -> None:
    writer = TakeWriter(tmp_path / "take.zarr", HEADER, 100, 40).open()
    writer.append(chunk(0, 100), NO_EVENTS, targets(100))
    writer.close()
    take = open_take(tmp_path)
    take.x[10:20][:] = -1.0
    np.testing.assert_array_equal(take.x[10:20], chunk(0, 100)["x"][10:20])


def test_an_array_keeps_no_more_than_a_few_mebibytes_of_chunks(tmp_path: Path) -> None:
    frames = 400_000
    writer = TakeWriter(tmp_path / "take.zarr", HEADER, frames).open()
    for _ in range(frames // 20_000):
        writer.append(zeros(20_000), NO_EVENTS, targets(20_000))
    writer.close()
    take = open_take(tmp_path)
    for first in range(0, frames, 20_000):
        take.x[first : first + 3]
    assert len(take.x.recent.chunks) == 4
    assert sum(values.nbytes for _, values in take.x.recent.chunks) <= 4 << 20
