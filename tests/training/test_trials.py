"""Trials of behaviours: they are the episodes of the evaluation, and say how often a behaviour does what it is for."""

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.policy.bundle import load_policy
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.evaluation import EpisodeSettings, run_episodes
from crowdsim.training.recipe import BehaviourSpec
from crowdsim.training.statistics import inspect_bundle
from crowdsim.training.trials import (
    ARRIVED_WITHIN,
    CLOSE,
    LANDED_WITHIN,
    WARNED,
    _Goal,
    _run_trials,
    measure_success,
    starts_of_trials,
)


@pytest.fixture(scope="module")
def policy(tiny_policy):
    return load_policy(tiny_policy)


def test_trials_end_when_the_compiled_episodes_do(policy):
    rate = policy.database.control_rate
    for name, seconds, within in (("approach", ARRIVED_WITHIN, 0.6 + CLOSE), ("punch", LANDED_WITHIN, 0.5)):
        behaviour = policy.behaviour(name)
        states, targets = starts_of_trials(policy, name == "punch", name == "approach", 40)
        settings = EpisodeSettings(seconds, within=within)
        expected = run_episodes(policy.actions, behaviour, policy.body, rate, states, targets, settings)
        goal = _Goal(tolerance=behaviour.terms[0].tolerance) if name == "punch" else _Goal(within=within)
        times = _run_trials(policy, behaviour, states, targets, round(seconds * rate), goal) / rate
        wanted = expected.landings if name == "punch" else expected.arrivals
        assert np.isfinite(wanted).sum() > 20
        np.testing.assert_allclose(times, wanted, rtol=1e-6)


def test_success_reports_what_is_done_how_often_and_how_soon(policy):
    found = {one.name: measure_success(policy, one) for one in policy.behaviours}
    assert (found["approach"].task, found["approach"].seconds) == ("arrive", ARRIVED_WITHIN)
    assert (found["punch"].task, found["punch"].seconds) == ("strike", LANDED_WITHIN)
    for success in found.values():
        assert success.share > 0.8
        assert 0.0 < success.median_seconds < success.seconds
    assert 0.0 <= found["approach"].share_behind <= 1.0


def test_a_behaviour_that_pays_for_hits_is_tried_at_keeping_clear_of_one(policy):
    spec = BehaviourSpec.model_validate(
        {
            "axes": {"distance": {"count": 8, "maximum": 2.0}, "bearing": {"count": 8}, "impact": {"count": 5}},
            "rewards": [{"kind": "hit"}],
        }
    )
    evade, _ = train_behaviour("evade", spec, policy.database, policy.actions, policy.body)
    found = measure_success(policy, evade)
    assert (found.task, found.seconds) == ("evade", WARNED)
    assert found.share > 0.5
    blind = replace(evade, table=0.0 * evade.table, terms=(evade.terms[0].model_copy(update={"weight": 0.0}),))
    assert measure_success(policy, blind).share < 0.8 * found.share


def test_a_behaviour_that_wants_to_be_elsewhere_does_not_succeed(policy):
    approach = policy.behaviour("approach")
    worst = replace(approach, table=-approach.table)
    assert measure_success(policy, worst).share < 0.5 * measure_success(policy, approach).share


def test_a_bundle_holds_success_rates_and_the_distribution_of_strikes(policy):
    report = inspect_bundle(policy)
    for name, facts in report["behaviours"].items():
        assert facts["success"]["share"] == measure_success(policy, policy.behaviour(name)).share
    for key in ("by_hand", "by_kind", "by_height"):
        assert sum(report["strikes"][key].values()) == report["motion"]["strikes"] > 0
    assert 0.5 < report["strikes"]["used_share"] <= 1.0
    near, far = report["strikes"]["striking_range"]
    assert 0.3 < near < far < 1.3
    assert 0 < report["motion"]["frames_kept"] <= report["motion"]["frames"]
    assert any(weakness["what"].startswith("little motion: 24 s") for weakness in report["weaknesses"])
