"""Scenarios and policies are found by path, in the working folder, or where the package ships them."""

import os
from pathlib import Path

import pytest

from crowdsim import assets
from crowdsim.errors import PolicyError, RecipeError, ScenarioError

ROOT = Path(assets.__file__).parents[1]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for kind in ("scenarios", "policies"):
        (tmp_path / kind).mkdir()
    monkeypatch.setattr(assets, "_cache", lambda: tmp_path / "cache")
    return tmp_path


def bundle(path: Path) -> Path:
    path.mkdir(parents=True)
    (path / "policy.json").write_text("{}")
    return path


def test_a_path_wins_over_a_name(folder):
    (folder / "brawl_30").write_text("")
    assert assets.find_scenario("brawl_30") == Path("brawl_30")


def test_the_working_folder_wins_over_what_ships(folder):
    (folder / "scenarios/brawl_30.yaml").write_text("")
    assert assets.find_scenario("brawl_30") == folder / "scenarios/brawl_30.yaml"


@pytest.mark.parametrize("name", ["brawl_30", "brawl_30.yaml", "scenarios/brawl_30.yaml"])
def test_what_ships_is_found_from_any_folder(folder, name):
    assert assets.find_scenario(name) == ROOT / "scenarios/brawl_30.yaml"


def test_a_folder_beside_the_modules_of_a_wheel_wins_over_one_beside_the_package(folder, monkeypatch):
    wheel = folder / "site/crowdsim"
    (wheel / "scenarios").mkdir(parents=True)
    (wheel / "scenarios/wheel.yaml").write_text("")
    (folder / "site/scenarios").mkdir()
    monkeypatch.setattr(assets, "__file__", str(wheel / "assets.py"))
    assert assets.folders("scenarios") == [folder / "scenarios", wheel / "scenarios"]
    assert assets.find_scenario("wheel") == wheel / "scenarios/wheel.yaml"


def test_what_is_not_found_names_what_there_is(folder, monkeypatch):
    monkeypatch.setattr(assets, "folders", lambda kind: [folder / kind])
    with pytest.raises(ScenarioError) as caught:
        assets.find_scenario("brawl")
    assert str(caught.value) == "brawl: no such scenario, and there are no scenarios to choose from"
    for name in ("brawl_2", "duel"):
        (folder / f"scenarios/{name}.yaml").write_text("")
    with pytest.raises(ScenarioError) as caught:
        assets.find_scenario("brawl")
    assert str(caught.value) == (
        "brawl: no such scenario, expected a file or one of brawl_2, duel (did you mean 'brawl_2'?)"
    )
    with pytest.raises(ScenarioError, match=r"^other/duel\.yaml: no such scenario, expected"):
        assets.find_scenario("other/duel.yaml")
    with pytest.raises(ScenarioError, match=r"^scenarios: is a folder, expected a scenario$"):
        assets.find_scenario("scenarios")
    with pytest.raises(RecipeError, match=r"^boxer: no such recipe"):
        assets.find_recipe("boxer")


def test_policies_are_recipes_and_bundles_without_one(folder, monkeypatch):
    monkeypatch.setattr(assets, "folders", lambda kind: [folder / kind])
    (folder / "policies/boxer.yaml").write_text("")
    bundle(folder / "policies/guest")
    (folder / "policies/empty").mkdir()
    assert assets.policy_names() == ["boxer", "guest"]
    assert assets.find_bundle("guest") == folder / "policies/guest"
    with pytest.raises(PolicyError, match=r"boxer\.yaml: is not trained yet, expected .*; run: crowdsim train "):
        assets.find_bundle("boxer")
    with pytest.raises(PolicyError) as caught:
        assets.find_bundle("boxr")
    assert str(caught.value) == ("boxr: no such policy, expected a file or one of boxer, guest (did you mean 'boxer'?)")
    trained = bundle(folder / "policies/boxer")
    assert assets.find_bundle("boxer") == assets.find_bundle("policies/boxer.yaml").resolve() == trained


def test_a_bundle_lies_beside_its_recipe_or_in_the_cache_when_that_is_read_only(folder, monkeypatch):
    recipe = folder / "policies/boxer.yaml"
    recipe.write_text("")
    assert assets.bundle_folder(recipe) == folder / "policies/boxer"
    shipped = bundle(folder / "policies/boxer")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert assets.bundle_folder(recipe) == folder / "cache/boxer"
    assert assets.find_bundle("boxer") == shipped
    cached = bundle(folder / "cache/boxer")
    assert assets.find_bundle("boxer") == cached
