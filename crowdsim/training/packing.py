"""Packed policies: trained bundles made small enough to ship in a wheel, and unpacked once where that is installed.

A packed policy is a JSON file, which holds what ``policy.json`` does, and two files of compressed arrays beside it. One
holds the motion; policies of the same motion share it. Of each table only what cannot be computed is kept: one half of
mirror-symmetric values, and instead of a table of Q in bytes the values V that it is one backup of. Unpacking gives the
bundle that was packed, byte for byte, on one kind of processor; on another one, some entries of Q may differ by a step.
Nothing in a packed policy is used unchecked.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, ValidationError

from crowdsim.array_checks import ArrayFault
from crowdsim.config.documents import DocumentModel, document_fault
from crowdsim.core.types import Array, Progress
from crowdsim.errors import PolicyError
from crowdsim.files import open_plain
from crowdsim.policy import bundle
from crowdsim.policy.actions import leading_actions
from crowdsim.policy.checks import BEHIND, DEFENCE, GROUPS, STATE_VALUES, TABLE
from crowdsim.policy.document import Hash, PolicyDocument, Timings
from crowdsim.policy.environment import Axis, Grid, build_grid
from crowdsim.policy.flattening import STORED, assemble_motion, check_flattened
from crowdsim.policy.policy import StateValues
from crowdsim.policy.rewards import TargetBody
from crowdsim.training.behaviours import Lesson
from crowdsim.training.mirroring import is_mirrored, values_with_images
from crowdsim.training.recipe import Recipe

KIND = "crowdsim packed policy"
VERSION = 2
MOTION = ("database_", "skeleton_", "body_")
"""How the names of arrays begin that depend on the motion alone."""
_MOST_BYTES = 1 << 31
"""Longest file of compressed arrays that is read."""
_KINDS = {"|b1", "|u1", "|i1", *(f"<{letter}{size}" for letter in "iuf" for size in (2, 4, 8))}
_MOST_UNPACKED = 1 << 33
"""Most bytes that the arrays of one file may have."""
_MOST_ENTRIES = 1 << 31


def _check_listed(item: list[Any]) -> list[Any]:
    name, kind, shape = item
    if not (isinstance(name, str) and isinstance(kind, str) and kind in _KINDS and isinstance(shape, list)):
        raise ValueError("expected name, type and shape of an array")
    if len(shape) > 8 or not all(type(size) is int and 0 <= size <= _MOST_UNPACKED for size in shape):
        raise ValueError("expected a shape of whole numbers")
    return item


class _Part(DocumentModel):
    """A file of compressed arrays."""

    file: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,250}\.xz$")]
    sha256: Hash
    arrays: list[Annotated[list[Any], Field(min_length=3, max_length=3), AfterValidator(_check_listed)]]


class _Packed(DocumentModel):
    """The JSON file of a packed policy."""

    kind: str
    version: int
    checksum: str
    policy: dict[str, Any]
    timings: Timings
    parts: list[_Part] = Field(min_length=1, max_length=8)


def pack_policy(trained: Path, folder: Path) -> None:
    """Pack a trained bundle into files in a folder: ``NAME.json``, and those that it names.

    Raises:
        PolicyError: The bundle is foreign or damaged.
        OSError: A file cannot be written.
    """
    document = bundle.read_document(trained)
    arrays = bundle.map_arrays(trained, document)
    for key in ("kind", "version", "files", "checksum"):
        del document[key]
    tables = _kept_tables(document, arrays.pop("values"), arrays.pop(STATE_VALUES, None), arrays)
    motion = {name: array for name, array in arrays.items() if name.startswith(MOTION)}
    others = {name: array for name, array in arrays.items() if name not in motion}
    folder.mkdir(parents=True, exist_ok=True)
    packed = {
        "kind": KIND,
        "version": VERSION,
        "policy": document,
        "timings": bundle.read_timings(trained),
        "parts": [_write_part(folder, "motion", motion), _write_part(folder, document["name"], {**others, **tables})],
    }
    text = json.dumps(bundle.with_checksum(packed), allow_nan=False)
    (folder / f"{document['name']}.json").write_text(text + "\n", encoding="utf-8")


def read_packed(path: Path) -> dict[str, Any]:
    """Return what the JSON file of a packed policy holds.

    Raises:
        VersionError: It is of another format version.
        PolicyError: It is foreign or damaged.
    """
    packed = bundle.read_checked(path, KIND, VERSION, "install crowdsim again")
    check_packed(path, packed)
    return packed


def unpack_policy(path: Path, folder: Path, progress: Progress | None = None) -> None:
    """Write the bundle of a packed policy, a JSON file, to a folder, in whose place an older bundle may stand.

    Raises:
        PolicyError: A file is missing, foreign or damaged.
        OutputError: The bundle cannot be written; nothing is left behind.
    """
    packed = read_packed(path)
    document = packed["policy"]
    described = document["behaviours"]

    def report(done: int) -> None:
        if progress is not None:
            progress(f"unpacking policy {document['name']} (once)", done, len(described) + 2)

    report(0)
    arrays = {name: array for part in packed["parts"] for name, array in _read_part(path, part).items()}
    check_unpacked(path, document, arrays)
    report(1)
    values, behind = [], []
    for done, behaviour in enumerate(described, start=2):
        table = unpack_table(arrays.pop(_kept_name(behaviour)), _grid(behaviour), len(arrays["graph_state_frames"]))
        if "state_values" in behaviour:
            behind.append(table)
            table = _computed_table(path, document, behaviour, arrays, table)
        values.append(table)
        report(done)
    arrays["values"] = np.concatenate(values)
    if behind:
        arrays[STATE_VALUES] = np.concatenate(behind)
    bundle.write_arrays(folder, document, arrays, packed["timings"])
    report(len(described) + 2)


def pack_table(table: Array, grid: Grid, states: int) -> Array:
    """Return what is kept of a behaviour's flat table, in the same type: codes (S or S / 2, *grid.shape), or the table.

    Of a table of V these are differences from what neighbours on the grid predict (Ibarria et al., "Out-of-core
    compression and decompression of large n-dimensional scalar fields", 2003), small ones of either sign as small
    codes; for the captured states alone, where the values are mirror-symmetric. A table of Q is kept as it is.
    """
    if len(table) != states * grid.cells:
        return table
    values = table.reshape(states, grid.cells)
    captured = values[: states // 2]
    if is_mirrored(grid) and np.array_equal(values_with_images(captured, grid), values):
        values = captured
    codes = values.reshape(len(values), *grid.shape).view(f"u{table.itemsize}")
    for axis in range(1, codes.ndim):
        codes = np.diff(codes, axis=axis, prepend=codes.dtype.type(0))
    signed = codes.view(f"i{table.itemsize}")
    return ((signed << 1) ^ (signed >> (8 * table.itemsize - 1))).view(table.dtype)


def unpack_table(kept: Array, grid: Grid, states: int) -> Array:
    """Return the table of which ``pack_table`` kept this. Flat."""
    if kept.ndim == 1:
        return kept
    folded = kept.view(f"u{kept.itemsize}")
    codes = (folded >> 1) ^ (0 - (folded & 1))
    for axis in range(1, codes.ndim):
        np.cumsum(codes, axis=axis, dtype=codes.dtype, out=codes)
    values = codes.view(kept.dtype).reshape(len(kept), grid.cells)
    return (values if len(values) == states else values_with_images(values, grid)).ravel()


def _kept_tables(
    document: Mapping[str, Any], values: Array, behind: Array | None, arrays: Mapping[str, Array]
) -> dict[str, Array]:
    """Return what is kept of the tables of all behaviours, by name."""
    states, kept = len(arrays["graph_state_frames"]), {}
    for behaviour in document["behaviours"]:
        grid = _grid(behaviour)
        table, values = np.split(values, [behaviour["entries"]])
        if behind is not None and "state_values" in behaviour:
            table, behind = np.split(behind, [states * grid.cells])
        kept[_kept_name(behaviour)] = pack_table(table, grid, states)
    return kept


def _kept_name(behaviour: Mapping[str, Any]) -> str:
    return f"values_{behaviour['name']}"


def _grid(behaviour: Mapping[str, Any]) -> Grid:
    return build_grid(Axis(**axis) for axis in behaviour["axes"])


def _computed_table(
    path: Path, document: Mapping[str, Any], behaviour: dict[str, Any], arrays: Mapping[str, Array], values: Array
) -> Array:
    """Return a behaviour's table of Q in bytes by one backup of V, and put its range into the behaviour's data."""
    database, _, actions = assemble_motion(document, arrays)
    try:
        spec = Recipe.model_validate(document["recipe"]).behaviours[behaviour["name"]]
    except (ValidationError, KeyError):
        raise PolicyError(f"{path}: policy: recipe: is no recipe of {behaviour['name']!r}") from None
    behind = StateValues(values, **behaviour["state_values"])
    body = TargetBody(**document["target"])
    actions = leading_actions(actions, actions.state_count)
    table, low, step = Lesson(behaviour["name"], spec, database, actions, body).q_bytes(behind)
    behaviour.update(stored_low=low, stored_step=step)
    return table


def _write_part(folder: Path, stem: str, arrays: Mapping[str, Array]) -> dict[str, Any]:
    """Write arrays to a compressed file, and return what is needed to read them.

    The bytes of each array are put in planes, the first bytes of all entries before the second: they are alike. Its
    axes are reversed, so that what a joint does over time is side by side.
    """
    flat = (np.ascontiguousarray(array.T).reshape(-1) for array in arrays.values())
    planes = (array.view(np.uint8).reshape(-1, array.itemsize).T for array in flat)
    content = lzma.compress(b"".join(plane.tobytes() for plane in planes))
    digest = hashlib.sha256(content).hexdigest()
    file = f"{stem}-{digest[:12]}.xz"
    (folder / file).write_bytes(content)
    facts = [[name, array.dtype.str, list(array.shape)] for name, array in arrays.items()]
    return {"file": file, "sha256": digest, "arrays": facts}


def _read_part(path: Path, part: Mapping[str, Any]) -> dict[str, Array]:
    """Return the arrays in a file that the packed policy at ``path`` names."""
    file = path.with_name(part["file"])
    try:
        with open_plain(file.parent, file.name) as opened:
            content = opened.read(_MOST_BYTES + 1)
    except OSError as error:
        raise PolicyError(f"{file}: cannot be read: {error.strerror}; install crowdsim again") from None
    if hashlib.sha256(content).hexdigest() != part["sha256"]:
        raise PolicyError(f"{file}: damaged: its SHA-256 is not the one in {path.name}; install crowdsim again")
    size = sum(np.dtype(code).itemsize * math.prod(shape) for _, code, shape in part["arrays"])
    planes, first, arrays = np.frombuffer(decompress(file, content, size), np.uint8), 0, {}
    for name, code, shape in part["arrays"]:
        kind, count = np.dtype(code), math.prod(shape)
        plane = planes[first : first + count * kind.itemsize].reshape(kind.itemsize, count)
        entries = np.array(plane.T, order="C").view(kind).reshape(shape[::-1])
        arrays[name] = np.array(entries.T, order="C")
        first += plane.size
    return arrays


def check_packed(path: Path, packed: Mapping[str, Any]) -> None:
    """Raise a ``PolicyError`` if the JSON file of a packed policy is not what it must be."""
    fault = document_fault(_Packed, dict(packed))
    if fault:
        raise PolicyError(f"{path}: {fault}")
    of_bundle: dict[str, Any] = {"kind": "", "version": 0, "checksum": "", "files": {}}
    more = sorted(set(packed["policy"]) & set(of_bundle))
    fault = f"unknown key {more[0]!r}" if more else document_fault(PolicyDocument, {**packed["policy"], **of_bundle})
    if fault:
        raise PolicyError(f"{path}: policy: {fault}")
    for behaviour in packed["policy"]["behaviours"]:
        if behaviour.get("state_values", behaviour) is None:
            raise PolicyError(f"{path}: policy: behaviours: state_values is empty, expected a mapping or no such key")
    names = [item[0] for part in packed["parts"] for item in part["arrays"]]
    if len(set(names)) < len(names):
        raise PolicyError(f"{path}: parts: two arrays have one name, expected each once")
    kept = {_kept_name(behaviour) for behaviour in packed["policy"]["behaviours"]}
    optional = {name for group in GROUPS if set(group) & set(names) for name in group}
    optional |= {DEFENCE} & set(names)
    wanted = {name for name in TABLE if name not in ("values", STATE_VALUES, DEFENCE, *BEHIND)} | kept | optional
    if set(names) != wanted:
        odd = sorted(set(names) ^ wanted)[0]
        what = "lack" if odd in wanted else "hold"
        raise PolicyError(f"{path}: parts: {what} an array {odd!r}, expected every array of a packed policy")


def check_unpacked(path: Path, document: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Raise a ``PolicyError`` if an array of a packed policy is not what it must be, before any is used."""
    stored = np.dtype(STORED[document["recipe"]["precision"]])
    entries = sum(behaviour["entries"] for behaviour in document["behaviours"])
    if entries > _MOST_ENTRIES:
        raise PolicyError(f"{path}: policy: behaviours: have {entries:,} entries, expected at most {_MOST_ENTRIES:,}")
    plain = {name: array for name, array in arrays.items() if name in TABLE}
    try:
        # The tables are checked when the bundle is read; only their lengths matter here.
        check_flattened(document, {**plain, "values": np.zeros(entries, stored)})
        for behaviour in document["behaviours"]:
            _check_kept(behaviour, arrays, stored)
    except ArrayFault as fault:
        raise PolicyError(f"{path}: array {fault}") from None


def _check_kept(behaviour: Mapping[str, Any], arrays: Mapping[str, Array], stored: np.dtype[Any]) -> None:
    """Hold what is kept of a behaviour's table against what it must be."""
    name = _kept_name(behaviour)
    kept, states = arrays[name], arrays["graph_state_frames"].size
    shape = tuple(axis["count"] for axis in behaviour["axes"])
    computed = "state_values" in behaviour
    halves = [] if states % 2 else [(states // 2, *shape)]
    shapes = [(states, *shape), *halves]
    if not computed:
        shapes = [(behaviour["entries"],), *(shapes if behaviour["entries"] == states * math.prod(shape) else [])]
    kinds = {np.dtype(np.uint16)} if computed else {stored}
    if kept.shape not in shapes or kept.dtype not in kinds:
        words = " or ".join(map(str, shapes))
        raise ArrayFault(name, f"is {kept.dtype}{kept.shape}, expected {min(map(str, kinds))} of shape {words}")


def decompress(file: Path, content: bytes, size: int) -> bytes:
    """Return what a compressed file holds; no more of it is read than should be there.

    Raises:
        PolicyError: It is damaged, or holds another number of bytes.
    """
    if size > _MOST_UNPACKED:
        raise PolicyError(f"{file}: would hold {size:,} bytes, expected at most {_MOST_UNPACKED:,}")
    stream = lzma.LZMADecompressor(lzma.FORMAT_XZ)
    try:
        data = stream.decompress(content, size + 1)
        # The end of the stream may be behind the last byte.
        data += b"" if stream.eof else stream.decompress(b"", 1)
    except (lzma.LZMAError, EOFError) as error:
        raise PolicyError(f"{file}: damaged: {error}") from None
    if len(data) != size or not stream.eof or stream.unused_data:
        raise PolicyError(f"{file}: damaged: holds another number of bytes than {size:,}, which its arrays have")
    return data
