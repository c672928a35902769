"""The manifest of a run: what was run, on what, how long it took, and a checksum of every file."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path
from typing import Any

from crowdsim import __version__
from crowdsim.errors import OutputError, TakeError

NAME = "manifest.json"
FORMAT = "crowdsim-run"
VERSION = 1
_TAKE = "take.zarr/"
_PACKAGES = ("numpy", "scipy", "numba", "zarr", "pydantic", "open3d-cpu", "open3d", "imageio-ffmpeg")


def describe_machine() -> dict[str, Any]:
    """Return what a run's figures depend on: processor, system, Python and packages."""
    versions = {"crowdsim": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return {
        "versions": versions,
        "machine": {
            "system": platform.platform(),
            "processor": _processor(),
            "cores": os.cpu_count(),
        },
    }


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def peak_memory() -> int | None:
    """Return the most memory that this process has held [bytes]; None where the system does not tell."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def available_memory() -> int | None:
    """Return how much memory is free for programs [bytes]; None where the system does not tell."""
    try:
        with open("/proc/meminfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
    except (OSError, ValueError):
        pass
    return None


def checksums(folder: Path, paths: Iterable[Path] | None = None, threads: int = 1) -> dict[str, dict[str, Any]]:
    """Return size and SHA-256 of files of a run folder, by path; of all but the manifest when None is given."""
    chosen = sorted(_files(folder) if paths is None else paths)
    chosen = [path for path in chosen if path != folder / NAME]
    with ThreadPoolExecutor(max(1, threads)) as pool:
        hashes = list(pool.map(_hash, chosen))
    return {
        path.relative_to(folder).as_posix(): {"bytes": path.stat().st_size, "sha256": told}
        for path, told in zip(chosen, hashes, strict=True)
    }


def _files(folder: Path) -> Iterable[Path]:
    return (path for path in folder.rglob("*") if path.is_file())


def _hash(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def write_manifest(folder: Path, told: Mapping[str, Any], files: Mapping[str, Mapping[str, Any]]) -> Path:
    """Write a run's manifest, which is the only proof that it is done.

    Args:
        folder: The run folder.
        told: What a reader should know of the run.
        files: Its files, as ``checksums`` gives them.

    Raises:
        OutputError: It cannot be written.
    """
    return _write(folder, {"format": FORMAT, "version": VERSION, **told, **describe_machine(), "files": files})


def update_manifest(
    folder: Path, kind: str, written: Sequence[Path], told: Mapping[str, Any], threads: int = 1
) -> list[Path]:
    """Note in a finished run's manifest that the files of an output have been written anew.

    Args:
        folder: The run folder.
        kind: Folder of the output in it, ``bvh`` say.
        written: Its files.
        told: What a reader should know of them.
        threads: Threads that sum up files.

    Returns:
        Files of that output that were there before, were not written anew, and have been removed.

    Raises:
        TakeError: The manifest is damaged.
        OutputError: It cannot be written.
    """
    document = read_manifest(folder)
    files = {name: facts for name, facts in document["files"].items() if not name.startswith(f"{kind}/")}
    before = {folder / name for name in document["files"]} - {folder / name for name in files}
    stale = sorted(before - set(written))
    for path in stale:
        path.unlink(missing_ok=True)
    files.update(checksums(folder, written, threads))
    exports = {**document.get("exports", {}), kind: dict(told)}
    _write(folder, {**document, "exports": exports, "files": dict(sorted(files.items()))})
    return stale


def _write(folder: Path, document: Mapping[str, Any]) -> Path:
    path = folder / NAME
    partial = folder / f".{NAME}.part"
    rest = {key: value for key, value in document.items() if key != "checksum"}
    try:
        partial.write_text(_text({**rest, "checksum": _checksum(rest)}), encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _text(document: Mapping[str, Any]) -> str:
    return json.dumps(document, indent=1) + "\n"


def _checksum(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of what a manifest says, without its own."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return a run's manifest.

    Raises:
        TakeError: There is none, or it is damaged, foreign or of another version.
    """
    path = folder / NAME
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise TakeError(f"{folder}: no {NAME} here, so this is no finished run") from None
    except (OSError, ValueError) as error:
        raise TakeError(f"{path}: is damaged: {error}") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise TakeError(f"{path}: is no manifest of a run")
    if document.get("version") != VERSION:
        raise TakeError(f"{path}: is of version {document.get('version')!r}, expected {VERSION}")
    if document.get("checksum") != _checksum(document):
        raise TakeError(f"{path}: is damaged: its checksum does not fit what it says")
    return document


def verify(folder: Path, threads: int = 1) -> tuple[list[str], list[str]]:
    """Hold a run folder against its manifest.

    Returns:
        What differs, a line each, and the files that have come since, such as pictures that were drawn later. A file
        that has come into the take differs, since a take reads all files in its folder.

    Raises:
        TakeError: There is no manifest to hold it against.
    """
    document = read_manifest(folder)
    recorded = document["files"]
    with ThreadPoolExecutor(max(1, threads)) as pool:
        found = list(pool.map(lambda item: _differs(folder / item[0], item[1]), recorded.items()))
    findings = [finding for finding in found if finding]
    if (folder / NAME).read_text(encoding="utf-8") != _text(document):
        findings.append(f"{folder / NAME}: has changed: it is not as it was written")
    names = {path.relative_to(folder).as_posix() for path in _files(folder)} - {NAME}
    more = sorted(names - set(recorded))
    findings.extend(f"{folder / name}: is not in {NAME}" for name in more if name.startswith(_TAKE))
    return findings, [name for name in more if not name.startswith(_TAKE)]


def _differs(path: Path, told: Mapping[str, Any]) -> str:
    """Say how a file differs from what was recorded of it; an empty text when it does not."""
    try:
        size = path.stat().st_size
        if size != told["bytes"]:
            return f"{path}: has {size} bytes, expected {told['bytes']}"
        if _hash(path) != told["sha256"]:
            return f"{path}: has changed: its SHA-256 is not the one in {NAME}"
    except FileNotFoundError:
        return f"{path}: is missing"
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror or error}"
    return ""
