"""Trained bundles: a folder of ``policy.json`` and ``.npy`` arrays, written whole or not at all, checked on reading.

``policy.json`` holds the format version, fingerprints, the resolved recipe, parameters, statistics, size and SHA-256 of
every array, and a checksum of itself. The times that training took are in ``timings.json``, which nothing depends on,
so that all else has the same bytes whenever the same thing is trained. Arrays are mapped into memory, never unpickled.

A bundle may come from a stranger, who signs what he likes. Reading it once holds ``policy.json`` against the model in
``document``, and every array against its row of the table in ``checks``: type, shape, ranges, and that indices lead to
what is there. Nothing behind that checks an index again.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import shutil
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.array_checks import ArrayFault
from crowdsim.config.documents import document_fault, parse_json
from crowdsim.core.types import Array, FileName
from crowdsim.errors import OutputError, PolicyError, VersionError
from crowdsim.files import open_plain, replace_folder, restore_folder, stat_plain
from crowdsim.policy.checks import BEHIND, DEFENCE, STATE_VALUES, TABLE
from crowdsim.policy.document import PolicyDocument, Timings
from crowdsim.policy.flattening import assemble_policy, check_flattened, flatten_policy
from crowdsim.policy.policy import Policy

KIND = "crowdsim policy"
VERSION = 1
"""Raise it when a bundle of before can no longer be read."""
_MOST_BYTES = 1 << 26
"""Longest document that is read [bytes]."""


def write_bundle(folder: Path, policy: Policy, timings: Mapping[str, Any]) -> None:
    """Write a policy to a folder, replacing an older bundle.

    Everything is written to a temporary folder beside it, which is renamed at the end.

    Raises:
        OutputError: It cannot be written; nothing is left behind.
    """
    write_arrays(folder, *flatten_policy(policy), timings)


def write_arrays(
    folder: Path, document: Mapping[str, Any], arrays: Mapping[str, Array], timings: Mapping[str, Any]
) -> None:
    """Write what ``flatten_policy`` returned, as ``write_bundle`` does."""
    folder = Path(folder)
    check_name(folder)
    fresh, old = (folder.with_name(f".{folder.name}.{word}-{os.getpid()}") for word in ("new", "old"))
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh.mkdir()
        _write(fresh, document, arrays, timings)
        replace_folder(fresh, folder, old)
    except OSError as error:
        raise OutputError(f"{error.filename or folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def check_name(folder: Path) -> None:
    """Raise an ``OutputError`` if there is something else than a bundle where one is to be written."""
    if folder.exists() and not (folder / "policy.json").is_file() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{folder}: is no trained policy, so it is not overwritten; expected a free name")


def tidy(folder: Path) -> bool:
    """Remove what processes have left that were killed while they wrote a bundle; return whether one was brought back.

    Only the process that holds the bundle's lock may do this.
    """
    restored = False
    for old in sorted(folder.parent.glob(f".{folder.name}.old-*")):
        with suppress(OSError):
            restored |= restore_folder(folder, old)
    for left in folder.parent.glob(f".{folder.name}.*-*"):
        if re.fullmatch(r"(?:new|old)-\d+", left.name[len(folder.name) + 2 :]) and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)
    return restored


def _write(folder: Path, described: Mapping[str, Any], arrays: Mapping[str, Array], timings: Mapping[str, Any]) -> None:
    document = {"kind": KIND, "version": VERSION, **described}
    files = {}
    for name, array in sorted(arrays.items()):
        path = folder / f"{name}.npy"
        np.save(path, np.ascontiguousarray(array), allow_pickle=False)
        files[path.name] = {"size": path.stat().st_size, "sha256": file_hash(path)}
    document["files"] = files
    text = json.dumps(with_checksum(document), indent=1, allow_nan=False)
    (folder / "policy.json").write_text(text + "\n", encoding="utf-8")
    (folder / "timings.json").write_text(json.dumps(dict(timings), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def load_policy(folder: FileName) -> Policy:
    """Return the policy in a folder; its arrays are mapped into memory, where changes stay.

    Raises:
        PolicyError: There is none, or it is foreign, of another version or damaged: which file, and which check.
    """
    folder = Path(folder)
    document = read_document(folder)
    arrays = map_arrays(folder, document, (STATE_VALUES,))
    try:
        check_flattened(document, arrays)
    except ArrayFault as fault:
        raise PolicyError(f"{folder / fault.name}.npy: {fault.what}") from None
    return assemble_policy(document, arrays)


def map_arrays(folder: Path, document: Mapping[str, Any], but: Collection[str] = ()) -> dict[str, Array]:
    """Return the arrays of the bundle in a folder by name, all but some, mapped into memory, where changes stay.

    Raises:
        PolicyError: One is missing, damaged, or no array of a bundle.
    """
    named = {name.removesuffix(".npy"): (name, facts) for name, facts in document["files"].items()}
    for name in TABLE:
        if name not in named and name not in (STATE_VALUES, DEFENCE, *BEHIND):
            raise PolicyError(f"{folder / 'policy.json'}: files: lacks {name}.npy, expected every array of a bundle")
    return {name: _map(folder, *file) for name, file in named.items() if name not in but}


def read_document(folder: FileName) -> dict[str, Any]:
    """Return the plain data in ``policy.json`` once it has passed its checks.

    Raises:
        VersionError: It is of another format version.
        PolicyError: There is none, or it is foreign or damaged.
    """
    path = Path(folder) / "policy.json"
    if not path.exists():
        raise PolicyError(f"{path}: no such file, expected a trained policy; train one with: crowdsim train")
    document = read_checked(path, KIND, VERSION, "train it again")
    fault = document_fault(PolicyDocument, document)
    if fault:
        raise PolicyError(f"{path}: {fault}")
    return document


def read_checked(path: Path, kind: str, version: int, remedy: str) -> dict[str, Any]:
    """Return the plain data in a JSON file with a checksum of itself, which ``with_checksum`` returned.

    Errors say the ``remedy``: what to do where it cannot be read.

    Raises:
        VersionError: It is of another format version.
        PolicyError: It is foreign or damaged.
    """
    try:
        with open_plain(path.parent, path.name) as file:
            data = file.read(_MOST_BYTES + 1)
        if len(data) > _MOST_BYTES:
            raise PolicyError(f"{path}: has more than {_MOST_BYTES} bytes, too many for what it is")
        document = parse_json(data.decode("utf-8"))
    except OSError as error:
        raise PolicyError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise PolicyError(f"{path}: damaged: is no JSON ({error})") from None
    if not isinstance(document, dict) or document.get("kind") != kind:
        raise PolicyError(f"{path}: foreign: its kind is not {kind!r}")
    if document.get("version") != version:
        raise VersionError(f"{path}: its format version is {document.get('version')!r}, expected {version}; {remedy}")
    if document.get("checksum") != _checksum(document):
        raise PolicyError(f"{path}: damaged: its checksum does not match its contents; {remedy}")
    return document


def with_checksum(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain data with a checksum of itself."""
    return {**document, "checksum": _checksum(document)}


def read_timings(folder: FileName) -> dict[str, Any]:
    """Return what training took, by behaviour; an empty mapping where that is not known."""
    try:
        with open_plain(Path(folder), "timings.json") as file:
            report = parse_json(file.read(_MOST_BYTES).decode("utf-8"))
    except (OSError, ValueError):
        return {}
    return {} if document_fault(Timings, report) else dict(report)


def encode(values: Array, precision: str) -> tuple[Array, float, float]:
    """Return values as control reads them, what an entry of 0 is worth, and what one more is.

    ``float16`` keeps as many digits in the bundle and is read as float32; ``int8`` and ``int16`` make 256 and 65,536
    steps between the lowest and the highest value, which are also read.
    """
    if precision not in ("int8", "int16"):
        rounded = values.astype(np.float16) if precision == "float16" else values
        return rounded.astype(np.float32), 0.0, 1.0
    return whole_steps(values, 255 if precision == "int8" else 65535)


def whole_steps(values: Array, count: int) -> tuple[Array, float, float]:
    """Return values in so many equal steps, what an entry of 0 is worth, and what one more is."""
    low, high = float(values.min()), float(values.max())
    step = (high - low) / count or 1.0
    return np.rint((values - low) / step).astype(np.uint8 if count < 256 else np.uint16), low, step


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def canonical(document: Any) -> str:
    """Return plain data as JSON that is the same for the same data."""
    return json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _checksum(document: Mapping[str, Any]) -> str:
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(canonical(rest).encode()).hexdigest()


def _map(folder: Path, name: str, facts: Mapping[str, Any]) -> Array:
    """Return an array of a bundle, mapped into memory, once size, checksum and header fit."""
    path = folder / name
    try:
        size = stat_plain(folder, name).st_size
    except FileNotFoundError:
        raise PolicyError(f"{path}: no such file, but policy.json lists it; train the policy again") from None
    except OSError as error:
        raise PolicyError(f"{path}: {error.strerror or error}") from None
    if size != facts["size"]:
        raise PolicyError(f"{path}: damaged: has {size} bytes, expected {facts['size']}; train the policy again")
    if file_hash(path) != facts["sha256"]:
        raise PolicyError(f"{path}: damaged: its SHA-256 is not the one in policy.json; train the policy again")
    dtype, shape, start = _read_header(path)
    if start + dtype.itemsize * math.prod(shape) != size:
        raise PolicyError(f"{path}: has {size} bytes, too few or too many for {dtype.name}{shape}")
    if not math.prod(shape):
        return np.empty(shape, dtype)  # which cannot be mapped
    # Copy on write: compiled code sees the same kind of array as in training, and the file cannot change.
    return np.asarray(np.memmap(path, dtype, "c", start, shape))


def _read_header(path: Path) -> tuple[np.dtype[Any], tuple[int, ...], int]:
    """Return type and shape of the array in a file, and where its entries begin."""
    with open(path, "rb") as file:
        head = file.read(len(_MAGIC) + 2)
        count = int.from_bytes(head[len(_MAGIC) :], "little")
        found = _HEADER.fullmatch(file.read(count)) if head.startswith(_MAGIC) else None
    if found is None:
        raise PolicyError(f"{path}: is no array of numbers in C order as NumPy writes it")
    shape = tuple(int(size) for size in re.findall(rb"\d+", found[2]))
    return np.dtype(found[1].decode()), shape, len(_MAGIC) + 2 + count


_MAGIC = b"\x93NUMPY\x01\x00"
_HEADER = re.compile(
    rb"\{'descr': '(<[iuf][248]|\|[biu]1)', 'fortran_order': False, "
    rb"'shape': \(((?:\d{1,18}, ?)*(?:\d{1,18})?)\), \} *\n"
)
"""What the files of arrays begin with (NEP 1), and the text behind that."""
