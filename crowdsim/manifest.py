"""The manifest of a run: what was run, on what, how long it took, and a checksum of every file."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from crowdsim import __version__
from crowdsim.errors import OutputError, TakeError

NAME = "manifest.json"
FORMAT = "crowdsim-run"
VERSION = 1
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


def checksums(folder: Path) -> dict[str, dict[str, Any]]:
    """Return size and SHA-256 of every file of a run folder but the manifest, by path, in order."""
    told = {}
    for path in sorted(_files(folder)):
        name = path.relative_to(folder).as_posix()
        if name != NAME:
            told[name] = {"bytes": path.stat().st_size, "sha256": _hash(path)}
    return told


def _files(folder: Path) -> Iterable[Path]:
    return (path for path in folder.rglob("*") if path.is_file())


def _hash(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def write_manifest(folder: Path, told: Mapping[str, Any]) -> Path:
    """Write a run's manifest, which is the only proof that it is done; files are summed up here.

    Raises:
        OutputError: It cannot be written.
    """
    document = {"format": FORMAT, "version": VERSION, **told, **describe_machine(), "files": checksums(folder)}
    path = folder / NAME
    partial = folder / f".{NAME}.part"
    try:
        partial.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


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
    return document


def verify(folder: Path) -> list[str]:
    """Return what differs between a run folder and its manifest, a line each; an empty list when nothing does.

    Raises:
        TakeError: There is no manifest to hold it against.
    """
    recorded = read_manifest(folder)["files"]
    findings = []
    for name, told in recorded.items():
        path = folder / name
        if not path.is_file():
            findings.append(f"{path}: is missing")
        elif path.stat().st_size != told["bytes"]:
            findings.append(f"{path}: has {path.stat().st_size} bytes, expected {told['bytes']}")
        elif _hash(path) != told["sha256"]:
            findings.append(f"{path}: has changed: its SHA-256 is not the one in {NAME}")
    names = {path.relative_to(folder).as_posix() for path in _files(folder)} - {NAME}
    findings.extend(f"{folder / name}: is not in {NAME}" for name in sorted(names - set(recorded)))
    return findings
