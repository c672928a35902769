"""Reads BVH text up to the first row of motion, which exporters write in many forms."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

from crowdsim.bvh.file import CHANNELS, snap_rate
from crowdsim.errors import BvhError, nearest

_TOKEN = re.compile(rb"\s*([{}]|[^\s{}]+)")
_NUMBER = re.compile(rb"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.IGNORECASE)
_BAD_NUMBER = re.compile(rb"([+-]?)(?:1\.#)?(nan|inf|infinity|qnan|snan|ind|j)\d*(\([a-z0-9]*\))?", re.IGNORECASE)
_LINE_END = re.compile(rb"\r\n|\r|\n")
_FRAMES = re.compile(rb"\s*frames\s*(?::\s*)?([^\s]+)", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"\s*frame\s*time\s*(?::\s*)?([^\s]+)", re.IGNORECASE)
_LONGEST_NAME = 256
_MOST_FINDINGS = 20


def read_number(token: bytes) -> float | None:
    """Return the number that a token spells, or None: '1.5', '1,5', '-2e-3', 'nan', '-inf', Windows' '-1.#IND'."""
    if _NUMBER.fullmatch(token):
        return float(token.replace(b",", b"."))
    bad = _BAD_NUMBER.fullmatch(token)
    if bad is None:
        return None
    if bad[2].lower().startswith((b"inf", b"j")):
        return -math.inf if bad[1] == b"-" else math.inf
    return math.nan


def show(token: bytes, encoding: str = "latin-1") -> str:
    """Return a token for a message: quoted, and shortened when it is long."""
    text = token[:200].decode(encoding, "replace")
    return repr(text if len(text) <= 40 else text[:37] + "...")


class Scanner:
    """Walks over the tokens of BVH text: braces, and runs of anything else between white space and braces."""

    def __init__(self, data: bytes, path: str) -> None:
        self.data = data
        self.path = path
        self.at = 0
        self.start = 0
        self.findings: list[str] = []
        self.faults: list[str] = []

    def next(self) -> bytes:
        """Return the next token and step over it; empty at the end."""
        match = _TOKEN.match(self.data, self.at)
        if match is None:
            self.start = self.at = len(self.data)
            return b""
        self.start, self.at = match.start(1), match.end()
        return match[1]

    def peek(self) -> bytes:
        """Return the next token and stay before it."""
        match = _TOKEN.match(self.data, self.at)
        return b"" if match is None else match[1]

    def line_of(self, place: int) -> int:
        """Return the line of a place in the data, from 1."""
        data = self.data
        both = data.count(b"\r\n", 0, place)
        return 1 + data.count(b"\n", 0, place) + data.count(b"\r", 0, place) - both

    def error(self, expected: str, place: int | None = None) -> BvhError:
        """Return the error that the token at ``place``, by default the last one, is not what was expected."""
        place = self.start if place is None else place
        match = _TOKEN.match(self.data, place)
        found = f"found {show(match[1])}" if match else "the file ends"
        line = self.line_of(match.start(1) if match else len(self.data))
        return BvhError(f"{self.path}:{line}: {found}, expected {expected}")

    def find(self, what: str, place: int | None = None) -> None:
        """Note a finding about the token at ``place``, by default the last one, up to a limit."""
        if len(self.findings) < _MOST_FINDINGS:
            self.findings.append(f"{self.path}:{self.line_of(self.start if place is None else place)}: {what}")

    def fault(self, what: str) -> None:
        """Note a finding by which the motion is incomplete or wrong."""
        self.findings.append(what)
        self.faults.append(what)

    def name(self) -> bytes:
        """Return the text before the opening brace, and step over both.

        A name is one line and may hold blanks, colons, keywords and, where the opening brace is on a line below,
        braces.
        """
        while self.data[self.at : self.at + 1].isspace():
            self.at += 1
        brace = self.data.find(b"{", self.at)
        line_end = _LINE_END.search(self.data, self.at, brace if brace >= 0 else len(self.data))
        if line_end is None and self._is_glued(brace):
            # A brace inside a word, as in hand{1}: part of the name when the line below opens the block.
            end = _LINE_END.search(self.data, brace, brace + _LONGEST_NAME)
            if end is not None and self._token_at(end.start()) == b"{":
                line_end = end
        stop = line_end.start() if line_end else brace if brace >= 0 else len(self.data)
        name = self.data[self.at : stop]
        self.at = stop
        if self.next() != b"{":
            raise self.error("'{'")
        return name.strip()

    def _is_glued(self, brace: int) -> bool:
        around = self.data[max(self.at, brace - 1) : brace] + self.data[brace + 1 : brace + 2]
        return brace > self.at and len(around) == 2 and not around[:1].isspace() and not around[1:].isspace()

    def _token_at(self, place: int) -> bytes:
        match = _TOKEN.match(self.data, place)
        return b"" if match is None else match[1]


@dataclass
class Hierarchy:
    """The tree as read, in file order; lists because it grows while reading."""

    names: list[bytes] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[tuple[float, float, float] | None] = field(default_factory=list)
    channels: list[tuple[str, ...] | None] = field(default_factory=list)
    end_names: list[bytes] = field(default_factory=list)
    end_parents: list[int] = field(default_factory=list)
    end_offsets: list[tuple[float, float, float] | None] = field(default_factory=list)


_END = -2


def read_hierarchy(scanner: Scanner) -> Hierarchy:
    """Read from the start of the text to the end of the last root's block.

    Raises:
        BvhError: The text is no BVH hierarchy; says where, what was found and what was expected.
    """
    if scanner.next().lower() != b"hierarchy":
        raise scanner.error("'HIERARCHY'")
    tree = Hierarchy()
    if scanner.next().lower() != b"root":
        raise scanner.error("'ROOT' and a name")
    _open_joint(scanner, tree, -1)
    stack = [0]
    while True:
        word = scanner.next()
        keyword = word.lower()
        if not stack:
            if keyword != b"root":
                scanner.at = scanner.start
                return tree
            _open_joint(scanner, tree, -1)
            stack.append(len(tree.names) - 1)
            continue
        joint = stack[-1]
        if keyword == b"}":
            stack.pop()
        elif keyword == b"offset":
            offset = _read_offset(scanner)
            if joint == _END:
                tree.end_offsets[-1] = offset
            else:
                tree.offsets[joint] = offset
        elif joint == _END:
            if keyword != b"channels" or scanner.next() != b"0":
                raise scanner.error("'OFFSET' or '}' of an end site, which has neither channels nor children")
        elif keyword == b"channels":
            if tree.channels[joint] is not None:
                raise scanner.error("one CHANNELS a joint")
            tree.channels[joint] = _read_channels(scanner)
        elif keyword == b"joint":
            _open_joint(scanner, tree, joint)
            stack.append(len(tree.names) - 1)
        elif keyword in (b"end", b"endsite", b"end_site"):
            label = scanner.name()
            tree.end_names.append(label or b"Site")
            tree.end_parents.append(joint)
            tree.end_offsets.append(None)
            stack.append(_END)
        else:
            raise scanner.error("OFFSET, CHANNELS, JOINT, End Site or '}'")


def _open_joint(scanner: Scanner, tree: Hierarchy, parent: int) -> None:
    """Read a joint's name and opening brace and add it to the tree."""
    name = scanner.name()
    if not name:
        name = b"joint%d" % len(tree.names)
        scanner.find(f"joint without a name, called {name.decode()!r}")
    tree.names.append(name)
    tree.parents.append(parent)
    tree.offsets.append(None)
    tree.channels.append(None)


def _read_offset(scanner: Scanner) -> tuple[float, float, float]:
    """Read the three numbers after OFFSET."""
    numbers = []
    for axis in "xyz":
        number = read_number(scanner.next())
        if number is None:
            raise scanner.error(f"a number, the {axis} of an OFFSET")
        if not math.isfinite(number):
            scanner.find(f"OFFSET is {number}, 0 taken")
            number = 0.0
        numbers.append(number)
    return numbers[0], numbers[1], numbers[2]


def _read_channels(scanner: Scanner) -> tuple[str, ...]:
    """Read the count and the names after CHANNELS."""
    token = scanner.next()
    if not token.isdigit() or len(token) > 9:
        raise scanner.error("the number of channels")
    count = int(token)
    names: list[str] = []
    while len(names) < count:
        word = scanner.next()
        name = CHANNELS.get(word.decode("latin-1").lower())
        if name is None:
            hint = nearest(word[:40].decode("latin-1"), CHANNELS.values())
            raise scanner.error(f"channel {len(names) + 1} of {count}, such as Xposition or Zrotation{hint}")
        names.append(name)
    if scanner.peek().decode("latin-1").lower() in CHANNELS:
        scanner.next()
        raise scanner.error(f"{count} channels, as CHANNELS says")
    return tuple(names)


def read_motion_head(scanner: Scanner) -> tuple[int, float, float]:
    """Read MOTION, Frames: and Frame Time:; return the frames declared, the frame time [s] and the rate."""
    if scanner.next() == b"":
        scanner.find("the file ends after the hierarchy, without MOTION")
        return 0, 0.0, snap_rate("", 0.0)
    if scanner.data[scanner.start : scanner.at].lower() != b"motion":
        raise scanner.error("'ROOT' or 'MOTION'")
    declared: int | None = None
    time_token: bytes | None = None
    while declared is None or time_token is None:
        if scanner.peek() == b"":
            scanner.start = len(scanner.data)
            scanner.find(f"the file ends before {'Frames' if declared is None else 'Frame Time'}:")
            break
        frames = _FRAMES.match(scanner.data, scanner.at) if declared is None else None
        times = _FRAME_TIME.match(scanner.data, scanner.at) if time_token is None else None
        if frames:
            scanner.start, scanner.at = frames.start(1), frames.end()
            declared = _whole_number(scanner, frames[1])
        elif times:
            scanner.start, scanner.at = times.start(1), times.end()
            time_token = times[1]
        else:
            scanner.next()
            raise scanner.error("'Frames:' and a number" if declared is None else "'Frame Time:' and a number")
    if time_token is None:
        return declared or 0, 0.0, snap_rate("", 0.0)
    frame_time = read_number(time_token)
    if frame_time is None:
        raise scanner.error("a number of seconds")
    fps = snap_rate(time_token.decode(), frame_time)
    if not 1e-9 < frame_time < 1e9:
        scanner.find(f"frame time is {show(time_token)}, {fps:g} frames a second taken")
    elif not 1.0 <= fps <= 2000.0:
        scanner.find(f"frame time {show(time_token)} means {fps:.6g} frames a second")
    return declared or 0, frame_time, fps


def _whole_number(scanner: Scanner, token: bytes) -> int:
    """Return the number of frames in a token."""
    number = read_number(token)
    if number is None or not 0 <= number < 1e18 or number != int(number):
        raise scanner.error("a number of frames")
    return int(token) if token.isdigit() else int(number)
