"""Packed policies from strangers, whose checksums fit, are refused before anything in them is used."""

import hashlib
import json
import lzma
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crowdsim.errors import PolicyError
from crowdsim.policy import bundle
from crowdsim.training import packing
from crowdsim.training.packing import pack_policy, unpack_policy


@pytest.fixture
def packed(tiny_policy, tmp_path) -> Path:
    pack_policy(tiny_policy, tmp_path / "packed")
    return tmp_path / "packed" / "tiny.json"


def change(path: Path, edit: Callable[[dict[str, Any]], Any]) -> None:
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(bundle.with_checksum({**document, "checksum": ""})))


def change_array(path: Path, name: str, edit: Callable[[np.ndarray], np.ndarray]) -> None:
    def put(document: dict[str, Any]) -> None:
        for at, part in enumerate(document["parts"]):
            if any(item[0] == name for item in part["arrays"]):
                arrays = packing._read_part(path, part)
                arrays[name] = np.ascontiguousarray(edit(arrays[name].copy()))
                document["parts"][at] = packing._write_part(path.parent, "changed", arrays)

    change(path, put)


def refusal(path: Path, folder: Path) -> str:
    with pytest.raises(PolicyError) as caught:
        unpack_policy(path, folder / "unpacked")
    assert not (folder / "unpacked").exists()
    return str(caught.value)


EDITS: list[tuple[Callable[[dict[str, Any]], Any], str]] = [
    (lambda d: d.pop("parts"), "tiny.json: parts: missing"),
    (lambda d: d.update(policy=[]), "tiny.json: policy: is a list"),
    (lambda d: d["policy"].pop("behaviours"), "tiny.json: policy: behaviours: missing"),
    (lambda d: d["policy"].update(files={}), "tiny.json: policy: unknown key 'files'"),
    (lambda d: d["policy"]["behaviours"][0].update(entries=-1), "behaviours[0].entries: is -1"),
    (lambda d: d["parts"][0].update(file="../motion.xz"), "tiny.json: parts[0].file: is '../motion.xz'"),
    (lambda d: d["parts"][0].update(file="/etc/passwd"), "tiny.json: parts[0].file: is '/etc/passwd'"),
    (lambda d: d["parts"][0]["arrays"][0].__setitem__(1, "|O"), "tiny.json: parts[0].arrays[0]: "),
    (lambda d: d["parts"][0]["arrays"][0].__setitem__(2, [-1]), "tiny.json: parts[0].arrays[0]: "),
    (lambda d: d["parts"][0]["arrays"][0].__setitem__(2, [1 << 33, 1 << 33]), "bytes, expected at most"),
    (lambda d: d["parts"][0]["arrays"].pop(), "tiny.json: parts: lack an array"),
    (lambda d: d["parts"][1]["arrays"].append(["values", "|u1", [1]]), "tiny.json: parts: hold an array 'values'"),
]


@pytest.mark.parametrize(("edit", "what"), EDITS)
def test_changed_documents_are_refused(packed: Path, tmp_path: Path, edit: Any, what: str) -> None:
    change(packed, edit)
    assert what in refusal(packed, tmp_path)


@pytest.mark.parametrize("name", ["skeleton_parents", "graph_action_next", "actions_lengths", "graph_state_frames"])
def test_indices_out_of_range_reach_nothing(packed: Path, tmp_path: Path, name: str) -> None:
    change_array(packed, name, lambda array: array + 100_000)
    assert f"tiny.json: array {name}" in refusal(packed, tmp_path)


def test_a_table_of_another_shape_is_refused(packed: Path, tmp_path: Path) -> None:
    name = f"values_{json.loads(packed.read_text())['policy']['behaviours'][0]['name']}"
    change_array(packed, name, lambda array: array[:-1])
    assert f"tiny.json: array {name}: is " in refusal(packed, tmp_path)


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda content: lzma.compress(bytes(1 << 28)), "holds another number of bytes than"),
        (lambda content: lzma.compress(lzma.decompress(content)[:-1]), "holds another number of bytes than"),
        (lambda content: content[:-40], "holds another number of bytes than"),
        (lambda content: content + b"more", "holds another number of bytes than"),
        (
            lambda content: b"no xz at all, whatever the name of the file says",
            "damaged: Input format not supported by decoder",
        ),
    ],
    ids=["bomb", "short", "cut", "more", "foreign"],
)
def test_changed_files_of_arrays_are_refused(packed: Path, tmp_path: Path, make: Any, what: str) -> None:
    def put(document: dict[str, Any]) -> None:
        part = document["parts"][0]
        content = make((packed.parent / part["file"]).read_bytes())
        (packed.parent / part["file"]).write_bytes(content)
        part["sha256"] = hashlib.sha256(content).hexdigest()

    change(packed, put)
    assert what in refusal(packed, tmp_path)


def test_links_are_not_followed(packed: Path, tmp_path: Path) -> None:
    file = packed.parent / json.loads(packed.read_text())["parts"][0]["file"]
    shutil.move(file, tmp_path / "elsewhere.xz")
    file.symlink_to(tmp_path / "elsewhere.xz")
    assert "is a symbolic link, expected a regular file" in refusal(packed, tmp_path)
