"""`crowdsim validate`: what a run would fail on is found beforehand, and in the same words."""

import json
from pathlib import Path

import pytest
from scenes import crowdsim, scene, write_scene

RED, BLUE = scene()["groups"]


def found(capsys, *arguments: str) -> list[str]:
    """Findings of a file, which must be there."""
    assert crowdsim("validate", *arguments) == 2
    report = capsys.readouterr()
    assert report.out == ""
    return report.err.splitlines()


@pytest.mark.parametrize(
    ("outputs", "finding"),
    [
        ({"bvh": {"frames": [0, 161]}}, "outputs.bvh.frames: is [0, 161], but the run has frames 0 to 159 at 60 fps"),
        ({"ply": {"fps": 30, "frames": "3s:4s"}},
         "outputs.ply.frames: is [90, 120], but the run has frames 0 to 79 at 30 fps"),
        ({"render": {"frames": [160, 161]}},
         "outputs.render.frames: is [160, 161], but the run has frames 0 to 159 at 60 fps"),
    ],
)  # fmt: skip
def test_output_frames_beyond_the_end_are_found_before_a_run_begins(workplace: Path, capsys, outputs, finding) -> None:
    write_scene(workplace / "four.yaml", outputs=outputs)
    (line,) = found(capsys, "four.yaml")
    assert line.startswith("four.yaml:")
    assert line.endswith(f": {finding}, 40 control frames (2.66667 s), expected a range within")
    assert crowdsim("run", "four.yaml") == 2
    assert capsys.readouterr().err == f"{line}\n"
    assert not (workplace / "output").exists()


def test_output_frames_may_reach_to_the_end_of_the_last_control_frame(workplace: Path, capsys) -> None:
    frames = {"bvh": {"frames": [10, 160]}, "ply": {"frames": "2s:2.66s", "every": 20, "points": 9}}
    write_scene(workplace / "four.yaml", outputs=frames)
    assert crowdsim("validate", "four.yaml") == 0
    assert crowdsim("run", "four.yaml") == 0
    text = (workplace / "output/four/bvh/red_0.bvh").read_text()
    assert "Frames: 150\n" in text
    assert sorted(path.name for path in (workplace / "output/four/ply").glob("*.ply")) == ["000120.ply", "000140.ply"]


def test_events_after_the_end_are_found_and_reported_by_a_run(workplace: Path, capsys) -> None:
    events = [
        {"kind": "remove", "group": "red", "when": {"kind": "frame", "frame": 40}},
        {"kind": "remove", "group": "red", "when": {"kind": "seconds", "seconds": 2.6}},
        {"kind": "remove", "group": "red", "when": {"kind": "seconds", "seconds": 2.7}},
    ]
    write_scene(workplace / "four.yaml", events=events)
    lines = found(capsys, "four.yaml")
    assert [line.split(": ", 1)[1] for line in lines] == [
        "events[0].when.frame: is 40, but the run ends after 40 control frames (2.66667 s), expected a time before "
        "that",
        "events[2].when.seconds: is 2.7, but the run ends after 40 control frames (2.66667 s), expected a time before "
        "that",
    ]
    assert crowdsim("run", "four.yaml") == 0
    assert [line for line in capsys.readouterr().err.splitlines() if "events[" in line] == lines


def test_avatars_outside_the_arena_are_named(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", arena={"kind": "rectangle", "size": [1.9, 4], "centre": [0.1, 0]})
    (line,) = found(capsys, "four.yaml")
    assert line.endswith(
        "groups[0].placement: 1 of 2 avatars are outside the arena, red_0, expected all inside a rectangle of 1.9 m "
        "by 4 m"
    )


def test_policies_of_different_control_rates_are_found(workplace: Path, capsys) -> None:
    text = (workplace / "policies" / "tiny.yaml").read_text()
    (workplace / "policies" / "slow.yaml").write_text(f"control_rate: 10\n{text}")
    types = {"boxer": {"policy": "tiny"}, "slow": {"policy": "slow"}}
    write_scene(workplace / "four.yaml", types=types)
    assert crowdsim("validate", "four.yaml") == 0
    capsys.readouterr()
    write_scene(workplace / "four.yaml", types=types, groups=[{**RED, "type": "slow"}, BLUE])
    (line,) = found(capsys, "four.yaml")
    assert line.endswith("types.slow.policy: policies of one run need one control rate, but tiny has 15, slow has 10")


@pytest.mark.parametrize("order", [["base", "heir"], ["heir", "base"]])
def test_a_typo_that_types_inherit_is_one_finding(workplace: Path, capsys, order: list[str]) -> None:
    types = {"base": {"policy": "tiny", "behaviours": {"aproach": 1}}, "heir": {"extends": "base"}}
    types["heir"]["behaviours"] = {"punch": 2}
    groups = [{**group, "type": "heir"} for group in (RED, BLUE)]
    write_scene(workplace / "four.yaml", types={name: types[name] for name in order}, groups=groups)
    (line,) = found(capsys, "four.yaml")
    assert line.endswith(
        "types.base.behaviours.aproach: policy 'tiny' has no such behaviour (did you mean 'approach'?); it has "
        "approach, punch"
    )
    types["heir"]["behaviours"] = {"aproach": 2}
    write_scene(workplace / "four.yaml", types=types, groups=groups)
    assert len(found(capsys, "four.yaml")) == 2


def test_scenarios_and_recipes_are_found_by_name(workplace: Path, capsys) -> None:
    (workplace / "scenarios").mkdir()
    write_scene(workplace / "scenarios" / "four.yaml", duration=0)
    assert crowdsim("validate", "tiny") == 0
    assert crowdsim("validate", "brawl_30", "policies/tiny.yaml") == 0
    assert capsys.readouterr().out == "1 file checked, nothing is wrong\n2 files checked, nothing is wrong\n"
    (line,) = found(capsys, "four")
    assert line.endswith("scenarios/four.yaml:4:11: duration: is 0, expected a whole number from 1 to 100000000")
    (line,) = found(capsys, "brawl_3")
    assert line.startswith("brawl_3: no such file, expected a file or one of ")
    assert line.endswith("(did you mean 'brawl_30'?)")
    assert found(capsys, ".") == [".: is a folder, expected a scenario"]


def test_json_holds_every_file_and_finding(workplace: Path, capsys) -> None:
    write_scene(workplace / "good.yaml")
    write_scene(workplace / "bad.yaml", duration=0)
    assert crowdsim("validate", "good.yaml", "bad.yaml", "--json") == 2
    report = capsys.readouterr()
    finding = "bad.yaml:4:11: duration: is 0, expected a whole number from 1 to 100000000"
    assert json.loads(report.out) == {
        "valid": False,
        "files": [
            {"file": "good.yaml", "valid": True, "findings": []},
            {"file": "bad.yaml", "valid": False, "findings": [finding]},
        ],
    }
    assert report.err == f"{finding}\n"
    assert crowdsim("validate", "good.yaml", "--json") == 0
    assert json.loads(capsys.readouterr().out)["valid"] is True
