"""A disk that fails at the n-th write, renaming or fsync: a clear error, what was finished stays, and a way on."""

import builtins
import errno
import io
import itertools
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from scenes import crowdsim, write_scene
from test_crash import Task, check_end, check_whole, contents

from crowdsim.policy.bundle import load_policy
from crowdsim.runs import checkpoint
from crowdsim.training import train
from crowdsim.training.recipe import load_recipe

OUTPUTS = {"take": {"chunk": 16}, "bvh": {"fps": 15, "avatars": [0]}}
SHORT = {"take": {"chunk": 4}, "bvh": {"fps": 15, "avatars": [0]}}
KINDS = {"full": errno.ENOSPC, "broken": errno.EIO, "forbidden": errno.EACCES}


class Disk:
    """Files below a folder fail from, or at, the n-th operation.

    Args:
        below: The folder.
        number: Which operation fails, from 1; none with 0.
        code: The error.
        stays: Whether all writes fail from then on, as on a full disk.
    """

    def __init__(self, below: Path, number: int, code: int, stays: bool) -> None:
        self.count = 0
        self.failed = False
        self._below, self._number, self._code, self._stays = os.fspath(below), number, code, stays

    def covers(self, path: object) -> bool:
        if not isinstance(path, (str, os.PathLike)):
            return False
        return os.path.abspath(os.fspath(path)).startswith(self._below)

    def step(self, path: object, is_write: bool) -> None:
        """Count an operation, and fail when it is its turn."""
        self.count += 1
        if self.count == self._number or (self.failed and self._stays and is_write):
            self.failed = True
            raise OSError(self._code, os.strerror(self._code), os.fspath(path))


class Written:
    """An open file whose writes are counted."""

    def __init__(self, file: Any, path: object, disk: Disk) -> None:
        self._file, self._path, self._disk = file, path, disk

    def write(self, data: Any) -> int:
        self._disk.step(self._path, True)
        return self._file.write(data)

    def fileno(self) -> int:
        if ".png" in os.fspath(self._path):
            # Else pictures are written past this.
            raise io.UnsupportedOperation("fileno")
        return self._file.fileno()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> "Written":
        return self

    def __exit__(self, *reason: object) -> None:
        self._file.close()

    def __iter__(self) -> Iterator[Any]:
        return iter(self._file)


@contextmanager
def failing(below: Path, number: int, kind: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    """Let the disk fail."""
    disk = Disk(below, number, KINDS[kind], kind == "full")
    open_file, replace, rename = io.open, os.replace, os.rename

    def opened(path: Any, mode: str = "r", *values: Any, **named: Any) -> Any:
        file = open_file(path, mode, *values, **named)
        return Written(file, path, disk) if set(mode) & set("wax+") and disk.covers(path) else file

    def moved(move: Callable[..., None]) -> Callable[..., None]:
        def step(source: Any, target: Any, **named: Any) -> None:
            if disk.covers(target):
                disk.step(target, False)
            move(source, target, **named)

        return step

    def synced(file: Any) -> None:
        disk.step(below, True)

    with monkeypatch.context() as patch:
        patch.setattr(builtins, "open", opened)
        patch.setattr(io, "open", opened)
        patch.setattr(os, "replace", moved(replace))
        patch.setattr(os, "rename", moved(rename))
        patch.setattr(os, "fsync", synced)
        patch.setattr(checkpoint, "sync_disk", synced)
        patch.setattr(checkpoint, "LASTS_AFTER", 0.0)
        yield disk


RUN = ["run", "four.yaml", "--threads", "1", "--out", "work", "-q"]
COMMANDS = {
    "run": RUN,
    "extend": [*RUN, "--extend", "3"],
    "export": [
        "export",
        "work",
        "--bvh",
        "--ply",
        "--fps",
        "10",
        "--every",
        "9",
        "--points",
        "10",
        "--threads",
        "1",
        "-q",
    ],
    "skins": ["export", "work", "--glb", "--clips", "--fps", "10", "--threads", "1", "-q"],
    "render": [
        "render",
        "work",
        "--png",
        "--contact-sheet",
        "1",
        "--size",
        "16x16",
        "--fps",
        "1",
        "--camera",
        "side",
        "--threads",
        "1",
        "-q",
    ],
    "train": ["train", "tiny", "--force", "--threads", "1", "-q"],
}


def make_scene(workplace: Path, is_short: bool) -> Path:
    """Return the folder with a scene and its run."""
    write_scene(workplace / "four.yaml", duration=6 if is_short else 20, outputs=SHORT if is_short else OUTPUTS)
    assert crowdsim(*RUN) == 0
    shutil.move(workplace / "work", workplace / "run")
    return workplace


def prepare(scene: Path, name: str) -> None:
    """Put what a command begins with into the folder ``work``."""
    shutil.rmtree(scene / "work", ignore_errors=True)
    if name in ("extend", "export", "skins", "render"):
        shutil.copytree(scene / "run", scene / "work")


def fail_at(scene: Path, name: str, number: int, kind: str, task: Task, patch: pytest.MonkeyPatch, capsys: Any) -> bool:
    """Let a command fail at an operation, check what it says and leaves, and complete it; False when none failed."""
    prepare(scene, name)
    work = scene / "policies" / "tiny" if name == "train" else scene / "work"
    before = contents(work) if work.exists() else {}
    capsys.readouterr()
    with failing(work.parent if name == "train" else work, number, kind, patch) as disk:
        code = crowdsim(*COMMANDS[name])
    said = capsys.readouterr().err
    if not disk.failed:
        assert code == 0, said
        return False
    where = f"{name}, {kind} at operation {number}"
    if code != 0:
        assert code == 1 or (code, kind) == (2, "forbidden"), f"{where}: exit code {code}: {said}"
        assert os.strerror(KINDS[kind]) in said, f"{where}: {said}"
        assert "Traceback" not in said, where
    if work.exists():
        check_whole(work, task, before)
    if name == "train":
        load_policy(work)
    assert crowdsim(*COMMANDS[name]) == 0, f"{where}, then: {capsys.readouterr().err}"
    check_end(work, task)
    return True


def train_once(recipe: Path, patch: pytest.MonkeyPatch) -> None:
    """Train a recipe, and let every training from now on give that policy: what may fail is its writing."""
    trained = train.train_policy(load_recipe(recipe), recipe.stem)
    patch.setattr(train, "train_policy", lambda *_: trained)


def check_failing(
    scene: Path, name: str, every: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Let a command fail at every n-th of its operations, each error in turn, and complete it each time."""
    if name == "train":
        train_once(scene / "policies" / "tiny.yaml", monkeypatch)
    prepare(scene, name)
    assert crowdsim(*COMMANDS[name]) == 0
    undisturbed = scene / f"undisturbed-{name}"
    shutil.copytree(scene / "policies" / "tiny" if name == "train" else scene / "work", undisturbed)
    task = Task(COMMANDS[name], lambda: None, undisturbed)
    for turn, number in enumerate(itertools.count(1, every)):
        if not fail_at(scene, name, number, list(KINDS)[turn % 3], task, monkeypatch, capsys):
            break
    print(f"{name}: {number - 1} operations")


@pytest.mark.parametrize(
    ("name", "every"),
    [
        ("run", 71),
        ("export", 71),
        ("skins", 97),
        ("train", 7),
        *(pytest.param(name, 2, marks=pytest.mark.slow) for name in ("export", "render", "run")),
        pytest.param("skins", 11, marks=pytest.mark.slow),
    ],
)
def test_a_failing_disk_is_a_clear_error_and_the_command_can_be_completed(
    workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, every: int
) -> None:
    check_failing(make_scene(workplace, name == "train"), name, every, monkeypatch, capsys)
