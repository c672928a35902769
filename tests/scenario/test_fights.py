"""Scenarios in which avatars can be hurt, and fights have an end."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from crowdsim.cli import app
from crowdsim.errors import OutputError, ScenarioError
from crowdsim.preparation.validation import check_file
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.runner import run, run_to
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.store import open_take
from crowdsim.training.train import train_recipe

FIGHT = {
    "version": 1,
    "name": "fight",
    "seed": 3,
    "duration": 600,
    "types": {"boxer": {"policy": "tiny", "damage": {"health": 30, "knock_down": 8, "downs": 2}}},
    "groups": [
        {"name": "red", "team": "red", "type": "boxer", "count": 3, "facing": "enemies",
         "placement": {"kind": "army", "side": "left", "ranks": 1, "gap": 1.5}},
        {"name": "blue", "team": "blue", "type": "boxer", "count": 3, "facing": "enemies",
         "placement": {"kind": "army", "side": "right", "ranks": 1, "gap": 1.5}},
    ],
    "opponents": {"kind": "other_team"},
    "until": "last_team",
}  # fmt: skip


def write(folder: Path, **changes: object) -> Path:
    path = folder / "fight.yaml"
    path.write_text(yaml.safe_dump({**FIGHT, **changes}), encoding="utf-8")
    return path


def findings(folder: Path, **changes: object) -> list[str]:
    with pytest.raises(ScenarioError) as error:
        load_scenario(write(folder, **changes))
    return [line.split(": ", 1)[1] for line in str(error.value).splitlines()]


def test_a_run_ends_with_its_outcome_in_manifest_and_summary(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(workplace, outputs={"bvh": {"fps": 30, "frames": [0, 90]}})
    with pytest.raises(SystemExit) as stop:
        app(["run", str(path), "--quiet"])
    assert stop.value.code in (0, None)
    manifest = read_manifest(workplace / "output/fight")
    outcome, frames = manifest["outcome"], manifest["control_frames"]
    assert outcome["kind"] == "last_team"
    assert outcome["frame"] + 45 == frames < 600
    assert sorted(outcome["teams"]) == ["blue", "red"]
    assert 0 in outcome["teams"].values()
    assert outcome["standing_count"] == len(outcome["standing"]) <= 3
    assert open_take(workplace / "output/fight/take.zarr").frame_count == frames
    with pytest.raises(SystemExit):
        app(["run", str(path), "--json", "--force"])
    assert json.loads(capsys.readouterr().out)["runs"][0]["outcome"] == outcome


def test_a_run_that_has_ended_is_not_extended(workplace: Path) -> None:
    scenario = load_scenario(write(workplace))
    run_to(workplace / "out", scenario)
    with pytest.raises(OutputError, match="has come to the end of its scenario, last team; it cannot be extended"):
        run_to(workplace / "out", scenario, more=(10, False))


def test_outputs_behind_the_end_are_left_out(workplace: Path) -> None:
    given = {"bvh": {"fps": 30, "frames": [1000, 1100]}, "ply": {"fps": 30, "frames": [1000, 1100], "points": 10}}
    report = run_to(workplace / "out", load_scenario(write(workplace, outputs=given)))
    assert set(report.outputs) == {"take"}
    assert report.outcome is not None


def test_events_let_groups_flee_and_watch(workplace: Path) -> None:
    far = {}
    for kind, more in (("fight", {}), ("flee", {}), ("watch", {"distance": 3.0})):
        events = [
            {"kind": kind, "group": group, "when": {"kind": "frame", "frame": 30}, **more} for group in ("red", "blue")
        ]
        path = write(workplace, events=events, until=None, duration=400, types={"boxer": {"policy": "tiny"}})
        nearest = []
        for seed in (1, 2, 3):
            take = run(load_scenario(path, seed=seed))
            here = [np.stack([take.x[300:, group], take.z[300:, group]]) for group in (slice(0, 3), slice(3, 6))]
            gaps = np.linalg.norm(here[0][..., :, None] - here[1][..., None, :], axis=0)
            nearest.append(np.median(gaps.min(axis=(1, 2))))
        far[kind] = float(np.mean(nearest))
    assert far["fight"] < 1.0
    assert far["watch"] > max(1.2, 1.4 * far["fight"])
    assert far["flee"] > max(far["watch"], 10.0)


def test_few_attack_one_opponent_where_few_may(workplace: Path) -> None:
    def near(attackers: int | None) -> float:
        groups = [dict(FIGHT["groups"][0], count=8), dict(FIGHT["groups"][1], count=1)]
        given = {"kind": "other_team", "attackers": attackers}
        take = run(load_scenario(write(workplace, groups=groups, opponents=given, until=None, duration=300,
                                       types={"boxer": {"policy": "tiny"}})))  # fmt: skip
        gaps = np.hypot(take.x[100:, :8] - take.x[100:, 8:], take.z[100:, :8] - take.z[100:, 8:])
        return float((gaps < 1.3).sum(axis=1).mean())

    assert near(2) < 0.7 * near(None)
    assert near(2) < 3.0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"types": {"boxer": {"policy": "tiny"}}}, ["until: no avatar can go down, expected 'damage' of their type"]),
        ({"until": {"down": 7}}, ["until.down: is 7, but 6 avatars can go down, expected at most that"]),
        ({"until": {"down": 1, "landed": 1}}, ["until: has both 'down' and 'landed', expected one of them"]),
        ({"until": None, "linger": 5}, ["linger: has no effect without 'until', which ends a run before its duration"]),
        ({"linger": -1}, ["linger: is -1, expected a number from 0 to 3600"]),
        ({"until": {}}, ["until: has neither 'down' nor 'landed', expected one of them"]),
        (
            {"groups": [FIGHT["groups"][0]], "opponents": {"kind": "anyone"}},
            ["until: is 'last_team', but all avatars are of team 'red', expected a second team or 'last_standing'"],
        ),
        (
            {"events": [{"kind": "flee", "when": {"kind": "down", "count": 13}}]},
            ["events[0].when.count: is 13, but there can be 12 knock-downs, expected at most that"],
        ),
        (
            {
                "types": {"boxer": {"policy": "tiny"}},
                "until": None,
                "events": [{"kind": "heal", "when": {"kind": "seconds", "seconds": 2}}],
            },
            ["events[0].kind: nothing hurts or tires these avatars, expected 'damage' of their type, or 'stamina'"],
        ),
        (
            {
                "arena": {"kind": "circle", "radius": 5},
                "events": [{"kind": "place", "when": {"kind": "ended"}, "group": "red", "point": [4, 4]}],
            },
            ["events[0].point: is 4, 4, expected a point in the arena"],
        ),
        (
            {"events": [{"kind": "flee", "when": {"kind": "health_below", "group": "red", "points": 31}}]},
            ["events[0].when.points: is 31, but avatars of 'red' start with less, expected at most 30"],
        ),
        (
            {
                "types": {
                    **FIGHT["types"],
                    "base": {"range": 0.2},
                    "boxer": {**FIGHT["types"]["boxer"], "extends": "base", "tempo": None},
                }
            },
            [
                "types.boxer.range: has no effect, since avatars whose tempo is null do not rest between bursts, "
                "expected 0 or a tempo"
            ],
        ),
    ],
)
def test_what_cannot_come_is_found(workplace: Path, changes: dict[str, object], expected: list[str]) -> None:
    found = [line.split(": ", 1)[-1] if line[0].isdigit() else line for line in findings(workplace, **changes)]
    assert [line.lstrip("0123456789: ") for line in found] == expected


def test_avatars_whose_stamina_is_inherited_can_be_healed(workplace: Path) -> None:
    types = {"base": {"policy": "tiny", "stamina": {}}, "boxer": {"extends": "base"}}
    events = [{"kind": "heal", "when": {"kind": "seconds", "seconds": 2}}]
    load_scenario(write(workplace, types=types, until=None, events=events))


def test_damage_is_inherited_key_by_key(workplace: Path) -> None:
    types = {
        **FIGHT["types"],
        "heavy": {"extends": "boxer", "damage": {"health": 50}},
        "ghost": {"extends": "boxer", "damage": None},
    }
    resolved = load_scenario(write(workplace, types=types)).types
    assert (resolved["heavy"].damage.health, resolved["heavy"].damage.downs) == (50, 2)
    assert resolved["ghost"].damage is None


def test_stances_of_which_a_policy_has_no_motion_are_found(workplace: Path) -> None:
    recipe = workplace / "policies/one_stance.yaml"
    text = (workplace / "policies/tiny.yaml").read_text(encoding="utf-8")
    recipe.write_text(text.replace("seed: 2}", "seed: 2}\n  mirror: false"), encoding="utf-8")
    train_recipe(recipe, threads=2)
    for stance in ("southpaw", {"southpaw": 0.3}):
        path = write(workplace, types={"boxer": {"policy": "one_stance", "stance": stance}}, until=None)
        found = [
            f"{path}:0:0: types.boxer.stance: policy 'one_stance' cannot keep the stance 'southpaw': the right foot "
            "leads in 0 % of its states, expected 20 % or more; 'mirror: true' in its recipe gives it as much motion "
            "of one stance as of the other"
        ]
        lines, _ = check_file(path)
        assert [re.sub(r":\d+:\d+:", ":0:0:", line) for line in lines] == found
        with pytest.raises(ScenarioError, match="cannot keep the stance 'southpaw'"):
            run_to(workplace / "output/fight", load_scenario(path))
        assert not (workplace / "output/fight").exists()
    fitting = write(workplace, types={"boxer": {"policy": "one_stance", "stance": "orthodox"}}, until=None)
    assert check_file(fitting)[0] == []


@pytest.mark.parametrize(
    ("stance", "message"),
    [
        ("soutpaw", "types.boxer.stance: is 'soutpaw'"),
        ({"southpaw": 1.5}, "types.boxer.stance.southpaw: is 1.5, expected a number from 0 to 1"),
        ({"orthodox": 1}, "types.boxer.stance.orthodox"),
    ],
)
def test_stances_that_there_are_not_are_findings(workplace: Path, stance: object, message: str) -> None:
    found = findings(workplace, types={"boxer": {"policy": "tiny", "stance": stance}}, until=None)
    assert any(message in line for line in found), found
