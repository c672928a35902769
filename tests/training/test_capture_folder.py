"""Where capture is looked for: the given folder, the recipe's, that of the environment; and that it may be anywhere."""

from pathlib import Path

import pytest

from crowdsim.errors import PolicyError
from crowdsim.training.fingerprint import capture_files, capture_folder, fingerprints_of
from crowdsim.training.recipe import Recipe, load_recipe, plain

RECIPE = """\
version: 1
motion:
  capture:
    folder: ../clips
    clips:
      - a.bvh
behaviours:
  approach:
    axes:
      distance: {count: 4, maximum: 4}
    rewards:
      - {kind: proximity, distance: 1}
"""


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    for name in ("clips", "given", "everybody", "policies"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.bvh").write_text(name)
    (tmp_path / "policies/own.yaml").write_text(RECIPE)
    (tmp_path / "policies/none.yaml").write_text(RECIPE.replace("    folder: ../clips\n", ""))
    monkeypatch.setenv("CROWDSIM_MOCAP", str(tmp_path / "everybody"))
    return tmp_path


def test_the_given_folder_goes_before_the_recipes_and_that_before_the_environments(project):
    own, none = load_recipe(project / "policies/own.yaml"), load_recipe(project / "policies/none.yaml")
    assert capture_folder(own, project / "given") == capture_folder(none, project / "given") == project / "given"
    assert capture_folder(own) == project / "clips"
    assert capture_folder(none) == project / "everybody"
    assert [path.read_text() for path in capture_files(own)] == ["clips"]


def test_a_recipes_folder_is_found_from_any_working_folder(project, monkeypatch):
    monkeypatch.chdir(project / "given")
    assert capture_folder(load_recipe("../policies/own.yaml")).resolve() == project / "clips"


def test_a_folder_that_is_missing_is_named(project, monkeypatch):
    recipe = load_recipe(project / "policies/own.yaml")
    (project / "clips").rename(project / "moved")
    with pytest.raises(PolicyError) as error:
        capture_folder(recipe)
    assert str(error.value) == (
        f"motion.capture.folder: {project}/clips: no such folder; change it, or give --mocap DIR"
    )
    assert capture_folder(recipe, project / "moved") == project / "moved"


def test_where_capture_is_changes_no_fingerprint_and_is_in_no_bundle(project):
    own, none = load_recipe(project / "policies/own.yaml"), load_recipe(project / "policies/none.yaml")
    assert plain(own) == plain(none)
    assert Recipe.model_validate(plain(own)) == none
    assert fingerprints_of(own, None) == fingerprints_of(none, None)


def test_names_are_taken_literally_before_they_are_patterns(project):
    (project / "clips/take [1].bvh").write_text("one")
    (project / "policies/odd.yaml").write_text(RECIPE.replace("- a.bvh", "- 'take [1].bvh'\n      - '*.bvh'"))
    found = capture_files(load_recipe(project / "policies/odd.yaml"))
    assert [path.name for path in found] == ["take [1].bvh", "a.bvh"]


def test_a_recipe_may_name_one_of_several_people_in_a_file(project):
    recipe = project / "policies/own.yaml"
    recipe.write_text(RECIPE.replace("- a.bvh", "- a.bvh#2"))
    loaded = load_recipe(recipe)
    found = capture_files(loaded)
    assert [path.name for path in found] == ["a.bvh#2"]
    prints = fingerprints_of(loaded, found)["capture"]
    (project / "clips/a.bvh").write_text("changed")
    assert fingerprints_of(loaded, found)["capture"] != prints


def test_one_of_several_people_is_not_read_again_where_the_whole_file_is(project):
    recipe = project / "policies/own.yaml"
    recipe.write_text(RECIPE.replace("- a.bvh", "- a.bvh#2\n      - a.bvh"))
    assert [path.name for path in capture_files(load_recipe(recipe))] == ["a.bvh"]
