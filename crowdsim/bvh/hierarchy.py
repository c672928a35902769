"""Reads BVH text up to the first row of motion, which exporters write in many forms."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

from crowdsim.bvh.file import CHANNELS, FARTHEST, snap_rate
from crowdsim.bvh.scanner import Scanner, read_number, show
from crowdsim.errors import nearest

_FRAMES = re.compile(rb"\s*frames\s*(?::\s*)?([^\s]+)", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"\s*frame\s*time\s*(?::\s*)?([^\s]+)", re.IGNORECASE)
_MOST_JOINTS = 1000
_MOST_CHANNELS = 12


@dataclass
class Hierarchy:
    """The tree as read, in file order; lists because it grows while reading. Places are those of the keywords."""

    names: list[bytes] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[tuple[float, float, float] | None] = field(default_factory=list)
    channels: list[tuple[str, ...] | None] = field(default_factory=list)
    end_names: list[bytes] = field(default_factory=list)
    end_parents: list[int] = field(default_factory=list)
    end_offsets: list[tuple[float, float, float] | None] = field(default_factory=list)
    places: list[int] = field(default_factory=list)
    end_places: list[int] = field(default_factory=list)


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
    without_channels: set[int] = set()
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
            offsets, owner = (tree.end_offsets, -1) if joint == _END else (tree.offsets, joint)
            if offsets[owner] is not None:
                raise scanner.error("one OFFSET a joint")
            offsets[owner] = _read_offset(scanner)
        elif joint == _END:
            if keyword != b"channels" or len(tree.end_names) in without_channels or scanner.next() != b"0":
                raise scanner.error("'OFFSET' or '}' of an end site, which has neither channels nor children")
            without_channels.add(len(tree.end_names))
        elif keyword == b"channels":
            if tree.channels[joint] is not None:
                raise scanner.error("one CHANNELS a joint")
            tree.channels[joint] = _read_channels(scanner)
        elif keyword == b"joint":
            _open_joint(scanner, tree, joint)
            stack.append(len(tree.names) - 1)
        elif keyword in (b"end", b"endsite", b"end_site"):
            if len(tree.end_names) == _MOST_JOINTS:
                raise scanner.error(f"at most {_MOST_JOINTS:,} end sites")
            tree.end_places.append(scanner.start)
            label = scanner.name()
            tree.end_names.append(label or b"Site")
            tree.end_parents.append(joint)
            tree.end_offsets.append(None)
            stack.append(_END)
        else:
            raise scanner.error("OFFSET, CHANNELS, JOINT, End Site or '}'")


def _open_joint(scanner: Scanner, tree: Hierarchy, parent: int) -> None:
    """Read a joint's name and opening brace and add it to the tree."""
    if len(tree.names) == _MOST_JOINTS:
        raise scanner.error(f"at most {_MOST_JOINTS:,} joints")
    tree.places.append(scanner.start)
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
            scanner.fault(f"OFFSET is {number}, 0 taken", scanner.start)
            number = 0.0
        elif abs(number) > FARTHEST:
            raise scanner.error(f"a number from -{FARTHEST:.0f} to {FARTHEST:.0f}, the {axis} of an OFFSET")
        numbers.append(number)
    return numbers[0], numbers[1], numbers[2]


def _read_channels(scanner: Scanner) -> tuple[str, ...]:
    """Read the count and the names after CHANNELS."""
    token = scanner.next()
    if not token.isdigit() or len(token) > 9:
        raise scanner.error("the number of channels")
    count = int(token)
    if count > _MOST_CHANNELS:
        raise scanner.error(f"at most {_MOST_CHANNELS} channels a joint")
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
            scanner.frames_at = scanner.start
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
        scanner.fault(f"frame time is {show(time_token)}, {fps:g} frames a second taken", scanner.start)
    elif not 1.0 <= fps <= 2000.0:
        scanner.find(f"frame time {show(time_token)} means {fps:.6g} frames a second")
    return declared or 0, frame_time, fps


def _whole_number(scanner: Scanner, token: bytes) -> int:
    """Return the number of frames in a token."""
    number = read_number(token)
    if number is None or not 0 <= number < 1e18 or number != int(number):
        raise scanner.error("a number of frames")
    return int(token) if token.isdigit() else int(number)
