"""How deep posed bodies are in one another."""

from dataclasses import replace

import naive_separation as naive
import numpy as np
import pytest
from take.synthetic_take import actions, build_take, database, sampler

from crowdsim.poses.kernels.capsules import Capsules
from crowdsim.take import penetration, quality
from crowdsim.take.kernels.penetration import find_penetrations
from crowdsim.take.penetration import Penetration, measure_penetration


@pytest.mark.parametrize("seed", range(3))
def test_depths_match_naive(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times, count, capsules = 2, 5, 3
    middles = rng.uniform(0.0, 0.8, (times, count, 1, 3))
    starts, ends = (middles + rng.normal(0.0, 0.15, (times, count, capsules, 3)) for _ in range(2))
    starts[1, 2] = np.nan
    radii = np.repeat(rng.uniform(0.03, 0.12, (count, capsules, 1)), 2, axis=2)
    arms = rng.random((count, capsules)) < 0.4
    bounds = 0.5 * np.linalg.norm(np.nan_to_num(ends - starts), axis=-1).max(axis=0) + radii[..., 0] + 1e-6
    posed = Capsules(starts.astype(np.float32), ends.astype(np.float32), radii, bounds, np.full(count, capsules))
    found, order = np.full((times, count, 2), np.inf), np.argsort(starts[:, :, 0, 0], axis=1)
    find_penetrations(0, times, posed, arms, order, found)
    for time in range(times):
        there = np.isfinite(starts[time, :, 0, 0])
        expected = naive.depths(starts[time, there], ends[time, there], radii[there], arms[there])
        np.testing.assert_allclose(found[time, there], expected, atol=3e-3)
        assert (found[time, ~there] == 0.0).all()


def test_bodies_apart_do_not_penetrate_and_bodies_at_one_place_do() -> None:
    first, lengths = actions(60)
    queues = [list(range(30)), list(range(30, 60))]
    apart, policy = build_take(queues, first, lengths, 30, start=[(0.0, 0.0, 0.0), (9.0, 0.0, 0.0)])
    figures = measure_penetration(sampler(apart, policy))
    assert (figures.penetration_share, figures.penetration_deepest, figures.penetrations_per_minute) == (0.0, 0.0, 0.0)
    same, policy = build_take([queues[0], queues[0]], first, lengths, 30, start=[(0.0, 0.0, 0.0)] * 2)
    figures = measure_penetration(sampler(replace(same, collision_avoidance=False), policy))
    assert figures.penetration_share == figures.penetration_share_with_arms == 1.0
    assert figures.penetration_deepest == pytest.approx(2.0 * database().body.capsule_radii[:, 0].max(), rel=0.2)
    # One episode each, over all 30 frames.
    assert figures.penetrations_per_minute == pytest.approx(60.0 * 15.0 / 30.0, rel=0.1)


def test_one_avatar_penetrates_nobody() -> None:
    first, lengths = actions(30)
    take, policy = build_take([list(range(30))], first, lengths, 20)
    assert measure_penetration(sampler(take, policy)).penetration_share is None


def test_a_run_that_is_too_long_is_measured_on_the_poses_that_its_feet_are_measured_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, lengths = actions(60)
    queues = [list(range(30)), list(range(30))]
    take, policy = build_take(queues, first, lengths, 90, start=[(0.0, 0.0, 0.0)] * 2)
    events = replace(take.events, outcome=np.zeros(0, np.int64), victim=np.zeros(0, np.int64), down=np.zeros(0, bool))
    posed, both = sampler(replace(take, collision_avoidance=False, events=events), policy), []
    monkeypatch.setattr(quality, "_MOST_POSES", 120)
    monkeypatch.setattr(quality, "_STRETCH", 30)
    monkeypatch.setattr(quality, "measure_penetration", lambda *_: both.append("apart") or Penetration(*[None] * 4))
    assert quality.measure_take(posed)["penetration_share"] is None
    assert both == ["apart"]
    monkeypatch.setattr(penetration, "_MOST_POSES", 120)
    stages: set[str] = set()
    figures = quality.measure_take(posed, lambda stage, *_: stages.add(stage))
    assert figures["penetration_share"] == figures["penetration_share_with_arms"] == 1.0
    assert figures["penetrations_per_minute"] is None
    assert both == ["apart"]
    assert stages == {"poses"}
