"""Manifests: every changed bit is found."""

import json
from contextlib import nullcontext
from pathlib import Path

import pytest

from crowdsim.errors import TakeError
from crowdsim.manifest import checksums, read_manifest, update_manifest, verify, write_manifest


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bvh").mkdir()
    (tmp_path / "bvh" / "a.bvh").write_bytes(b"HIERARCHY\n" * 100)
    (tmp_path / "scenario.resolved.yaml").write_text("version: 1\n")
    write_manifest(tmp_path, {"status": "done", "seed": 4}, checksums(tmp_path))
    return tmp_path


def test_an_untouched_run_has_no_finding(folder: Path) -> None:
    assert verify(folder) == ([], [])
    told = read_manifest(folder)
    assert told["seed"] == 4
    assert set(told["files"]) == {"bvh/a.bvh", "scenario.resolved.yaml"}
    assert "numpy" in told["versions"]


def test_a_changed_bit_a_lost_file_and_a_new_one_are_found(folder: Path) -> None:
    path = folder / "bvh" / "a.bvh"
    data = bytearray(path.read_bytes())
    data[500] ^= 1
    path.write_bytes(data)
    (folder / "scenario.resolved.yaml").unlink()
    (folder / "more.txt").write_text("x")
    (folder / "take.zarr").mkdir()
    (folder / "take.zarr" / "0").write_text("x")
    assert verify(folder, 2) == (
        [
            f"{path}: has changed: its SHA-256 is not the one in manifest.json",
            f"{folder / 'scenario.resolved.yaml'}: is missing",
            f"{folder / 'take.zarr' / '0'}: is not in manifest.json",
        ],
        ["more.txt"],
    )
    path.write_bytes(data[:-1])
    assert verify(folder)[0][0] == f"{path}: has 999 bytes, expected 1000"


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
            assert verify(folder)[0], place
    path.write_bytes(whole)
    assert verify(folder) == ([], [])


def test_exports_written_anew_take_the_place_of_those_before(folder: Path) -> None:
    (folder / "bvh" / "b.bvh").write_text("new")
    stale = update_manifest(folder, "bvh", [folder / "bvh" / "b.bvh"], {"fps": 30.0})
    assert stale == [folder / "bvh" / "a.bvh"]
    assert not stale[0].exists()
    assert verify(folder) == ([], [])
    told = read_manifest(folder)
    assert set(told["files"]) == {"bvh/b.bvh", "scenario.resolved.yaml"}
    assert told["exports"] == {"bvh": {"fps": 30.0}}
    assert told["seed"] == 4
