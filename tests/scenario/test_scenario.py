"""Scenario files: what they may say, what they may not, and what they resolve to."""

import json
import re
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from crowdsim import assets
from crowdsim.config.files import Finding, find_faults
from crowdsim.crowd.placement import place_groups
from crowdsim.errors import ScenarioError, nearest
from crowdsim.scenario.output import Ranged
from crowdsim.scenario.parts import AGGRESSIONS, GIRTHS, LENGTHS, RANGES, SCALES, SPEEDS, TEMPOS
from crowdsim.scenario.reference import scenario_reference, with_outputs
from crowdsim.scenario.scenario import (
    Scenario,
    dump_scenario,
    load_scenario,
    resolve_scenario,
    scenario_schema,
)

ROOT = Path(__file__).parents[2]
SCHEMA_FILE = "scenario.schema.json"
SHIPPED = sorted((ROOT / "scenarios").glob("*.yaml"))
NAMES = [
    "armies_200", "bout", "brawl_30", "brawl_30_cmu", "brawl_last_standing", "crowd_100k",
    "crowd_10k", "crowd_1m", "duel", "moving_target",
    "moving_target_fast",
]  # fmt: skip
POLICIES = ["boxer", "boxer_cmu", "boxer_crowd"]

BASE = """\
version: 1
name: test
seed: 1
duration: 100
types:
  boxer: {policy: boxer}
groups:
  - {name: red, team: red, type: boxer, count: 3, placement: {kind: grid}}
  - {name: blue, team: blue, type: boxer, count: 2, placement: {kind: grid, centre: [9, 0]}}
"""


@pytest.fixture(autouse=True)
def policies(monkeypatch, tmp_path):
    monkeypatch.setattr(assets, "policy_names", lambda: POLICIES)
    monkeypatch.chdir(tmp_path)


def find_scenario_faults(path: Path | str, overrides: tuple[str, ...] = ()) -> list[Finding]:
    folder = Path(path).parent
    return find_faults(path, Scenario, overrides, {"folder": folder, "policies": assets.policy_names()})


def findings(text: str, *overrides: str) -> list[str]:
    Path("s.yaml").write_text(text, encoding="utf-8")
    return [str(finding).removeprefix("s.yaml:") for finding in find_scenario_faults("s.yaml", overrides)]


def changed(old: str, new: str) -> list[str]:
    assert BASE.count(old) == 1
    return findings(BASE.replace(old, new))


def test_the_base_of_these_tests_is_right():
    assert findings(BASE) == []


@pytest.mark.parametrize("name", NAMES)
def test_shipped_scenarios_are_valid_and_fit(name):
    path = ROOT / "scenarios" / f"{name}.yaml"
    assert find_scenario_faults(path) == []
    scenario = load_scenario(path)
    assert scenario.name == name
    placed = place_groups(scenario)
    assert placed.shape == (3, scenario.avatar_count)
    assert np.isfinite(placed).all()


def test_shipped_scenarios_name_the_schema_for_editors():
    assert {path.stem for path in SHIPPED} >= set(NAMES)
    for path in SHIPPED:
        assert path.read_text().splitlines()[0] == f"# yaml-language-server: $schema={SCHEMA_FILE}"


def test_the_brawl_is_the_scene_that_people_rely_on():
    text = (ROOT / "scenarios/brawl_30.yaml").read_text()
    assert len(re.findall(r"^\s*seed: \d+$", text, re.M)) == len(re.findall(r"^\s*count: 30$", text, re.M)) == 1
    brawl = load_scenario(ROOT / "scenarios/brawl_30.yaml")
    assert (brawl.avatar_count, brawl.duration, brawl.opponents.kind) == (30, 1000, "anyone")
    assert brawl.outputs.bvh is not None
    assert brawl.outputs.bvh.fps == 60
    assert brawl.outputs.ply is not None
    assert (brawl.outputs.ply.every, brawl.outputs.ply.points) == (4, 500)
    assert brawl.outputs.render is None


def test_other_shipped_scenarios_are_what_their_names_say():
    armies = load_scenario(ROOT / "scenarios/armies_200.yaml")
    assert [group.count for group in armies.groups] == [100, 100]
    assert len(armies.teams) == 2
    assert {group.placement.gap for group in armies.groups} == {6.0}
    crowd = load_scenario(ROOT / "scenarios/crowd_10k.yaml")
    assert (crowd.avatar_count, crowd.duration) == (10_000, 200)
    assert crowd.outputs.model_dump(exclude_none=True).keys() == {"take"}
    slow, fast = (load_scenario(ROOT / f"scenarios/moving_target{which}.yaml") for which in ("", "_fast"))
    assert slow.groups[0].opponents.kind == fast.groups[0].opponents.kind == "target"
    assert (slow.targets["head"].speed, fast.targets["head"].speed) == (0.4, 1.0)
    assert load_scenario(ROOT / "scenarios/brawl_30_cmu.yaml").types["boxer"].policy == "boxer_cmu"


def test_the_committed_schema_and_reference_page_are_current():
    committed = (ROOT / "scenarios" / SCHEMA_FILE).read_text(encoding="utf-8")
    assert json.loads(committed) == json.loads(scenario_schema())
    assert (ROOT / "docs/scenarios.md").read_text(encoding="utf-8") == scenario_reference()
    commands = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    assert commands == with_outputs(commands)
    assert "| `csv` | " in commands


def test_examples_of_the_reference_page_are_valid(tmp_path):
    page = (ROOT / "docs/scenarios.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"```csv\n(.*?)```", page, re.DOTALL)
    (tmp_path / "cast.csv").write_text(table)
    examples = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    for number, example in enumerate(examples):
        (tmp_path / f"{number}.yaml").write_text(example)
        place_groups(load_scenario(tmp_path / f"{number}.yaml"))
    assert len(examples) == 2


def test_every_key_of_the_schema_has_a_meaning():
    schema = json.loads(scenario_schema())
    for name, part in {"Scenario": schema, **schema["$defs"]}.items():
        assert part["additionalProperties"] is False, name
        for key, value in part["properties"].items():
            assert value.get("description") or "$ref" in value, f"{name}.{key}"


def test_the_reference_page_links_to_sections_that_it_has():
    page = scenario_reference()
    anchors = {
        re.sub(r"[^a-z0-9_ -]", "", title.lower()).replace(" ", "-") for title in re.findall("^## (.*)", page, re.M)
    }
    assert set(re.findall(r"\]\(#([^)]*)\)", page)) <= anchors


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("version: 1", "version: 2", "1:10: version: is 2, expected 1"),
        ("name: test", "name: ../x",
         "2:7: name: is '../x', expected a name of letters, digits, '_', '-' and '.', at most 64, a letter or digit "
         "first, no '.' last, and none that Windows reserves, such as CON, NUL or COM1"),
        ("seed: 1", "seed: -1", "3:7: seed: is -1, expected a whole number from 0 to 9223372036854775807"),
        ("duration: 100", "duration: 0", "4:11: duration: is 0, expected a whole number from 1 to 100000000"),
        ("duration: 100", "duration: 1.5",
         "4:11: duration: is 1.5, expected a whole number from 1 to 100000000, a mapping with seconds or text such "
         "as 20s"),
        ("duration: 100", "duration: 0s",
         "4:11: duration.seconds: is '0s', expected a number above 0 and up to 1000000"),
        ("duration: 100", "duration: 20m",
         "4:11: duration: is '20m', expected a whole number from 1 to 100000000, a mapping with seconds or text such "
         "as 20s"),
        ("policy: boxer}", "policy: boxr}",
         "6:19: types.boxer.policy: is 'boxr', no known policy, expected boxer, boxer_cmu or boxer_crowd "
         "(did you mean 'boxer'?)"),
        ("{policy: boxer}", "{extends: boxed}",
         "6:20: types.boxer.extends: is 'boxed', expected a type of this scenario: boxer (did you mean 'boxer'?)"),
        ("{policy: boxer}", "{extends: boxer}", "6:20: types.boxer.extends: goes round in a circle: boxer -> boxer"),
        ("{policy: boxer}", "{scale: 3}", "6:18: types.boxer.scale: is 3, expected a number from 0.5 to 2.0"),
        ("{policy: boxer}", "{legs: 0}", "6:17: types.boxer.legs: is 0, expected a number from 0.9 to 1.1"),
        ("{policy: boxer}", "{arms: 2}", "6:17: types.boxer.arms: is 2, expected a number from 0.9 to 1.1"),
        ("{policy: boxer}", "{arms: long}", "6:17: types.boxer.arms: is 'long', expected a number from 0.9 to 1.1 or a "
         "mapping with kind: 'uniform' or 'normal'"),
        ("{policy: boxer}", "{scale: {kind: uniform, minimum: 1, maximum: 3}}",
         "6:18: types.boxer.scale: is 1 to 3, expected factors from 0.5 to 2"),
        ("{policy: boxer}", "{scale: {knd: uniform, minimum: 1, maximum: 2}}",
         "6:19: types.boxer.scale.knd: unknown key, expected kind: 'uniform' or 'normal' (did you mean 'kind'?)"),
        ("{policy: boxer}", "{speed: {kind: normal, deviation: 2}}",
         "6:18: types.boxer.speed: is -3 to 5, expected factors from 0.25 to 4"),
        ("{policy: boxer}", "{scale: {kind: uniform, minimum: 1.2, maximum: 1.1}}",
         "6:43: types.boxer.scale.minimum: is 1.2, expected at most the maximum, 1.1"),
        ("{policy: boxer}", "{tempo: {kind: uniform, minimum: -5, maximum: 60}}",
         "6:18: types.boxer.tempo: is -5 to 60, expected strikes per minute from 1 to 1000"),
        ("{policy: boxer}", "{tempo: {kind: normal, deviation: 10}}",
         "6:18: types.boxer.tempo.mean: missing, expected a number"),
        ("{policy: boxer}", "{tempo: 0}", "6:18: types.boxer.tempo: is 0, expected a number from 1.0 to 1000.0"),
        ("{policy: boxer}", "{aggression: 9}",
         "6:23: types.boxer.aggression: is 9, expected a number from 0.25 to 4.0"),
        ("{policy: boxer}", "{aggression: {kind: normal, deviation: 1}}",
         "6:23: types.boxer.aggression: is -1 to 3, expected factors from 0.25 to 4"),
        ("{policy: boxer}", "{aggression: {kind: uniform, minimum: -1, maximum: 2}}",
         "6:48: types.boxer.aggression.minimum: is -1, expected a number above 0"),
        ("{policy: boxer}", "{range: {kind: uniform, minimum: 0.5, maximum: 0.1}}",
         "6:43: types.boxer.range.minimum: is 0.5, expected at most the maximum, 0.1"),
        ("{policy: boxer}", "{range: {kind: normal, mean: 0, deviation: -1}}",
         "6:53: types.boxer.range.deviation: is -1, expected a number of at least 0"),
        ("{policy: boxer}", "{range: {kind: uniform, minimum: 0, maximum: 1.0e+9}}",
         "6:18: types.boxer.range: is 0 to 1e+09, expected distances [m] from -0.3 to 1"),
        ("{policy: boxer}", "{colour: red}",
         "6:19: types.boxer.colour: is 'red', expected a colour as '#rrggbb' in quotes, such as '#c8553d'"),
        ("{policy: boxer}", "{behaviours: {punch: -1}}",
         "6:31: types.boxer.behaviours.punch: is -1, expected a number from 0 to 1000"),
        ("  boxer: {policy: boxer}", "  'a b': {}\n  boxer: {}",
         "6:3: types: the key is 'a b', expected a name"),
        ("team: red, type: boxer", "team: red, type: boxxer",
         "8:34: groups[0].type: is 'boxxer', expected a type: boxer (did you mean 'boxer'?)"),
        ("team: red, type: boxer", "team: red",
         "8:5: groups[0]: has neither 'type' nor 'mix', expected one of them"),
        ("team: red, type: boxer", "team: red, mix: {boxer: 0}",
         "8:33: groups[0].mix: all weights are 0, expected one above 0"),
        ("team: red, type: boxer", "team: red, mix: {boxr: 1}",
         "8:40: groups[0].mix.boxr: no such type, expected boxer (did you mean 'boxer'?)"),
        ("name: blue", "name: Red", "9:12: groups[1].name: is 'Red' like groups[0], expected a name of its own"),
        ("count: 3", "count: 0", "8:48: groups[0].count: is 0, expected a whole number from 1 to 10000000"),
        ("placement: {kind: grid}", "placement: {kind: gird}",
         "8:69: groups[0].placement.kind: is 'gird', expected 'grid', 'ring', 'line', 'army', 'disc', 'points' or "
         "'table' (did you mean 'grid'?)"),
        ("placement: {kind: grid}", "placement: {kidn: grid}",
         "8:63: groups[0].placement.kidn: unknown key, expected kind: 'grid', 'ring', 'line', 'army', 'disc', "
         "'points' or 'table' (did you mean 'kind'?)"),
        ("placement: {kind: grid}", "placement: {kind: grid, centre: [1, 0, 2]}",
         "8:83: groups[0].placement.centre: has 3 items, expected a list of two numbers, x and z [m]"),
        ("placement: {kind: grid}", "placement: {kind: disc, radius: 0}",
         "8:83: groups[0].placement.radius: is 0, expected a number above 0 and up to 100000"),
        ("placement: {kind: grid}", "placement: {kind: grid}, facing: enemy",
         "8:84: groups[0].facing: is 'enemy', expected 'placement', 'centre', 'outwards', 'enemies' or 'random' or a "
         "number from -360 to 360 (did you mean 'enemies'?)"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(old, new, expected):
    found = changed(old, new)
    assert len(found) == 1
    assert found[0] == expected if not expected.endswith("a name") else found[0].startswith(expected)


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("opponents: {kind: target, target: hed}\ntargets: {head: {kind: circle, radius: 2}}",
         ["10:35: opponents.target: is 'hed', expected a target of this scenario: head (did you mean 'head'?)"]),
        ("opponents: {kind: fixed, group: rde}",
         ["10:33: opponents.group: is 'rde', expected a group: red or blue (did you mean 'red'?)"]),
        ("opponents: {kind: fixed, group: blue, member: 2}",
         ["10:33: opponents.group: is 'blue', whose own avatars would fight themselves, expected another group",
          "10:47: opponents.member: is 2, expected an avatar of 'blue' from 0 to 1"]),
        ("opponents: {kind: fixed, group: blue}",
         ["10:33: opponents.group: 'blue' has 2 avatars for 3 to fight, expected as many, or 'member'",
          "10:33: opponents.group: is 'blue', whose own avatars would fight themselves, expected another group"]),
        ("events: [{kind: remove, group: green, when: {kind: frame, frame: 3}}]",
         ["10:32: events[0].group: is 'green', expected a group: red or blue"]),
        ("events: [{kind: add, group: red, when: {kind: frame, frame: 3}}]",
         ["10:29: events[0].group: is 'red', which is there from the start, expected a group with 'waits: true'"]),
        ("events: [{kind: weights, when: {kind: seconds, seconds: 3}}]",
         ["10:10: events[0]: changes nothing, expected 'behaviours', 'temperature', 'tempo' or 'reaction'"]),
        ("events: [{kind: remove, group: red, when: {kind: strikes, count: 3, team: rde}}]",
         ["10:75: events[0].when.team: is 'rde', expected a team: red or blue (did you mean 'red'?)"]),
        ("outputs: {bvh: {avatars: [0, 5]}}", ["10:30: outputs.bvh.avatars[1]: is 5, expected an avatar from 0 to 4"]),
        ("outputs: {bvh: {frames: 5}}",
         ["10:25: outputs.bvh.frames: is 5, expected a list of two whole numbers, a mapping with seconds or text such "
          "as 0:120 or 2s:5s"]),
        ("outputs: {render: {frames: 5s:2s}}",
         ["10:28: outputs.render.frames: is [5.0, 2.0], expected the first frame before the last"]),
        ("outputs: {render: {mp4: false}}",
         ["10:19: outputs.render: writes nothing, expected mp4, png or contact_sheet"]),
        ("outputs: {ply: {frames: [5, 2]}}",
         ["10:25: outputs.ply.frames: is [5, 2], expected the first frame before the last"]),
        ("outputs: {render: {camera: {kind: follow, avatar: 9}}}",
         ["10:51: outputs.render.camera.avatar: no avatar 9, expected a number from 0 to 4 or a name such as 'red_0'"]),
        ("outputs: {render: {camera: tpo}}",
         ["10:28: outputs.render.camera: camera 'tpo' is unknown, expected one of auto, fight, fight:AVATAR, orbit, "
          "follow, follow:AVATAR, eye, eye:AVATAR, top, side, front (did you mean 'top'?)"]),
        ("outputs: {bvh: {avatars: [reds]}}",
         ["10:27: outputs.bvh.avatars[0]: is 'reds', expected the number or name of an avatar, or red or blue "
          "(did you mean 'red'?)"]),
        ("outputs: {png: {}}",
         ["10:11: outputs.png: unknown key, expected take, bvh, ply, pcd, render, profile, clips, csv, "
          "glb or report"]),
        ("arena: {kind: circle, radius: .inf}", ["10:31: arena.radius: is .inf, expected a finite number"]),
    ],
)  # fmt: skip
def test_a_mistake_among_events_opponents_and_outputs_is_found(more, expected):
    assert sorted(findings(BASE + more)) == sorted(expected)


def typos(word: str) -> set[str]:
    """Every word that a letter less, more, changed or swapped with the next one makes."""
    places = range(len(word))
    less = {word[:i] + word[i + 1 :] for i in places}
    more = {f"{word[:i]}q{word[i:]}" for i in places}
    other = {f"{word[:i]}q{word[i + 1 :]}" for i in places}
    swapped = {word[:i] + word[i + 1 : i + 2] + word[i] + word[i + 2 :] for i in places}
    return {typo for typo in less | more | other | swapped if len(typo) > 1} - {word}


def test_a_key_that_is_a_letter_wrong_is_suggested():
    schema = json.loads(scenario_schema())
    for name, part in {"Scenario": schema, **schema["$defs"]}.items():
        keys = list(part["properties"])
        for key in keys:
            for typo in typos(key) - set(keys):
                assert nearest(typo, keys) == f" (did you mean '{key}'?)", (name, typo)


def test_a_group_that_may_or_may_not_wait_is_one_finding():
    text = BASE.replace("count: 3,", 'count: 3, waits: "yes",')
    text += "events: [{kind: add, group: red, when: {kind: frame, frame: 3}}]"
    assert findings(text) == ["8:58: groups[0].waits: is 'yes', expected true or false"]


@pytest.mark.parametrize("duration", ["20s", "20.0 s", "{seconds: 20}"])
def test_a_duration_may_be_given_in_seconds(duration):
    text = BASE.replace("duration: 100", f"duration: {duration}")
    Path("s.yaml").write_text(text, encoding="utf-8")
    assert load_scenario("s.yaml").control_frames(15.0) == 300
    assert load_scenario("s.yaml", ["duration=4s"]).control_frames(15.0) == 60


@pytest.mark.parametrize(
    "frames", ["[60, 150]", "60:150", "2s:5s", "[2s, 5s]", "{seconds: [2, 5]}", "1.99s:4.99s", "2s..5s"]
)
def test_frames_of_an_output_may_be_given_in_seconds(frames):
    text = BASE + f"outputs: {{bvh: {{fps: 30, frames: {frames}}}, render: {{fps: 30, frames: {frames}}}}}"
    Path("s.yaml").write_text(text, encoding="utf-8")
    scenario = load_scenario("s.yaml")
    assert scenario.outputs.bvh.frames == scenario.outputs.render.frames == (60, 150)
    Path("again.yaml").write_text(dump_scenario(scenario), encoding="utf-8")
    assert load_scenario("again.yaml") == scenario


def test_limits_of_distributions_are_the_same_in_check_and_reference():
    types = json.loads(scenario_schema())["$defs"]["AvatarType"]["properties"]
    given = (("scale", SCALES), ("speed", SPEEDS), ("tempo", TEMPOS), ("aggression", AGGRESSIONS), ("range", RANGES),
             ("girth", GIRTHS), ("legs", LENGTHS), ("arms", LENGTHS))  # fmt: skip
    for key, (least, most) in given:
        number = types[key]["anyOf"][0]
        assert (number["minimum"], number["maximum"]) == (least, most)
        assert f"from {least:g} to {most:g}" in types[key]["description"]
        assert findings(BASE.replace("{policy: boxer}", f"{{{key}: {most}}}")) == []
        for value in (least - 0.01, most + 0.01):
            for text in (f"{value}", f"{{kind: uniform, minimum: {value}, maximum: {value}}}"):
                assert len(findings(BASE.replace("{policy: boxer}", f"{{{key}: {text}}}"))) == 1
    factors = [line for line in scenario_reference().splitlines() if "factor" in line]
    assert not [line for line in factors if "<= 10 " in line]


def test_the_search_is_the_scenarios_and_that_of_all_groups():
    choices = "expected 'auto', 'kd_tree' or 'scipy'"
    for kind in ("kind: anyone", "kind: other_team"):
        assert findings(BASE + f"opponents: {{{kind}, search: scipy}}") == []
    assert findings(BASE + "opponents: {kind: anyone, search: kdtree}") == [
        f"10:35: opponents.search: is 'kdtree', {choices} (did you mean 'kd_tree'?)"
    ]
    group = BASE.replace("centre: [9, 0]}", "centre: [9, 0]}, opponents: {kind: anyone, search: scipy}")
    assert findings(group) == [
        "9:128: groups[1].opponents.search: is 'scipy', expected 'auto' as in the scenario's own opponents, or no "
        "search here"
    ]
    assert findings(group + "opponents: {kind: other_team, search: scipy}") == []
    event = "{kind: retarget, opponents: {kind: anyone, search: scipy}, when: {kind: frame, frame: 1}}"
    assert [line.partition(": ")[2].partition(":")[0] for line in findings(BASE + f"events: [{event}]")] == [
        "events[0].opponents.search"
    ]


def test_a_search_replaces_every_one_that_the_scenario_names():
    file = Path("s.yaml")
    group = BASE.replace("centre: [9, 0]}", "centre: [9, 0]}, opponents: {kind: other_team, search: scipy}")
    for text in (BASE, group + "opponents: {kind: anyone, search: scipy}\n"):
        file.write_text(text, encoding="utf-8")
        scenario = load_scenario(file, search="kd_tree")
        assert scenario.opponents.search == "kd_tree"
        assert {each.opponents.search for each in scenario.groups} == {"kd_tree"}
        Path("again.yaml").write_text(dump_scenario(scenario), encoding="utf-8")
        assert load_scenario("again.yaml") == scenario
        with pytest.raises(ScenarioError) as error:
            load_scenario(file, search="kdtree")
        assert str(error.value) == (
            "the search is 'kdtree', expected 'auto', 'kd_tree' or 'scipy' (did you mean 'kd_tree'?)"
        )


def test_a_scenario_without_opponents_is_refused():
    one = BASE.split("  - {name: blue")[0]
    assert findings(one + "opponents: {kind: other_team}") == [
        "9:19: opponents.kind: is 'other_team', but all avatars are of team 'red', expected a second team or kind "
        "'anyone'"
    ]
    assert findings(one.replace("count: 3", "count: 1")) == [
        "1:1: opponents: there is one avatar without an opponent, expected a second avatar or a scripted target"
    ]


def test_a_faulty_group_is_not_a_missing_one():
    one = BASE.split("  - {name: blue")[0]
    assert findings(one.replace("count: 3", "count: 0")) == [
        "8:48: groups[0].count: is 0, expected a whole number from 1 to 10000000"
    ]
    assert findings(one.split("  - {")[0].replace("groups:", "groups: []")) == [
        "7:9: groups: has 0 items, expected at least 1"
    ]


def test_too_many_avatars_files_and_points_are_mistakes():
    many = BASE.replace("count: 3", "count: 10000000")
    assert findings(many) == ["8:3: groups: there are 10,000,002 avatars, expected at most 10,000,000"]
    found = findings(BASE.replace("count: 3", "count: 1000000") + "outputs: {bvh: {}, ply: {points: 600}}")
    assert found == [
        "10:16: outputs.bvh: asks for 1,000,002 files, expected at most 10,000; choose some by 'avatars'",
        "10:34: outputs.ply.points: asks for 600,001,200 points a frame, expected at most 500,000,000",
    ]


def test_names_that_refer_to_nothing_are_found_beside_other_mistakes():
    text = BASE.replace("seed: 1", "sede: 1").replace("team: red, type: boxer", "team: red, type: boxxer")
    assert findings(text) == [
        "3:1: sede: unknown key, expected version, name, description, seed, duration, pre_roll, fps, arena, obstacles, "
        "types, groups, opponents, collision_avoidance, reactions, until, linger, targets, events, cameras or outputs "
        "(did you mean 'seed'?)",
        "8:34: groups[0].type: is 'boxxer', expected a type: boxer (did you mean 'boxer'?)",
    ]


@pytest.mark.parametrize(
    "file", ["../points.csv", "/etc/points.csv", "a/../../points.csv", "..\\points.csv", "C:/p.csv"]
)
def test_paths_cannot_leave_the_folder_of_the_scenario(file):
    found = changed("{kind: grid}}", f"{{kind: points, file: '{file}'}}}}")
    assert [line.split(": ", 1)[1] for line in found] == [
        f"groups[0].placement.file: is {file!r}, expected a path inside the scenario's folder"
    ]


def test_a_link_that_leaves_the_folder_is_refused(tmp_path):
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "points.csv").write_text("0,0\n")
    (folder / "points.csv").symlink_to(tmp_path / "points.csv")
    (folder / "s.yaml").write_text(BASE.replace("{kind: grid}}", "{kind: points, file: points.csv}}"))
    found = [finding.message for finding in find_scenario_faults(folder / "s.yaml")]
    assert found == ["is 'points.csv', a link that leaves the scenario's folder, expected a file in it"]


def test_a_missing_file_of_points_names_those_there_are():
    Path("other.csv").write_text("0,0\n")
    assert changed("{kind: grid}}", "{kind: points, file: point.csv}}") == [
        "8:83: groups[0].placement.file: is 'point.csv', and . holds no such file, expected one of other.csv"
    ]


TYPES = """\
  boxer: {policy: boxer, behaviours: {approach: 2, punch: 3}, candidates: {margin: 0.5, maximum: 7}, scale: 1.1}
  heavy: {extends: boxer, behaviours: {punch: 1}, candidates: {maximum: 2}, speed: 0.9}
  giant: {extends: heavy, scale: 1.5}
"""


def test_types_inherit_settings_from_the_type_they_extend():
    Path("s.yaml").write_text(BASE.replace("  boxer: {policy: boxer}\n", TYPES))
    giant = load_scenario("s.yaml").types["giant"]
    assert giant.behaviours == {"approach": 2, "punch": 1}
    assert (giant.candidates.margin, giant.candidates.maximum) == (0.5, 2)
    assert (giant.scale, giant.speed, giant.extends) == (1.5, 0.9, None)


def test_circles_of_types_are_found_whatever_their_length():
    text = BASE.replace("boxer: {policy: boxer}", "a: {extends: b}\n  b: {extends: c}\n  c: {extends: a}\n  boxer: {}")
    assert findings(text) == [
        "6:16: types.a.extends: goes round in a circle: a -> b -> c -> a",
        "7:16: types.b.extends: goes round in a circle: b -> c -> a -> b",
        "8:16: types.c.extends: goes round in a circle: c -> a -> b -> c",
    ]


@pytest.mark.parametrize("name", NAMES)
def test_a_resolved_scenario_loads_again_to_an_equal_one(name, tmp_path):
    scenario = load_scenario(ROOT / "scenarios" / f"{name}.yaml")
    (tmp_path / "scenario.resolved.yaml").write_text(dump_scenario(scenario))
    again = load_scenario(tmp_path / "scenario.resolved.yaml")
    assert again == scenario
    assert dump_scenario(again) == dump_scenario(scenario)
    assert all(group.name and group.opponents for group in again.groups)
    assert again != load_scenario(ROOT / "scenarios" / f"{name}.yaml", seed=scenario.seed + 1)


def test_resolving_writes_defaults_and_checksums_out():
    Path("p.csv").write_text("x,z\n0,0\n1,0\n2,0\n")
    Path("s.yaml").write_text(BASE.replace("{kind: grid}}", "{kind: points, file: p.csv}}").replace("name: red, ", "")
                              + "fps: 24\noutputs: {bvh: {}}\n")  # fmt: skip
    scenario = load_scenario("s.yaml")
    assert scenario.files == ("p.csv",)
    assert scenario.groups[0].name == "group1"
    assert scenario.outputs.bvh.fps == 24
    Path("r.yaml").write_text(dump_scenario(scenario))
    assert load_scenario("r.yaml") == scenario
    Path("p.csv").write_text("x,z\n0,0\n1,0\n3,0\n")
    with pytest.raises(ScenarioError, match="the file has changed"):
        load_scenario("r.yaml")


def test_seed_frames_and_fraction_change_a_loaded_scenario():
    path = ROOT / "scenarios/armies_200.yaml"
    scenario = load_scenario(path, seed=9, frames=12, fraction=0.1)
    assert (scenario.seed, scenario.duration, [group.count for group in scenario.groups]) == (9, 12, [10, 10])
    assert scenario.types == load_scenario(path).types
    for wrong in ({"seed": -1}, {"frames": 0}, {"fraction": 0.0}, {"fraction": 1.5}, {"fraction": float("nan")}):
        with pytest.raises(ScenarioError, match="expected"):
            load_scenario(path, **wrong)


def test_overrides_reach_into_groups():
    path = ROOT / "scenarios/brawl_30.yaml"
    scenario = load_scenario(path, ["groups[0].count=12", "outputs.ply=null", "duration.seconds=2", "name=2e3"])
    assert (scenario.avatar_count, scenario.outputs.ply, scenario.control_frames(15), scenario.name) == (
        12,
        None,
        30,
        "2e3",
    )
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path, ["groups[0].cuont=12"])
    assert str(caught.value) == (
        "--set groups[0].cuont=12: groups[0].cuont: unknown key, expected name, team, type, mix, count, placement, "
        "enter, facing, opponents or waits (did you mean 'count'?)"
    )


def test_a_scenario_that_is_not_found_names_those_there_are():
    with pytest.raises(
        ScenarioError, match=r"^brawl_3: no such scenario, expected a file or one of .*did you mean 'brawl_30"
    ):
        load_scenario("brawl_3")


def test_avatars_are_named_by_group_and_number():
    scenario = resolve_scenario(Scenario.model_validate({
        "version": 1, "name": "t", "duration": 1, "types": {"b": {}}, "groups": [
            {"type": "b", "count": 11, "placement": {"kind": "grid"}},
            {"name": "x", "type": "b", "count": 1, "placement": {"kind": "grid", "centre": [50, 0]}},
        ],
    }))  # fmt: skip
    assert [scenario.avatar_name(i) for i in (0, 10, 11)] == ["group1_00", "group1_10", "x_0"]
    with pytest.raises(IndexError):
        scenario.avatar_name(12)


def places_in(data, path=()):
    for key in data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ():
        yield (*path, key)
        yield from places_in(data[key], (*path, key))


JUNK = [
    None,
    True,
    -1,
    0,
    1e9,
    10**30,
    "",
    "x",
    "none",
    [],
    [1],
    [[1]],
    [None],
    {},
    {"kind": "disc"},
    {"kind": 3},
    {"a": {}},
]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.randoms(use_true_random=False), st.sampled_from(SHIPPED))
def test_any_damage_gives_findings_of_one_line_or_a_scenario_that_resolves(random, path):
    data = yaml.safe_load(path.read_text())
    for _ in range(random.randint(1, 3)):
        *above, key = random.choice(list(places_in(data)) or [("name",)])
        parent = data
        for part in above:
            parent = parent[part]
        if random.random() < 0.2:
            del parent[key]
        else:
            parent[random.choice([key, "kindd"]) if isinstance(parent, dict) else key] = deepcopy(random.choice(JUNK))
        if not data:
            break
    Path("s.yaml").write_text(yaml.safe_dump(data))
    found = find_scenario_faults("s.yaml")
    for finding in found:
        assert re.fullmatch(r"s\.yaml:\d+:\d+: [^ ]+: .+|s\.yaml:1:1: the file .+", str(finding)), finding
    if not found:
        Path("r.yaml").write_text(dump_scenario(load_scenario("s.yaml")))
        assert load_scenario("r.yaml") == load_scenario("s.yaml")


def test_pictures_have_the_rate_of_the_scenario():
    scenario = load_scenario(yaml.safe_load(BASE), ["fps=24", "outputs={bvh: {}, render: {}, ply: {fps: 12}}"])
    assert [output.rate for output in scenario.outputs.wanted() if isinstance(output, Ranged)] == [24.0, 12.0, 24.0]


def test_avatars_to_export_may_be_named_as_groups_and_avatars():
    scenario = load_scenario(yaml.safe_load(BASE), ["outputs.bvh.avatars=[blue, red_1, 0]"])
    assert scenario.outputs.bvh.avatars == (0, 1, 3, 4)


def test_names_of_cameras_become_their_keys():
    cameras = "cameras={low: {kind: follow, avatar: red_1}, far: {kind: orbit, distance: 30}}"
    shots = "[{camera: low, to: 2s}, {camera: side, from: 2s, to: 90}]"
    scenario = load_scenario(yaml.safe_load(BASE), [cameras, f"outputs.render={{camera: far, shots: {shots}}}"])
    render = scenario.outputs.render
    assert (render.camera.kind, render.camera.distance) == ("orbit", 30.0)
    assert [getattr(shot.camera, "kind", shot.camera) for shot in render.shots] == ["follow", "side"]
    Path("again.yaml").write_text(dump_scenario(scenario), encoding="utf-8")
    assert load_scenario("again.yaml") == scenario
