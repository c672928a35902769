"""The journal of a run folder: which files are being written in it, noted before the first of them is begun.

Its journal distinguishes what a killed or interrupted command leaves from files of the user. The journal goes when the
manifest lists everything.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crowdsim.config.documents import parse_json
from crowdsim.errors import OutputError
from crowdsim.files import is_inside, open_plain, walk
from crowdsim.runs.signed_json import checksum, write_signed

NAME = ".crowdsim-journal.json"
FORMAT = "crowdsim-journal"
VERSION = 1

_PARTS = ("inputs", "files", "exports")

EXTENSION = ".extension"
"""Folder in a run's in which the run is being extended."""

_ZARR = re.compile(r"(?:[a-z_]+/){0,2}(?:\.z(?:group|attrs|array|metadata)|\d+(?:\.\d+)*)")
_ZARR_TEMPORARY = re.compile(r"(.+)\.[0-9a-f]{32}\.partial")
_SEGMENT = re.compile(r"mark|parts\.txt|\d{8,}-\d{8,}\.mp4|\.mark\.part|\.\d{8,}-\d{8,}\.mp4\.part")
_TREES = (
    (re.compile(r"take\.zarr(?:\.partial)?"), _ZARR),
    (re.compile(r"\.video-[0-9a-f]{16}"), _SEGMENT),
    (re.compile(r"\.extension(?:\.part)?|\.export-[0-9a-f]{16}"), re.compile(r".+")),
)
"""Folders that are noted as a whole, and the files in them that a run or a rendering writes."""

_SERIES = re.compile(r"\{(\d{1,12}):(\d{1,12}):([1-9]\d{0,11})\}\.([a-z]+)")

# Names of half-written files, and of what they were to become.
_TEMPORARIES = (
    (re.compile(r"\.(.+)\.[0-9a-f]{32}\.part"), r"\1"),
    (re.compile(r"\.(.+)\.part(\.[a-z]+)"), r"\1\2"),
    (re.compile(r"\.(.+)\.\d+(\.png)"), r"\1\2"),
    (re.compile(r"\.(.+)\.part"), r"\1"),
    (re.compile(r"(.+)\.part"), r"\1"),
)
_CUT = 100
"""Names of half-written BVH files are cut off there."""


@dataclass(frozen=True)
class Journal:
    """What is being written in a run folder.

    Attributes:
        inputs: Small files that any run begins with: its resolved scenario, and those that it reads.
        files: Everything else, by names in the folder; a take and a video's segments by their folder, numbered files by
            one name, see ``series_name``.
        exports: Likewise what exports and renderings write, who take what there is of the run.
        origin: What a run is made from, see ``origin.Origin.document``; empty where no run writes.
    """

    inputs: frozenset[str] = frozenset()
    files: frozenset[str] = frozenset()
    exports: frozenset[str] = frozenset()
    origin: Mapping[str, Any] = field(default_factory=dict)

    @property
    def names(self) -> frozenset[str]:
        """All names."""
        return self.inputs | self.files | self.exports


def read_journal(folder: Path) -> Journal | None:
    """Return the journal of a folder; None where there is none of this program, or it is damaged."""
    try:
        with open_plain(folder, NAME) as file:
            document = parse_json(file.read().decode("utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(document, dict) or document.get("format") != FORMAT or document.get("version") != VERSION:
        return None
    parts = [document.get(name, []) for name in _PARTS]
    origin = document.get("origin", {})
    if document.get("checksum") != checksum(document) or not isinstance(origin, dict):
        return None
    if not all(isinstance(part, list) and all(map(is_inside, part)) for part in parts):
        return None
    inputs, files, exports = map(frozenset, parts)
    return Journal(inputs, files, exports, origin)


def write_journal(folder: Path, journal: Journal) -> None:
    """Write the journal of a folder.

    Raises:
        OutputError: It cannot be written.
    """
    document = {
        "format": FORMAT,
        "version": VERSION,
        **{name: sorted(getattr(journal, name)) for name in _PARTS},
        "origin": dict(journal.origin),
    }
    write_signed(folder / NAME, folder / f"{NAME}.part", document)


def remove_journal(folder: Path) -> None:
    """Remove the journal of a folder.

    Raises:
        OutputError: It cannot be removed.
    """
    path = folder / NAME
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be removed: {error.strerror or error}") from None


def series_name(folder: str, frames: range, suffix: str) -> str:
    """Return the one name that numbered files of a folder are noted by, ``ply/{0:1000:4}.ply`` say."""
    return f"{folder}/{{{frames.start}:{frames.stop}:{frames.step}}}.{suffix}"


class Noted:
    """Tells which files noted names mean.

    Args:
        names: Names of files, of folders that are noted as a whole, and of numbered files, see ``series_name``.

    Attributes:
        files: Names of single files.
        trees: Names of folders that are noted as a whole.
        folders: Names of all folders above one of them.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.files: set[str] = set()
        self.trees: dict[str, re.Pattern[str]] = {}
        self.folders: set[str] = set()
        self._series: dict[tuple[str, str], list[range]] = {}
        for name in names:
            above, _, last = name.rpartition("/")
            match = _SERIES.fullmatch(last)
            pattern = next((pattern for tree, pattern in _TREES if tree.fullmatch(last)), None)
            if match:
                frames = range(int(match[1]), int(match[2]), int(match[3]))
                self._series.setdefault((above, match[4]), []).append(frames)
            elif pattern:
                self.trees[name] = pattern
            else:
                self.files.add(name)
            while above and above not in self.folders:
                self.folders.add(above)
                above = above.rpartition("/")[0]
        self._cut = {_cut(name) for name in self.files}

    def names(self, name: str) -> bool:
        """Whether a file is one of the single or numbered ones."""
        if name in self.files:
            return True
        above, _, last = name.rpartition("/")
        digits, _, suffix = last.partition(".")
        series = self._series.get((above, suffix), ()) if digits.isdecimal() and digits.isascii() else ()
        return any(int(digits) in frames and digits == f"{int(digits):06d}" for frames in series)

    def count_by_folder(self) -> dict[str, int]:
        """Return how many single and numbered files are meant, by the folder they are in, or their name without one."""
        counts: dict[str, int] = {}
        for name in self.files:
            top = name.split("/")[0]
            counts[top] = counts.get(top, 0) + 1
        for (above, _), series in self._series.items():
            top = above.split("/")[0]
            counts[top] = counts.get(top, 0) + sum(map(len, series))
        return counts

    def tree_of(self, name: str) -> str | None:
        """Return the folder, noted as a whole, that a file is in."""
        return next((tree for tree in self.trees if name.startswith(f"{tree}/")), None)

    def covers(self, name: str) -> bool:
        """Whether a file is one of those meant, or half of one."""
        tree = self.tree_of(name)
        if tree is not None:
            above, slash, last = name[len(tree) + 1 :].rpartition("/")
            temporary = _ZARR_TEMPORARY.fullmatch(last)
            return self.trees[tree].fullmatch(f"{above}{slash}{temporary[1] if temporary else last}") is not None
        return self.names(name) or any(whole in self._cut or self.names(whole) for whole in _wholes(name))


def find_noted(folder: Path, names: Iterable[str], held: Iterable[str] | None = None) -> set[str]:
    """Return the names of files in a folder that noted names mean, half-written ones included.

    Args:
        folder: The folder.
        names: Names as in a journal.
        held: Names of all files in the folder, when they are known.

    Raises:
        OSError: The folder cannot be read.
    """
    noted = Noted(names)
    return {name for name in (walk(folder) if held is None else held) if noted.covers(name)}


def _wholes(name: str) -> list[str]:
    """Return what a half-written file by this name may have been to become."""
    above, slash, last = name.rpartition("/")
    matches = ((pattern.fullmatch(last), whole) for pattern, whole in _TEMPORARIES)
    return [f"{above}{slash}{match.expand(whole)}" for match, whole in matches if match]


def _cut(name: str) -> str:
    above, slash, last = name.rpartition("/")
    return f"{above}{slash}{last[:_CUT]}"
