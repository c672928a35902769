"""Training says what is wrong with capture, uses no clip that fails, and lets a recipe overrule that."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim

from crowdsim.bvh.io import from_clip, write_bvh
from crowdsim.errors import MotionError, RecipeError
from crowdsim.performer.session import perform
from crowdsim.training.motion_loading import load_motion
from crowdsim.training.recipe import Recipe
from crowdsim.training.survey import survey_capture

ROOT = Path(__file__).parents[2]
FILES = {
    "held.bvh": "root held for 5 frames",
    "left.bvh": "left-handed",
    "still.bvh": "root does not travel",
    "lost.bvh": "root at the origin for 6 frames",
}


class Notes:
    """Progress that keeps what it is to show."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show nothing."""

    def note(self, text: str) -> None:
        """Keep a line."""
        self.lines.append(text)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        made = importlib.import_module("_capture_faults")
    found = tmp_path_factory.mktemp("capture")
    clip = from_clip(perform(10.0, 1)[0].clip.sliced(60, 540))
    write_bvh(found / "clean.bvh", clip)
    for name, fault in FILES.items():
        write_bvh(found / name, made.FAULTS[fault][1](clip))
    return found


def recipe(clips: list[str], **capture) -> Recipe:
    axes = {"distance": {"count": 8}, "bearing": {"count": 8}, "height": {"count": 2}}
    return Recipe.model_validate(
        {
            "version": 1,
            "motion": {"capture": {"clips": clips, **capture}},
            "behaviours": {"fight": {"axes": axes, "rewards": [{"kind": "strike"}]}},
        }
    )


def test_a_survey_uses_what_is_repaired_and_leaves_out_what_is_refused(folder):
    survey = survey_capture(folder)
    assert [file.name for file in survey.used] == ["clean.bvh", "held.bvh", "left.bvh", "lost.bvh"]
    (left_out,) = survey.left_out
    assert left_out.name == "still.bvh"
    assert "in_place: the body moves in place: its feet slide at " in left_out.reason
    assert left_out.reason.endswith("says repair (its path follows the feet that bear it) or keep")


def test_train_prints_what_it_found_in_the_files_that_it_uses_and_in_those_that_it_does_not(
    folder, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("crowdsim.graph.motion_graph.build_graph", _stop)
    assert crowdsim("train", "--mocap", folder, "--name", "me") == 1
    printed = capsys.readouterr().err
    assert f"{folder}/still.bvh: left out: line 1, column 1: in_place: the body moves in place" in printed
    assert f"{folder}/left.bvh:1:1: handedness: coordinates are left-handed" in printed
    assert f"{folder}/lost.bvh:1:1: root_jumps: the root is elsewhere" in printed
    assert "clean.bvh:1:1" not in printed
    assert printed.count("handedness: ") == 1


def _stop(*_):
    raise MotionError("not this far")


def test_a_recipes_files_are_read_repaired_divided_and_noted(folder):
    names = ["clean.bvh", "held.bvh", "left.bvh", "lost.bvh"]
    notes = Notes()
    database = load_motion(recipe(names), [folder / name for name in names], notes)
    assert [line.partition(": ")[0] for line in notes.lines] == [f"{folder}/{name}:1:1" for name in names[1:]]
    names_of_clips = list(database.clip_names)[:5]
    assert names_of_clips[:3] == ["clean", "held", "left"]
    assert [name.partition("@")[0] for name in names_of_clips[3:]] == ["lost", "lost"]
    steps = np.linalg.norm(np.diff(database.heads[:, [0, 2]], axis=0), axis=1)
    inside = np.ones(len(steps), bool)
    inside[np.asarray(database.clip_starts[1:-1]) * database.stride - 1] = False
    assert steps[inside].max() < 0.2


def test_a_recipe_refuses_a_file_that_fails_and_may_overrule_that(folder):
    with pytest.raises(MotionError, match=r"still\.bvh:1:1: in_place: the body moves in place"):
        load_motion(recipe(["still.bvh"]), [folder / "still.bvh"])
    kept = load_motion(recipe(["still.bvh"], faults={"in_place": "keep"}), [folder / "still.bvh"])
    repaired = load_motion(recipe(["still.bvh"], faults={"in_place": "repair"}), [folder / "still.bvh"])
    assert kept.frame_count == repaired.frame_count
    assert np.ptp(repaired.heads[:, 2]) > np.ptp(kept.heads[:, 2])


@pytest.mark.parametrize(
    ("faults", "message"),
    [
        ({"in_plce": "keep"}, "fault 'in_plce' is unknown"),
        ({"tilt": "mend"}, "repair"),
        ({"tilt": 60}, "fault 'tilt': 60"),
        ({"time_base": 0.5}, "or 1 to 2000 frames a second"),
    ],
)
def test_a_recipe_with_an_unknown_fault_is_refused(tmp_path, faults, message):
    import yaml

    from crowdsim.training.recipe import load_recipe, plain

    document = plain(recipe(["a.bvh"]))
    document["motion"]["capture"]["faults"] = faults
    (tmp_path / "me.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(RecipeError, match=r"motion\.capture\.faults") as error:
        load_recipe(tmp_path / "me.yaml")
    assert message in str(error.value)
