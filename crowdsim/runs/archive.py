"""A run as one file: take, scenario, policies and manifest in a ZIP archive, which other machines read as it is.

Files are stored, not compressed (take and video are already), so that an archive never unpacks to more than its size.
"""

from __future__ import annotations

import errno
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from os.path import lexists
from pathlib import Path
from typing import Any

from crowdsim.config.documents import parse_json
from crowdsim.core.types import FileName
from crowdsim.errors import OutputError, TakeError
from crowdsim.files import is_inside, make_folder, open_plain, walk, whole_file
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.folder import RESOLVED
from crowdsim.runs.manifest import FORMAT, MOST_BYTES, checksums, read_manifest, signed_manifest, verify
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.opening import POLICIES, bundle_of
from crowdsim.runs.stage import TAKE


def pack_run(folder: FileName, out: FileName, threads: int = 1, force: bool = False) -> tuple[int, int]:
    """Write a finished run into an archive; return how many files are in it, and its size [bytes].

    Args:
        folder: The run folder.
        out: The archive.
        threads: Threads that sum up files.
        force: Whether an archive of a run that is there may be replaced.

    Raises:
        TakeError: The run is not finished, or files have changed since.
        PolicyError: A policy is missing, or not the one that the run was made with.
        OutputError: The archive cannot be written, or something else has its name.
    """
    folder, out = Path(folder), Path(out)
    document = read_manifest(folder, ("policies",))
    if lexists(out):
        if not _is_run(out):
            raise OutputError(f"{out}: is there already and no archive of a run, expected another name")
        if not force:
            raise OutputError(f"{out}: is there already; --force replaces it")
    # What the run reads, its take and its checkpoint, but no outputs.
    own = {RESOLVED, CHECKPOINT, *document.get("inputs", [])}
    sources = {(folder, ""): [name for name in document["files"] if name in own or name.startswith(f"{TAKE}/")]}
    for policy, fingerprint in document["policies"].items():
        bundle = bundle_of(folder, policy, fingerprint)
        sources[bundle, f"{POLICIES}/{policy}/"] = list(walk(bundle))
    files: dict[str, dict[str, Any]] = {}
    try:
        for (place, above), names in sources.items():
            files |= {f"{above}{name}": facts for name, facts in checksums(place, names, threads).items()}
    except OSError as error:
        raise TakeError(f"{error.filename or folder}: cannot be read: {error.strerror or error}") from None
    for name in sources[folder, ""]:
        if files[name] != document["files"][name]:
            raise TakeError(f"{folder / name}: has changed since the run was finished; crowdsim verify reports all")
    kept = {key: value for key, value in document.items() if key not in ("exports", "checksum")}
    manifest = signed_manifest({**kept, "files": dict(sorted(files.items()))})
    make_folder(out.parent)
    with whole_file(out.parent, out.name) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(_entry(MANIFEST), manifest.encode("utf-8"))
        found = {f"{above}{name}": (place, name) for (place, above), names in sources.items() for name in names}
        for name, source in sorted(found.items()):
            with open_plain(*source) as file, archive.open(_entry(name), "w", force_zip64=True) as target:
                shutil.copyfileobj(file, target)
    return len(files) + 1, out.stat().st_size


def _entry(name: str) -> zipfile.ZipInfo:
    """Return a file's entry, which is the same whenever it is packed."""
    entry = zipfile.ZipInfo(name)
    entry.external_attr = (stat.S_IFREG | 0o644) << 16
    return entry


def is_archive(path: Path) -> bool:
    """Whether a file is a ZIP archive."""
    return path.is_file() and zipfile.is_zipfile(path)


def _is_run(path: Path) -> bool:
    """Whether a file is an archive that a run was packed into."""
    try:
        with zipfile.ZipFile(path) as archive:
            document = parse_json(archive.read(_check_entries(path, archive)[MANIFEST]))
    except (OSError, ValueError, TakeError, zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError):
        return False
    return isinstance(document, dict) and document.get("format") == FORMAT


@contextmanager
def opened(path: Path) -> Iterator[Path]:
    """Give a run's folder, or a folder with what its archive holds, which is there for as long as this lasts.

    Raises:
        TakeError: It is an archive that no run was packed into, or it is damaged or hostile.
        OutputError: It cannot be unpacked.
    """
    if not path.is_file():
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="crowdsim-") as place:
        folder = Path(place) / path.stem
        unpack(path, folder)
        yield folder


def unpack(path: Path, folder: Path) -> None:
    """Unpack an archive into a new folder, and check it.

    Raises:
        TakeError: It is no archive of a run, is damaged, or holds what no run's archive does; nothing stays of it
            outside the folder.
        OutputError: The folder cannot be written.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = _check_entries(path, archive)
            folder.mkdir(parents=True)
            archive.extract(entries.pop(MANIFEST), folder)
            listed = read_manifest(folder)["files"]
            odd = min(entries.keys() ^ listed.keys(), default=None)
            if odd is not None:
                where = f"is in its {MANIFEST}, but missing" if odd in listed else f"is not in its {MANIFEST}"
                raise TakeError(f"{path}: {odd!r} {where}")
            for entry in entries.values():
                archive.extract(entry, folder)
        for finding in verify(folder).findings:
            raise TakeError(f"{path}/{finding.removeprefix(f'{folder}/')}")
    except zipfile.BadZipFile as error:
        raise TakeError(f"{path}: is no archive of a run, or damaged: {error}") from None
    except (EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise TakeError(f"{path}: is damaged: {error}") from None
    except OSError as error:
        if error.errno == errno.EINVAL:
            # An entry that begins before the file does.
            raise TakeError(f"{path}: is damaged: {error.strerror}") from None
        raise OutputError(f"{error.filename or path}: cannot be unpacked: {error.strerror or error}") from None


def _check_entries(path: Path, archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Return the files of an archive by name: plain, stored, inside it, and no larger than it together."""
    entries: dict[str, zipfile.ZipInfo] = {}
    for entry in archive.infolist():
        name, mode = entry.filename, entry.external_attr >> 16
        fault = ""
        if not is_inside(name) or "\\" in name:
            fault = "leads out of the archive, expected a file inside"
        elif name in entries:
            fault = "is there twice"
        elif entry.is_dir() or (stat.S_IFMT(mode) not in (0, stat.S_IFREG)):
            fault = "is a link or no regular file"
        elif entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size:
            fault = "is compressed, expected files as they are"
        elif entry.flag_bits & 1:
            fault = "is encrypted"
        if fault:
            raise TakeError(f"{path}: {name!r} {fault}")
        entries[name] = entry
    if MANIFEST not in entries:
        raise TakeError(f"{path}: is no archive of a run: holds no {MANIFEST}")
    if entries[MANIFEST].file_size > MOST_BYTES:
        raise TakeError(f"{path}: {MANIFEST}: has {entries[MANIFEST].file_size} bytes, too many for a manifest")
    total, size = sum(entry.file_size for entry in entries.values()), path.stat().st_size
    if total > size:
        raise TakeError(f"{path}: claims to hold {total} bytes, but has only {size}")
    return entries
