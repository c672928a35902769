"""Manifests: every changed bit is found."""

import hashlib
import json
import os
from contextlib import nullcontext
from pathlib import Path

import pytest

from crowdsim.errors import OutputError, TakeError
from crowdsim.runs.manifest import EXPORT, Verdict, checksums, read_manifest, signed_manifest, verify, write_manifest
from crowdsim.runs.stage import Wanted, complete, open_stage, write_together


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bvh").mkdir()
    (tmp_path / "bvh" / "a.bvh").write_bytes(b"HIERARCHY\n" * 100)
    (tmp_path / "scenario.resolved.yaml").write_text("version: 1\n")
    write_manifest(tmp_path, {"status": "done", "seed": 4}, checksums(tmp_path))
    return tmp_path


def test_an_untouched_run_has_no_finding(folder: Path) -> None:
    assert verify(folder) == Verdict()
    report = read_manifest(folder)
    assert report["seed"] == 4
    assert set(report["files"]) == {"bvh/a.bvh", "scenario.resolved.yaml"}
    assert "numpy" in report["versions"]


def test_a_changed_bit_a_lost_file_and_a_new_one_are_found(folder: Path) -> None:
    path = folder / "bvh" / "a.bvh"
    data = bytearray(path.read_bytes())
    data[500] ^= 1
    path.write_bytes(data)
    (folder / "scenario.resolved.yaml").unlink()
    (folder / "more.txt").write_text("x")
    (folder / "take.zarr").mkdir()
    (folder / "take.zarr" / "0").write_text("x")
    assert verify(folder, 2) == Verdict(
        (
            f"{path}: has changed: its SHA-256 is not the one in manifest.json",
            f"{folder / 'scenario.resolved.yaml'}: is missing",
            f"{folder / 'take.zarr' / '0'}: is not in manifest.json",
        ),
        foreign=("more.txt",),
    )
    path.write_bytes(data[:-1])
    assert verify(folder).findings[0] == f"{path}: has 999 bytes, expected 1000"


def test_what_is_no_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TakeError, match=r"no manifest\.json here, so this is no finished run"):
        verify(tmp_path)
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(TakeError, match="is damaged"):
        verify(tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps({"format": "other"}))
    with pytest.raises(TakeError, match="is no manifest of a run"):
        verify(tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps({"format": "crowdsim-run", "version": 7}))
    with pytest.raises(TakeError, match="is of version 7, expected 1"):
        verify(tmp_path)


def _is_damaged(folder: Path) -> bool:
    try:
        read_manifest(folder)
    except TakeError:
        return True
    return False


def test_any_changed_bit_of_a_manifest_is_found(folder: Path) -> None:
    path = folder / "manifest.json"
    whole = path.read_bytes()
    for place in range(0, len(whole), 7):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        with pytest.raises(TakeError) if _is_damaged(folder) else nullcontext():
            assert verify(folder).findings, place
    path.write_bytes(whole)
    assert verify(folder) == Verdict()


def export(folder: Path, name: str) -> None:
    """Write a file in the place of all BVH files of a run."""
    wanted = Wanted(EXPORT, {"bvh": {"fps": 30.0}}, {f"bvh/{name}"}, {"name": name}, ["bvh"])
    with write_together(folder, wanted, folder) as writing:
        (writing.folder / "bvh").mkdir()
        (writing.folder / "bvh" / name).write_text("new")
        assert (folder / "bvh" / "a.bvh").exists()


def test_new_exports_replace_those_before(folder: Path) -> None:
    export(folder, "b.bvh")
    assert not (folder / EXPORT).exists()
    assert not (folder / "bvh" / "a.bvh").exists()
    assert verify(folder) == Verdict()
    report = read_manifest(folder)
    assert set(report["files"]) == {"bvh/b.bvh", "scenario.resolved.yaml"}
    assert report["exports"]["bvh"]["fps"] == 30.0
    assert report["seed"] == 4


def sign(folder: Path, **files: dict) -> None:
    """Write the manifest again with more files in it, as anyone can."""
    report = read_manifest(folder)
    write_manifest(folder, {"status": "done"}, {**report["files"], **files})


@pytest.mark.parametrize(
    "name",
    ["../victim", "bvh/../../victim", "/etc/hostname", "", "bvh//a.bvh", "./bvh/a.bvh", "manifest.json", "a\0b",
     "notes.txt", "take.zarr/notes.txt", "bvh/a.txt", ".crowdsim-lock.json", "ply/1.ply", "policies/boxer/../x.npy"],
)  # fmt: skip
def test_a_manifest_names_only_files_inside_its_folder(folder: Path, name: str) -> None:
    sign(folder, **{name: {"bytes": 0, "sha256": ""}})
    for use in (read_manifest, verify, lambda folder: export(folder, "b.bvh")):
        with pytest.raises(TakeError, match="expected only files that a run writes inside"):
            use(folder)
    assert (folder / "bvh" / "a.bvh").exists()


def test_links_pipes_and_devices_are_findings_and_are_not_opened(folder: Path, tmp_path_factory) -> None:
    outside = tmp_path_factory.mktemp("outside")
    (outside / "b.bvh").write_text("secret")
    (folder / "bvh" / "link.bvh").symlink_to(outside / "b.bvh")
    (folder / "linked").symlink_to(outside)
    os.mkfifo(folder / "bvh" / "pipe.bvh")
    (folder / "bvh" / "c.bvh").mkdir()
    facts = {"bytes": 6, "sha256": hashlib.sha256(b"secret").hexdigest()}
    sign(folder, **{name: facts for name in ("bvh/link.bvh", "linked/bvh/b.bvh", "bvh/pipe.bvh", "bvh/c.bvh")})
    assert verify(folder).findings == (
        f"{folder / 'bvh/c.bvh'}: is a folder, expected a regular file; links are not followed",
        f"{folder / 'bvh/link.bvh'}: is a symbolic link, expected a regular file; links are not followed",
        f"{folder / 'bvh/pipe.bvh'}: is a named pipe, expected a regular file; links are not followed",
        f"{folder / 'linked'}: is a symbolic link, expected a folder; links are not followed",
    )


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_a_manifest_that_is_no_regular_file_is_refused_and_not_opened(tmp_path: Path, make) -> None:
    make(tmp_path / "manifest.json")
    with pytest.raises(TakeError, match=r"manifest\.json: is a (named pipe|symbolic link), expected a regular file"):
        verify(tmp_path)


def test_an_export_removes_and_replaces_nothing_behind_a_link(folder: Path, tmp_path_factory) -> None:
    outside = tmp_path_factory.mktemp("outside")
    (folder / "bvh").rename(outside / "bvh")
    (folder / "bvh").symlink_to(outside / "bvh")
    for name in ("a.bvh", "b.bvh"):
        with pytest.raises(OutputError, match=r"bvh(/a.bvh)?: is in the way"):
            export(folder, name)
    # A link that comes while an export is written.
    stage = open_stage(folder, EXPORT, "key")
    (stage.path / "bvh").mkdir()
    (stage.path / "bvh" / "b.bvh").write_text("new")
    report = read_manifest(folder)
    write_manifest(stage.path, {"status": "done"}, {**checksums(stage.path, ["bvh/b.bvh"]), **report["files"]})
    with pytest.raises(OutputError, match=r"bvh: .*is a symbolic link, expected"):
        complete(folder)
    assert [path.name for path in (outside / "bvh").iterdir()] == ["a.bvh"]


def test_a_manifest_without_sizes_and_checksums_is_damaged(folder: Path) -> None:
    for files, what in (
        (["a"], "files: is a list, expected"),
        ({"a": 3}, "files.a: is 3, expected"),
        (None, "files: is"),
    ):
        (folder / "manifest.json").write_text(signed_manifest({"files": files}))
        with pytest.raises(TakeError, match=f"is damaged: {what}"):
            read_manifest(folder)
