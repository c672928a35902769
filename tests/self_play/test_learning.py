"""Learning in fights: hits are credited to the decisions before them, and what is seldom chosen is judged with care."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from crowdsim.core.threats import CELLS
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.model import build_model
from crowdsim.errors import PolicyError, RecipeError
from crowdsim.policy import bundle
from crowdsim.self_play.fights import BLOCKED, DISCOUNT, HORIZON, Side, Tally, start_fights, watch_fights
from crowdsim.self_play.learning import expected_hits, learn_defence
from crowdsim.self_play.response import best_response
from crowdsim.training.recipe import DefenceSpec, Recipe, load_recipe
from crowdsim.training.train import train_policy

TINY = Path(__file__).parents[1] / "tiny_policy.yaml"
SPEC = {"rounds": 2, "pairs": 6, "seconds": 30.0}
PAIRS = 8


def recipe(**changes):
    return Recipe.model_validate({**yaml.safe_load(TINY.read_text(encoding="utf-8")), **changes})


@cache
def trained():
    return train_policy(recipe(defend=SPEC), "tiny", spar=learn_defence)[0]


def fights(seed=3, defence=1.0):
    one = trained()
    return start_fights([one], build_model([one]), PAIRS, Side(0.5, defence), Side(0.05), seed)


def test_hits_are_credited_to_the_decisions_before_them():
    one, frames, learners = fights(), 400, np.arange(2 * PAIRS) < PAIRS
    tally = Tally.empty(trained().actions.action_count)
    watch_fights(one, frames, learners, tally)

    other = fights()
    events, decided, cells = [], [], []
    before = other.avatars.fight["decisions"].copy()
    for frame in range(frames):
        events.append(other.run(1).events)
        now = other.avatars.fight["decisions"]
        for i in np.flatnonzero(now != before):
            if other.avatars.fight["threat"][i] >= 0 and other.avatars.number[i] < PAIRS:
                decided.append((frame, other.avatars.number[i], other.avatars.motion["action"][i]))
                cells.append(other.avatars.fight["threat"][i])
        before = now.copy()
    taken, landed, count = (np.zeros_like(tally.count) for _ in range(3))
    horizon = round(HORIZON * other.rate)
    for (frame, who, action), cell in zip(decided, cells, strict=True):
        if frame >= frames - horizon:
            continue
        count[action, cell] += 1
        for later in range(1, horizon + 1):
            strikes = events[frame + later]
            for k in range(len(strikes.frame)):
                if strikes.outcome[k] not in (layout.LANDED, layout.BLOCKED):
                    continue
                worth = (1.0 if strikes.outcome[k] == layout.LANDED else BLOCKED) * DISCOUNT ** (later / other.rate)
                taken[action, cell] += worth * (strikes.victim[k] == who)
                landed[action, cell] += worth * (strikes.attacker[k] == who)
    assert count.sum() > 100
    assert taken.sum() > 0
    np.testing.assert_array_equal(tally.count, count)
    np.testing.assert_allclose(tally.taken, taken, atol=1e-9)
    np.testing.assert_allclose(tally.landed, landed, atol=1e-9)


def test_what_was_seldom_chosen_is_judged_by_what_is_usual():
    count = np.zeros((4, CELLS))
    hits = np.zeros((4, CELLS))
    count[0, :2], hits[0, :2] = 1e6, (2e5, 4e5)  # often: its own hits
    count[1, 0], hits[1, 0] = 1e6, 1e5  # twice as good as usual in one cell, never chosen in another
    count[2, 0], hits[2, 0] = 1.0, 1.0  # once, and hit at once
    table = expected_hits(hits, count)
    np.testing.assert_allclose(table[0, :2], (0.2, 0.4), rtol=1e-3)
    assert table[1, 0] == pytest.approx(0.1, rel=1e-3)
    assert table[1, 1] < 0.75 * table[0, 1]
    usual = hits.sum(axis=0) / np.maximum(count.sum(axis=0), 1)
    assert table[2, 0] == pytest.approx(usual[0], rel=0.25)
    assert np.allclose(table[3], usual, rtol=1e-3)


def test_defence_is_learned_to_the_same_bytes_and_kept_in_the_bundle(tmp_path):
    again = train_policy(recipe(defend=SPEC), "tiny", threads=2, spar=learn_defence)[0]
    one = trained()
    assert one.defence.tobytes() == again.defence.tobytes()
    assert one.defence.shape == (one.actions.choice_count, CELLS)
    assert len(np.unique(one.defence)) > 20
    bundle.write_bundle(tmp_path / "tiny", one, {})
    loaded = bundle.load_policy(tmp_path / "tiny")
    assert loaded.defence.tobytes() == one.defence.tobytes()
    assert loaded.learned == ["approach", "punch", "defend"]
    assert loaded.defence_weight == 1.0
    assert train_policy(recipe(), "tiny")[0].defence is None


def test_a_table_of_another_shape_is_refused_by_its_name(tmp_path):
    one = trained()
    bundle.write_bundle(tmp_path / "tiny", replace(one, defence=one.defence[:-1]), {})
    with pytest.raises(PolicyError, match=r"defence\.npy"):
        bundle.load_policy(tmp_path / "tiny")


def test_a_recipe_says_what_is_wrong_with_its_defence(tmp_path):
    text = TINY.read_text(encoding="utf-8")
    path = tmp_path / "one.yaml"
    for more, message in (
        ("weights: {punch: 1, defend: 1}\n", "defend.*is no behaviour"),
        ("defend: {rounds: 0}\n", "rounds"),
        ("defend: {pairs: 1000}\n", "pairs"),
        ("weights: {punch: 1, defent: 1}\ndefend: {}\n", "did you mean 'defend'"),
    ):
        path.write_text(text + more, encoding="utf-8")
        with pytest.raises(RecipeError, match=message):
            load_recipe(path)
    path.write_text(text.replace("  punch:\n", "  defend:\n"), encoding="utf-8")
    with pytest.raises(RecipeError, match="section 'defend'"):
        load_recipe(path)


def test_defence_is_not_left_out_where_nobody_can_fight():
    with pytest.raises(PolicyError, match="learned in fights"):
        train_policy(recipe(defend=SPEC), "tiny")


def test_the_best_response_reports_its_gain_over_the_policy_itself():
    spec = DefenceSpec(rounds=1, seconds=20, pairs=6)
    found = best_response(trained(), 0.05, spec, weights=(0.5,))
    assert found == best_response(trained(), 0.05, spec, weights=(0.5,))
    assert found["weight"] == 0.5
    assert found["landed"] >= 0
    assert np.isfinite(found["gain"])
