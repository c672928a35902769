"""Scripted targets that outrun those who follow them: `validate` and `run` warn, and go on."""

import json
import math
import shutil
from pathlib import Path

import pytest
from scenes import crowdsim, scene, write_scene

from crowdsim.scenario.scenario import Scenario, resolve_scenario
from crowdsim.scenario.warnings import speed_warnings
from crowdsim.take.figures_text import number

STATISTICS = {"tiny": {"sustained_speed": 1.5, "strikes": {"reach": {"distance": [0.4, 0.8]}}}}
CIRCLE = {"kind": "circle", "radius": 4.0, "speed": 2.0}
FOLLOW = {"kind": "target", "target": "head"}


def warnings(**changes: object) -> list[str]:
    report = scene(**{"opponents": FOLLOW, "targets": {"head": CIRCLE}, **changes})
    scenario = resolve_scenario(Scenario.model_validate(report))
    return [str(finding) for finding in scenario.place(speed_warnings(scenario, STATISTICS))]


def test_a_target_that_outruns_its_followers_is_named_with_what_they_can_do() -> None:
    assert warnings() == [
        "four: targets.head.speed: is 2, too fast for type 'boxer', whose policy 'tiny' sustains 1.5 m/s; "
        "expected at most 1.87"
    ]
    assert warnings(targets={"head": {**CIRCLE, "speed": 1.8}}) == []
    assert len(warnings(targets={"head": {**CIRCLE, "speed": -2.0}})) == 1


@pytest.mark.parametrize(
    ("kind", "most"),
    [
        ({"speed": 2.0}, 3.75),
        ({"speed": {"kind": "uniform", "minimum": 0.5, "maximum": 2.0}}, 0.93),
        ({"scale": 0.8}, 1.42),
    ],
)
def test_the_slowest_avatar_of_a_type_counts(kind: dict, most: float) -> None:
    types = {"boxer": {"policy": "tiny", **kind}}
    assert warnings(types=types, targets={"head": {**CIRCLE, "speed": most}}) == []
    (line,) = warnings(types=types, targets={"head": {**CIRCLE, "speed": most + 0.02}})
    assert line.endswith(f"expected at most {most}")


@pytest.mark.parametrize(
    ("points", "warned"),
    [
        ([[0, 0], [0, 100]], True),
        ([[0, 0], [0, 1.5]], False),  # within reach from the middle
        ([[5, 5]], False),
        ([[0, 0], [0, 3], [3, 3], [3, 0]], True),
    ],
)
def test_a_target_that_stays_within_reach_may_be_as_fast_as_it_likes(points: list, warned: bool) -> None:
    assert bool(warnings(targets={"head": {"kind": "points", "points": points, "speed": 15.0}})) == warned


def test_only_types_that_follow_the_target_are_asked_and_only_with_their_policys_own_weights() -> None:
    assert warnings(opponents={"kind": "other_team"}) == []
    assert warnings(types={"boxer": {"policy": "tiny", "behaviours": {"punch": 1.0}}}) == []
    assert warnings(types={"boxer": {"policy": "boxer"}}) == []
    later = {"kind": "retarget", "when": {"kind": "frame", "frame": 9}, "group": "blue", "opponents": FOLLOW}
    (line,) = warnings(opponents={"kind": "other_team"}, events=[later])
    assert "for type 'boxer'" in line


def test_validate_and_run_warn_on_standard_error_and_go_on(workplace: Path, capsys: pytest.CaptureFixture) -> None:
    write_scene(workplace / "four.yaml", opponents=FOLLOW, targets={"head": {**CIRCLE, "speed": 15}})
    lines = (workplace / "four.yaml").read_text().splitlines()
    row = next(row for row, line in enumerate(lines, start=1) if line.strip() == "speed: 15")
    where = f"four.yaml:{row}:{lines[row - 1].index('15') + 1}: targets.head.speed: is 15, too fast for type 'boxer'"
    assert crowdsim("validate", "four.yaml") == 0
    report = capsys.readouterr()
    assert report.err.startswith(where)
    assert report.err.count("\n") == 1
    assert report.out == "1 file checked, nothing is wrong\n"
    assert crowdsim("run", "four.yaml") == 0
    assert capsys.readouterr().err.startswith(where)


def test_untrained_policies_have_no_known_speed(workplace: Path, capsys: pytest.CaptureFixture) -> None:
    write_scene(workplace / "four.yaml", opponents=FOLLOW, targets={"head": {**CIRCLE, "speed": 15}})
    shutil.rmtree(workplace / "policies" / "tiny")
    assert crowdsim("validate", "four.yaml") == 0
    assert capsys.readouterr().err == ""
    assert crowdsim("run", "four.yaml") == 0
    assert "targets.head.speed: is 15, too fast for type 'boxer'" in capsys.readouterr().err


def test_inspect_reports_the_speed_that_a_policy_sustains(workplace: Path, capsys: pytest.CaptureFixture) -> None:
    assert crowdsim("inspect", "tiny", "--json") == 0
    speed = json.loads(capsys.readouterr().out)["sustained_speed"]
    assert math.isfinite(speed)
    assert speed > 0.0
    assert crowdsim("inspect", "tiny") == 0
    assert f"that flee at up to {number(speed)} m/s\n" in capsys.readouterr().out
