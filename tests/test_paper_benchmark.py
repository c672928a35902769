"""The benchmark of the paper: what it takes back, how it counts what avatars earn, and a quick run of all of it."""

import importlib
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from crowdsim import load_scenario
from crowdsim.crowd.chunk import Chunk
from crowdsim.crowd.events import Events
from crowdsim.policy.rewards import ProximityTerm, StrikeTerm, TransitionTerm
from crowdsim.training.recipe import Recipe, load_recipe

ROOT = Path(__file__).parents[1]
BOXER = ROOT / "policies" / "boxer.yaml"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The benchmark's modules; that of scenes has the name of a helper of tests."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    monkeypatch.delitem(sys.modules, "scenes", raising=False)
    names = ("paper", "_policies.paper_differences", "_policies.realised_reward")
    for name in names:
        monkeypatch.delitem(sys.modules, name, raising=False)
    modules = {name.rpartition(".")[2]: importlib.import_module(name) for name in names}
    monkeypatch.delitem(sys.modules, "scenes")
    return SimpleNamespace(**modules)


@pytest.mark.parametrize("quick", [True, False])
def test_every_difference_changes_either_the_training_or_the_scene(bench: SimpleNamespace, quick: bool) -> None:
    changes, recipe = bench.paper_differences, load_recipe(BOXER)
    scenario = load_scenario(ROOT / "scenarios" / "brawl_30.yaml")
    base = Recipe.model_validate(changes.smaller(recipe, quick))
    assert base.motion.performer.seconds < recipe.motion.performer.seconds
    for name, difference in changes.differences(quick).items():
        report = changes.smaller(recipe, quick, difference.weighted)
        if difference.recipe is not None:
            difference.recipe(report)
        assert (Recipe.model_validate(report) != base) == (difference.recipe is not None), name
        assert (difference.scenario(scenario) != scenario) == (difference.recipe is None), name
    assert changes.smaller(recipe, quick) == changes.smaller(load_recipe(BOXER), quick)


def test_scenes_as_in_the_paper_have_none_of_what_control_adds(bench: SimpleNamespace) -> None:
    scenario = bench.paper_differences.as_in_the_paper(load_scenario(ROOT / "scenarios" / "brawl_30.yaml"))
    assert not scenario.collision_avoidance
    assert {kind.tempo for kind in scenario.types.values()} == {None}
    assert {group.opponents.hysteresis for group in scenario.groups} == {0.0}


def stand(frames: int, **changes: object) -> Chunk:
    """Two avatars 1 m apart, each straight ahead of the other, the second one of scale 0.5; nobody does anything."""
    report = {
        "first": 0,
        "action": np.zeros((frames, 2), int),
        "action_frame": np.tile(np.arange(1.0, frames + 1.0)[:, None], 2),
        "x": np.zeros((frames, 2)),
        "z": np.tile([0.0, 1.0], (frames, 1)),
        "heading": np.tile([0.0, np.pi], (frames, 1)),
        "opponent": np.tile([1, 0], (frames, 1)),
        "targets": np.zeros((frames, 0, 3)),
        "events": strikes(),
    }
    return Chunk(**{**report, **changes})


def strikes(*rows: tuple[float, int, tuple[float, float, float], float, bool]) -> Events:
    frame, attacker, point, speed, landed = zip(*rows, strict=True) if rows else ([], [], np.zeros((0, 3)), [], [])
    who = np.array(attacker, int)
    return Events(
        np.array(frame, float), who, 1 - who, np.zeros(len(who), int), np.array(point, float), np.array(speed, float),
        np.array(landed, bool),
    )  # fmt: skip


def earned(bench: SimpleNamespace, term: object, *chunks: Chunk) -> float:
    policy = SimpleNamespace(
        actions=SimpleNamespace(costs=np.array([0.0, 0.5, 0.25])), database=SimpleNamespace(strike_speeds=[4.0, 6.0])
    )
    counter = bench.realised_reward.RewardCounter((term,), policy, [1.0, 0.5])
    for chunk in chunks:
        counter.add(chunk)
    return counter.mean()


def test_nearness_counts_in_every_frame_on_the_avatars_own_scale(bench: SimpleNamespace) -> None:
    term = ProximityTerm(kind="proximity", weight=3.0, distance=1.0, sigma=0.5, facing=True)
    assert earned(bench, term, stand(4), stand(6, first=4)) == pytest.approx(3.0 * (1.0 + np.exp(-2.0)) / 2.0)
    away = stand(10, heading=np.full((10, 2), np.pi / 2.0))
    aside = (np.exp(-np.hypot(1.0, 1.0) / 0.5) + np.exp(-np.hypot(1.0, 2.0) / 0.5)) / 2.0
    assert earned(bench, term, away) == pytest.approx(3.0 * aside)


def test_strikes_earn_by_their_speed_and_cost_effort_and_waste(bench: SimpleNamespace) -> None:
    term = StrikeTerm(kind="strike", weight=2.0, speed_weight=0.5, effort=0.25, waste=3.0)
    struck = strikes((1.4, 0, (0.0, 1.5, 0.9), 20.0, True), (2.0, 0, (0.0, 1.5, 0.5), 5.0, False))
    assert earned(bench, term, stand(5, events=struck)) == pytest.approx(2.0 * (2.0 - 2 * 0.25 - 3.0) / 10.0)


def test_transitions_cost_when_they_happen_also_between_chunks(bench: SimpleNamespace) -> None:
    term = TransitionTerm(kind="transition", weight=2.0, each=0.1)
    action = np.array([[0, 0], [1, 0], [1, 0]])
    age = np.array([[1.0, 1.0], [1.0, 2.0], [2.0, 3.0]])
    later = stand(2, first=3, action=np.array([[1, 0], [1, 2]]), action_frame=np.array([[1.0, 4.0], [2.0, 1.0]]))
    total = earned(bench, term, stand(3, action=action, action_frame=age), later) * 10.0
    assert total == pytest.approx(-(2.0 * (0.5 + 0.5 + 0.25) + 3 * 0.1))


@pytest.mark.slow
def test_a_quick_run_measures_every_difference(
    bench: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["paper.py", "--quick", "--json", "--threads", "1"])
    bench.paper.main()
    report = json.loads(capsys.readouterr().out)
    assert {"actions", "states", "table_bytes", "training_seconds", "landed_per_minute"} <= set(report["boxer_paper"])
    assert set(report["boxer_paper"]["scenes"]) == set(bench.paper.SCENES)
    assert set(report["differences"]) == {"unablated", *bench.paper_differences.differences(True)}
    for one in report["differences"].values():
        assert {"landed_per_minute", "return_ratio"} <= set(one)
        assert np.isfinite(one["return_ratio"])
    assert report["differences"]["unablated"]["return_ratio"] == 1.0
    bench.paper.show(report)
    assert "not legible" in capsys.readouterr().out
