"""Reads BVH files: the hierarchy token by token, the motion in compiled code."""

from __future__ import annotations

import codecs
import os
import re
from collections import Counter
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from crowdsim.bvh.file import FARTHEST, Bvh, quoted
from crowdsim.bvh.hierarchy import Hierarchy, read_hierarchy, read_motion_head
from crowdsim.bvh.kernels import count_by_line, parse_numbers
from crowdsim.bvh.scanner import Scanner, read_number, show
from crowdsim.core.types import Array, FileName
from crowdsim.errors import BvhError

_HARD_TOKENS = 4096
_LARGEST = 1 << 30
_MOST_FINDINGS = 8
_GLUED = re.compile(rb"(\d\.?)(?=-[\d.])")
_NUMBERS = re.compile(rb"\S+")
_LINE_FEED, _RETURN = b"\n\r"


def read_bvh(path: FileName) -> Bvh:
    """Read a BVH file as it is; what is odd but readable becomes a finding.

    Raises:
        BvhError: The file cannot be opened or is no BVH; says line and column, the token and what was expected.
    """
    return parse_bvh(_load(path), os.fspath(path))


def parse_bvh(data: bytes, path: str = "") -> Bvh:
    """Read BVH text from memory, as ``read_bvh`` does; ``path`` is what messages and the result call it."""
    data = _as_ascii_based(data, path)
    scanner = Scanner(data, path)
    tree = read_hierarchy(scanner)
    encoding = _encoding_of(data[: scanner.at])
    names = _unique_names(tree, encoding, scanner)
    channels = tuple(own or () for own in tree.channels)
    columns = sum(map(len, channels))
    declared, frame_time, fps = read_motion_head(scanner)
    rows = _read_motion(scanner, columns, declared)
    motion = rows.values
    _check_tree(scanner, tree, names, columns)
    bvh = Bvh(
        names=names,
        parents=np.array(tree.parents, np.int32),
        offsets=np.array([offset or (0.0, 0.0, 0.0) for offset in tree.offsets], float).reshape(-1, 3),
        channels=channels,
        end_parents=np.array(tree.end_parents, np.int32),
        end_offsets=np.array([offset or (0.0, 0.0, 0.0) for offset in tree.end_offsets], float).reshape(-1, 3),
        end_names=tuple(name.decode(encoding) for name in tree.end_names),
        motion=motion,
        declared_frames=declared,
        frame_time=frame_time,
        fps=fps,
        path=path,
    )
    if len(motion) != declared:
        # One row more or fewer is how exporters count; more are a file that is incomplete.
        report = scanner.note if abs(len(motion) - declared) == 1 else scanner.fault
        report(f"{len(motion)} rows of motion, Frames: says {declared}", scanner.frames_at)
    for what, row, column in _bad_channels(bvh):
        scanner.fault(what, rows.place_of(row, column))
    return replace(bvh, findings=tuple(scanner.findings), faults=tuple(scanner.faults))


def _load(path: FileName) -> bytes:
    """Return the bytes of a regular file."""
    if Path(path).is_dir():
        raise BvhError(f"{path}: is a folder, expected a BVH file")
    try:
        if Path(path).exists() and not Path(path).is_file():
            raise BvhError(f"{path}: is no regular file, expected a BVH file")
        size = os.stat(path).st_size
        if size > _LARGEST:
            raise BvhError(f"{path}: is a file of {size:,} bytes, expected at most {_LARGEST:,}")
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise BvhError(f"{path}: cannot be read: {reason}") from error


def _as_ascii_based(data: bytes, path: str) -> bytes:
    """Return the text without a byte order mark, and as UTF-8 where it was UTF-16."""
    if data.startswith(codecs.BOM_UTF8):
        return data[len(codecs.BOM_UTF8) :]
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            return data.decode("utf-16").encode()
        except UnicodeError as error:
            raise BvhError(f"{path}:1:1: broken UTF-16 text, expected a BVH file") from error
    return data


def _encoding_of(header: bytes) -> str:
    """Return 'utf-8' where the header is that, else 'latin-1', which reads any byte."""
    try:
        header.decode()
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def _unique_names(tree: Hierarchy, encoding: str, scanner: Scanner) -> tuple[str, ...]:
    """Return the names as text, and note those that more than one joint has."""
    names = tuple(name.decode(encoding) for name in tree.names)
    if len(set(names)) < len(names):
        often, count = Counter(names).most_common(1)[0]
        second = names.index(often, names.index(often) + 1)
        scanner.note(f"{count} joints are called {quoted(often)}", tree.places[second])
    return names


def _check_tree(scanner: Scanner, tree: Hierarchy, names: tuple[str, ...], columns: int) -> None:
    """Note findings about the hierarchy as a whole."""
    roots = [joint for joint, parent in enumerate(tree.parents) if parent < 0]
    if len(roots) > 1:
        shown = ", ".join(quoted(names[root]) for root in roots[:4]) + (" ..." if len(roots) > 4 else "")
        what = f"{len(roots)} ROOTs ({shown}): several people, #1 to #{len(roots)}"
        scanner.note(what, tree.places[roots[1]])
    bare = [joint for joint, offset in enumerate(tree.offsets) if offset is None]
    if bare:
        what = f"joint {quoted(names[bare[0]])} has no OFFSET, 0 taken ({len(bare)} such joints)"
        scanner.note(what, tree.places[bare[0]])
    bare = [end for end, offset in enumerate(tree.end_offsets) if offset is None]
    if bare:
        what = f"an end site of joint {quoted(names[tree.end_parents[bare[0]]])} has no OFFSET, 0 taken"
        scanner.note(f"{what} ({len(bare)} such end sites)", tree.end_places[bare[0]])
    scaled = [joint for joint, own in enumerate(tree.channels) if any(c.endswith("scale") for c in own or ())]
    if scaled:
        scanner.note(f"joint {quoted(names[scaled[0]])} has scale channels, which are not used", tree.places[scaled[0]])
    if columns == 0:
        scanner.fault("no joint has channels, so nothing moves", tree.places[0])


@dataclass
class _Rows:
    """The rows of motion, and where they are written.

    Attributes:
        values: Shape (F, C).
        scanner: The text.
        start: Where the numbers begin in it.
        firsts: Number of each row's first value in the text, where rows were left out. Shape (F,).
    """

    values: Array
    scanner: Scanner
    start: int
    firsts: Array | None = None

    def place_of(self, row: int, column: int) -> int:
        """Return where a value begins in the text."""
        first = row * self.values.shape[1] if self.firsts is None else int(self.firsts[row])
        return place_of_number(self.scanner.data, self.start, first + column)


def place_of_number(data: bytes, start: int, number: int) -> int:
    """Return where one of the numbers begins that follow each other from ``start`` on, counted from 0."""
    lines = lines_of_numbers(data, start)
    counts = np.cumsum(lines[:, 1])
    at = int(np.searchsorted(counts, number, side="right"))
    place = line_start(data, start, int(lines[at, 0]))
    tokens = islice(_NUMBERS.finditer(data, place), number - int(counts[at] - lines[at, 1]), None)
    return next(tokens).start()


def line_start(data: bytes, start: int, line: int) -> int:
    """Return where a line begins, counted from 0 and from ``start`` on."""
    if line == 0:
        return start
    text = np.frombuffer(data, np.uint8)[start:]
    is_end = text == _LINE_FEED
    is_end[:-1] |= (text[:-1] == _RETURN) & (text[1:] != _LINE_FEED)
    return start + int(np.flatnonzero(is_end)[line - 1]) + 1


def lines_of_numbers(data: bytes, start: int) -> Array:
    """Return (line from ``start`` on, numbers on it) of every line that is not blank. Shape (L, 2)."""
    most = data.count(b"\n", start) + data.count(b"\r", start) + 1
    lines = np.empty((most, 2), np.int64)
    return lines[: count_by_line(np.frombuffer(data, np.uint8), start, len(data), lines)]


def _read_motion(scanner: Scanner, columns: int, declared: int) -> _Rows:
    """Read the rows of numbers up to the end of the text, or to what is no number once all rows are there."""
    data = np.frombuffer(scanner.data, np.uint8)
    start, stop = scanner.at, len(scanner.data)
    most = (stop - start + 1) // 2
    wanted = min(declared * columns, most) if columns else 0
    values = np.empty(wanted)
    hard = np.empty((_HARD_TOKENS, 3), np.int64)
    state = np.zeros(5, np.int64)
    state[0] = start
    while True:
        parse_numbers(data, stop, columns, values, hard, state)
        at, count, hards = int(state[0]), int(state[1]), int(state[2])
        for number, first, last in hard[:hards].tolist():
            value = read_number(scanner.data[first:last])
            if value is None and number < declared * columns and _GLUED.search(scanner.data[first:last]):
                # Recorders that leave out a blank: where rows are whole then, that is what it was.
                parted = scanner.data[:start] + _GLUED.sub(rb"\1 ", scanner.data[start:])
                if (lines_of_numbers(parted, start)[:declared, 1] == columns).all():
                    what = f"{show(scanner.data[first:last])}: numbers without a blank between, parted at their signs"
                    scanner.note(what, first)
                    scanner.data = parted
                    return _read_motion(scanner, columns, declared)
            if value is None:
                return _Rows(_end_of_motion(scanner, values, number, first, columns, declared), scanner, start)
            values[number] = value
        if at >= stop:
            break
        if count >= len(values):
            longer = np.empty(min(most, max(1024, 2 * len(values))))
            longer[:count] = values[:count]
            values = longer
    if columns == 0:
        if count:
            raise scanner.error("no numbers, since no joint has channels", start)
        return _Rows(np.zeros((0, 0)), scanner, start)
    odd_lines = int(state[4]) + (int(state[3]) not in (0, columns))
    if odd_lines:
        return _odd_rows(scanner, start, values[:count], columns, declared)
    return _Rows(values[:count].reshape(-1, columns), scanner, start)


def _end_of_motion(scanner: Scanner, values: Array, count: int, place: int, columns: int, declared: int) -> Array:
    """Return the rows before a token that is no number, if they are as many as the file declares."""
    rows = count // columns if columns else 0
    if rows < declared or not rows:
        raise scanner.error("a number", place)
    rest = len(scanner.data) - place
    token = show(scanner.data[place : place + 40].split()[0])
    scanner.find(f"{rest} bytes from {token} on, after the last row, are no numbers and left out", place)
    return values[: rows * columns].reshape(-1, columns)


def _odd_rows(scanner: Scanner, start: int, values: Array, columns: int, declared: int) -> _Rows:
    """Make rows of numbers whose lines do not all hold one row.

    Where most lines hold one row, lines are rows, and the odd ones are left out; else line ends mean nothing, and only
    an incomplete last row is left out.
    """
    lines = lines_of_numbers(scanner.data, start)
    odd = lines[:, 1] != columns
    if len(lines) > 2 and np.ptp(lines[:, 1]) == 0 and abs(len(lines) - declared) <= 1:
        place = scanner.where(place_of_number(scanner.data, start, 0))
        raise BvhError(f"{place}: {len(lines)} rows of {lines[0, 1]} numbers, expected {columns}, one a channel")
    firsts = np.cumsum(lines[:, 1]) - lines[:, 1]
    if 2 * odd.sum() <= len(lines):
        more = f", and {odd.sum() - 1} more such rows" if odd.sum() > 1 else ""
        what = f"row of {lines[odd][0, 1]} numbers, expected {columns}, one a channel; left out{more}"
        report = scanner.note if odd.sum() == 1 and odd[-1] else scanner.fault
        report(what, place_of_number(scanner.data, start, int(firsts[odd][0])))
        firsts = firsts[~odd]
        return _Rows(values[firsts[:, None] + np.arange(columns)], scanner, start, firsts)
    rest = len(values) % columns
    if rest:
        what = f"{len(values)} numbers are {rest} more than whole rows of {columns}; left out"
        scanner.fault(what, place_of_number(scanner.data, start, len(values) - rest))
    return _Rows(values[: len(values) - rest].reshape(-1, columns), scanner, start)


def _bad_channels(bvh: Bvh) -> list[tuple[str, int, int]]:
    """Return where the motion is not finite or out of range, by joint and channel, with row and column of each."""
    # Comparing with NaN is false.
    if not bvh.motion.size or (bvh.motion.min() >= -FARTHEST and bvh.motion.max() <= FARTHEST):
        return []
    bad = ~(np.abs(bvh.motion) <= FARTHEST)
    columns = np.flatnonzero(bad.any(axis=0))
    found = []
    for column in columns[:_MOST_FINDINGS]:
        frame, count = int(np.argmax(bad[:, column])), int(bad[:, column].sum())
        more = f" and in {count - 1} more frames" if count > 1 else ""
        value = bvh.motion[frame, column]
        limit = f", expected numbers from -{FARTHEST:.0f} to {FARTHEST:.0f}" if np.isfinite(value) else ""
        what = f"frame {frame}, {bvh.describe_column(int(column))} is {value}{more}{limit}"
        found.append((what, frame, int(column)))
    if len(columns) > _MOST_FINDINGS:
        column = int(columns[_MOST_FINDINGS])
        row = int(np.argmax(bad[:, column]))
        found.append((f"{len(columns) - _MOST_FINDINGS} more channels are wrong somewhere", row, column))
    return found
