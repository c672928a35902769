"""Commands that are killed at random moments: what they left is whole, and the same command completes it exactly."""

import os
import random
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import pytest
from scenes import write_scene

sys.path.insert(0, str(Path(__file__).parent))
from forking import Server

from crowdsim.errors import TakeError
from crowdsim.policy.bundle import load_policy
from crowdsim.runs.checkpoint import read_checkpoint
from crowdsim.runs.lock import EXTENDING
from crowdsim.runs.manifest import read_manifest, verify

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a system that forks")

OUTPUTS = {
    "take": {"chunk": 8},
    "bvh": {"fps": 30},
    "ply": {"fps": 30, "every": 3, "points": 20},
    "render": {"fps": 2, "size": [32, 24], "png": True, "mp4": True, "contact_sheet": 2, "camera": "side"},
}
RUN = ["run", "four.yaml", "--threads", "1", "--out", "work"]
EXTEND = [*RUN, "--extend", "20"]
EXPORT = ["export", "work", "--bvh", "--ply", "--fps", "24", "--every", "3", "--points", "30", "--threads", "1"]
SKINS = ["export", "work", "--glb", "--clips", "--fps", "120", "--threads", "1"]
PICTURES = ["--png", "--mp4", "--contact-sheet", "3", "--size", "40x30", "--fps", "4", "--camera", "side"]
RENDER = ["render", "work", *PICTURES, "--threads", "1"]
TRAIN = ["train", "tiny", "--force", "--threads", "1"]


@dataclass
class Task:
    """A command that is killed.

    Attributes:
        words: The command.
        prepare: Puts what it begins with into the folder ``work``, from the folders of the fixture.
        undisturbed: Folder as the command leaves it when it is not killed.
        seconds: How long that takes.
    """

    words: list[str]
    prepare: Callable[[], None]
    undisturbed: Path
    seconds: float = 0.0


@pytest.fixture
def server(workplace: Path) -> Iterator[Server]:
    """A warm process in a folder with a scene, and its run."""
    write_scene(workplace / "four.yaml", duration=40, outputs=OUTPUTS)
    server = Server(workplace, [RUN])
    shutil.move(workplace / "work", workplace / "run")
    yield server
    server.close()


def do_undisturbed(server: Server, name: str) -> Task:
    """Return a task that has been done undisturbed."""
    work = server.folder / "work"

    def clear() -> None:
        shutil.rmtree(work, ignore_errors=True)

    def finished() -> None:
        clear()
        shutil.copytree(server.folder / "run", work)

    words, prepare = {
        "run": (RUN, clear),
        "extend": (EXTEND, finished),
        "export": (EXPORT, finished),
        "skins": (SKINS, finished),
        "render": (RENDER, finished),
        "train": (TRAIN, lambda: None),
    }[name]
    prepare()
    since = perf_counter()
    assert server.run(*words) == 0, server.said()
    seconds = perf_counter() - since
    undisturbed = server.folder / f"undisturbed-{name}"
    shutil.copytree(server.folder / "policies" / "tiny" if name == "train" else work, undisturbed)
    return Task(words, prepare, undisturbed, seconds)


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files of a run under final names, but those that differ from run to run."""
    found = {}
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        is_temporary = name.startswith((".", "take.zarr.partial")) or "/." in name.replace("take.zarr/", "")
        if path.is_file() and name not in ("manifest.json", "timings.json") and not is_temporary:
            found[name] = path.read_bytes()
    return {name: text for name, text in found.items() if ".part" not in name and not name.endswith(".partial")}


def check_whole(work: Path, task: Task, before: dict[str, bytes]) -> None:
    """Nothing under a final name is anything but what was there before or comes in the end."""
    end = contents(task.undisturbed)
    for name, text in contents(work).items():
        if name == "checkpoint.bin":
            try:
                read_checkpoint(work, 100, 1_000_000)
            except TakeError as error:
                raise AssertionError("a checkpoint is half-written") from error
        elif not name.startswith("take.zarr/"):
            assert text in (before.get(name), end.get(name)), f"{name} is partial"


def check_end(work: Path, task: Task) -> None:
    assert contents(work) == contents(task.undisturbed)
    if (work / "manifest.json").exists():
        assert verify(work).findings == ()
        one, other = read_manifest(work), read_manifest(task.undisturbed)
        for key in ("files", "statistics", "policies", "control_frames", "avatars", "origin"):
            assert one[key] == other[key], key
    assert [path.name for path in work.iterdir() if path.name.startswith(".")] == []


def is_reported(work: Path) -> bool:
    """Whether a run has been extended, and that has been reported."""
    return read_manifest(work)["control_frames"] == 60 and not (work / EXTENDING).exists()


def crash(server: Server, name: str, task: Task, kills: int, rng: random.Random) -> int:
    """Kill a command so many times, let it come to its end now and then, and return how often that was."""
    work = server.folder / ("policies/tiny" if name == "train" else "work")
    done, ends = 0, 0
    while done < kills:
        task.prepare()
        before = contents(work) if work.exists() else {}
        killed = 0
        while True:
            is_last = done >= kills or (killed > 0 and rng.random() < 0.3)
            code = server.run(*task.words, kill_after=None if is_last else rng.uniform(0.0, task.seconds))
            if code == 0:
                break
            assert code == -9, server.said()
            done, killed = done + 1, killed + 1
            check_whole(work, task, before)
            if name == "train":
                load_policy(work)
            if name == "extend" and is_reported(work):
                # Killed after its report; the same command would extend it further.
                break
        check_end(work, task)
        ends += 1
        if name == "train":
            assert [path.name for path in work.parent.iterdir() if path.name.startswith(".")] == []
    return ends


SHORT = {"run": 3, "export": 2, "skins": 2}
LONG = {"run": 80, "extend": 30, "export": 40, "skins": 20, "render": 30, "train": 20}


@pytest.mark.parametrize("kills", [SHORT, pytest.param(LONG, marks=pytest.mark.slow)], ids=["short", "long"])
def test_what_was_killed_at_any_moment_is_completed_to_the_same_bytes(server: Server, kills: dict[str, int]) -> None:
    seed = random.SystemRandom().randrange(10**6)
    print(f"seed {seed}")
    rng = random.Random(seed)
    for name, count in kills.items():
        task = do_undisturbed(server, name)
        ends = crash(server, name, task, count, rng)
        print(f"{name}: {count} kills, {ends} times brought to its end, {task.seconds:.2f} s undisturbed")
