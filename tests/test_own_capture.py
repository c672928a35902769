"""From a folder of BVH files to a run by the command line: recipe, training, summary, and messages of failure."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from scenes import crowdsim

from crowdsim.performer.session import write_performance
from crowdsim.take.figures_text import percent
from crowdsim.training import fit_recipe
from crowdsim.training.recipe import load_recipe


@pytest.fixture(scope="module", autouse=True)
def floats() -> Iterator[None]:
    """Let recipes be written for values in floats, as those of other tests: control is compiled for each type anew."""
    settings, blocks = fit_recipe._template()
    assert settings.count("precision: int16") == 1
    with pytest.MonkeyPatch.context() as patch:
        changed = settings.replace("precision: int16", "precision: float32")
        patch.setattr(fit_recipe, "_template", lambda: (changed, dict(blocks)))
        yield


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A working folder with capture in a layout of its own, of which the policy ``me`` has been trained."""
    folder = tmp_path_factory.mktemp("project")
    (folder / "capture/day 1").mkdir(parents=True)
    shutil.move(write_performance(folder / "written", 8.0, 3)[0], folder / "capture/day 1/Boxing.BVH")
    (folder / "capture/broken.bvh").write_text("Once upon a time\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.delenv("CROWDSIM_MOCAP", raising=False)
        assert crowdsim("train", "--mocap", "capture/", "--name", "me", "--threads", "1") == 0
    return folder


@pytest.fixture
def inside(project, monkeypatch) -> Path:
    monkeypatch.chdir(project)
    monkeypatch.delenv("CROWDSIM_MOCAP", raising=False)
    return project


def still_clip(path: Path) -> Path:
    """Write a file in which the embedded boxer stays in its first pose for two seconds."""
    source = write_performance(path.parent / "source", 4.0, 3)[0].read_bytes()
    head, _, motion = source.partition(b"Frames: 240")
    rows = motion.splitlines()[2:]
    path.write_bytes(head + b"Frames: 120\nFrame Time: 0.0166667\n" + b"\n".join(rows[:1] * 120) + b"\n")
    shutil.rmtree(path.parent / "source")
    return path


def test_any_layout_becomes_a_recipe_and_a_bundle(inside, capsys):
    recipe = load_recipe("policies/me.yaml")
    assert recipe.motion.capture.clips == ["day 1/Boxing.BVH"]
    assert (
        "# left out: broken.bvh: line 1, column 1: found 'Once', expected 'HIERARCHY'"
        in Path("policies/me.yaml").read_text()
    )
    assert (inside / "policies/me/policy.json").is_file()
    assert crowdsim("validate", "policies/me.yaml") == 0
    assert crowdsim("train", "me", "--json") == 0
    assert json.loads(capsys.readouterr().out.partition("nothing is wrong\n")[2])["trained"] is False


def test_a_changed_recipe_is_trained_again_from_its_own_folder(inside, tmp_path, capsys):
    text = Path("policies/me.yaml").read_text().replace("mirror: true", "mirror: false")
    text = re.sub(r"folder: \S+", f"folder: {inside}/capture", re.sub(r"\bcount: \d+", "count: 4", text))
    (tmp_path / "mine.yaml").write_text(text)
    assert crowdsim("train", tmp_path / "mine.yaml") == 0
    printed = capsys.readouterr().out
    assert f"{tmp_path}/mine: trained\n  motion      1 clip, 8.0 s, " in printed
    assert "mirror images" not in printed
    assert f"  next        crowdsim inspect {tmp_path}/mine.yaml\n    scenarios find policies by name: " in printed
    assert crowdsim("inspect", tmp_path / "mine.yaml") == 0


def test_names_that_are_taken_are_refused_before_anything_is_read(inside, capsys):
    before = Path("policies/me.yaml").read_bytes()
    assert crowdsim("train", "--mocap", "capture/", "--name", "me", "--force") == 2
    error = capsys.readouterr().err
    assert "me.yaml is there already and is not overwritten; train it as it is with: crowdsim train me; or " in error
    assert Path("policies/me.yaml").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "train: expected a recipe, or --mocap DIR and --name NAME for capture of your own"),
        (("me", "--name", "you"), "train me --name you: expected a recipe or --name, not both"),
        (("--name", "you"), "train --name you: expected a folder of capture by --mocap DIR or in CROWDSIM_MOCAP"),
        (("me", "--behaviours", "approach"), "train --behaviours: expected --name too; a recipe says itself what is"),
        (("--name", "you", "--mocap", "policies/me"), "policies/me: holds no BVH file, nor does a folder in it"),
    ],
)
def test_what_is_missing_is_named(inside, capsys, words, message):
    assert crowdsim("train", *words) == 2
    assert capsys.readouterr().err.startswith(message)
    assert not (inside / "policies/you.yaml").exists()


def test_files_that_are_left_out_are_noted_with_their_reason(inside, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("crowdsim.self_play.train.train_recipe", lambda *words: (inside / "policies/me", True))
    monkeypatch.chdir(tmp_path)
    assert crowdsim("train", "--mocap", inside / "capture", "--name", "again") == 0
    noted = capsys.readouterr().err
    assert f"{inside}/capture/broken.bvh: left out: line 1, column 1: found 'Once', expected 'HIERARCHY'\n" in noted
    assert re.search(r"policies/again\.yaml: written for 1 of 2 files, 8\.0 s with \d+ strikes\n", noted)


def test_training_ends_with_a_summary_whose_json_says_the_same(inside, capsys):
    assert crowdsim("train", "me") == 0
    text = capsys.readouterr().out
    assert crowdsim("train", "me", "--json") == 0
    summary = json.loads(capsys.readouterr().out)["summary"]
    strikes, reach = summary["strikes"], summary["reach"]
    assert strikes["count"] == sum(strikes["by_hand"].values()) == sum(strikes["by_kind"].values()) > 0
    lines = [
        "me: up to date",
        f"  motion      1 clip, 8.0 s, {summary['motion']['frames_kept'] / summary['motion']['frames']:.0%} of it used",
        f"  strikes     {strikes['count']}, {strikes['used_share']:.0%} used\n",
        "    by kind   " + ", ".join(f"{count} {kind}" for kind, count in strikes["by_kind"].items()),
        f"    by hand   {strikes['by_hand']['left']} left, {strikes['by_hand']['right']} right",
        f"    aimed at  {strikes['by_height']['head']} head, {strikes['by_height']['body']} body",
        f"  graph       {summary['states']:,} states, {summary['actions']:,} actions",
        "  reach       heads {:.2f} to {:.2f} m away; fists ".format(*reach["distance"]),
        f"  speed       follows a target at up to {summary['sustained_speed']:.1f} m/s",
        f"  fight       lands a strike within 6 s in {summary['success']['fight']['share']:.0%} of trials",
        "  duel        five one-minute duels with itself, mean",
        f"    turned away     {percent(summary['duel']['turned_away_share'])} of the time",
        "  weaknesses  ",
        "    little motion: 8 s, which soon repeats itself: add clips",
        f"  next        {summary['next']}",
    ]
    positions = [text.index(line) for line in lines]
    assert positions == sorted(positions)
    for weakness in summary["weaknesses"]:
        assert f"    {weakness['what']}: {weakness['advice']}\n" in text
    assert crowdsim("inspect", "me", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["weaknesses"] == summary["weaknesses"]
    assert report["duel"] == summary["duel"]
    assert report["behaviours"]["fight"]["success"] == summary["success"]["fight"]


def test_the_next_command_works_when_typed(inside, capsys):
    assert crowdsim("train", "me", "--json") == 0
    program, *words = shlex.split(json.loads(capsys.readouterr().out)["summary"]["next"])
    assert program == "crowdsim"
    assert crowdsim(*words, "--frames", "30") == 0
    assert "strikes         " in capsys.readouterr().out
    assert (inside / "output/duel_me/manifest.json").is_file()


def test_the_commands_of_the_guide_are_those_that_work(inside, capsys):
    guide = (Path(__file__).parents[1] / "docs/own_capture.md").read_text(encoding="utf-8")
    first, second, third = re.findall(r"^crowdsim .*$", guide, re.MULTILINE)
    assert first == "crowdsim train --mocap capture/ --name me"
    assert crowdsim("train", "me") == 0
    assert f"  next        {second}\n" in capsys.readouterr().out
    assert crowdsim(*shlex.split(second)[1:], "--frames", "30", "--force") == 0
    assert crowdsim(*shlex.split(third)[1:], "--size", "64x48", "--out", "seen") == 0
    assert (inside / "seen/contact_sheet.png").is_file()


def test_a_shipped_recipe_says_what_is_in_a_folder_of_another_layout(inside, capsys):
    assert crowdsim("train", "boxer_cmu", "--mocap", "capture/") == 2
    assert capsys.readouterr().err.partition("boxer_cmu.yaml: ")[2] == (
        "capture: holds nothing like 'fight_daz/*.bvh', 'locomotion_daz/*.bvh', named in motion.capture.clips; "
        "it holds 2 BVH files: broken.bvh, day 1/Boxing.BVH; "
        "to train on them in any layout: crowdsim train --mocap capture --name NAME\n"
    )


def test_capture_without_strikes_is_refused_in_the_figures_of_inspect(inside, tmp_path, capsys):
    still_clip(tmp_path / "still.bvh")
    assert crowdsim("inspect", tmp_path / "still.bvh", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["strikes"] == 0
    fists = f"{report['highest_fist_speed']:.1f} m/s in still.bvh ({report['seconds']:.2f} s)"
    assert crowdsim("train", "--mocap", tmp_path, "--name", "calm") == 2
    by_name = capsys.readouterr().err
    (tmp_path / "calm.yaml").write_text(
        re.sub(r"(?s)      - day 1.*?  mirror", "      - still.bvh\n  mirror", Path("policies/me.yaml").read_text())
    )
    assert crowdsim("train", tmp_path / "calm.yaml", "--mocap", tmp_path) == 2
    by_recipe = capsys.readouterr().err
    for error in (by_name, by_recipe):
        assert (
            f"strikes, and there are none in 1 file of {report['seconds']:.2f} s\n  fastest fists: {fists}; " in error
        )
        assert f"check the unit (found to be 0.01 m, which makes the body {report['height_m']:.2f} m tall)" in error
    assert by_name.endswith("or train without strikes, by: --behaviours approach\n")
    assert "leave punch and fight out of the recipe; give approach a distance in its proximity rewards" in by_recipe
    assert not (inside / "policies/calm.yaml").exists()


@pytest.mark.mocap
def test_real_walks_are_refused_in_the_figures_of_inspect(mocap, tmp_path, monkeypatch, capsys):
    names = ["cmu_02_02.bvh", "cmu_07_01.bvh"]
    (tmp_path / "walks").mkdir()
    for name in names:
        shutil.copy(mocap / "locomotion_daz" / name, tmp_path / "walks")
    monkeypatch.chdir(tmp_path)
    assert crowdsim("train", "--mocap", "walks", "--name", "walker") == 2
    error = capsys.readouterr().err
    for name in names:
        assert crowdsim("inspect", f"walks/{name}", "--json") == 0
        report = json.loads(capsys.readouterr().out)
        assert f"{report['highest_fist_speed']:.1f} m/s in {name} ({report['seconds']:.2f} s)" in error
    assert "2.64 s" in error


@pytest.mark.mocap
def test_real_walks_become_avatars_that_walk_to_their_targets(mocap, tmp_path, monkeypatch, capsys):
    (tmp_path / "walks").mkdir()
    for name in ("cmu_02_01.bvh", "cmu_02_02.bvh"):
        shutil.copy(mocap / "locomotion_daz" / name, tmp_path / "walks")
    monkeypatch.chdir(tmp_path)
    assert crowdsim("train", "--mocap", "walks", "--name", "walker", "--behaviours", "approach") == 0
    printed = capsys.readouterr().out
    assert "  strikes     0\n  graph" in printed
    assert "no strikes: avatars come to their targets and do no more" in printed
    program, *words = shlex.split(printed.rpartition("next")[2])
    assert program == "crowdsim"
    assert crowdsim(*words, "--frames", "30") == 0


def test_a_graph_that_cannot_be_built_leaves_the_recipe_to_be_changed(inside, tmp_path, monkeypatch, capsys):
    from crowdsim.errors import MotionError

    def fail(*words):
        raise MotionError("policies/odd.yaml: the graph has no cycle")

    monkeypatch.setattr("crowdsim.self_play.train.train_recipe", fail)
    monkeypatch.chdir(tmp_path)
    assert crowdsim("train", "--mocap", inside / "capture", "--name", "odd") == 1
    assert capsys.readouterr().err.endswith(
        "policies/odd.yaml: the graph has no cycle\n"
        "policies/odd.yaml is kept; change it and go on with: crowdsim train odd\n"
    )
    assert (tmp_path / "policies/odd.yaml").is_file()
