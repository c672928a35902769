"""Trained bundles: a folder of ``policy.json`` and ``.npy`` arrays, written whole or not at all, checked on reading.

``policy.json`` holds the format version, fingerprints, the resolved recipe, parameters, statistics, size and SHA-256 of
every array, and a checksum of itself. The times that training took are in ``timings.json``, which nothing depends on,
so that all else has the same bytes whenever the same thing is trained. Arrays are mapped into memory, never unpickled.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from crowdsim.core.types import Array, FileName
from crowdsim.errors import OutputError, PolicyError, VersionError
from crowdsim.graph.motion_graph import MotionGraph
from crowdsim.motion.body import Body
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.skeleton import Skeleton
from crowdsim.policy.actions import Actions
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.rewards import AnyTerm, TargetBody

KIND = "crowdsim policy"
VERSION = 1
"""Raise it when a bundle of before can no longer be read."""


def write_bundle(folder: Path, policy: Policy, timings: Mapping[str, Any]) -> None:
    """Write a policy to a folder, replacing an older bundle.

    Everything is written to a temporary folder beside it, which is renamed at the end.

    Raises:
        OutputError: It cannot be written; nothing is left behind.
    """
    folder = Path(folder)
    if folder.exists() and not (folder / "policy.json").is_file() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{folder}: is no trained policy, so it is not overwritten; expected a free name")
    fresh, old = (folder.with_name(f".{folder.name}.{word}-{os.getpid()}") for word in ("new", "old"))
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh.mkdir()
        _write(fresh, policy, timings)
        if folder.exists():
            os.replace(folder, old)
        os.replace(fresh, folder)
    except OSError as error:
        if old.exists() and not folder.exists():
            os.replace(old, folder)
        raise OutputError(f"{error.filename or folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def _write(folder: Path, policy: Policy, timings: Mapping[str, Any]) -> None:
    arrays: dict[str, Array] = {}
    database = _split(policy.database, "database", arrays)
    document: dict[str, Any] = {
        "kind": KIND,
        "version": VERSION,
        "name": policy.name,
        "fingerprint": policy.fingerprint,
        "fingerprints": dict(policy.fingerprints),
        "units": {"length": "m", "time": "s", "angle": "rad"},
        "recipe": dict(policy.recipe),
        "database": database,
        "skeleton": _split(policy.database.skeleton, "skeleton", arrays),
        "body": _split(policy.database.body, "body", arrays),
        "graph": _split(policy.graph, "graph", arrays),
        "target": policy.body.model_dump(),
        "behaviours": [_describe(behaviour) for behaviour in policy.behaviours],
        "statistics": dict(policy.statistics),
    }
    for name, array in zip(policy.actions._fields, policy.actions, strict=True):
        arrays[f"actions_{name}"] = array
    stored = []
    for behaviour, report in zip(policy.behaviours, document["behaviours"], strict=True):
        report["stored_low"], report["stored_step"] = behaviour.low, behaviour.step
        stored.append(
            behaviour.table.astype(np.float16) if policy.recipe["precision"] == "float16" else behaviour.table
        )
    arrays["values"] = np.concatenate(stored)
    files = {}
    for name, array in sorted(arrays.items()):
        path = folder / f"{name}.npy"
        np.save(path, np.ascontiguousarray(array), allow_pickle=False)
        files[path.name] = {"size": path.stat().st_size, "sha256": file_hash(path)}
    document["files"] = files
    document["checksum"] = _checksum(document)
    (folder / "policy.json").write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    (folder / "timings.json").write_text(json.dumps(dict(timings), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def load_policy(folder: FileName) -> Policy:
    """Return the policy in a folder; its arrays are mapped into memory, where changes stay.

    Raises:
        PolicyError: There is none, or it is foreign, of another version or damaged: which file, and which check.
    """
    folder = Path(folder)
    document = read_document(folder)
    arrays = {Path(name).stem: _map(folder / name, facts) for name, facts in document["files"].items()}
    try:
        return _assemble(folder, document, arrays)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise PolicyError(f"{folder / 'policy.json'}: does not describe its arrays: {error}") from None


def read_document(folder: FileName) -> dict[str, Any]:
    """Return the plain data in ``policy.json`` once it has passed its checks.

    Raises:
        VersionError: It is of another format version.
        PolicyError: There is none, or it is foreign or damaged.
    """
    path = Path(folder) / "policy.json"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise PolicyError(f"{path}: no such file, expected a trained policy; train one with: crowdsim train") from None
    except OSError as error:
        raise PolicyError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise PolicyError(f"{path}: damaged: is no JSON ({error})") from None
    if not isinstance(document, dict) or document.get("kind") != KIND:
        raise PolicyError(f"{path}: foreign: its kind is not {KIND!r}")
    if document.get("version") != VERSION:
        raise VersionError(
            f"{path}: its format version is {document.get('version')!r}, expected {VERSION}; train it again"
        )
    if document.get("checksum") != _checksum(document):
        raise PolicyError(f"{path}: damaged: its checksum does not match its contents; train it again")
    return document


def read_timings(folder: FileName) -> dict[str, Any]:
    """Return what training took, by behaviour; an empty mapping where that is not known."""
    try:
        report = json.loads((Path(folder) / "timings.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return report if isinstance(report, dict) else {}


def encode(values: Array, precision: str) -> tuple[Array, float, float]:
    """Return values as control reads them, what an entry of 0 is worth, and what one more is.

    ``float16`` keeps as many digits in the bundle and is read as float32; ``int8`` and ``int16`` make 256 and 65,536
    steps between the lowest and the highest value, which are also read.
    """
    if precision not in ("int8", "int16"):
        rounded = values.astype(np.float16) if precision == "float16" else values
        return rounded.astype(np.float32), 0.0, 1.0
    kind = np.uint8 if precision == "int8" else np.uint16
    low, high = float(values.min()), float(values.max())
    step = (high - low) / np.iinfo(kind).max or 1.0
    return np.rint((values - low) / step).astype(kind), low, step


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


def _map(path: Path, facts: Mapping[str, Any]) -> Array:
    """Return an array of a bundle, mapped into memory, once size and checksum fit."""
    try:
        size = path.stat().st_size
    except OSError:
        raise PolicyError(f"{path}: no such file, but policy.json lists it; train the policy again") from None
    if size != facts["size"]:
        raise PolicyError(f"{path}: damaged: has {size} bytes, expected {facts['size']}; train the policy again")
    if file_hash(path) != facts["sha256"]:
        raise PolicyError(f"{path}: damaged: its SHA-256 is not the one in policy.json; train the policy again")
    try:
        # Copy on write: compiled code sees the same kind of array as in training, and the file cannot change.
        array = np.load(path, mmap_mode="c", allow_pickle=False)
    except ValueError:
        array = np.load(path, allow_pickle=False)  # an array without entries cannot be mapped
    return np.asarray(array)


def _split(thing: Any, prefix: str, arrays: dict[str, Array]) -> dict[str, Any]:
    """Return the plain fields of a dataclass, and put its arrays with the others."""
    report: dict[str, Any] = {}
    for field in dataclasses.fields(thing):
        value = getattr(thing, field.name)
        if isinstance(value, np.ndarray):
            arrays[f"{prefix}_{field.name}"] = value
        elif not dataclasses.is_dataclass(value):
            report[field.name] = dict(value) if isinstance(value, Mapping) else value
    return report


def _join(kind: type[Any], prefix: str, report: Mapping[str, Any], arrays: Mapping[str, Array], **parts: Any) -> Any:
    """Return a dataclass from its plain fields, its arrays, and other dataclasses."""
    values = dict(parts)
    for field in dataclasses.fields(kind):
        if f"{prefix}_{field.name}" in arrays:
            values[field.name] = arrays[f"{prefix}_{field.name}"]
        elif field.name in report:
            value = report[field.name]
            values[field.name] = tuple(value) if isinstance(value, list) else value
    return kind(**values)


def _describe(behaviour: Behaviour) -> dict[str, Any]:
    return {
        "name": behaviour.name,
        "axes": [dataclasses.asdict(axis) for axis in behaviour.grid.axes],
        "lookup": behaviour.lookup,
        "entries": len(behaviour.table),
        "scale": behaviour.scale,
        "rewards": [term.model_dump() for term in behaviour.terms],
        "discount": behaviour.discount,
    }


def _assemble(folder: Path, document: Mapping[str, Any], arrays: Mapping[str, Array]) -> Policy:
    skeleton = _join(Skeleton, "skeleton", document["skeleton"], arrays)
    body = _join(Body, "body", document["body"], arrays)
    database = _join(MotionDatabase, "database", document["database"], arrays, skeleton=skeleton, body=body)
    graph = _join(MotionGraph, "graph", document["graph"], arrays)
    actions = Actions(*(arrays[f"actions_{name}"] for name in Actions._fields))
    terms: TypeAdapter[Any] = TypeAdapter(tuple[AnyTerm, ...])
    stored = arrays["values"]
    values = stored.astype(np.float32) if stored.dtype == np.float16 else stored
    behaviours, first = [], 0
    for report in document["behaviours"]:
        end = first + report["entries"]
        grid = build_grid(Axis(**axis) for axis in report["axes"])
        expected = grid.cells * (actions.action_count if report["lookup"] == "q" else actions.state_count)
        if report["entries"] != expected or end > len(values):
            what = f"holds {report['entries']} entries for {report['name']!r}, expected {expected}"
            raise PolicyError(f"{folder / 'values.npy'}: {what}")
        behaviours.append(
            Behaviour(
                name=report["name"],
                grid=grid,
                lookup=report["lookup"],
                table=values[first:end],
                scale=report["scale"],
                terms=terms.validate_python(report["rewards"]),
                discount=report["discount"],
                low=report["stored_low"],
                step=report["stored_step"],
            )
        )
        first = end
    return Policy(
        name=document["name"],
        database=database,
        graph=graph,
        actions=actions,
        behaviours=tuple(behaviours),
        body=TargetBody(**document["target"]),
        values=values,
        recipe=document["recipe"],
        statistics=document["statistics"],
        fingerprint=document["fingerprint"],
        fingerprints=document["fingerprints"],
    )
