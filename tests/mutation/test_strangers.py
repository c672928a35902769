"""Bundles and runs of strangers, each with one thing wrong: the message says which file it is in, and which check."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numcodecs.zstd import Zstd
from on_disk import sign
from scenes import crowdsim

from crowdsim.errors import TakeError
from crowdsim.motion.strikers import LIMBS
from crowdsim.policy import checks
from crowdsim.policy.bundle import file_hash, with_checksum
from crowdsim.policy.checks import BEHIND, relations_behind
from crowdsim.policy.flattening import flatten_policy
from crowdsim.runs.checkpoint import read_checkpoint, write_checkpoint
from crowdsim.runs.manifest import signed_text

Change = Callable[[np.ndarray], Any]


@pytest.fixture(scope="module")
def copied(strangers: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[Path, bytes]]:
    """A folder with copies of a bundle and a run, and what is in its files."""
    folder = tmp_path_factory.mktemp("copied")
    for name in ("policies", "run"):
        shutil.copytree(strangers / name, folder / name)
    return folder, {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def place(copied: tuple[Path, dict[Path, bytes]], monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working folder with a bundle and a run, which are as they were again after the test."""
    folder, contents = copied
    monkeypatch.chdir(folder)
    yield folder
    shutil.rmtree(folder / "out", ignore_errors=True)
    for path in folder.rglob("*"):
        if path.is_file() and path not in contents:
            path.unlink()
    for path, data in contents.items():
        if path.read_bytes() != data:
            path.write_bytes(data)


def set_entry(at: Any, value: Any) -> Change:
    """Return a change that sets entries of an array."""

    def change(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[at] = value
        return values

    return change


def write_array(bundle: Path, name: str, values: np.ndarray) -> None:
    """Write an array of a bundle, with a checksum that fits."""
    np.save(bundle / f"{name}.npy", values)
    sign_bundle(bundle)


def sign_bundle(bundle: Path, **changes: Any) -> None:
    """Make the checksums of a bundle fit, and change its document."""
    document = {**json.loads((bundle / "policy.json").read_text()), **changes}
    files = {path.name: {"size": path.stat().st_size, "sha256": file_hash(path)} for path in bundle.glob("*.npy")}
    (bundle / "policy.json").write_text(json.dumps(with_checksum({**document, "files": files})))


ARRAYS: dict[str, tuple[str, Change, str]] = {
    "a parent behind its child": ("skeleton_parents", set_entry(2, 9), "holds 9 at [2], expected -1 for the root and"),
    "a joint that is its own parent": ("skeleton_parents", set_entry(3, 3), "holds 3 at [3], expected -1 for the root"),
    "an action of 2 billion frames": (
        "graph_action_lengths",
        set_entry(0, 2**31 - 1),
        "holds 2147483647 at [0], expected numbers from 1 to 4096",
    ),
    "an action of no frames": ("graph_action_lengths", set_entry(5, 0), "holds 0 at [5], expected numbers from 1 to "),
    "a path that is no number": ("actions_paths", set_entry((7, 1), np.nan), "holds nan at [7, 1], expected numbers f"),
    "a state that is not there": (
        "graph_action_next",
        set_entry(0, 10**6),
        "holds 1000000 at [0], expected indices f",
    ),
    "offsets that descend": ("actions_path_offsets", set_entry(3, 0), "offset 3 is -"),
    "offsets that begin late": ("graph_action_offsets", set_entry(0, 1), "offsets begin with 1 and end with "),
    "a capsule on no joint": ("body_capsule_joints", set_entry(0, 99), "holds 99 at [0], expected indices from 0 to 2"),
    "a capsule of no part": ("body_capsule_parts", set_entry(0, 200), "holds 200 at [0], expected numbers from 0 to 5"),
    "a limb that no body has": (
        "database_strike_limbs",
        set_entry(0, len(LIMBS)),
        f"holds {len(LIMBS)} at [0], expected numbers from 0 t",
    ),
    "a rotation of no length": (
        "database_rotations",
        set_entry((0, 0), 0.0),
        "holds 0.0 at [0, 0] as a length, expe",
    ),
    "a truth value of 7": ("database_contacts", lambda a: _byte(a, 7), "holds 7 at [0, 0], expected 0 or 1"),
    "another state than the graph's": (
        "actions_next",
        lambda a: a[::-1].copy(),
        "expected the same as in graph_actio",
    ),
    "another strike": ("actions_strike_ids", lambda a: a[::-1].copy(), "expected the strikes between first and last f"),
    "doubles": ("actions_paths", lambda a: a.astype(np.float64), "holds float64, expected float32"),
    "big endian": ("graph_action_next", lambda a: a.astype(">i4"), "is no array of numbers in C order"),
    "Fortran order": ("database_heads", np.asfortranarray, "is no array of numbers in C order"),
    "too few rows": ("actions_paths", lambda a: a[:-1], "is not "),
    "texts": ("values", lambda a: a.astype("U3"), "is no array of numbers in C order"),
}


def _byte(values: np.ndarray, value: int) -> np.ndarray:
    raw = values.view(np.uint8).copy()
    raw[0, 0] = value
    return raw.view(bool)


@pytest.mark.parametrize(("name", "change", "message"), ARRAYS.values(), ids=ARRAYS)
def test_a_bundle_with_a_wrong_array_is_refused(place: Path, capsys, name: str, change: Change, message: str) -> None:
    bundle = place / "policies" / "tiny"
    write_array(bundle, name, change(np.load(bundle / f"{name}.npy")))
    assert crowdsim("inspect", "policies/tiny") == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    if message != "is not ":
        assert said.startswith(f"policies/tiny/{name}.npy: ")
        assert message in said


def test_every_array_of_a_bundle_has_a_check_and_every_index_out_of_range_is_refused(base) -> None:
    _, arrays = flatten_policy(base.policy)
    assert set(arrays) <= set(checks.TABLE)
    behind = relations_behind(dict.fromkeys(BEHIND, np.zeros(0)))
    related = {relation.name for relation in (*checks._relations(4, {"P": 4, "F": 1}), *behind)}
    free = {"values", checks.STATE_VALUES}
    for name, column in checks.TABLE.items():
        assert column.checks or name in related | free, name
    for name, values in base.arrays.items():
        if values.dtype.kind != "i":
            continue
        for wrong in (-(2**31), -2, len(values) * 10**6, 2**31 - 1):
            for at in (0, len(values) // 2, -1):
                with pytest.raises(Exception, match="expected") as caught:
                    base.check_bundle(base.document, {**base.arrays, name: set_entry(at, wrong)(values)})
                assert type(caught.value).__name__ == "PolicyError", (name, wrong, at)


def _at(path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    """Return a change of plain data at a path of keys."""

    def change(document: Any) -> None:
        *above, last = [int(key) if key.isdecimal() else key for key in path.split("/")]
        for key in above:
            document = document[key]
        document[last] = value

    return change


DOCUMENTS = {
    "behaviours/0/scale": (-1.0, "behaviours[0].scale: is -1.0, expected a number from 0.0 to"),
    "behaviours/0/axes/0/count": (10**12, "behaviours[0].axes[0].count: is 1000000000000, expected a whole number"),
    "behaviours/0/axes/0/maximum": (1e308, "behaviours[0].axes[0].maximum: is 1e+308, expected a number"),
    "behaviours/0/lookup": ("x", "behaviours[0].lookup: is 'x', expected 'q' or 'v'"),
    "behaviours/0/entries": (3, "values.npy: holds 3 entries for 'approach', expected "),
    "behaviours": ({}, "behaviours: is a mapping, expected a list"),
    "skeleton/names": (["a"], "expected a joint from 0 to 0"),
    "body/roles": ({"head": 0}, "body.roles: lacks 'pelvis', expected a body's roles"),
    "body/roles/head": (99, "body.roles.head: is 99, expected a joint from 0 to "),
    "database/control_rate": (0, "database.control_rate: is 0, expected a number from 0.01 to 10000"),
    "database": (None, "database: is empty, expected a mapping"),
    "target/head_radius": (-0.1, "target.head_radius: is -0.1, expected a number from 1e-06"),
    "recipe": ([], "recipe: is a list, expected a mapping"),
    "statistics/motion": ({}, "statistics.motion.clips: missing, expected a whole number"),
}


@pytest.mark.parametrize(("path", "value", "message"), [(path, *rest) for path, rest in DOCUMENTS.items()])
def test_a_bundle_with_a_wrong_document_is_refused(place: Path, capsys, path: str, value: Any, message: str) -> None:
    bundle = place / "policies" / "tiny"
    document = json.loads((bundle / "policy.json").read_text())
    _at(path, value)(document)
    sign_bundle(bundle, **document)
    assert crowdsim("inspect", "policies/tiny") == 2
    said = capsys.readouterr().err
    assert said.startswith("policies/tiny/")
    assert message in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [("[]", "foreign"), ("{" * 10**5, "is no JSON"), ("[" * 10**5, "nested too deeply"), ('{"a": NaN}', "NaN is no"),
     ('{"a": 1e999}', "1e999 is too large"), ('{"a": ' + "9" * 5000 + "}", "is no JSON"), ("\x00", "is no JSON")],
)  # fmt: skip
def test_a_bundle_with_no_document_at_all_is_refused(place: Path, capsys, text: str, message: str) -> None:
    (place / "policies" / "tiny" / "policy.json").write_text(text)
    assert crowdsim("inspect", "policies/tiny") == 2
    said = capsys.readouterr().err
    assert said.startswith("policies/tiny/policy.json: ")
    assert message in said


def change_chunk(take: Path, name: str, change: Change) -> None:
    """Change the only chunk of an array of a take, and make the manifest fit."""
    facts = json.loads((take / name / ".zarray").read_text())
    chunk = take / name / ".".join("0" for _ in facts["shape"])
    whole = np.zeros(facts["chunks"], facts["dtype"])
    if chunk.exists():
        whole = np.frombuffer(Zstd().decode(chunk.read_bytes()), facts["dtype"]).reshape(facts["chunks"])
    chunk.write_bytes(Zstd(level=1).encode(np.ascontiguousarray(change(whole)).tobytes()))
    sign(take.parent)


TAKES: dict[str, tuple[str, Change, str]] = {
    "NaN frames": ("x", set_entry((3, 1), np.nan), "holds nan at [3, 1], expected a number where an avatar is present"),
    "a NaN phase": ("action_frame", set_entry((3, 1), np.nan), "holds nan at [3, 1], expected numbers from 0 to"),
    "a phase before the start": (
        "action_frame",
        set_entry((3, 1), -9.0),
        "holds -9.0 at [3, 1], expected numbers fr",
    ),
    "negative scale": ("scale", set_entry(2, -1.0), "holds -1.0 at [2], expected numbers from 0.01 to 100"),
    "no speed": ("speed", set_entry(2, 0.0), "holds 0.0 at [2], expected numbers from 0.01 to 20"),
    "an action that is not there": (
        "action",
        set_entry((7, 0), 10**6),
        "holds 1000000 at [7, 0], expected one of th",
    ),
    "an opponent that is not there": (
        "opponent",
        set_entry((7, 0), 4),
        "holds 4 at [7, 0], expected indices from -2",
    ),
    "a target that is not there": (
        "opponent",
        set_entry((7, 0), -3),
        "holds -3 at [7, 0], expected indices from -2",
    ),
    "a type that is not there": ("type", set_entry(0, 1), "holds 1 at [0], expected indices from 0 to 0"),
    "a team that is not there": ("team", set_entry(0, -1), "holds -1 at [0], expected indices from 0 to 1"),
    "a policy that is not there": ("policy", set_entry(3, 5), "holds 5 at [3], expected indices from 0 to 0"),
    "a strike at 3e38": ("events/frame", set_entry(0, 3e38), "at [0], expected numbers from -1 to 40"),
    "a strike at no time": ("events/frame", set_entry(0, np.inf), "holds inf at [0], expected numbers from -1 to 40"),
    "a strike by nobody": ("events/attacker", set_entry(0, -1), "holds -1 at [0], expected indices from 0 to 3"),
    "a victim that is not there": ("events/victim", set_entry(0, 4), "holds 4 at [0], expected indices from -2 to 3"),
    "a third hand": ("events/hand", set_entry(0, 2), "holds 2 at [0], expected numbers from 0 to 1"),
    "a limb that no body has": (
        "events/limb",
        set_entry(0, len(LIMBS)),
        f"holds {len(LIMBS)} at [0], expected numbers from 0 t",
    ),
    "a fist at no place": ("events/point", set_entry((0, 2), np.nan), "holds nan at [0, 2], expected numbers from"),
    "a target at no place": ("target", set_entry((1, 0, 0), np.inf), "holds inf at [1, 0, 0], expected numbers from"),
}


@pytest.mark.parametrize(("name", "change", "message"), TAKES.values(), ids=TAKES)
def test_a_take_with_a_wrong_array_is_refused(place: Path, capsys, name: str, change: Change, message: str) -> None:
    change_chunk(place / "run" / "take.zarr", name, change)
    assert crowdsim("export", "run", "--bvh", "--out", "out", "--threads", "1") == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"run/take.zarr/{name}: ")
    assert message in said
    assert not list(place.glob("out/bvh/*"))


def test_a_run_whose_checksums_fit_is_not_used_for_that(place: Path, capsys) -> None:
    change_chunk(place / "run" / "take.zarr", "scale", set_entry(0, np.nan))
    assert crowdsim("verify", "run") == 0
    assert crowdsim("pack", "run", "-o", "run.zip") == 0
    for words in (("inspect", "run"), ("inspect", "run.zip"), ("export", "run.zip", "--ply")):
        capsys.readouterr()
        assert crowdsim(*words) == 2
        assert "take.zarr/scale: holds nan at [0], expected numbers from 0.01 to 100" in capsys.readouterr().err


METADATA = {
    "codecs that run code": (
        "x",
        {"filters": [{"id": "pickle"}]},
        "x/.zarray: is damaged: filters: is a list, expect",
    ),
    "another codec": ("x", {"compressor": {"id": "blosc"}}, "compressor.id: is 'blosc', expected 'zstd'"),
    "objects": ("name", {"dtype": "|O"}, "dtype: is '|O', expected a type of numbers or text that takes have"),
    "more frames than there are": (
        "opponent",
        {"shape": [10**12, 4]},
        "opponent: has the shape (1000000000000, 4), ",
    ),
    "chunks larger than memory": (
        "x",
        {"chunks": [10**6, 10**6]},
        "chunks: are of [1000000, 1000000] entries, too m",
    ),
    "no axes": ("x", {"shape": [], "chunks": []}, "shape: has 0 items, expected at least 1"),
    "another format": ("x", {"zarr_format": 3}, "zarr_format: is 3, expected 2"),
    "doubles": ("x", {"dtype": "<f8"}, "x: holds float64, expected float32"),
}


@pytest.mark.parametrize(("name", "change", "message"), METADATA.values(), ids=METADATA)
def test_a_take_with_wrong_metadata_is_refused(place: Path, capsys, name: str, change: Any, message: str) -> None:
    path = place / "run" / "take.zarr" / name / ".zarray"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    assert crowdsim("export", "run", "--bvh", "--out", "out") == 2
    assert message in capsys.readouterr().err


def test_a_take_that_claims_more_frames_than_it_has_chunks_is_refused(place: Path, capsys) -> None:
    take = place / "run" / "take.zarr"
    for name in ("action", "action_frame", "x", "z", "heading", "opponent", "target"):
        facts = json.loads((take / name / ".zarray").read_text())
        facts["shape"][0] = 10**12
        (take / name / ".zarray").write_text(json.dumps(facts))
    assert crowdsim("export", "run", "--bvh", "--out", "out") == 2
    assert "take.zarr/opponent: holds 3 files, expected 25000000000 chunks or more" in capsys.readouterr().err


def test_a_chunk_that_unpacks_to_more_than_it_may_is_refused(place: Path, capsys) -> None:
    take = place / "run" / "take.zarr"
    small = (take / "x" / "0.0").read_bytes()
    for data in (Zstd().encode(bytes(10**7)), small + Zstd().encode(bytes(10**7)), small[:-3], b"", b"x" * 99):
        (take / "x" / "0.0").write_bytes(data)
        assert crowdsim("export", "run", "--bvh", "--out", "out") == 2
        assert "take.zarr/x/0.0: is damaged: " in capsys.readouterr().err


def test_a_take_without_avatars_is_refused_for_that(place: Path, capsys) -> None:
    for path in (place / "run" / "take.zarr").glob("*/.zarray"):
        facts = json.loads(path.read_text())
        axis = {"time": None, "target": None}.get(path.parent.name, len(facts["shape"]) - 1)
        if axis is not None:
            facts["shape"][axis] = 0
        path.write_text(json.dumps(facts))
    for kind in ("--bvh", "--ply", "--pcd"):
        assert crowdsim("export", "run", kind, "--out", "out") == 2
        assert capsys.readouterr().err == "run/take.zarr: has no avatars, expected one or more\n"


ATTRIBUTES = {
    "control_rate": (1e-300, "control_rate: is 1e-300, expected a number from 0.01 to 1"),
    "type_names": ([], "type_names: has 0 items, expected at least 1"),
    "policy_fingerprints": ([], "policy_fingerprints: has 0 items, expected 1, one a policy"),
    "type_colours": ([[2.0, 0.0, 0.0]], "type_colours[0][0]: is 2.0, expected a number from 0.0 to 1.0"),
    "type_bodies": ([{"sex": "male", "hands": "paws"}], "type_bodies[0].hands: is 'paws', expected 'gloves' or 'bare'"),
    "target_names": ("ball", "target_names: is 'ball', expected a list"),
    "seed": ("x", "seed: is 'x', expected a whole number"),
}


@pytest.mark.parametrize(("name", "value", "message"), [(name, *rest) for name, rest in ATTRIBUTES.items()])
def test_a_take_with_wrong_attributes_is_refused(place: Path, capsys, name: str, value: Any, message: str) -> None:
    path = place / "run" / "take.zarr" / ".zattrs"
    path.write_text(json.dumps({**json.loads(path.read_text()), name: value}))
    assert crowdsim("inspect", "run") == 2
    assert f"run/take.zarr/.zattrs: is damaged: {message}" in capsys.readouterr().err


MANIFESTS: dict[str, tuple[Any, str]] = {
    "avatars": ("x", "avatars: is 'x', expected a whole number"),
    "files": ([], "files: is a list, expected a mapping"),
    "seconds": ({}, "seconds: lacks 'total'"),
    "policies": (["tiny"], "policies: is a list, expected a mapping"),
    "inputs": ({"a": 1}, "inputs: is a mapping, expected a list"),
    "exports": ({"plots": {"files": 5}}, "exports.plots.files: is 5, expected a list"),
    "outcome": ({"kind": "time"}, "outcome.frame: missing, expected a whole number"),
}


@pytest.mark.parametrize(("name", "value", "message"), [(name, *rest) for name, rest in MANIFESTS.items()])
def test_a_manifest_of_the_wrong_shape_is_refused(place: Path, capsys, name: str, value: Any, message: str) -> None:
    path = place / "run" / "manifest.json"
    path.write_text(signed_text({**json.loads(path.read_text()), name: value}))
    assert crowdsim("verify", "run") == 2
    assert f"run/manifest.json: is damaged: {message}" in capsys.readouterr().err
    assert crowdsim("status", "run", "--json") == 1
    assert json.loads(capsys.readouterr().out)["run"]["state"] == "damaged"


def test_a_manifest_without_what_a_command_needs_is_refused(place: Path, capsys) -> None:
    path = place / "run" / "manifest.json"
    document = json.loads(path.read_text())
    del document["seconds"], document["avatars"]
    path.write_text(signed_text(document))
    assert crowdsim("inspect", "run") == 2
    assert "run/manifest.json: is damaged: lacks 'seconds'" in capsys.readouterr().err
    assert crowdsim("status", "run", "--json") == 1
    assert json.loads(capsys.readouterr().out)["run"]["why"] == "run/manifest.json: is damaged: lacks 'avatars'"


CHECKPOINTS: dict[str, tuple[str, Change, str]] = {
    "an action": ("simulation.avatars.motion.action", set_entry(0, 10**6), "action' holds 1000000, which is"),
    "an opponent": ("simulation.avatars.opponent", set_entry(0, 4), "opponent' holds 4, which is out of"),
    "a policy": ("simulation.avatars.policy", set_entry(0, 1), "array 'avatars.policy' is not that of the run"),
    "a position": ("simulation.avatars.x", set_entry(0, np.nan), "holds nan, which is out of range"),
    "a phase": ("simulation.avatars.motion.phase", set_entry(0, 1e6), "phase' holds 1000000.0, which is out of"),
    "who is fresh": ("simulation.fresh", lambda _: np.array([9], np.int32), "'fresh' holds 9, which is out of range"),
    "the frame": ("simulation.frame", lambda _: np.array(7), "it is of control frame 40, and of 7"),
    "the searches": ("simulation.searches", lambda _: np.array(["x"]), "'searches' is none of direct, kd_tree, scipy"),
}


@pytest.mark.parametrize(("name", "change", "message"), CHECKPOINTS.values(), ids=CHECKPOINTS)
def test_a_run_is_not_extended_from_a_wrong_checkpoint(
    place: Path, strangers: Path, capsys, name: str, change: Change, message: str
) -> None:
    begun = read_checkpoint(place / "run", 100, 1_000_000)
    part, _, array = name.partition(".")
    arrays = dict(getattr(begun, part))
    write_checkpoint(place / "run", replace(begun, **{part: {**arrays, array: change(arrays[array])}}))
    sign(place / "run")
    scenario = str(strangers / "four.yaml")
    assert crowdsim("run", scenario, "--out", "run", "--extend", "5", "--threads", "1") == 2
    said = capsys.readouterr().err.splitlines()[-1]
    shutil.rmtree(place / "run" / ".run.partial")
    assert "checkpoint.bin: cannot be continued: " in said
    assert message in said


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame": -1}, "frame: is -1, expected a whole number"),
        ({"arrays": [["a", "|O", [1]]]}, "expected name, type and shape of an array"),
        ({"arrays": [["a", "<f8", [10**12]]]}, "bytes of arrays, expected 8,000,000,000,000"),
        (lambda size: {"arrays": [["a", "|u1", [1]], ["a", "|u1", [size - 1]]]}, "array 'a' is there twice"),
        ({"arrays": []}, "bytes of arrays, expected 0"),
        ({"origin": None}, "origin: is empty, expected text"),
    ],
)
def test_a_checkpoint_with_a_wrong_first_line_is_damaged(place: Path, change: Any, message: str) -> None:
    path = place / "run" / "checkpoint.bin"
    head, _, body = path.read_bytes().partition(b"\n")
    document = {**json.loads(head), **(change(len(body)) if callable(change) else change)}
    del document["sha256"]
    digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode() + body).hexdigest()
    path.write_bytes(json.dumps({**document, "sha256": digest}).encode() + b"\n" + body)
    with pytest.raises(TakeError) as caught:
        read_checkpoint(place / "run", 100, 1_000_000)
    assert str(caught.value).startswith(f"{path}: is damaged: ")
    assert message in str(caught.value)


def test_a_checkpoint_of_more_bytes_than_its_avatars_have_is_not_read(place: Path, strangers: Path, capsys) -> None:
    path = place / "run" / "checkpoint.bin"
    before = path.read_bytes()
    document = json.loads(before.partition(b"\n")[0])
    head = json.dumps({**document, "frame": 2**32, "arrays": [["a", "|u1", [2**30]]]}).encode() + b"\n"
    path.write_bytes(head)
    os.truncate(path, len(head) + 2**30)
    try:
        assert crowdsim("run", str(strangers / "four.yaml"), "--out", "run", "--extend", "5", "--threads", "1") == 2
    finally:
        path.write_bytes(before)
    said = "run/checkpoint.bin: is damaged: has 1,073,741,824 bytes of arrays, expected at most"
    assert said in capsys.readouterr().err
