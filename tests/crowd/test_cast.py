"""What a scenario makes of avatars: weights of behaviours, tempo, and what events change of them."""

import re
from dataclasses import replace

import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim import assets
from crowdsim.crowd.draw import draw_crowd
from crowdsim.preparation.prepare import table_type_of
from crowdsim.scenario.scenario import load_scenario

SCENARIO = """\
version: 1
name: pair
seed: 1
duration: 30
types:
  boxer: {{policy: boxer{type}}}
groups:
  - {{name: pair, type: boxer, count: 2, placement: {{kind: line, start: [-1, 0], end: [1, 0]}}}}
opponents: {{kind: anyone}}
events: [{event}]
"""
EVENT = "{{kind: weights, when: {{kind: frame, frame: 5}}, {}}}"


def drawn(tmp_path, recipe=None, result="", event=""):
    """The crowd of a scenario whose one type says this of itself."""
    path = tmp_path / "pair.yaml"
    path.write_text(SCENARIO.format(type=result, event=event))
    scenario = load_scenario(path)
    one = replace(policy(0, name="boxer"), recipe={} if recipe is None else {"weights": recipe})
    return draw_crowd(scenario, [one])


@pytest.mark.parametrize(
    ("recipe", "result", "expected"),
    [
        (None, "", [1.0, 1.0]),
        ({"punch": 0.4}, "", [0.0, 0.4]),
        ({"approach": 2.0, "punch": 0.4}, "", [2.0, 0.4]),
        ({"approach": 2.0, "punch": 0.4}, ", behaviours: {punch: 3}", [0.0, 3.0]),
        (None, ", behaviours: {approach: 0.7}", [0.7, 0.0]),
        ({"punch": 0.4}, ", behaviours: {approach: 0.7, punch: 0}", [0.7, 0.0]),
    ],
)
def test_weights_default_to_zero_or_to_those_of_the_recipe_where_a_type_names_none(tmp_path, recipe, result, expected):
    people = drawn(tmp_path, recipe, result)
    np.testing.assert_array_equal(people.weights, [expected])


def test_an_event_leaves_weights_that_it_does_not_name_as_they_are(tmp_path):
    for event, expected in (
        ("behaviours: {punch: 3}", [np.nan, 3.0]),
        ("temperature: 0.5", [np.nan, np.nan]),
        ("behaviours: {approach: 0}, temperature: 0.5", [0.0, np.nan]),
    ):
        people = drawn(tmp_path, {"approach": 2.0}, ", behaviours: {approach: 1}", EVENT.format(event))
        np.testing.assert_array_equal(people.changes[0].weights, [expected])


@pytest.mark.parametrize(
    ("result", "interval"),
    [
        ("", 15.0), (", tempo: 30", 30.0), (", tempo: null", 0.0),
        (", tempo: {kind: uniform, minimum: 20, maximum: 40}", 30.0),
        (", tempo: {kind: normal, mean: 90, deviation: 10}", 10.0),
    ],
)  # fmt: skip
def test_tempo_sets_the_frames_of_recovery_after_a_strike(tmp_path, result, interval):
    assert policy(0).database.control_rate == 15.0
    people = drawn(tmp_path, result=result)
    np.testing.assert_array_equal(people.intervals, [interval])


@pytest.mark.parametrize(
    ("result", "expected"),
    [
        (", aggression: 4", (1.0, 2.0, 0.0)),
        (", aggression: 0.25, range: 0.5, tempo: 10", (1.0, -2.0, 0.5)),
        (", tempo: null, aggression: 0.5", (1.0, -1.0, 0.0)),
        (", range: -0.3", (1.0, 0.0, -0.3)),
        (", tempo: {kind: normal, mean: 30, deviation: 0}, range: {kind: uniform, minimum: 0.1, maximum: 0.1}",
         (1.0, 0.0, 0.1)),
    ],
)  # fmt: skip
def test_a_type_makes_the_temperaments_of_its_avatars(tmp_path, result, expected):
    people = drawn(tmp_path, result=result)
    assert people.conditioned
    np.testing.assert_allclose(people.temperaments, [expected] * 2)


@pytest.mark.parametrize("result", ["", ", tempo: 20", ", tempo: null", ", aggression: 1, range: 0"])
def test_without_a_temperament_there_is_no_row_of_conditions(tmp_path, result):
    people = drawn(tmp_path, result=result)
    assert not people.conditioned
    assert people.temperaments.shape == (0, 3)


@pytest.mark.parametrize(
    ("precisions", "expected"),
    [
        (["int8"], "uint8"),
        (["int16"], "uint16"),
        (["float16"], "float32"),
        (["int8", "int8"], "uint8"),
        (["int8", "int16"], "float32"),
        (["float16", "float32"], "float32"),
    ],
)
def test_the_type_of_tables_follows_from_the_recipes_of_a_run(tmp_path, monkeypatch, precisions, expected):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "policies").mkdir()
    shipped = assets.find_recipe("boxer").read_text(encoding="utf-8")
    names = [f"own_{number}" for number in range(len(precisions))]
    for name, precision in zip(names, precisions, strict=True):
        changed = re.sub(r"(?m)^precision: .*$", f"precision: {precision}", shipped)
        assert changed != shipped or precision == "int16"
        (tmp_path / "policies" / f"{name}.yaml").write_text(changed, encoding="utf-8")
    assert table_type_of(names) == expected
