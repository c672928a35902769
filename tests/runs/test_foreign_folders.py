"""Run folders that a stranger has made, and files of the user in them: no command harms what others have written."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene
from test_runner import tree

from crowdsim.figures import new_figure
from crowdsim.runs.manifest import (
    EXPORT,
    MOST_BYTES,
    NAME,
    NOTE,
    OUTPUTS,
    RUN,
    STAGES,
    checksums,
    read_manifest,
    signed_manifest,
    signed_text,
)
from crowdsim.take import plots, quality

PICTURE = ("render", "run", "--png", "--size", "32x24", "--frames", "0:1", "--camera", "top")
COMMANDS = [
    ("verify", "run"),
    ("status", "run"),
    ("inspect", "run"),
    ("export", "run", "--bvh", "--frames", "0:3"),
    PICTURE,
    ("inspect", "run", "--plots", "run"),
    ("pack", "run", "-o", "packed.zip"),
    ("run", "four.yaml", "--out", "run"),
    ("run", "four.yaml", "--out", "run", "--extend", "5"),
    ("run", "four.yaml", "--out", "run", "--force"),
]


measure, MEASURED = quality.measure_take, list[dict]()


def measure_once(*words: object) -> dict:
    if not MEASURED:
        MEASURED.append(measure(*words))
    return dict(MEASURED[0])


@pytest.fixture
def place(workplace: Path, finish: Callable[..., None], monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a run, and beside it files of the user; plots are empty, and ``inspect`` measures motion once."""
    monkeypatch.setattr(quality, "measure_take", measure_once)
    for name in ("hit_figure", "distance_figure", "action_figure"):
        monkeypatch.setattr(plots, name, lambda _: new_figure(0.1, 0.1, None))
    write_scene(workplace / "four.yaml")
    finish(workplace)
    (workplace / "victim" / "bvh").mkdir(parents=True)
    for name in ("thesis.txt", "bvh/red_0.bvh", "manifest.json", "stage.json", "checkpoint.bin"):
        (workplace / "victim" / name).write_text("precious")
    return workplace


def note(stage: Path, **more: object) -> None:
    """Write the note of a stage, as anyone can."""
    (stage / NOTE).write_text(signed_text({"format": "crowdsim-stage", "key": "k", "boot": "b", **more}))


def forge(stage: Path, listed: dict[str, bytes], folder: Path) -> None:
    """Write a list of files into a stage, so that it seems to wait to be put in its place."""
    facts = {name: {"bytes": len(text), "sha256": hashlib.sha256(text).hexdigest()} for name, text in listed.items()}
    report = read_manifest(folder)
    (stage / NAME).write_text(signed_manifest({**report, "files": {**report["files"], **facts}}))
    note(stage)


def run_all(place: Path) -> None:
    """Run every command; each does its work or refuses."""
    for words in COMMANDS:
        assert crowdsim(*words) in (0, 1, 2), words


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_that_is_a_link_is_neither_emptied_nor_read(place: Path, stage: str) -> None:
    note(place / "victim")
    before = tree(place / "victim")
    (place / "run" / stage).symlink_to(place / "victim")
    run_all(place)
    assert tree(place / "victim") == before


@pytest.mark.parametrize("stage", STAGES)
def test_a_folder_of_the_user_with_the_name_of_a_stage_is_kept(place: Path, capsys, stage: str) -> None:
    shutil.copytree(place / "victim", place / "run" / stage, ignore=shutil.ignore_patterns(NOTE))
    before = tree(place / "run" / stage)
    run_all(place)
    assert tree(place / "run" / stage) == before
    assert f"{stage}: is in the way, and no command of crowdsim has made it; move it" in capsys.readouterr().err


def test_former_names_of_stages_are_no_ones_but_the_users(place: Path) -> None:
    for name in (".extension", ".export-0123456789abcdef", "take.zarr.partial", ".video-0123456789abcdef"):
        shutil.copytree(place / "victim", place / "run" / name)
    before = {name: text for name, text in tree(place / "run").items() if "thesis" in name or "red_0" in name}
    run_all(place)
    assert {name: text for name, text in tree(place / "run").items() if name in before} == before


@pytest.mark.parametrize("stage", [RUN, EXPORT])
def test_files_outside_are_not_moved_through_links_in_a_stage(place: Path, stage: str) -> None:
    before = tree(place / "victim")
    folder = place / "run" / stage
    folder.mkdir()
    (folder / "bvh").symlink_to(place / "victim" / "bvh")
    (folder / "video.mp4").symlink_to(place / "victim" / "thesis.txt")
    (folder / "take.zarr").symlink_to(place / "victim")
    forge(folder, {"bvh/red_0.bvh": b"precious", "video.mp4": b"precious"}, place / "run")
    run_all(place)
    assert tree(place / "victim") == before
    assert not (place / "run" / "bvh" / "red_0.bvh").is_symlink()


@pytest.mark.parametrize("link", [RUN, "take.zarr"])
def test_a_take_behind_a_link_is_not_read(place: Path, capsys, link: str) -> None:
    shutil.move(place / "run" / "take.zarr", place / "victim" / "take.zarr")
    (place / "run" / link).symlink_to(place / "victim" / ("" if link == RUN else link))
    for words in (("inspect", "run"), ("export", "run", "--bvh"), PICTURE):
        capsys.readouterr()
        assert crowdsim(*words) == 2
        said = capsys.readouterr().err
        assert "run: no take here" in said or "run/take.zarr: is a symbolic link, expected the take itself" in said


@pytest.mark.parametrize("name", [".zattrs", "x/.zarray", "x/0.0", ""])
def test_a_take_with_links_is_neither_extended_nor_given_other_outputs(place: Path, capsys, name: str) -> None:
    linked = place / "run" / "take.zarr" / name
    target = place / "elsewhere"
    shutil.move(linked, target)
    linked.symlink_to(target)
    before = tree(place)
    for more in (("--extend", "5"), ("--set", "outputs.csv={}")):
        capsys.readouterr()
        assert crowdsim("run", "four.yaml", "--out", "run", *more) == 2
        assert "the run cannot be continued: run/take.zarr" in capsys.readouterr().err
        assert tree(place) == before


def test_files_of_the_user_in_a_run_folder_are_neither_replaced_nor_removed(place: Path) -> None:
    mine = {"notes.txt": b"mine", "bvh/mine.bvh": b"mine", "bvh/red_0.bvh": b"longer than theirs", "video.mp4": b"mine"}
    (place / "run" / "bvh").mkdir()
    for name, text in mine.items():
        (place / "run" / name).write_bytes(text)
    stage = place / "run" / RUN
    (stage / "bvh").mkdir(parents=True)
    (stage / "bvh" / "red_0.bvh").write_text("theirs")
    forge(stage, {"bvh/red_0.bvh": b"theirs"}, place / "run")
    # The list of the run claims the user's files as its own, so that they would go with it.
    report = read_manifest(place / "run")
    claimed = {name: {"bytes": 3, "sha256": "0" * 64} for name in ("bvh/mine.bvh", "video.mp4")}
    (place / "run" / NAME).write_text(signed_manifest({**report, "files": {**report["files"], **claimed}}))
    run_all(place)
    found = tree(place / "run")
    assert {name: found[name] for name in mine} == mine


@pytest.mark.parametrize("inputs", [[], ["notes.txt"]])
def test_a_list_that_claims_any_file_of_the_user_removes_it_only_as_it_was_written(
    place: Path, inputs: list[str]
) -> None:
    (place / "run" / "notes.txt").write_text("mine")
    report = read_manifest(place / "run")
    files = {**report["files"], "notes.txt": {"bytes": 4, "sha256": "0" * 64}}
    (place / "run" / NAME).write_text(signed_manifest({**report, "inputs": inputs, "files": files}))
    run_all(place)
    assert (place / "run" / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("name", [NAME, OUTPUTS, f"{RUN}/{NOTE}", "scenario.resolved.yaml", ".crowdsim-lock.json"])
def test_what_is_read_whole_has_a_largest_size(place: Path, capsys, name: str) -> None:
    import resource

    path = place / "run" / name
    path.parent.mkdir(exist_ok=True)
    if name == OUTPUTS:
        (place / "run" / NAME).unlink()
    with open(path, "wb") as file:
        file.truncate(max(180_000_000, 4 * MOST_BYTES))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    run_all(place)
    assert "Traceback" not in capsys.readouterr().err
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 400_000


def test_commands_that_read_change_nothing(place: Path) -> None:
    assert crowdsim("export", "run", "--bvh", "--ply", "--every", "20", "--frames", "0:30") == 0
    stage = place / "run" / EXPORT
    (stage / "bvh").mkdir(parents=True)
    os.replace(place / "run" / "bvh" / "red_0.bvh", stage / "bvh" / "red_0.bvh")
    forge(stage, {}, place / "run")
    facts = {path: path.lstat() for path in [place / "run", *(place / "run").rglob("*")]}
    for words in (("verify", "run"), ("inspect", "run"), ("status", "run"), ("validate", "four.yaml")):
        assert crowdsim(*words) == 0, words
    after = {path: path.lstat() for path in [place / "run", *(place / "run").rglob("*")]}
    assert {path: (one.st_mtime_ns, one.st_size) for path, one in after.items()} == {
        path: (one.st_mtime_ns, one.st_size) for path, one in facts.items()
    }


def test_exports_and_pictures_of_a_run_do_not_go_into_another_one(place: Path, capsys) -> None:
    shutil.copytree(place / "run", place / "other")
    before = tree(place / "other"), (place / "other" / NAME).read_bytes()
    for words in (("export", "run", "--bvh"), PICTURE):
        for force in ((), ("--force",)):
            for out in ("other", "other/more"):
                capsys.readouterr()
                assert crowdsim(*words, "--out", out, *force) == 2
                assert f"{out}: is in the folder of another run, " in capsys.readouterr().err
    assert (tree(place / "other"), (place / "other" / NAME).read_bytes()) == before


@pytest.mark.parametrize(
    ("out", "why"),
    [
        ("run/take.zarr", "is inside a folder that crowdsim keeps in the run"),
        ("run/take.zarr/more", "is inside a folder that crowdsim keeps in the run"),
        (f"run/{EXPORT}/more", "is inside a folder that crowdsim keeps in the run"),
        (f"run/{NAME}", "is in the way of what is to be written"),
        ("run/scenario.resolved.yaml", "is in the way of what is to be written"),
    ],
)
def test_exports_and_pictures_go_neither_into_the_take_nor_into_a_file_of_their_run(
    place: Path, capsys, out: str, why: str
) -> None:
    before = tree(place / "run"), (place / "run" / NAME).read_bytes()
    for words in (("export", "run", "--glb", "--frames", "0:3"), PICTURE):
        for force in ((), ("--force",)):
            capsys.readouterr()
            assert crowdsim(*words, "--out", out, *force) == 2
            assert f"{out}: {why}" in capsys.readouterr().err
    assert (tree(place / "run"), (place / "run" / NAME).read_bytes()) == before
    assert not list((place / "run").glob(".*.partial"))
    assert crowdsim("export", "run", "--glb", "--frames", "0:3") == 0
    assert crowdsim("verify", "run") == 0


OUT = {
    "export": ("export", "run", "--bvh", "--frames", "0:3", "--out", "out"),
    "render": (
        *("render", "run", "--png", "--contact-sheet", "1", "--size", "32x24", "--frames", "0:1", "--out", "out"),
        *("--camera", "side"),
    ),
    "plots": ("inspect", "run", "--plots", "out"),
    "perform": ("perform", "--seconds", "2", "--out", "out"),
}
OTHERWISE = {"export": ("--fps", "30"), "render": ("--camera", "top"), "plots": (), "perform": ("--seed", "4")}


@pytest.mark.parametrize("kind", OUT)
def test_only_what_crowdsim_has_written_is_replaced_and_only_by_force(place: Path, capsys, kind: str) -> None:
    assert crowdsim(*OUT[kind]) == 0
    names = sorted(name for name in tree(place / "out") if name != OUTPUTS)
    assert set(read_manifest(place / "out", name=OUTPUTS)["files"]) == set(names)
    before = tree(place / "out")
    assert crowdsim(*OUT[kind]) == 0
    assert tree(place / "out") == before
    if OTHERWISE[kind]:
        capsys.readouterr()
        assert crowdsim(*OUT[kind], *OTHERWISE[kind]) == 2
        assert "is there already; --force replaces what crowdsim has written" in capsys.readouterr().err
        assert tree(place / "out") == before
    assert crowdsim(*OUT[kind], *OTHERWISE[kind], "--force") == 0
    shutil.rmtree(place / "out")
    mine = place / "out" / names[0]
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    for force in ((), ("--force",)):
        capsys.readouterr()
        assert crowdsim(*OUT[kind], *force) == 2
        assert f"out/{names[0]}: is in the way of what is to be written" in capsys.readouterr().err
        assert tree(place / "out") == {names[0]: b"mine"}


def test_runs_open_from_any_working_folder(place: Path, monkeypatch, capsys) -> None:
    import crowdsim as package

    # Done here, with the policies of this folder.
    assert crowdsim("run", "four.yaml", "--out", "run", "--force") == 0
    run = place / "far" / "away" / "run"
    expected = package.open_run(place / "run").joints(0, 1.0)
    run.parent.mkdir(parents=True)
    shutil.move(place / "run", run)
    (place / "elsewhere").mkdir()
    monkeypatch.chdir(place / "elsewhere")
    assert (package.open_run(run).joints(0, 1.0) == expected).all()
    assert crowdsim("export", run, "--bvh", "--frames", "0:2", "--out", "here") == 0
    # The policy has moved to another folder in which policies are found by name.
    shutil.copytree(place / "policies" / "tiny", place / "elsewhere" / "policies" / "renamed")
    shutil.rmtree(place / "policies")
    assert (package.open_run(run).joints(0, 1.0) == expected).all()
    shutil.rmtree(place / "elsewhere" / "policies")
    capsys.readouterr()
    assert crowdsim("export", run, "--bvh", "--out", "there") == 2
    assert "run: policy 'tiny' is missing (looked in " in capsys.readouterr().err


def test_a_run_that_does_not_fit_its_policy_says_which_it_looked_at(place: Path, capsys) -> None:
    document = json.loads((place / "run" / NAME).read_text())
    document["policies"]["tiny"] = "0" * 64
    (place / "run" / NAME).write_text(signed_manifest({**document, "files": checksums(place / "run")}))
    assert crowdsim("pack", "run", "-o", "run.zip") == 2
    said = capsys.readouterr().err
    assert "policy 'tiny' is not the one that the take was recorded with (looked in " in said
    assert "policies/tiny" in said


@pytest.mark.parametrize("head", [b"(((((", b"{'descr': '<f8',", b"\xff" * 40, b"", b"[" * 5000])
def test_a_header_of_numpy_that_is_none_is_a_finding(workplace: Path, capsys, head: bytes) -> None:
    (workplace / "points.npy").write_bytes(b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head)
    placement = {"kind": "points", "file": "points.npy"}
    groups = [{"name": "pair", "type": "boxer", "count": 2, "placement": placement}]
    write_scene(workplace / "pair.yaml", groups=groups, opponents={"kind": "anyone"})
    assert crowdsim("validate", "pair.yaml") == 2
    assert "is no NPY file, expected an array as numpy.save writes it" in capsys.readouterr().err
