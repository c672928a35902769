"""The benchmark of scenes: its goals, its ring, and a quick run of every scene."""

import importlib.util
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import crowdsim, write_scene

from crowdsim import load_scenario, open_run, run
from crowdsim.take.measures import measure_fights

ROOT = Path(__file__).parents[1]
KEYS = {
    "first_landed_seconds", "out_of_reach_share", "stuck_avatars", "stuck_share", "thrown_per_minute",
    "landed_per_minute", "least_landed_per_minute", "landed_share", "blocked_share", "evaded_share",
    "air_share", "turned_away_share",
    "distance_median", "overlap_share",
}  # fmt: skip


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The benchmark, which has the name of the helper of tests that it is loaded beside."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    goals = importlib.import_module("_scene_goals")
    specification = importlib.util.spec_from_file_location("scenes_benchmark", ROOT / "benchmarks" / "scenes.py")
    module = importlib.util.module_from_spec(specification)
    monkeypatch.setitem(sys.modules, "scenes_benchmark", module)
    specification.loader.exec_module(module)
    return SimpleNamespace(goals=goals, scenes=module)


def test_the_worst_of_seeds_follows_the_direction_of_a_figure(bench: SimpleNamespace) -> None:
    worst, goal = bench.goals.worst_of, bench.goals.Goal
    assert worst("air_share", [0.1, 0.3, None]) == 0.3
    assert worst("landed_share", [0.1, 0.3]) == 0.1
    assert worst("first_landed_seconds", [1.0, 9.0]) == 9.0
    assert worst("first_landed_seconds", [1.0, None]) is None
    assert worst("distance_median", [0.8, 1.1], goal(0.85, 1.15)) == 0.8
    assert worst("distance_median", [0.9, 1.3], goal(0.85, 1.15)) == 1.3
    assert worst("stuck_avatars", [None, None]) is None


def test_goals_are_held_against_the_worst_seed_or_the_mean(
    bench: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    goal = bench.goals.Goal
    seeds = [{"seed": n, "landed_per_minute": value, "air_share": None} for n, value in enumerate((2.0, 7.0))]
    for asked, missed in (
        ({"landed_per_minute": goal(4.0)}, ["landed_per_minute"]),
        ({"landed_per_minute": goal(4.0, mean=True)}, []),
        ({"landed_per_minute": goal(5.0, mean=True)}, ["landed_per_minute"]),
        ({"air_share": goal(most=0.02)}, ["air_share"]),
    ):
        monkeypatch.setitem(bench.goals.GOALS, "duel", asked)
        report = bench.goals.summarise("duel", seeds)
        assert (report["landed_per_minute"], report["mean"]["landed_per_minute"]) == (2.0, 4.5)
        assert report["missed"] == missed
    assert [str(goal(most=0.02)), str(goal(4.0, mean=True)), str(goal(1.0, 2.0))] == ["<= 0.02", ">= 4, mean", "1 to 2"]


def test_goals_name_scenes_and_figures_that_there_are(bench: SimpleNamespace) -> None:
    for scene, goals in bench.goals.GOALS.items():
        assert scene in bench.scenes.names()
        more = {"within_share", "arrived_share", "arrived_in_time_share", "pelvis_outside_share", "feet_outside_share"}
        assert set(goals) <= KEYS | more


def test_arrivals_of_a_ring_are_first_times_within_reach(bench: SimpleNamespace) -> None:
    distances = np.full((150, 4), 4.0)
    distances[60:, 0] = 0.9  # 4.0 s, in time for 4 m: 4.83 s
    distances[75:, 1] = 1.2  # 5.0 s
    distances[30:40, 2] = 1.25
    report = bench.scenes.arrivals(distances, 15.0, 4.0)
    assert report == {"arrived_share": 0.25, "arrived_in_time_share": 0.5, "arrival_seconds": 4.5}
    assert bench.scenes.arrivals(distances[:, 3:], 15.0, 4.0)["arrival_seconds"] is None


def test_a_quick_run_measures_every_scene(
    bench: SimpleNamespace, workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["scenes.py", "--quick", "--json", "--policy", "tiny", "--threads", "1"])
    bench.scenes.main()
    report = json.loads(capsys.readouterr().out)
    assert set(report) == {f"ring_{d}" for d in (2, 3, 4, 8, 12)} | {
        p.stem for p in (ROOT / "scenarios").glob("*.yaml")
    }
    for name, scene in report.items():
        assert set(scene) >= KEYS
        assert set(scene["mean"]) >= KEYS
        assert len(scene["seeds"]) == (1 if name == "crowd_1m" else 2)
        assert scene["thrown_per_minute"] >= 0.0
        assert ("within_share" in scene) == (name in bench.scenes.NEAR)
        assert ("arrived_share" in scene) == name.startswith("ring_")


def test_scenes_are_measured_as_runs_of_the_package_are(bench: SimpleNamespace, workplace: Path) -> None:
    path = write_scene(workplace / "four.yaml", duration=200)
    scenario = load_scenario(path).model_copy(update={"seed": 3})
    scene = bench.scenes.Scene("four", scenario, 5.0, 1)
    report = bench.scenes.play(scene, 3, bench.scenes.load_policies(scenario), 1)
    take = run(scenario)
    assert {**measure_fights(take, take.policies, after=5.0).__dict__, "seed": 3} == report


def test_inspect_reports_the_same_figures_of_a_run(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_scene(workplace / "four.yaml", duration=200)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    capsys.readouterr()
    assert crowdsim("inspect", "run", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    opened = open_run(workplace / "run")
    expected = measure_fights(opened, opened.policies).__dict__
    assert expected["distance_median"] is not None
    assert {key: report[key] for key in KEYS} == expected
    assert report["hits_per_minute_per_avatar"] == pytest.approx(report["landed_per_minute"])
