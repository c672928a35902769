"""Runs that were interrupted go on as if nothing had happened, or say why they cannot."""

import re
import signal
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim, write_scene
from test_runner import tree

from crowdsim import __version__
from crowdsim.errors import TakeError
from crowdsim.export import cloud_files, pointcloud
from crowdsim.runs import checkpoint, provenance, recording
from crowdsim.runs.checkpoint import Checkpoint, Pace, frames_done, read_checkpoint, write_checkpoint
from crowdsim.runs.manifest import read_manifest
from crowdsim.take import store
from crowdsim.training import fingerprint

OUTPUTS = {
    "take": {"chunk": 8},
    "bvh": {"fps": 30},
    "ply": {"fps": 30, "every": 3, "points": 20},
    "render": {"fps": 5, "size": [64, 48], "png": True, "mp4": True, "contact_sheet": 2, "camera": "side"},
}
GROUPS = [
    {"name": "red", "team": "red", "type": "boxer", "count": 2,
     "placement": {"kind": "line", "start": [-1, 0.7], "end": [1, 0.7]}, "facing": "enemies"},
    {"name": "blue", "team": "blue", "type": "boxer", "count": 2,
     "placement": {"kind": "line", "start": [-1, -0.7], "end": [1, -0.7]}, "facing": "enemies"},
    {"name": "late", "team": "red", "type": "boxer", "count": 1, "waits": True,
     "placement": {"kind": "line", "start": [0, 2], "end": [0, 2]}, "facing": "enemies"},
]  # fmt: skip
EVENTS = [
    {"kind": "add", "when": {"kind": "frame", "frame": 21}, "group": "late"},
    {"kind": "weights", "when": {"kind": "strikes", "count": 2}, "behaviours": {"approach": 2}},
]
"""Much is pending at any time: avatars who come late, a condition, strikes."""


CHUNK, STEP = 8, 3
"""Control frames of a chunk of the take, and of a step of the simulation: most steps end in the midst of a chunk."""


@pytest.fixture(autouse=True)
def small_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs go in small steps, and whole chunks of strikes be on disk early: all of damage is 0."""
    monkeypatch.setattr(recording, "_STEP_AVATAR_FRAMES", 5 * STEP)
    monkeypatch.setattr(store, "EVENTS_A_CHUNK", 4)


class Stop(Exception):
    """The process is gone."""


class Simulated:
    """Notes which control frames are simulated from now on, and what had been printed before the first of them.

    Attributes:
        frames: The control frames.
        said: What was printed on standard error before.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self.frames: list[int] = []
        self.said = ""
        noted = self

        class Noting(recording.Simulation):
            def run(self, frames: int):
                if not noted.frames:
                    noted.said = capsys.readouterr().err
                first = self.frame
                chunk = super().run(frames)
                noted.frames += range(first, self.frame)
                return chunk

        capsys.readouterr()
        monkeypatch.setattr(recording, "Simulation", Noting)


def stop_at(monkeypatch: pytest.MonkeyPatch, frame: int, number: int | None = None) -> None:
    """Let a run end at a control frame: as if killed, or by a signal."""

    class Stopped(recording.Simulation):
        def run(self, frames: int):
            if self.frame >= frame:
                if number is None:
                    raise Stop
                signal.raise_signal(number)
            return super().run(frames)

    monkeypatch.setattr(recording, "Simulation", Stopped)


def same_as_undisturbed(folder: Path, undisturbed: Path) -> None:
    one, other = read_manifest(folder), read_manifest(undisturbed)
    assert tree(folder) == tree(undisturbed)
    for key in ("files", "statistics", "policies", "control_frames", "avatars"):
        assert one[key] == other[key], key


@pytest.mark.parametrize("number", [None, signal.SIGINT])
@pytest.mark.parametrize("frames", [(0,), (9,), (37,), (8, 17, 40)])
def test_a_run_that_stopped_goes_on_to_the_same_bytes(
    workplace: Path, finish, monkeypatch, capsys, frames: tuple[int, ...], number: int | None
) -> None:
    monkeypatch.setattr(Pace, "is_due", lambda self, size: True)
    write_scene(workplace / "four.yaml", duration=60, outputs=OUTPUTS, groups=GROUPS, events=EVENTS)
    finish(workplace, out="undisturbed")
    for frame in frames:
        with monkeypatch.context() as patch:
            stop_at(patch, frame, number)
            if number is None:
                with pytest.raises(Stop):
                    crowdsim("run", "four.yaml", "--out", "run")
            else:
                assert crowdsim("run", "four.yaml", "--out", "run") == 128 + number
        assert not (workplace / "run" / "manifest.json").exists()
        assert frames_done(workplace / "run" / ".run.partial") == frames_done_at(frame, number)
    simulated, done = Simulated(monkeypatch, capsys), frames_done_at(frames[-1], number)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert simulated.frames == list(range(done, 60))
    if done:
        assert f"run: continuing after {done} control frames\n" in simulated.said
        assert "continuing" not in capsys.readouterr().err
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


def frames_done_at(frame: int, number: int | None) -> int:
    """Return after which frame a run goes on: of the last step, and by a signal the one that was being computed."""
    ends = sorted({*range(0, 99, CHUNK), *(first + k for first in range(0, 99, CHUNK) for k in (STEP, 2 * STEP))})
    step = next(k for k, end in enumerate(ends) if end >= frame)
    return ends[step + (1 if number else 0)]


def stop_run(monkeypatch: pytest.MonkeyPatch, frame: int = 16) -> None:
    """Let the run of ``four.yaml`` end as if killed at a control frame."""
    monkeypatch.setattr(Pace, "is_due", lambda self, size: True)
    with monkeypatch.context() as patch:
        stop_at(patch, frame)
        with pytest.raises(Stop):
            crowdsim("run", "four.yaml", "--out", "run")


@pytest.mark.parametrize("damage", ["flipped bit", "cut off", "no checkpoint", "missing chunk", "a chunk is empty"])
def test_what_cannot_be_continued_starts_over_to_the_same_bytes(
    workplace: Path, finish, monkeypatch, capsys, damage: str
) -> None:
    write_scene(workplace / "four.yaml", outputs={"take": {"chunk": 8}})
    finish(workplace, out="undisturbed")
    stop_run(monkeypatch)
    stage = workplace / "run" / ".run.partial"
    checkpoint, chunk = stage / "checkpoint.bin", stage / "take.zarr.partial" / "x" / "1.0"
    if damage == "flipped bit":
        whole = checkpoint.read_bytes()
        checkpoint.write_bytes(whole[:-9] + bytes([whole[-9] ^ 4]) + whole[-8:])
    elif damage == "cut off":
        checkpoint.write_bytes(checkpoint.read_bytes()[:-1])
    elif damage == "no checkpoint":
        checkpoint.unlink()
    elif damage == "missing chunk":
        chunk.unlink()
    else:
        chunk.write_bytes(b"")
    simulated = Simulated(monkeypatch, capsys)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert "; starting over" in simulated.said
    assert simulated.frames == list(range(40))
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


def test_a_changed_policy_is_refused_with_the_difference(workplace: Path, monkeypatch, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs={"take": {"chunk": 8}})
    stop_run(monkeypatch)
    before = tree(workplace / "run")
    recipe = workplace / "policies" / "tiny.yaml"
    recipe.write_text(recipe.read_text().replace("count: 6, fade", "count: 5, fade"))
    capsys.readouterr()
    assert crowdsim("run", "four.yaml", "--out", "run") == 2
    result = capsys.readouterr().err.splitlines()[-2:]
    assert result[0] == (
        "run: holds an unfinished run that cannot be continued, since something has changed; --force replaces it, "
        "--out names another folder"
    )
    assert re.fullmatch(r"policy tiny: was \w{12}\.\.\., is \w{12}\.\.\.", result[1])
    assert tree(workplace / "run") == before
    assert crowdsim("run", "four.yaml", "--out", "run", "--force") == 0


def test_a_changed_version_is_refused_with_the_difference(workplace: Path, monkeypatch, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs={"take": {"chunk": 8}})
    stop_run(monkeypatch)
    with monkeypatch.context() as patch:
        patch.setattr(provenance, "__version__", "9.9")
        patch.setattr(provenance, "sources_hash", lambda: "other sources")
        capsys.readouterr()
        assert crowdsim("run", "four.yaml", "--out", "run") == 2
    result = capsys.readouterr().err.splitlines()[-2:]
    assert result[0] == f"version of crowdsim: was {__version__}, is 9.9"
    assert re.fullmatch(r"version of sources: was \w{12}\.\.\., is other sources", result[1])
    assert crowdsim("run", "four.yaml", "--out", "run") == 0


def test_all_code_that_decides_what_a_run_writes_is_in_its_checksum() -> None:
    packages = {path.parent.name for path in Path(provenance.__file__).parents[1].glob("*/__init__.py")}
    decided = {*provenance._SOURCES, *fingerprint.SOURCES}
    assert packages - decided == {"batch", "commands", "config", "play", "self_play"}
    assert decided <= packages


def test_outputs_go_on_behind_the_last_whole_file(workplace: Path, finish, monkeypatch, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs=OUTPUTS)
    finish(workplace, out="undisturbed")
    write, written = cloud_files.write_cloud, []

    def stop(path: Path, cloud) -> None:
        if len(written) == 5:
            raise Stop
        written.append(path)
        write(path, cloud)

    with monkeypatch.context() as patch:
        patch.setattr(pointcloud, "write_cloud", stop)
        with pytest.raises(Stop):
            crowdsim("run", "four.yaml", "--out", "run", "--threads", "1")
    capsys.readouterr()
    assert crowdsim("status", "run") == 0
    result = capsys.readouterr().out
    assert result.startswith("interrupted  run  4 avatars, 40 control frames, bvh 0 of 5, ")
    assert "ply 5 of 28" in result
    before = {path: path.stat().st_mtime_ns for path in (workplace / "run" / ".run.partial" / "ply").iterdir()}
    simulated = Simulated(monkeypatch, capsys)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert simulated.frames == []
    assert {path: (workplace / "run" / "ply" / path.name).stat().st_mtime_ns for path in before} == before
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


def test_outputs_of_an_unfinished_take_are_not_taken_for_those_of_the_run(
    workplace: Path, finish, monkeypatch, capsys
) -> None:
    write_scene(workplace / "four.yaml", outputs={"take": {"chunk": 8}, "bvh": {"fps": 30}})
    finish(workplace, out="undisturbed")
    monkeypatch.setattr(Pace, "is_due", lambda self, size: True)
    with monkeypatch.context() as patch:
        stop_at(patch, 16, signal.SIGTERM)
        assert crowdsim("run", "four.yaml", "--out", "run") == 143
    assert crowdsim("export", "run", "--bvh", "--fps", "30") == 0
    simulated = Simulated(monkeypatch, capsys)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert simulated.frames == list(range(frames_done_at(16, signal.SIGTERM), 40))
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


def test_checkpoints_take_no_more_than_their_share_of_the_time(monkeypatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(checkpoint, "perf_counter", lambda: clock[0])
    pace, spent, written = Pace(), 0.0, 0
    while clock[0] < 100.0:
        if pace.is_due(1000):
            since, written = clock[0], written + 1
            clock[0] += 0.01 if written % 7 else 0.2
            spent += clock[0] - since
            pace.wrote(since, 1000)
        clock[0] += 0.001
    assert written > 10
    assert spent < 0.01 * clock[0]


def test_a_small_checkpoint_may_come_sooner_than_a_large_one(monkeypatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(checkpoint, "perf_counter", lambda: clock[0])
    pace = Pace()
    # The first one comes at once; a large one waits as any other.
    assert pace.is_due(1000)
    assert not pace.is_due(100_000_000)
    clock[0] = 81.0
    assert pace.is_due(100_000_000)
    clock[0] = 0.0
    clock[0] = 0.01
    pace.wrote(0.0, 1000)
    clock[0] += 1.0
    assert pace.is_due(400)
    assert not pace.is_due(1000)
    clock[0] += 1.0
    assert pace.is_due(1000)
    assert not pace.is_due(1100)


def test_a_checkpoint_reads_back_and_every_flipped_bit_is_found(tmp_path: Path) -> None:
    arrays = {"a": np.arange(3), "b": np.zeros((0, 2), "<f4"), "names": np.array(["x", "yz"])}
    timings = np.arange(42).reshape(7, 6)
    write_checkpoint(tmp_path, Checkpoint(7, "abc", arrays, {"frames": np.array(4)}, timings))
    result = read_checkpoint(tmp_path, 100, 1_000_000)
    assert (result.frame, result.origin, frames_done(tmp_path)) == (7, "abc", 7)
    assert {name: (value.dtype, value.tolist()) for name, value in result.simulation.items()} == {
        name: (value.dtype, value.tolist()) for name, value in arrays.items()
    }
    assert result.timings is not None
    assert result.timings.tolist() == timings.tolist()
    whole = (tmp_path / "checkpoint.bin").read_bytes()
    for place in range(len(whole)):
        for bit in range(0, 8, 3):
            (tmp_path / "checkpoint.bin").write_bytes(
                whole[:place] + bytes([whole[place] ^ 1 << bit]) + whole[place + 1 :]
            )
            with pytest.raises(TakeError):
                read_checkpoint(tmp_path, 100, 1_000_000)
