"""A power cut: what was not on disk is empty, and the machine was started again; runs go on to the same bytes."""

import itertools
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene
from test_crash import contents

from crowdsim import files
from crowdsim.runs import checkpoint, lock, recording, stage
from crowdsim.runs.manifest import verify

OUTPUTS = {"take": {"chunk": 8}, "bvh": {"fps": 30}, "ply": {"fps": 30, "every": 6, "points": 20}}


class Cut(Exception):
    """The power is gone."""


class Disk:
    """Knows which files are on disk: those that have not changed since they were synced, one by one or all."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.safe = folder, {}
        fsync, sync_disk = os.fsync, files.sync_disk

        def sync_file(number: int) -> None:
            fsync(number)
            facts = os.fstat(number)
            self.safe[facts.st_ino] = (facts.st_size, facts.st_mtime_ns)

        def sync_all(folder: Path) -> None:
            sync_disk(folder)
            for path in self.folder.rglob("*"):
                if path.is_file():
                    facts = path.stat()
                    self.safe[facts.st_ino] = (facts.st_size, facts.st_mtime_ns)

        monkeypatch.setattr(os, "fsync", sync_file)
        for module in (checkpoint, stage):
            monkeypatch.setattr(module, "sync_disk", sync_all)

    def cut(self) -> int:
        """Empty every file that is not on disk; return how many there were."""
        lost = 0
        for path in [path for path in self.folder.rglob("*") if path.is_file()]:
            facts = path.stat()
            if self.safe.get(facts.st_ino) != (facts.st_size, facts.st_mtime_ns):
                path.write_bytes(b"")
                lost += 1
        return lost


def at_frame(number: int) -> Callable[[pytest.MonkeyPatch], None]:
    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        run = recording.Simulation.run

        def stopped(simulation, frames):
            if simulation.frame >= number:
                raise Cut
            return run(simulation, frames)

        monkeypatch.setattr(recording.Simulation, "run", stopped)

    return patch


def at_cloud(number: int) -> Callable[[pytest.MonkeyPatch], None]:
    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        from crowdsim.export import cloud_files, pointcloud

        write, written = cloud_files.write_cloud, []

        def stopped(path: Path, cloud) -> None:
            if len(written) == number:
                raise Cut
            written.append(path)
            write(path, cloud)

        monkeypatch.setattr(pointcloud, "write_cloud", stopped)

    return patch


def at_move(number: int) -> Callable[[pytest.MonkeyPatch], None]:
    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        move, moved = stage.move_plain, []

        def stopped(*values) -> None:
            if len(moved) == number:
                raise Cut
            moved.append(values)
            move(*values)

        monkeypatch.setattr(stage, "move_plain", stopped)

    return patch


CUTS = [at_frame(0), at_frame(16), at_cloud(3), at_move(0), at_move(2), at_move(5)]


@pytest.mark.parametrize(
    "cut", CUTS, ids=["at once", "in the simulation", "in exports", "moving", "later", "take moved"]
)
def test_a_run_goes_on_after_a_power_cut_to_the_same_bytes(workplace: Path, monkeypatch, cut) -> None:
    monkeypatch.setattr(checkpoint, "LASTS_AFTER", 0.0)
    monkeypatch.setattr(stage, "_SLOW", 0.0)
    due = itertools.cycle([True, False])
    monkeypatch.setattr(checkpoint.Pace, "is_due", lambda *_: next(due))
    write_scene(workplace / "four.yaml", outputs=OUTPUTS)
    assert crowdsim("run", "four.yaml", "--out", "undisturbed") == 0
    with monkeypatch.context() as patch:
        due = itertools.cycle([True, False])
        disk = Disk(workplace / "run", patch)
        cut(patch)
        with pytest.raises(Cut):
            crowdsim("run", "four.yaml", "--out", "run", "--threads", "1")
        lost = disk.cut()
    assert lost > 0 or cut not in CUTS[:3]
    for module in (lock, stage):
        monkeypatch.setattr(module, "boot_id", lambda: "the next one")
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert contents(workplace / "run") == contents(workplace / "undisturbed")
    assert verify(workplace / "run").findings == ()
    assert not [path for path in (workplace / "run").iterdir() if path.name.startswith(".")]


def test_an_export_after_a_power_cut_has_the_same_bytes(workplace: Path, monkeypatch) -> None:
    write_scene(workplace / "four.yaml")
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    words = ("export", "run", "--ply", "--every", "9", "--points", "20", "--threads", "1")
    assert crowdsim(*words, "--out", "undisturbed") == 0
    with monkeypatch.context() as patch:
        disk = Disk(workplace / "run" / ".export.partial", patch)
        at_cloud(5)(patch)
        with pytest.raises(Cut):
            crowdsim(*words)
        assert disk.cut() == 5
    for module in (lock, stage):
        monkeypatch.setattr(module, "boot_id", lambda: "the next one")
    assert crowdsim(*words) == 0
    clouds = {path.name: path.read_bytes() for path in (workplace / "run" / "ply").iterdir()}
    assert clouds == {path.name: path.read_bytes() for path in (workplace / "undisturbed" / "ply").iterdir()}
