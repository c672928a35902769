"""Recipes: what they default to, and every mistake with its line, its column and what was expected."""

import contextlib
import json
from pathlib import Path

import pytest

from crowdsim.cli import main
from crowdsim.errors import RecipeError
from crowdsim.policy.axes.registry import NAMES
from crowdsim.policy.rewards import TERMS
from crowdsim.policy.terms.registry import names
from crowdsim.training.recipe import Axes, load_recipe, recipe_reference, recipe_schema

RECIPE = """\
version: 1
motion:
  performer:
    seconds: 60
behaviours:
  punch:
    axes:
      distance:
        count: 8
      bearing:
        count: 12
    rewards:
      - kind: strike
        tolerance: 0.1
"""

POLICIES = Path(__file__).parents[2] / "policies"


def faults(tmp_path, text):
    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(RecipeError) as error:
        load_recipe(path)
    return str(error.value).replace(f"{path}:", "").splitlines()


def changed(old, new):
    assert old in RECIPE
    return RECIPE.replace(old, new)


@pytest.mark.parametrize("name", ["boxer", "boxer_cmu", "boxer_crowd"])
def test_every_shipped_recipe_is_valid_and_learns_to_fight_beside_both_behaviours(name):
    recipe = load_recipe(POLICIES / f"{name}.yaml")
    assert list(recipe.behaviours) == ["approach", "punch", "fight"]
    assert recipe.weights == {"fight": 1.0}


def test_the_papers_recipe_has_the_papers_grids_its_table_and_its_method():
    recipe = load_recipe(POLICIES / "boxer_paper.yaml")
    behaviours = recipe.behaviours.values()
    shapes = {
        name: tuple(axis.count for axis in spec.axes.given().values()) for name, spec in recipe.behaviours.items()
    }
    assert shapes == {"approach": (5, 13), "punch": (10, 10, 4)}
    assert all(axis.reach for axis in recipe.behaviours["punch"].axes.given().values())
    assert {spec.lookup for spec in behaviours} == {"q"}
    assert {spec.backup for spec in behaviours} == {"max_of_interpolated"}
    assert {spec.solver.kind for spec in behaviours} == {"q_learning"}
    assert {spec.discount for spec in behaviours} == {0.97}
    assert {term.form for spec in behaviours for term in spec.rewards} == {"max"}
    assert all(spec.target.speed > 0.0 and spec.target.still == 0.0 for spec in behaviours)
    assert not any(spec.normalise for spec in behaviours)
    assert (recipe.graph.actions, recipe.prune, recipe.motion.mirror) == (27072, None, False)
    assert (recipe.control_rate, recipe.playback_rate) == (15.0, 15.0)
    assert recipe.weights == {"approach": 1.0, "punch": 1.0}


def test_a_short_recipe_gets_the_defaults(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(RECIPE)
    recipe = load_recipe(path)
    punch = recipe.behaviours["punch"]
    assert (recipe.control_rate, recipe.playback_rate, recipe.precision) == (15.0, 60.0, "float32")
    assert (punch.discount, punch.lookup, punch.backup) == (0.97, "v", "interpolation_of_max")
    assert punch.solver.kind == "value_iteration"
    assert recipe.motion.mirror


def test_limbs_that_strike_are_named_in_pairs_or_one_by_one(tmp_path):
    path = tmp_path / "r.yaml"
    for text, expected in (
        ("", (0, 1)),
        ("strikes: {}\n", (0, 1)),
        ("strikes: {limbs: [hands, feet]}\n", (0, 1, 2, 3)),
        ("strikes: {limbs: [right_foot, left_hand]}\n", (0, 3)),
        ("strikes: {limbs: [feet, left_foot]}\n", (2, 3)),
    ):
        path.write_text(RECIPE + text)
        assert load_recipe(path).strikes.numbers() == expected
    assert "strikes.limbs" in faults(tmp_path, RECIPE + "strikes: {limbs: []}\n")[0]
    assert "strikes.limbs[0]: is 'foot'" in faults(tmp_path, RECIPE + "strikes: {limbs: [foot]}\n")[0]


def test_every_axis_and_every_reward_can_be_written_in_a_recipe():
    assert set(Axes.model_fields) == set(NAMES)
    assert [term.model_fields["kind"].annotation.__args__[0] for term in TERMS] == names()


def with_axis(name, keys):
    """The recipe with one more axis."""
    return changed("      bearing:", f"      {name}: {{{keys}}}\n      bearing:")


HEADING = "      bearing:", "      heading: {count: 6}\n      bearing:"


@pytest.mark.parametrize(
    ("recipe", "finding"),
    [
        (
            changed(*HEADING) + "    backup: max_of_interpolated\n",
            "axes.heading: changes with each action, which needs the backup interpolation_of_max, not max_",
        ),
        (
            changed(HEADING[0], HEADING[1].replace("6", "6, stretch: 2")),
            "expected even steps of a heading",
        ),
        (changed(HEADING[0], HEADING[1].replace("6", "6, reach: true")), "strikes reach no heading, expected false"),
        (
            with_axis("velocity", "count: 4") + "    backup: max_of_interpolated\n",
            "axes.velocity: changes with each action, which needs the backup interpolation_of_max, not",
        ),
        (
            with_axis("velocity", "count: 4, maximum: 30"),
            "axes.velocity.maximum: is 30, expected values from -10 to 10 m/s",
        ),
        (with_axis("velocity", "count: 4, minimum: 1, maximum: 0.5"), "is 0.5, expected more than the minimum 1"),
        (
            with_axis("velocity", "count: 1"),
            "axes.velocity.count: is 1, expected 2 or more, since one velocity is no range",
        ),
        (with_axis("impact", "count: 1, fade: 0.2"), "axes.impact.count: is 1, expected 2 or more"),
        (
            with_axis(
                "height", "count: 2}\n      heading: {count: 4}\n      velocity: {count: 2}\n      impact: {count: 2"
            ),
            "axes: are 6, distance, bearing, height, heading, velocity, impact, expected 5 at most",
        ),
        (with_axis("velocity", "count: 4, stretch: 1"), "expected even steps of a velocity"),
        (with_axis("impact", "count: 4"), "axes.impact: changes nothing, expected a reward 'hit' or a fade"),
        (with_axis("impact", "count: 4, reach: true"), "strikes reach no impact, expected false"),
        (
            with_axis("impact", "count: 4, minimum: -0.5"),
            "axes.impact.minimum: is -0.5, expected values from 0 to 10 s",
        ),
        (
            changed("kind: strike", "kind: hit").replace("        tolerance: 0.1\n", ""),
            "rewards[0]: (hit) needs the axis impact, the grid has distance, bearing",
        ),
    ],
)
def test_an_axis_that_cannot_be_learned_is_a_finding(tmp_path, recipe, finding):
    [line] = faults(tmp_path, recipe)
    assert finding in line


def test_an_unknown_axis_names_the_nearest_one(tmp_path):
    [line] = faults(tmp_path, changed("      bearing:", "      baering:"))
    assert line.startswith("10:7: behaviours.punch.axes.baering: unknown key, expected ")
    assert line.endswith("(did you mean 'bearing'?)")


def test_an_unknown_reward_names_the_nearest_one(tmp_path):
    [line] = faults(tmp_path, changed("kind: strike", "kind: strik"))
    assert line.startswith("13:15: behaviours.punch.rewards[0].kind: is 'strik', expected ")
    assert line.endswith("(did you mean 'strike'?)")


def test_an_unknown_key_of_a_reward_names_the_nearest_one(tmp_path):
    [line] = faults(tmp_path, changed("tolerance: 0.1", "tolerence: 0.1"))
    assert line.startswith("14:9: behaviours.punch.rewards[0].tolerence: unknown key, expected ")
    assert line.endswith("(did you mean 'tolerance'?)")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "    seconds: 60\n",
            "    seconds: 60\n  capture:\n    clips: [a.bvh]\n",
            "3:3: motion: names both performer and capture, expected one",
        ),
        (
            "  performer:\n    seconds: 60\n",
            "  mirror: true\n",
            "3:3: motion: names no motion, expected performer or capture",
        ),
        (
            "behaviours:",
            "playback_rate: 50\nbehaviours:",
            "5:1: playback_rate: is 50, expected a whole multiple of the control rate 15",
        ),
        (
            "        count: 8\n",
            "        count: 8\n        minimum: 2\n        maximum: 1\n",
            "11:9: behaviours.punch.axes.distance.maximum: is 1, expected more than the minimum 2",
        ),
        (
            "    rewards:",
            "    solver:\n      kind: q_learning\n    rewards:",
            "7:5: behaviours.punch.backup: is interpolation_of_max, expected max_of_interpolated with q_learning",
        ),
    ],
)
def test_what_does_not_go_together_is_reported_with_its_position(tmp_path, old, new, message):
    [line] = faults(tmp_path, changed(old, new))
    place, rest = message.split(": ", 1)
    assert line.split(": ", 1)[1] == rest
    assert line.split(":")[0] == place.split(":")[0]


def test_a_range_that_is_too_wide_is_reported(tmp_path):
    [line] = faults(tmp_path, changed("tolerance: 0.1", "tolerance: -0.1"))
    assert line.startswith("14:20: behaviours.punch.rewards[0].tolerance: is -0.1, expected ")


def test_default_weights_are_those_of_behaviours_that_the_recipe_learns(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(RECIPE + "weights:\n  punch: 0.5\n")
    assert load_recipe(path).weights == {"punch": 0.5}
    path.write_text(RECIPE)
    assert load_recipe(path).weights is None


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("  pumch: 1\n", "16:10: weights.pumch: is no behaviour of the recipe (did you mean 'punch'?)"),
        ("  punch: 1\n  fight: 2\n", "17:10: weights.fight: is no behaviour of the recipe"),
        ("  punch: -1\n", "16:10: weights.punch: is -1, expected a number from 0.0 to 1000.0"),
    ],
)
def test_a_weight_of_what_is_not_learned_is_reported_with_its_line(tmp_path, lines, expected):
    assert faults(tmp_path, RECIPE + "weights:\n" + lines) == [expected]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "        count: 12\n",
            "        count: 12\n        stretch: 1\n",
            "is stretched, expected even steps of a bearing",
        ),
        ("        count: 8\n", "        count: 8\n        stretch: 0\n", "is 0, expected a number above 0"),
        (
            "      - kind: strike\n",
            "      - kind: proximity\n        distance: [0.9, 0.4]\n      - kind: strike\n",
            "is [0.9, 0.4], expected the nearer distance first",
        ),
    ],
)
def test_an_impossible_stretch_or_band_is_reported(tmp_path, old, new, message):
    [line] = faults(tmp_path, changed(old, new))
    assert line.split(": ", 2)[2].startswith(message)


def test_the_committed_reference_page_of_recipes_is_current():
    page = (Path(__file__).parents[2] / "docs/recipes.md").read_text(encoding="utf-8")
    assert page == recipe_reference()


def test_every_key_of_the_recipe_schema_has_a_meaning():
    schema = json.loads(recipe_schema())
    for name, part in {"Recipe": schema, **schema["$defs"]}.items():
        for key, value in part["properties"].items():
            assert value.get("description") or "$ref" in value or "const" in value, f"{name}.{key}"


def test_the_command_prints_the_schema_of_recipes(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["crowdsim", "schema", "recipe"])
    with contextlib.suppress(SystemExit):
        main()
    assert json.loads(capsys.readouterr().out) == json.loads(recipe_schema())


@pytest.mark.parametrize(
    ("strikes", "motion", "words"),
    [
        ("{limbs: [props]}", "", "strikes.limbs[0]: is asked for, but no hand holds one"),
        ("{limbs: [hands, left_prop]}", "", "strikes.limbs[1]: is asked for, but no hand holds one"),
        (
            "{limbs: [hands], props: [{hand: right, point: [0, 0, 1]}]}", ", mirror: false",
            "strikes.props[0]: strikes nothing; expected 'props' in strikes.limbs",
        ),
        (
            "{limbs: [props], props: [{hand: right, point: [0, 0, 1]}, {hand: right, point: [0, 0, 1]}]}", "",
            "strikes.props[1].hand: hold two for the right hand",
        ),
        (
            "{limbs: [props], props: [{hand: right, point: [0, 0, 1]}]}", "",
            "motion.mirror: is true, but strikes.props lie in one hand, expected false",
        ),
        (
            "{limbs: [hands]}", ", stick: one_hand",
            "motion.performer.stick: is one_hand, but strikes.props do not say where that is; expected there one prop, "
            "{hand: right, point: [-0.39, 0, 0.45]}",
        ),
    ],
)  # fmt: skip
def test_props_of_recipes_that_do_not_fit_are_found(tmp_path, strikes, motion, words):
    text = (Path(__file__).parents[1] / "tiny_policy.yaml").read_text(encoding="utf-8")
    mirror = ", mirror: false" in motion
    text = text.replace(
        "seed: 2}", "seed: 2" + ("" if mirror else motion) + "}" + ("\n  mirror: false" if mirror else "")
    )
    path = tmp_path / "held.yaml"
    path.write_text(text + f"strikes: {strikes}\n", encoding="utf-8")
    with pytest.raises(RecipeError) as caught:
        load_recipe(path)
    assert words in str(caught.value)
