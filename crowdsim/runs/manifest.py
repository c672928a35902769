"""The manifest of a run: what was run, on what, how long it took, and a checksum of every file."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from crowdsim import __version__
from crowdsim.config.documents import document_fault, parse_json
from crowdsim.errors import TakeError
from crowdsim.files import NotPlainError, is_inside, open_plain, stat_plain, walk
from crowdsim.runs.journal import NAME as JOURNAL
from crowdsim.runs.journal import find_noted, read_journal
from crowdsim.runs.lock import LOCKS
from crowdsim.runs.manifest_model import RunManifest
from crowdsim.runs.signed_json import checksum, signed_text, text_of, write_signed

NAME = "manifest.json"
FORMAT = "crowdsim-run"
VERSION = 1
_TAKE = "take.zarr/"
_OWN = {NAME, JOURNAL, *LOCKS}
"""What is no result of a run: this list itself, and notes of what goes on."""
_PACKAGES = ("numpy", "scipy", "numba", "zarr", "pydantic", "open3d-cpu", "open3d", "imageio-ffmpeg")


class ForeignManifestError(TakeError):
    """A file of the manifest's name was written by another program."""


@cache
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
    """Return the most memory that this process has held [bytes]; None where the system does not report it."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def available_memory() -> int | None:
    """Return how much memory is free for programs [bytes]; None where the system does not report it."""
    try:
        with open("/proc/meminfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
    except (OSError, ValueError):
        pass
    return None


def checksums(folder: Path, names: Iterable[str] | None = None, threads: int = 1) -> dict[str, dict[str, Any]]:
    """Return size and SHA-256 of files of a run folder, by name; of all but the manifest when None is given.

    Raises:
        OSError: One is missing or no regular file, or cannot be read.
    """
    chosen = sorted(set(walk(folder) if names is None else names) - _OWN)
    with ThreadPoolExecutor(max(1, threads)) as pool:
        hashes = list(pool.map(lambda name: _hash(folder, name), chosen))
    return {name: {"bytes": size, "sha256": report} for name, (size, report) in zip(chosen, hashes, strict=True)}


def _hash(folder: Path, name: str) -> tuple[int, str]:
    """Return size and SHA-256 of a file."""
    digest, size = hashlib.sha256(), 0
    with open_plain(folder, name) as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
            size += len(block)
    return size, digest.hexdigest()


def write_manifest(folder: Path, report: Mapping[str, Any], files: Mapping[str, Mapping[str, Any]]) -> Path:
    """Write a run's manifest, which is the only proof that it is done.

    Args:
        folder: The run folder.
        report: What a reader should know of the run.
        files: Its files, as ``checksums`` gives them.

    Raises:
        OutputError: It cannot be written.
    """
    return _write(folder, {"format": FORMAT, "version": VERSION, **report, **describe_machine(), "files": files})


def update_manifest(
    folder: Path, kind: str, written: Sequence[str], report: Mapping[str, Any], threads: int = 1
) -> None:
    """Note in a finished run's manifest that files of an output have been written anew.

    Args:
        folder: The run folder.
        kind: Folder of the output in it, ``bvh`` say; ``pictures`` for those of the renderer.
        written: Names of the files in the run folder.
        report: What a reader should know of them.
        threads: Threads that sum up files.

    Raises:
        TakeError: The manifest is damaged.
        OSError: A file cannot be read.
        OutputError: The manifest cannot be written.
    """
    document = read_manifest(folder)
    files = dict(document["files"])
    files.update(checksums(folder, written, threads))
    exports = {**document.get("exports", {}), kind: dict(report)}
    _write(folder, {**document, "exports": exports, "files": dict(sorted(files.items()))})


def stage_manifest(
    folder: Path,
    staged: Path,
    kinds: Mapping[str, Sequence[str]],
    report: Mapping[str, Any],
    hashes: Mapping[str, Mapping[str, Any]],
) -> list[str]:
    """Write into a staging folder the manifest that a run will have when files of outputs have taken their places.

    Args:
        folder: The run folder; where it holds no manifest, none is written.
        staged: The staging folder.
        kinds: Names of all files of each folder of outputs.
        report: What a reader should know of them.
        hashes: Their sizes and checksums.

    Returns:
        Names of files of these folders that the manifest lists now, and that are no longer among them.

    Raises:
        TakeError: The manifest is damaged.
        OutputError: It cannot be written.
    """
    if not os.path.lexists(folder / NAME):
        return []
    document = read_manifest(folder)
    stale = {name for name in document["files"] if name.rpartition("/")[0] in kinds} - set(hashes)
    files = {name: facts for name, facts in document["files"].items() if name not in stale}
    exports = {**document.get("exports", {}), **{kind: dict(report) for kind in kinds}}
    _write(staged, {**document, "exports": exports, "files": dict(sorted({**files, **hashes}.items()))})
    return sorted(stale)


def signed_manifest(report: Mapping[str, Any]) -> str:
    """Return a manifest as it is written, of a report that has everything but the checksum."""
    return signed_text({**report, "format": FORMAT, "version": VERSION})


def _write(folder: Path, document: Mapping[str, Any]) -> Path:
    path = folder / NAME
    write_signed(path, folder / f".{NAME}.part", document)
    return path


def read_manifest(folder: Path, needed: Iterable[str] = ()) -> dict[str, Any]:
    """Return a run's manifest; what it names lies inside its folder.

    Args:
        folder: The run folder.
        needed: What it must hold beside its files.

    Raises:
        ForeignManifestError: Another program has written it.
        TakeError: There is none, or it is damaged or of another version, lacks something, or names what no run writes.
    """
    path = folder / NAME
    try:
        with open_plain(folder, NAME) as file:
            document = parse_json(file.read().decode("utf-8"))
    except FileNotFoundError:
        raise TakeError(f"{folder}: no {NAME} here, so this is no finished run") from None
    except NotPlainError as error:
        raise TakeError(f"{path}: {error.strerror}") from None
    except (OSError, ValueError) as error:
        raise TakeError(f"{path}: is damaged: {error}") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ForeignManifestError(f"{path}: is no manifest of a run")
    if document.get("version") != VERSION:
        raise TakeError(f"{path}: is of version {document.get('version')!r}, expected {VERSION}")
    if document.get("checksum") != checksum(document):
        raise TakeError(f"{path}: is damaged: its checksum does not fit what it says")
    fault = document_fault(RunManifest, document)
    if fault:
        raise TakeError(f"{path}: is damaged: {fault}")
    for name in needed:
        if name not in document:
            raise TakeError(f"{path}: is damaged: lacks {name!r}")
    for name in document["files"]:
        if not is_inside(name) or name in _OWN:
            raise TakeError(f"{path}: names {name!r}, expected only files that a run writes inside {folder}")
    return document


@dataclass(frozen=True)
class Verdict:
    """How a run folder differs from its manifest.

    Attributes:
        findings: What differs, a line each. A file that has come into the take differs too, since a take reads all
            files in its folder.
        unfinished: Names of files that an export or a rendering has begun and not finished.
        foreign: Names of other files, which crowdsim has not written.
    """

    findings: tuple[str, ...] = ()
    unfinished: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()


def verify(folder: Path, threads: int = 1) -> Verdict:
    """Hold a run folder against its manifest.

    Raises:
        TakeError: There is no manifest to hold it against.
        OSError: The folder cannot be read.
    """
    document = read_manifest(folder)
    recorded = document["files"]
    with ThreadPoolExecutor(max(1, threads)) as pool:
        found = list(pool.map(lambda item: _differs(folder, *item), recorded.items()))
    findings = [finding for finding in found if finding]
    with open_plain(folder, NAME) as file:
        if file.read() != text_of(document).encode("utf-8"):
            findings.append(f"{folder / NAME}: has changed: it is not as it was written")
    held = set(walk(folder)) - _OWN
    journal = read_journal(folder)
    begun = set() if journal is None else find_noted(folder, {*journal.names, NAME, JOURNAL}, held)
    more = sorted(held - set(recorded))
    findings.extend(f"{folder / name}: is not in {NAME}" for name in more if name.startswith(_TAKE))
    more = [name for name in more if not name.startswith(_TAKE)]
    return Verdict(
        tuple(findings),
        tuple(name for name in more if name in begun),
        tuple(name for name in more if name not in begun),
    )


def _differs(folder: Path, name: str, report: Mapping[str, Any]) -> str:
    """Say how a file differs from what was recorded of it; an empty text when it does not."""
    path = folder / name
    try:
        size = stat_plain(folder, name).st_size
        if size != report.get("bytes"):
            return f"{path}: has {size} bytes, expected {report.get('bytes')}"
        if _hash(folder, name)[1] != report.get("sha256"):
            return f"{path}: has changed: its SHA-256 is not the one in {NAME}"
    except FileNotFoundError:
        return f"{path}: is missing"
    except NotPlainError as error:
        return f"{error.filename}: {error.strerror}"
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror or error}"
    return ""
