"""Mutants of files: a bundle, a run or its archive is copied, a file in it changed, and all checksums made to fit."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mutants import Rng, mutate_array, mutate_json
from numcodecs.zstd import Zstd

from crowdsim.errors import CrowdsimError
from crowdsim.policy.bundle import load_policy, read_timings, with_checksum
from crowdsim.runs.archive import opened
from crowdsim.runs.checkpoint import read_checkpoint
from crowdsim.runs.manifest import NOTE, RUN, checksums, signed_manifest, signed_text, verify
from crowdsim.runs.opening import open_run
from crowdsim.runs.stage import complete
from crowdsim.runs.status import describe_run


class Using(Protocol):
    """What is done with what could be read, see ``runnable.Base``."""

    folder: Path

    def use_policy(self, document: Any, arrays: Any) -> None:
        """Use a policy."""

    def use_take(self, take: Any) -> None:
        """Use a take."""

    def use_read_policy(self, policy: Any) -> None:
        """Use a policy that was read."""


def run_on_disk(base: Using, kind: str, seed: int | None) -> None:
    """Make a mutant of files, read it, and use what could be read; with no seed nothing is changed.

    Raises:
        CrowdsimError: It was refused.
    """
    with tempfile.TemporaryDirectory(dir=base.folder, prefix="mutant-") as place:
        folder = Path(place)
        rng = None if seed is None else np.random.default_rng(seed)
        if kind == "bundle files":
            shutil.copytree(base.folder / "policies" / "tiny", folder / "tiny")
            if rng is not None:
                change_bundle(rng, folder / "tiny")
            read_timings(folder / "tiny")
            base.use_read_policy(load_policy(folder / "tiny"))
            return
        shutil.copytree(base.folder / "run", folder / "run")
        shutil.copytree(base.folder / "policies" / "tiny", folder / "run" / "policies" / "tiny")
        sign(folder / "run")
        if rng is not None:
            change_run(rng, folder / "run")
        if kind == "archive":
            _zip(rng, folder / "run", folder / "run.zip")
            with opened(folder / "run.zip") as unpacked:
                _use_run(base, unpacked)
        else:
            _use_run(base, folder / "run")


def _use_run(base: Using, folder: Path) -> None:
    """Do what commands do with a run, each as if it were alone."""
    describe_run(folder)
    for read in (verify, lambda run: read_checkpoint(run, 100, 1_000_000), complete, verify):
        with suppress(CrowdsimError):
            read(folder)
    base.use_take(open_run(folder))


def change_bundle(rng: Rng, folder: Path) -> None:
    """Change a file of a bundle, and make its checksums fit."""
    names = sorted(path.name for path in folder.iterdir())
    name = "policy.json" if rng.random() < 0.3 else names[int(rng.integers(len(names)))]
    path = folder / name
    if path.suffix == ".npy" and rng.random() < 0.5:
        np.save(path, mutate_array(rng, np.load(path)), allow_pickle=False)
    elif path.suffix == ".npy":
        change_bytes(rng, path, 200)
    document = json.loads((folder / "policy.json").read_text())
    if name == "policy.json":
        change = mutate_json(rng, document)
        if not isinstance(change, dict):
            path.write_text(json.dumps(change))
            return
        document = change
    elif name == "timings.json":
        path.write_text(json.dumps(mutate_json(rng, json.loads(path.read_text()))))
    if isinstance(document.get("files"), dict) and isinstance(document["files"].get(name), dict):
        document["files"][name] = {"size": path.stat().st_size, "sha256": _hash(path)}
    with suppress(ValueError):
        (folder / "policy.json").write_text(json.dumps(with_checksum(document)))


def change_run(rng: Rng, folder: Path) -> None:
    """Change a file of a run, and make its checksums fit."""
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    names = [name for name in names if not name.startswith("policies/")]
    how = rng.random()
    name = names[int(rng.integers(len(names)))]
    name = "checkpoint.bin" if how < 0.15 else name
    path, changes = folder / name, {"checkpoint.bin": _change_checkpoint, "manifest.json": _change_manifest}
    if name in changes:
        changes[name](rng, path)
    elif path.name.startswith(".z") and rng.random() < 0.8:
        path.write_text(json.dumps(mutate_json(rng, json.loads(path.read_text()))))
    elif path.parent.parent.name in ("take.zarr", "events") and not path.name.startswith(".") and rng.random() < 0.8:
        _change_chunk(rng, path)
    else:
        change_bytes(rng, path, path.stat().st_size)
    if name != "manifest.json":
        sign(folder)
    if how > 0.8:
        _add_stage(rng, folder)


def _add_stage(rng: Rng, folder: Path) -> None:
    """Add a folder of a command that was killed while it put files in their places, with its note or list changed."""
    stage = folder / RUN
    (stage / "bvh").mkdir(parents=True)
    (stage / "bvh" / "red_0.bvh").write_text("HIERARCHY")
    note = {"format": "crowdsim-stage", "key": "a", "boot": "b", "planned": {"bvh": 1}, "origin": {}}
    listed = {
        **json.loads((folder / "manifest.json").read_text()),
        "files": checksums(folder, ["scenario.resolved.yaml"]),
    }
    listed["files"]["bvh/red_0.bvh"] = {"bytes": 9, "sha256": _hash(stage / "bvh" / "red_0.bvh")}
    changed = [note, listed]
    which = int(rng.integers(2))
    changed[which] = mutate_json(rng, changed[which])
    for name, document, sign_it in ((NOTE, changed[0], signed_text), ("manifest.json", changed[1], signed_manifest)):
        if isinstance(document, dict) and rng.random() < 0.9:
            with suppress(ValueError):
                (stage / name).write_text(sign_it(document))


def sign(folder: Path) -> None:
    """Make the manifest of a run fit its files."""
    document = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(signed_manifest({**document, "files": checksums(folder)}))


def _change_chunk(rng: Rng, path: Path) -> None:
    facts = json.loads((path.parent / ".zarray").read_text())
    whole = np.frombuffer(Zstd().decode(path.read_bytes()), facts["dtype"]).reshape(facts["chunks"])
    path.write_bytes(Zstd(level=1).encode(np.ascontiguousarray(mutate_array(rng, whole)).tobytes()))


def _change_checkpoint(rng: Rng, path: Path) -> None:
    head, _, body = path.read_bytes().partition(b"\n")
    document = json.loads(head)
    changed = mutate_json(rng, document)
    document = changed if isinstance(changed, dict) else document
    document.pop("sha256", None)
    digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode())
    digest.update(body)
    path.write_bytes(json.dumps({**document, "sha256": digest.hexdigest()}).encode() + b"\n" + body)


def _change_manifest(rng: Rng, path: Path) -> None:
    changed = mutate_json(rng, json.loads(path.read_text()))
    path.write_text(signed_text(changed) if isinstance(changed, dict) else json.dumps(changed))


def change_bytes(rng: Rng, path: Path, within: int) -> None:
    """Flip bits among the first bytes of a file, cut it, or put other bytes in it."""
    data = bytearray(path.read_bytes())
    within = min(within, len(data))
    changes: tuple[Callable[[], Any], ...] = (
        lambda: data.__setitem__(int(rng.integers(within)), int(rng.integers(256))),
        lambda: data.__delitem__(slice(int(rng.integers(within)), None)),
        lambda: data.__setitem__(slice(0, int(rng.integers(1, 40))), rng.bytes(int(rng.integers(0, 40)))),
        lambda: data.extend(rng.bytes(int(rng.integers(1, 40)))),
    )
    for _ in range(int(rng.integers(1, 4))):
        if data:
            within = min(within, len(data))
            changes[min(int(rng.integers(6)), 3) if rng.random() < 0.5 else 0]()
    path.write_bytes(bytes(data))


def _zip(rng: Rng | None, folder: Path, out: Path) -> None:
    """Write an archive as ``crowdsim pack`` does, and now and then change bytes of it."""
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, path.relative_to(folder).as_posix())
    if rng is not None and rng.random() < 0.3:
        change_bytes(rng, out, out.stat().st_size)


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
