"""Journals: files that a run or a rendering has written are recognised, and files of others are kept."""

from pathlib import Path

import pytest

from crowdsim.runs.journal import NAME, Journal, Noted, find_noted, read_journal, series_name, write_journal


@pytest.mark.parametrize(
    "name",
    [
        "bvh/red_0.bvh", "bvh/.red_0.bvh.0123456789abcdef0123456789abcdef.part", "ply/000004.ply", "ply/1000000.ply",
        "ply/.000004.part.ply", "take.zarr/.zattrs", "take.zarr/events/hand/0", "take.zarr/x/0.12",
        "take.zarr/x/0.0123456789abcdef0123456789abcdef.partial",
        "take.zarr/x/.zarray.0123456789abcdef0123456789abcdef.partial", ".video-0123456789abcdef/00000000-00000240.mp4",
        ".video-0123456789abcdef/.00000000-00000240.mp4.part", ".video-0123456789abcdef/mark", "profile.csv.part",
        ".profile.77.png",
    ],
)  # fmt: skip
def test_noted_files_and_halves_of_them_are_known(name: str) -> None:
    assert Noted(NOTED).covers(name)


@pytest.mark.parametrize(
    "name",
    [
        "bvh/red_1.bvh", "red_0.bvh", "bvh/red_0.bvh/x", "bvh/.red_1.bvh.part", "ply/000005.ply", "ply/4.ply",
        "ply/1000004.ply", "ply/x/000004.ply", "000004.ply", "take.zarr/notes.txt", "take.zarr/x/notes.0",
        "take.zarr/.x/0", "take.zarr.partial/x/0.0", ".video-fedcba9876543210/mark", ".video-0123456789abcdef/a.mp4",
        ".part", "a.part", "notes.csv.part", "ply/٠٠٠٠٠٤.ply",
    ],
)  # fmt: skip
def test_other_files_are_not(name: str) -> None:
    assert not Noted(NOTED).covers(name)


NOTED = [
    "bvh/red_0.bvh",
    series_name("ply", range(0, 1_000_001, 4), "ply"),
    "take.zarr",
    ".video-0123456789abcdef",
    "profile.csv",
    "profile.png",
]


def test_a_journal_reads_back_and_any_changed_bit_makes_it_none(tmp_path: Path) -> None:
    journal = Journal(frozenset({"scenario.resolved.yaml"}), frozenset(NOTED))
    write_journal(tmp_path, journal)
    assert read_journal(tmp_path) == journal
    assert [path.name for path in tmp_path.iterdir()] == [NAME]
    whole = (tmp_path / NAME).read_bytes()
    for place in range(0, len(whole), 11):
        (tmp_path / NAME).write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert read_journal(tmp_path) in (None, journal)


def test_a_journal_that_names_files_elsewhere_is_none(tmp_path: Path) -> None:
    write_journal(tmp_path, Journal(frozenset(), frozenset({"../x"})))
    assert read_journal(tmp_path) is None


def test_files_behind_links_are_not_found(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "red_0.bvh").write_text("mine")
    (tmp_path / "run" / "bvh").symlink_to(tmp_path / "elsewhere")
    assert find_noted(tmp_path / "run", NOTED) == set()
