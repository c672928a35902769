"""The manifest of a run: what was run, on what, how long it took, and a checksum of every file.

A folder of exports or pictures that is no run's has a list of the same form, ``.crowdsim-outputs.json``. What these two
list is what commands may replace or remove; a name that no command writes is refused, whatever the list says.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field, model_validator

from crowdsim.config.documents import DocumentModel, OpenModel, document_fault, parse_json
from crowdsim.config.files import Fault
from crowdsim.errors import RunError, TakeError
from crowdsim.files import (
    UNFINISHED,
    NotPlainError,
    exists_plain,
    is_folder,
    is_inside,
    open_plain,
    read_plain,
    stat_plain,
    walk,
    write_plain,
)
from crowdsim.machine import describe_machine
from crowdsim.runs.lock import LOCKS
from crowdsim.scenario.outputs import REGISTRY

NAME = "manifest.json"
OUTPUTS = ".crowdsim-outputs.json"
FORMAT = "crowdsim-run"
RUN, EXPORT, PICTURES, FILES = UNFINISHED, ".export.partial", ".pictures.partial", ".files.partial"
STAGES = (RUN, EXPORT, PICTURES, FILES)
"""Folders in which commands write until all is whole, see ``stage``; their note is called ``NOTE``."""
NOTE = "stage.json"
VERSION = 1
MOST_BYTES = 1 << 25
"""Longest manifest, which is enough for a quarter of a million files [bytes]."""
_TAKE = "take.zarr/"
_OWN = {NAME, OUTPUTS, *LOCKS}
"""What is no result of a command: these lists, and notes of what goes on."""
_OUTPUT = "|".join(one.pattern() for one in REGISTRY.values() if one.pattern())
_WRITTEN = re.compile(
    r"scenario\.resolved\.yaml|checkpoint\.bin|trace\.json|policies/[^/]+/[a-z_0-9]+\.(?:json|npy)"
    r"|take\.zarr/(?:[a-z_]+/){0,2}(?:\.z(?:group|attrs|array|metadata)|\d+(?:\.\d+)*)"
    rf"|(?:[^/]+/)*(?:{_OUTPUT}|[^/]+\.(?:bvh|png|mp4|svg))"
)
"""Names of files that commands write, in a run folder and elsewhere."""

_Count = Annotated[int, Field(ge=0, le=1 << 62)]
_Seconds = Annotated[float, Field(ge=0.0, le=1e12)]


class ForeignManifestError(TakeError):
    """A file of the manifest's name was written by another program."""


class FileEntry(DocumentModel):
    """A file: its size [bytes] and SHA-256."""

    bytes: _Count
    sha256: str


class ExportEntry(OpenModel):
    """Files that a command wrote again: what they depend on, and their names where only the command knows them."""

    key: str = ""
    files: list[str] = Field(default_factory=list)


class OutcomeEntry(OpenModel):
    """How a run ended, see ``crowd.ending.describe_outcome``."""

    kind: str
    frame: _Count
    standing: list[str]
    standing_count: _Count
    teams: dict[str, _Count]

    @model_validator(mode="after")
    def _adds_up(self) -> OutcomeEntry:
        if sum(self.teams.values()) != self.standing_count or bool(self.standing) != bool(self.standing_count):
            raise Fault("does not add up to those of its teams", "standing_count")
        return self


class RunManifest(OpenModel):
    """A manifest; keys that are missing are those of a run of an earlier version, or of none."""

    files: dict[str, FileEntry]
    status: str = ""
    scenario: str = ""
    seed: int = 0
    avatars: _Count = 0
    control_frames: _Count = 0
    policies: dict[str, str] = Field(default_factory=dict)
    policy_folders: dict[str, str] = Field(default_factory=dict)
    inputs: list[str] = Field(default_factory=list)
    origin: dict[str, Any] = Field(default_factory=dict)
    exports: dict[str, ExportEntry] = Field(default_factory=dict)
    statistics: dict[str, Any] = Field(default_factory=dict)
    outcome: OutcomeEntry | None = None
    seconds: dict[str, _Seconds] = Field(default_factory=lambda: {"total": 0.0})

    @model_validator(mode="after")
    def _has_total(self) -> RunManifest:
        if "total" not in self.seconds:
            raise Fault("lacks 'total'", "seconds")
        return self


def checksum(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of what a document says, without its own."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def signed_text(document: Mapping[str, Any]) -> str:
    """Return a document as it is written, with its checksum last, so that any changed bit is found."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return json.dumps({**rest, "checksum": checksum(rest)}, indent=1) + "\n"


def signed_manifest(report: Mapping[str, Any]) -> str:
    """Return a manifest as it is written, of a report that has everything but the checksum."""
    return signed_text({**report, "format": FORMAT, "version": VERSION})


def write_manifest(
    folder: Path, report: Mapping[str, Any], files: Mapping[str, Mapping[str, Any]], name: str = NAME
) -> None:
    """Write a manifest, which is the only proof that its files are whole, and wait until it is on disk.

    Args:
        folder: The folder.
        report: What a reader should know.
        files: All files, as ``checksums`` gives them.
        name: ``OUTPUTS`` in a folder that is no run's.

    Raises:
        OutputError: It cannot be written.
        RunError: There are too many files.
    """
    text = signed_manifest({**report, **describe_machine(), "files": dict(sorted(files.items()))})
    if len(text) > MOST_BYTES:
        raise RunError(f"{folder / name}: lists {len(files):,} files, too many for {MOST_BYTES >> 20} MB")
    write_plain(folder, name, text, lasts=True)


def read_manifest(folder: Path, needed: Iterable[str] = (), name: str = NAME) -> dict[str, Any]:
    """Return a manifest, all of whose names are those of files that commands write inside its folder.

    Args:
        folder: The folder.
        needed: What it must hold beside its files.
        name: ``OUTPUTS`` of a folder that is no run's.

    Raises:
        ForeignManifestError: Another program has written it.
        TakeError: There is none, or it is damaged or of another version, lacks something, or names other files.
    """
    path = folder / name
    try:
        document = parse_json(read_plain(folder, name, MOST_BYTES).decode("utf-8"))
    except FileNotFoundError:
        raise TakeError(f"{folder}: no {name} here, so this is no finished run") from None
    except NotPlainError as error:
        raise TakeError(f"{path}: {error.strerror}") from None
    except OSError as error:
        raise TakeError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
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
    for key in needed:
        if key not in document:
            raise TakeError(f"{path}: is damaged: lacks {key!r}")
    inputs = set(document.get("inputs", ())) if name == NAME else set()
    for file in document["files"]:
        if not is_inside(file) or not (file in inputs or is_written(file)):
            raise TakeError(f"{path}: names {file!r}, expected only files that a run writes inside {folder}")
    return document


def is_written(name: str) -> bool:
    """Whether a file inside a run folder, or another folder of outputs, has a name that commands give."""
    return _WRITTEN.fullmatch(name) is not None


class Ledger(NamedTuple):
    """What commands have written into a folder.

    Attributes:
        name: Name of the list: of a run's manifest, or ``OUTPUTS``.
        document: What it says.
    """

    name: str
    document: dict[str, Any]

    @property
    def files(self) -> dict[str, dict[str, Any]]:
        """Size and checksum of each file, by name."""
        found: dict[str, dict[str, Any]] = self.document["files"]
        return found


def read_ledger(folder: Path) -> Ledger:
    """Return what commands have written into a folder: of a run by its manifest, else by its list of outputs.

    Raises:
        TakeError: The list is damaged.
    """
    for name in (NAME, OUTPUTS):
        if exists_plain(folder, name):
            return Ledger(name, read_manifest(folder, name=name))
    return Ledger(OUTPUTS, {"files": {}})


def checksums(folder: Path, names: Iterable[str] | None = None, threads: int = 1) -> dict[str, dict[str, Any]]:
    """Return size and SHA-256 of files of a folder, by name; of all but lists and locks when None is given.

    Raises:
        OSError: One is missing or no regular file, or cannot be read.
    """
    chosen = sorted(set(walk(folder) if names is None else names) - _OWN)
    with ThreadPoolExecutor(max(1, threads)) as pool:
        return dict(zip(chosen, pool.map(lambda name: _facts(folder, name), chosen), strict=True))


def _facts(folder: Path, name: str) -> dict[str, Any]:
    digest, size = hashlib.sha256(), 0
    with open_plain(folder, name) as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
            size += len(block)
    return {"bytes": size, "sha256": digest.hexdigest()}


class Verdict(NamedTuple):
    """How a run folder differs from its manifest.

    Attributes:
        findings: What differs, a line each. A file that has come into the take differs too, since a take reads all
            files in its folder.
        unfinished: Names of folders in which a command has begun something and not finished it.
        foreign: Names of other files, which crowdsim has not written.
    """

    findings: tuple[str, ...] = ()
    unfinished: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()


def verify(folder: Path, threads: int = 1) -> Verdict:
    """Compare a run folder with its manifest; nothing is written.

    Where a command was killed while it put files in their places, some are still in the folder that it wrote into.

    Raises:
        TakeError: There is no manifest to compare it with.
        OSError: The folder cannot be read.
    """
    begun = [folder / name for name in STAGES if is_folder(folder, name) and exists_plain(folder / name, NOTE)]
    pending = next((stage for stage in begun if exists_plain(stage, NAME)), None)
    document = read_manifest(folder if pending is None else pending)
    recorded = document["files"]

    def place_of(name: str) -> Path:
        return pending if pending is not None and exists_plain(pending, name) else folder

    with ThreadPoolExecutor(max(1, threads)) as pool:
        found = list(pool.map(lambda item: difference(place_of(item[0]), *item), recorded.items()))
    findings = [finding for finding in found if finding]
    if read_plain(pending or folder, NAME, MOST_BYTES) != signed_text(document).encode("utf-8"):
        findings.append(f"{folder / NAME}: has changed: it is not as it was written")
    held = {name for name in walk(folder) if name.split("/")[0] not in STAGES} - _OWN
    more = sorted(held - set(recorded)) if pending is None else []
    findings.extend(f"{folder / name}: is not in {NAME}" for name in more if name.startswith(_TAKE))
    foreign = tuple(name for name in more if not name.startswith(_TAKE))
    return Verdict(tuple(findings), tuple(stage.name for stage in begun), foreign)


def difference(folder: Path, name: str, report: Mapping[str, Any]) -> str:
    """Return how a file differs from what was recorded of it; an empty text when it does not."""
    path = folder / name
    try:
        size = stat_plain(folder, name).st_size
        if size != report["bytes"]:
            return f"{path}: has {size} bytes, expected {report['bytes']}"
        if _facts(folder, name) != report:
            return f"{path}: has changed: its SHA-256 is not the one in {NAME}"
    except FileNotFoundError:
        return f"{path}: is missing"
    except NotPlainError as error:
        return f"{error.filename}: {error.strerror}"
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror or error}"
    return ""
