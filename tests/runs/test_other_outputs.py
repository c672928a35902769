"""Other outputs of a finished run are written from its take, without simulating again."""

from pathlib import Path
from unittest.mock import Mock

import pytest
from scenes import crowdsim, scene, write_scene
from test_resuming import EVENTS, GROUPS, Simulated, same_as_undisturbed
from test_runner import tree

from crowdsim.export import posed
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.opening import open_run
from crowdsim.scenario.scenario import load_scenario

PICTURES = "outputs.render={mp4: false, contact_sheet: 2, size: [64, 48], camera: top, marks: none}"


@pytest.mark.parametrize("keys", [{"duration": 30}, {"duration": 200, "until": {"landed": 1}, "linger": 0.5}])
def test_other_outputs_of_a_finished_run_are_written_without_simulating(
    workplace: Path, monkeypatch, capsys, keys: dict
) -> None:
    outputs = {"bvh": {}}
    write_scene(workplace / "four.yaml", outputs=outputs, groups=GROUPS, events=EVENTS, **keys)
    other = ("run", "four.yaml", "--set", "fps=24", "--set", PICTURES, "--set", "cameras={low: {kind: orbit}}")
    assert crowdsim(*other, "--out", "undisturbed") == 0
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    before = tree(workplace / "run" / "take.zarr")
    outcome = read_manifest(workplace / "run").get("outcome")
    with monkeypatch.context() as patch:
        simulated = Simulated(patch, capsys)
        assert crowdsim(*other, "--out", "run") == 0
        assert simulated.frames == []
        assert "only outputs differ; writing them from its take" in capsys.readouterr().err
        assert tree(workplace / "run" / "take.zarr") == before
        assert (workplace / "run" / "contact_sheet.png").exists()
        assert read_manifest(workplace / "run").get("outcome") == outcome
        assert crowdsim("verify", "run") == 0
        assert crowdsim(*other, "--out", "run") == 0
        assert "done already" in capsys.readouterr().out
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


def test_a_run_that_ended_early_has_its_outcome_where_only_outputs_were_left(
    workplace: Path, monkeypatch, capsys
) -> None:
    write_scene(workplace / "four.yaml", outputs={"bvh": {}}, duration=200, until={"landed": 1}, linger=0.5)
    assert crowdsim("run", "four.yaml", "--out", "whole") == 0
    with monkeypatch.context() as patch:
        patch.setattr(posed, "write_posed", Mock(side_effect=OSError(28, "no room", "bvh")))
        assert crowdsim("run", "four.yaml", "--out", "run") == 1
    with monkeypatch.context() as patch:
        simulated = Simulated(patch, capsys)
        assert crowdsim("run", "four.yaml", "--out", "run") == 0
        assert simulated.frames == []
    expected = read_manifest(workplace / "whole")["outcome"]
    assert expected["kind"] == "landed"
    assert read_manifest(workplace / "run")["outcome"] == expected
    same_as_undisturbed(workplace / "run", workplace / "whole")


def test_a_profile_that_was_not_measured_cannot_be_written_later(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", duration=10)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert crowdsim("run", "four.yaml", "--out", "run", "--set", "outputs.profile={}") == 2
    assert "holds another run" in capsys.readouterr().err
    assert crowdsim("run", "four.yaml", "--out", "run", "--set", "outputs.csv={}") == 0
    assert {"control", "take"} <= set(read_manifest(workplace / "run")["seconds"])


def test_cameras_of_a_scenario_are_not_joined(workplace: Path, capsys) -> None:
    keys = {"cameras": {"mine": {"kind": "orbit"}}, "outputs": {"render": {"camera": "mine+front"}}}
    write_scene(workplace / "four.yaml", duration=10, **keys)
    assert crowdsim("validate", "four.yaml") == 2
    assert "joins 'mine', a camera of the scenario, expected kinds of cameras on both sides" in capsys.readouterr().err


def test_names_mean_the_same_avatars_in_a_scenario_and_in_a_take(workplace: Path) -> None:
    kinds = scene()["groups"]
    groups = [{**kinds[0], "team": "blue"}, {**kinds[1], "name": "x", "team": "red"}]
    write_scene(workplace / "four.yaml", groups=groups, duration=2)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    scenario, cast = load_scenario(workplace / "four.yaml"), open_run(workplace / "run").cast
    for name, expected in (("red", [0, 1]), ("x", [2, 3]), ("blue", [0, 1]), ("x_1", [3])):
        assert scenario.members(name) == cast.members(name).tolist() == expected
    assert scenario.members("boxer") is None


def test_another_seed_is_another_run(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", duration=10)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert crowdsim("run", "four.yaml", "--out", "run", "--seed", "77", "--set", PICTURES) == 2
    assert "holds another run" in capsys.readouterr().err
    # The chunks that a take is in cannot be changed behind it.
    assert crowdsim("run", "four.yaml", "--out", "run", "--set", "outputs.take.chunk=8") == 2


def test_shots_of_a_run_end_where_it_ends(workplace: Path, capsys) -> None:
    shots = [{"camera": "top", "from": 0, "to": "2s"}, {"camera": "side", "from": "8s", "to": "9s"}]
    render = {"mp4": False, "png": True, "size": [64, 48], "shots": shots}
    write_scene(workplace / "four.yaml", duration=200, until={"landed": 1}, linger=0.5, outputs={"render": render})
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    frames = read_manifest(workplace / "run")["control_frames"]
    assert len(list((workplace / "run" / "frames").glob("*.png"))) == 60 * frames // 15
    shots[1]["to"] = "99s"
    write_scene(workplace / "four.yaml", duration=200, outputs={"render": render})
    capsys.readouterr()
    assert crowdsim("validate", "four.yaml") == 2
    assert "outputs.render.shots[1]: frames '8s:99s': there are frames 0 to 799" in capsys.readouterr().err
