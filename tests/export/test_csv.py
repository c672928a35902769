"""Positions of joints as CSV: they are those of the take, in whatever part is asked for."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim, scene, write_scene

from crowdsim.errors import CrowdsimError
from crowdsim.export import stream
from crowdsim.outputs.csv import CsvOutput
from crowdsim.runs.exports import choose_outputs
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.opening import open_run

OUTPUTS = {"csv": {"fps": 30, "every": 3, "joints": ["head", "left_hand"]}}


class Stop(Exception):
    """The process is gone."""


def tables(folder: Path) -> dict[str, bytes]:
    """Return the files of a run's CSV."""
    return {path.name: path.read_bytes() for path in (folder / "csv").iterdir() if path.name != "avatars.csv"}


def table(path: Path) -> tuple[list[str], np.ndarray]:
    """Return the columns of a file, and its numbers."""
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    return head, np.array(rows, float)


@pytest.fixture
def run(workplace: Path) -> Path:
    """A run that writes CSV."""
    write_scene(workplace / "four.yaml", outputs=OUTPUTS)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    return workplace / "run"


def test_positions_are_those_of_the_take(run: Path, capsys) -> None:
    opened = open_run(run)
    assert sorted(path.name for path in (run / "csv").iterdir()) == [
        "avatars.csv", "blue_0.csv", "blue_1.csv", "red_0.csv", "red_1.csv",
    ]  # fmt: skip
    roles = opened.policies[0].database.body.roles
    for avatar, name in enumerate(opened.take.cast.names):
        head, rows = table(run / "csv" / f"{name}.csv")
        assert head == ["frame", "seconds", *(f"{joint}_{axis}" for joint in ("head", "left_hand") for axis in "xyz")]
        np.testing.assert_array_equal(rows[:, 0], np.arange(0, 80, 3))
        np.testing.assert_allclose(rows[:, 1], np.arange(0, 80, 3) / 30, atol=6e-7)
        joints = opened.joints(avatar, np.arange(0, 80, 3) / 30)
        chosen = joints[:, [roles["head"], roles["left_hand"]]].reshape(27, 6)
        np.testing.assert_allclose(rows[:, 2:], chosen, atol=6e-7, rtol=0)
        assert np.ptp(rows[:, 2:], axis=0).min() > 0.01
    assert crowdsim("verify", run) == 0
    files = read_manifest(run)["files"]
    assert {f"csv/{name}.csv" for name in opened.take.cast.names} <= set(files)


def test_the_command_writes_all_joints_of_some_frames_and_avatars(run: Path, capsys) -> None:
    opened = open_run(run)
    words = ("export", run, "--csv", "--fps", "20", "--frames", "10:31", "--avatars", "1,3", "--out", "x")
    assert crowdsim(*words) == 0
    assert sorted(path.name for path in (run.parent / "x" / "csv").iterdir()) == [
        "avatars.csv",
        "blue_1.csv",
        "red_1.csv",
    ]
    for avatar, name in ((1, "red_1"), (3, "blue_1")):
        head, rows = table(run.parent / "x" / "csv" / f"{name}.csv")
        names = opened.joint_names(avatar)
        assert head[2:] == [f"{joint}_{axis}" for joint in names for axis in "xyz"]
        np.testing.assert_array_equal(rows[:, 0], np.arange(10, 31))
        joints = opened.joints(avatar, np.arange(10, 31) / 20)
        np.testing.assert_allclose(rows[:, 2:], joints.reshape(21, -1), atol=6e-7, rtol=0)
    capsys.readouterr()
    assert crowdsim(*words[:3], "--joints", "head,left_hnd") == 2
    error = capsys.readouterr().err
    assert error.startswith(
        "csv: joints[1]: is 'left_hnd', but the bodies of policy 'tiny' have no such joint, expected"
    )
    assert error.endswith("(did you mean 'left_hand'?)\n")
    assert crowdsim(*words[:3], "--points", "3") == 2
    assert capsys.readouterr().err == "--points has no effect on --csv, expected --ply or --pcd with it\n"


@pytest.mark.parametrize(
    ("kinds", "keys", "what"),
    [
        (["cvs"], {}, "cannot export 'cvs', expected bvh, ply, pcd, clips, csv, glb (did you mean 'csv'?)"),
        (["csv"], {"joint": "head"}, "no export has the key 'joint', expected frames, fps, avatars, whole, t_pose, "
         "every, points, surface, obstacles, rotations, joints, camera, split (did you mean 'joints'?)"),
        (["csv"], {"every": 0}, "csv: every: Input should be greater than or equal to 1"),
        (["csv"], {"frames": "5:2"}, "frames '5:2': is empty, expected the first frame before the last"),
    ],
)  # fmt: skip
def test_what_cannot_be_chosen_is_said(run: Path, kinds: list[str], keys: dict, what: str) -> None:
    with pytest.raises(CrowdsimError) as raised:
        choose_outputs(open_run(run).take, kinds, **keys)
    assert str(raised.value) == what


def test_joints_that_there_are_not_are_found_before_a_run(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs={"csv": {"joints": ["tail"]}})
    expected = "outputs.csv.joints[0]: is 'tail', but the bodies of policy 'tiny' have no such joint, expected "
    for words in (("validate", "four.yaml"), ("run", "four.yaml", "--out", "run")):
        assert crowdsim(*words) == 2
        assert expected in capsys.readouterr().err
    assert not (workplace / "run").exists()


def test_an_interrupted_run_goes_on_to_the_same_files(run: Path, monkeypatch) -> None:
    expected = tables(run)
    monkeypatch.setattr(stream, "_MANY_AVATARS", 1)
    begun = []

    def stop_at_third(self, sampler, avatar, path, frames):
        if len(begun) == 2:
            raise Stop
        begun.append(path)
        return begin(self, sampler, avatar, path, frames)

    begin = CsvOutput.begin
    with monkeypatch.context() as patch:
        patch.setattr(CsvOutput, "begin", stop_at_third)
        with pytest.raises(Stop):
            crowdsim("run", "four.yaml", "--out", "again")
    stage = run.parent / "again" / ".run.partial"
    kept = {path.name: path.stat().st_mtime_ns for path in (stage / "csv").glob("[!.]*")}
    assert sorted(kept) == ["red_0.csv", "red_1.csv"]
    assert not list((stage / "csv").glob(".*"))
    assert crowdsim("run", "four.yaml", "--out", "again") == 0
    assert {name: (run.parent / "again" / "csv" / name).stat().st_mtime_ns for name in kept} == kept
    assert tables(run.parent / "again") == expected


def test_parts_of_a_take_have_the_rows_of_the_whole(run: Path, monkeypatch) -> None:
    monkeypatch.setattr(stream, "_POSES_AT_ONCE", 20)
    assert crowdsim("export", run, "--csv", "--fps", "30", "--joints", "head,left_hand", "--out", "all") == 0
    whole = (run.parent / "all" / "csv" / "red_1.csv").read_text().splitlines()
    assert len(whole) == 81
    some = (run / "csv" / "red_1.csv").read_text().splitlines()
    assert some == [whole[0], *whole[1::3]]


def test_blocks_without_rows_are_nothing_special(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = tables(run)
    monkeypatch.setattr(stream, "_FRAMES_AT_ONCE", 2)
    words = ("--fps", "30", "--every", "3", "--joints", "head,left_hand", "--out", "x")
    assert crowdsim("export", run, "--csv", *words) == 0
    assert tables(run.parent / "x") == whole


def test_avatars_that_never_come_have_no_file_whatever_is_written_along(workplace: Path, capsys) -> None:
    groups = [{**group, "waits": group["name"] == "blue"} for group in scene()["groups"]]
    events = [{"kind": "add", "group": "blue", "when": {"kind": "strikes", "count": 10_000}}]
    write_scene(workplace / "four.yaml", groups=groups, events=events, opponents={"kind": "anyone"})
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    for kinds in (("--glb",), ("--glb", "--bvh", "--csv")):
        capsys.readouterr()
        assert crowdsim("export", "run", *kinds, "--avatars", "blue_0", "--out", "x", "--force") == 0
        assert "glb: avatars.csv only: none of these avatars is present in these frames" in capsys.readouterr().out
        assert not list((workplace / "x").rglob("*.glb"))


def test_a_glb_that_would_be_too_large_is_refused_before_the_run(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", duration=1_000_000, outputs={"glb": {}})
    assert crowdsim("run", "four.yaml", "--out", "run") == 2
    assert (
        "outputs.glb: would have about 5.8 GB, glTF files have at most 4.3; expected fewer" in capsys.readouterr().err
    )
    assert not (workplace / "run").exists()
