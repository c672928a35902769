"""Runs in one file: read elsewhere without training, and refused when something is wrong with them."""

import json
import shutil
import stat
import zipfile
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene
from test_runner import tree

from crowdsim.errors import OutputError, TakeError
from crowdsim.runs.archive import opened, pack_run, unpack
from crowdsim.runs.manifest import read_manifest


@pytest.fixture
def packed(workplace: Path) -> Path:
    """The archive of a run."""
    write_scene(workplace / "four.yaml", outputs={"bvh": {"fps": 30}})
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert crowdsim("pack", "run", "-o", "four.zip") == 0
    return workplace / "four.zip"


def test_an_archive_is_exported_rendered_inspected_and_verified_without_training(packed: Path, capsys) -> None:
    place = packed.parent
    assert crowdsim("export", "run", "--bvh", "--ply", "--every", "9", "--out", "before") == 0
    capsys.readouterr()
    assert crowdsim("inspect", "run", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    shutil.rmtree(place / "policies")
    shutil.rmtree(place / "run")
    assert crowdsim("verify", "four.zip") == 0
    assert "all as they were written" in capsys.readouterr().out
    assert crowdsim("inspect", "four.zip", "--json") == 0
    assert json.loads(capsys.readouterr().out) == figures
    assert crowdsim("export", "four.zip", "--bvh", "--ply", "--every", "9", "--out", "after") == 0
    assert tree(place / "after") == tree(place / "before")
    small = ("--size", "32x24", "--frames", "0:2", "--png", "--camera", "side")
    assert crowdsim("render", "four.zip", *small) == 0
    assert {path.name for path in (place / "four" / "frames").iterdir()} == {"000000.png", "000001.png"}
    assert crowdsim("export", "four.zip", "--bvh", "--frames", "0:3") == 0
    assert len(list((place / "four" / "bvh").glob("*.bvh"))) == 4


def test_the_same_run_gives_the_same_archive_without_its_outputs(packed: Path, capsys) -> None:
    pack_run(packed.parent / "run", packed.parent / "again.zip")
    assert (packed.parent / "again.zip").read_bytes() == packed.read_bytes()
    with zipfile.ZipFile(packed) as archive:
        tops = {name.split("/")[0] for name in archive.namelist()}
    assert tops == {"manifest.json", "scenario.resolved.yaml", "checkpoint.bin", "take.zarr", "policies"}
    with opened(packed) as folder:
        assert crowdsim("verify", folder) == 0
        unpacked = folder
    assert not unpacked.exists()


def test_what_cannot_be_packed_says_why(packed: Path, capsys) -> None:
    place = packed.parent
    (place / "mine.zip").write_text("mine")
    with zipfile.ZipFile(place / "other.zip", "w") as archive:
        archive.writestr("manifest.json", '{"format": "webapp"}')
    assert crowdsim("pack", "run", "-o", "four.zip", "--force") == 0
    for words, message in (
        (("run", "-o", "mine.zip"), "mine.zip: is there already and no archive of a run, expected another name"),
        (
            ("run", "-o", "mine.zip", "--force"),
            "mine.zip: is there already and no archive of a run, expected another name",
        ),
        (
            ("run", "-o", "other.zip", "--force"),
            "other.zip: is there already and no archive of a run, expected another name",
        ),
        (("run", "-o", "four.zip"), "four.zip: is there already; --force replaces it"),
        (("policies", "-o", "new.zip"), "policies: no manifest.json here, so this is no finished run"),
    ):
        capsys.readouterr()
        assert crowdsim("pack", *words) == 2
        assert capsys.readouterr().err == f"{message}\n"
    chunk = place / "run" / "take.zarr" / "x" / "0.0"
    chunk.write_bytes(chunk.read_bytes() + b"x")
    with pytest.raises(TakeError, match="has changed since the run was finished"):
        pack_run(place / "run", place / "new.zip")
    with pytest.raises(OutputError, match="no archive of a run"):
        pack_run(place / "run", place / "mine.zip")
    assert not (place / "new.zip").exists()


def repack(packed: Path, change) -> Path:
    """Write an archive again, each file as ``change`` returns it: entry and bytes, or None to leave it out."""
    hostile = packed.with_name("hostile.zip")
    with zipfile.ZipFile(packed) as old, zipfile.ZipFile(hostile, "w") as new:
        for entry in old.infolist():
            result = change(entry, old.read(entry))
            for one, data in result if isinstance(result, list) else [result] if result else []:
                new.writestr(one, data)
    return hostile


def entry(name: str, mode: int = stat.S_IFREG | 0o644, compression: int = zipfile.ZIP_STORED) -> zipfile.ZipInfo:
    result = zipfile.ZipInfo(name)
    result.external_attr, result.compress_type = mode << 16, compression
    return result


def added(name: str, data: bytes = b"x", **how):
    """Return a change that adds a file behind the manifest."""
    more = (entry(name, **how), data)
    return lambda one, old: [(one, old), more] if one.filename == "manifest.json" else (one, old)


def resigned(name: str):
    """Return a change that adds a file and lists it in the manifest, with a checksum that fits."""
    import hashlib

    from crowdsim.runs.manifest import signed_manifest

    def change(one, old):
        if one.filename != "manifest.json":
            return one, old
        document = json.loads(old)
        document.pop("checksum")
        document["files"][name] = {"bytes": 1, "sha256": hashlib.sha256(b"x").hexdigest()}
        return [(one, signed_manifest(document).encode()), (entry(name), b"x")]

    return change


HOSTILE = {
    "a link": (added("take.zarr/link", b"/etc/passwd", mode=stat.S_IFLNK | 0o777), "is a link or no regular file"),
    "a folder": (added("empty/", b""), "leads out of the archive"),
    "outside": (added("../outside"), "leads out of the archive"),
    "absolute": (added("/tmp/outside"), "leads out of the archive"),
    "listed outside": (resigned("../outside"), "leads out of the archive"),
    "backslash": (added("..\\outside"), "leads out of the archive"),
    "a bomb": (added("zeros", b"\0" * 10**7, compression=zipfile.ZIP_DEFLATED), "is compressed, expected files as"),
    "unlisted": (added("take.zarr/more"), "'take.zarr/more' is not in its manifest.json"),
    "twice": (added("scenario.resolved.yaml"), "is there twice"),
    "missing": (
        lambda one, old: None if one.filename == "checkpoint.bin" else (one, old),
        "'checkpoint.bin' is in its manifest.json, but missing",
    ),
    "no manifest": (lambda one, old: None if one.filename == "manifest.json" else (one, old), "holds no manifest.json"),
    "changed": (
        lambda one, old: (one, bytes([old[0] ^ 1]) + old[1:]) if one.filename == "take.zarr/x/0.0" else (one, old),
        "/take.zarr/x/0.0: has changed: its SHA-256",
    ),
    "longer": (
        lambda one, old: (one, old + b"x") if one.filename == "take.zarr/x/0.0" else (one, old),
        "/take.zarr/x/0.0: has ",
    ),
}


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(("change", "message"), HOSTILE.values(), ids=HOSTILE)
def test_hostile_archives_are_refused_and_nothing_is_written_outside(packed: Path, capsys, change, message) -> None:
    hostile = repack(packed, change)
    held = sorted(packed.parent.iterdir())
    for words in (("verify", hostile), ("export", hostile, "--bvh"), ("inspect", hostile)):
        capsys.readouterr()
        assert crowdsim(*words) == 2
        result = capsys.readouterr().err
        assert result.startswith(str(hostile))
        assert message in result
        assert len(result.splitlines()) == 1
    assert sorted(packed.parent.iterdir()) == held
    assert not Path("/tmp/outside").exists()


def test_a_length_that_lies_and_any_cut_are_found(packed: Path, tmp_path: Path) -> None:
    whole = packed.read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 1):
        packed.write_bytes(whole[:size])
        with pytest.raises(TakeError):
            unpack(packed, tmp_path / f"cut{size}")
    at = whole.rindex(b"PK\x01\x02")
    for change in (b"\xff\xff\xff\x7f", b"\x00\x00\x00\x00"):
        packed.write_bytes(whole[: at + 20] + change + change + whole[at + 28 :])
        with pytest.raises(TakeError):
            unpack(packed, tmp_path / f"lie{change[0]}")


def test_flipped_bits_of_an_archive_are_found_or_change_nothing(packed: Path, tmp_path: Path) -> None:
    whole = packed.read_bytes()
    for number, place in enumerate(range(1, len(whole), len(whole) // 60)):
        packed.write_bytes(whole[:place] + bytes([whole[place] ^ 1 << number % 8]) + whole[place + 1 :])
        folder = tmp_path / f"flip{number}"
        try:
            unpack(packed, folder)
        except TakeError:
            continue
        assert read_manifest(folder)["files"].keys() | {"manifest.json"} == set(tree(folder)) | {"manifest.json"}
