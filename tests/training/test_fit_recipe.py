"""The recipe that is written for a folder of capture."""

import errno
import os
from dataclasses import replace
from pathlib import Path

import pytest

from crowdsim.errors import MotionError, OutputError, RecipeError
from crowdsim.training import fit_recipe
from crowdsim.training.fit_recipe import BEHAVIOURS, recipe_text, write_recipe
from crowdsim.training.no_strikes_report import Fists
from crowdsim.training.recipe import Recipe, load_recipe
from crowdsim.training.survey import Survey, SurveyedFile

SHIPPED = Path(__file__).parents[2] / "policies"


def survey_of(folder: Path, seconds: float = 200.0, strikes: tuple[int, ...] = (20, 30, 0, 0)) -> Survey:
    folder.mkdir(exist_ok=True)
    file = SurveyedFile("a/take [1]: #2.bvh", "", seconds, strikes, Fists("a.bvh", seconds, 2.6, 0.01, 1.75))
    return Survey(folder, (file,), (SurveyedFile("b\n.bvh", "a single frame, expected motion"),))


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(project: Path, survey: Survey, behaviours=BEHAVIOURS) -> Recipe:
    path = project / "policies" / "any.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(recipe_text(survey, behaviours, path.parent), encoding="utf-8")
    return load_recipe(path)


def test_a_recipe_names_its_files_and_has_the_behaviours_of_the_shipped_one(project):
    recipe = written(project, survey_of(project / "capture"))
    shipped = load_recipe(SHIPPED / "boxer_cmu.yaml")
    assert recipe.motion.capture.clips == ["a/take [1]: #2.bvh"]
    assert recipe.motion.capture.folder == str(project / "capture")
    for name in ("graph", "prune", "behaviours", "weights", "precision"):
        assert getattr(recipe, name) == getattr(shipped, name), name


def test_the_folder_is_seen_from_the_recipe_within_a_project_and_absolute_elsewhere(project, tmp_path_factory):
    place = project / "policies"
    assert "\n    folder: ../capture #" in recipe_text(survey_of(project / "capture"), BEHAVIOURS, place)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    assert f"\n    folder: {elsewhere} #" in recipe_text(survey_of(elsewhere), BEHAVIOURS, place)


def test_more_motion_has_fewer_decisions_and_grid_points(project):
    sizes = []
    for seconds in (60.0, 200.0, 800.0, 3000.0, 9000.0):
        recipe = written(project, survey_of(project / "capture", seconds))
        fight, punch = recipe.behaviours["fight"].axes, recipe.behaviours["punch"].axes
        counts = [axes.distance.count * axes.bearing.count * axes.height.count for axes in (fight, punch)]
        sizes.append((recipe.graph.threshold, recipe.prune.spacing, *counts, recipe.motion.mirror))
    assert sizes == [
        (0.3, 0.33, 64 * 72 * 5, 40 * 80 * 5, True),
        (0.25, 0.33, 64 * 72 * 5, 40 * 80 * 5, True),
        (0.25, 0.55, 64 * 72 * 4, 36 * 72 * 4, True),
        (0.25, 0.66, 40 * 36 * 3, 24 * 36 * 3, True),
        (0.25, 0.66, 40 * 36 * 3, 24 * 36 * 3, False),
    ]
    one_handed = written(project, survey_of(project / "capture", 9000.0, (0, 50, 0, 0)))
    assert one_handed.motion.mirror


def test_motion_without_strikes_needs_a_behaviour_without_strikes(project):
    survey = survey_of(project / "capture", strikes=(0, 0, 0, 0))
    with pytest.raises(MotionError, match=r"(?s)need strikes, and there are none in 1 file.*--behaviours approach$"):
        recipe_text(survey, BEHAVIOURS, project)
    recipe = written(project, survey, ["approach"])
    assert list(recipe.behaviours) == ["approach"]
    assert recipe.weights is None
    spec = recipe.behaviours["approach"]
    assert not spec.strikes
    assert spec.measured_by_strikes == []


def test_behaviours_are_chosen_by_name(project):
    survey = survey_of(project / "capture")
    assert list(written(project, survey, ["fight", "approach"]).behaviours) == ["approach", "fight"]
    with pytest.raises(RecipeError, match="behaviour 'dance' is unknown, expected some of approach, punch, fight"):
        recipe_text(survey, ["dance"], project)


def test_a_recipe_is_written_once(project):
    survey = survey_of(project / "capture")
    assert write_recipe("me", survey) == Path("policies/me.yaml")
    before = (project / "policies/me.yaml").read_bytes()
    with pytest.raises(RecipeError) as error:
        write_recipe("me", survey)
    assert str(error.value) == (
        f"--name me: {project}/policies/me.yaml is there already and is not overwritten; "
        "train it as it is with: crowdsim train me; or choose another name"
    )
    with pytest.raises(RecipeError, match=r"--name boxer: .*boxer\.yaml is there already"):
        write_recipe("boxer", survey)
    for name in ("a/b", "", "2", "../up", "true", "a" * 65):
        with pytest.raises(RecipeError, match="expected at most 64 letters, digits, _ and -"):
            write_recipe(name, survey)
    (project / "policies/taken").mkdir()
    with pytest.raises(RecipeError, match="is there already and is no policy"):
        write_recipe("taken", replace(survey, left_out=()))
    assert (project / "policies/me.yaml").read_bytes() == before
    assert sorted(path.name for path in (project / "policies").iterdir()) == ["me.yaml", "taken"]


def test_capture_with_kicks_has_feet_that_strike(project):
    kicking = survey_of(project / "capture", strikes=(3, 4, 0, 2))
    recipe = written(project, kicking)
    assert recipe.strikes.numbers() == (0, 1, 2, 3)
    assert "9 strikes: 3 left hand, 4 right hand, 2 right foot." in (project / "policies" / "any.yaml").read_text()
    assert written(project, survey_of(project / "capture")).strikes.numbers() == (0, 1)


def test_few_ways_to_strikes_make_strikes_worth_more(project):
    usual = written(project, survey_of(project / "capture"))
    for scarce in (
        survey_of(project / "capture", 59.0),
        survey_of(project / "capture", 200.0, (2, 2, 20, 20)),
    ):
        recipe = written(project, scarce)
        fight = recipe.behaviours["fight"]
        assert [term.weight for term in fight.rewards] == [80.0, 7.0, 0.6, 5.0, 4.0]
        assert (fight.rewards[-1].each, fight.discount, fight.finer) == (1.2, 0.98, 2)
        assert (recipe.prune.transitions, recipe.prune.landing) == (16, 0.07)
        assert recipe.behaviours["punch"] == usual.behaviours["punch"]
    mixed = written(project, survey_of(project / "capture", 200.0, (20, 20, 20, 20)))
    assert mixed.behaviours["fight"] == usual.behaviours["fight"]


def test_a_recipe_that_cannot_be_written_leaves_no_file(tmp_path, monkeypatch):
    def full(source, target):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fit_recipe, "recipe_text", lambda *_: "version: 1\n")
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(OutputError, match=r"policies/me\.yaml: cannot be written: No space left") as error:
            fit_recipe.write_recipe("me", None, ())
    assert error.value.exit_code == 1
    assert list((tmp_path / "policies").iterdir()) == []
    assert fit_recipe.write_recipe("me", None, ()).read_text() == "version: 1\n"
