"""Checkpoints of a run that has taken a while are on disk, with all that they count on, before they have their name."""

import os
from pathlib import Path

import pytest

from crowdsim.errors import OutputError
from crowdsim.runs import checkpoint
from crowdsim.runs.checkpoint import NAME, Checkpoint, Pace, read_checkpoint, write_checkpoint


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[tuple[str, bool]]:
    """What is waited for, and whether the checkpoint has its name then."""
    found: list[tuple[str, bool]] = []
    for name in ("sync_disk", "sync_folder"):
        real = getattr(checkpoint, name)

        def wait(folder: Path, name: str = name, real=real) -> None:
            found.append((name, (tmp_path / NAME).exists()))
            real(folder)

        monkeypatch.setattr(checkpoint, name, wait)
    return found


def test_the_disk_is_waited_for_before_a_checkpoint_has_its_name_and_the_name_after(
    tmp_path: Path, waits: list[tuple[str, bool]]
) -> None:
    write_checkpoint(tmp_path, Checkpoint(4, "a", {}, {}), lasts=False)
    assert waits == []
    os.unlink(tmp_path / NAME)
    write_checkpoint(tmp_path, Checkpoint(5, "a", {}, {}))
    assert waits == [("sync_disk", False), ("sync_folder", True)]
    assert read_checkpoint(tmp_path, 100, 1_000_000).frame == 5


def test_a_disk_that_fails_while_it_is_waited_for_leaves_the_checkpoint_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_checkpoint(tmp_path, Checkpoint(4, "a", {}, {}))

    def fail(folder: Path) -> None:
        raise OSError(5, os.strerror(5), os.fspath(folder))

    monkeypatch.setattr(checkpoint, "sync_disk", fail)
    with pytest.raises(OutputError, match=r"checkpoint\.bin: cannot be written: Input/output error"):
        write_checkpoint(tmp_path, Checkpoint(5, "a", {}, {}))
    assert read_checkpoint(tmp_path, 100, 1_000_000).frame == 4
    assert [path.name for path in tmp_path.iterdir()] == [NAME]


def test_a_short_run_waits_for_no_disk_and_one_that_goes_on_does_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not Pace().lasts
    assert Pace(lasts=True).lasts
    monkeypatch.setattr(checkpoint, "LASTS_AFTER", 0.0)
    assert Pace().lasts
