"""What a BVH file holds, unchanged: the structure that reader and writer share."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from crowdsim.core.types import Array

CHANNELS = {
    letter.lower() + kind: letter + kind for kind in ("position", "rotation", "scale") for letter in ("X", "Y", "Z")
}
"""Known channel names in the usual spelling, by their lower-case form."""

FARTHEST = 1e6
"""The greatest offset, position or angle that a file may hold, in its own units."""

AXIS = {"X": 0, "Y": 1, "Z": 2}

COMMON_RATES = (24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150, 180, 200, 240, 250, 300, 360, 480, 500, 1000)
"""Rates at which motion is usually written [1/s]."""
_FILM_RATES = tuple(rate * 1000 / 1001 for rate in (24, 30, 48, 60, 120, 240))
_FALLBACK_RATE = 30.0


@dataclass(frozen=True)
class Bvh:
    """A BVH file in its own units: lengths in file units, angles in degrees, columns in file order.

    Attributes:
        names: Joint names. Length J.
        parents: Index of each joint's parent, -1 for a root; parents come before children. Shape (J,), int32.
        offsets: OFFSET of each joint. Shape (J, 3).
        channels: Channel names of each joint in file order, such as ('Xposition', 'Zrotation').
        end_parents: Joint that each end site hangs on. Shape (E,), int32.
        end_offsets: OFFSET of each end site. Shape (E, 3).
        end_names: What follows the word End, 'Site' as a rule. Length E.
        motion: One row a frame, one column a channel. Shape (F, C), float64.
        declared_frames: What the file says after ``Frames:``.
        frame_time: What the file says after ``Frame Time:`` [s].
        fps: Frames a second, the frame time's rounding undone.
        path: The file it came from, or an empty string.
        findings: What is odd about the file, one line each, ``PATH:LINE:COLUMN: what``.
        faults: Those of the findings by which the motion is incomplete or wrong.
    """

    names: tuple[str, ...]
    parents: Array
    offsets: Array
    channels: tuple[tuple[str, ...], ...]
    end_parents: Array
    end_offsets: Array
    end_names: tuple[str, ...]
    motion: Array
    declared_frames: int
    frame_time: float
    fps: float
    path: str = ""
    findings: tuple[str, ...] = field(default=())
    faults: tuple[str, ...] = field(default=())

    @property
    def joint_count(self) -> int:
        """Number of joints J, end sites excluded."""
        return len(self.names)

    @property
    def frame_count(self) -> int:
        """Number of rows F that the file holds, whatever it declares."""
        return len(self.motion)

    @property
    def channel_count(self) -> int:
        """Number of columns C."""
        return sum(map(len, self.channels))

    def first_channels(self) -> Array:
        """Return the column of each joint's first channel, and C at the end. Shape (J + 1,)."""
        return np.concatenate([[0], np.cumsum([len(names) for names in self.channels], dtype=np.int64)]).astype(
            np.int64
        )

    def describe_column(self, column: int) -> str:
        """Return a column in words: ``joint 'chest', channel Xrotation``."""
        first = self.first_channels()
        joint = int(np.searchsorted(first, column, side="right")) - 1
        return f"joint {quoted(self.names[joint])}, channel {self.channels[joint][column - int(first[joint])]}"


def quoted(name: str) -> str:
    """Return a name for a message: quoted, and shortened when it is long."""
    return repr(name if len(name) <= 60 else name[:57] + "...")


def snap_rate(text: str, frame_time: float) -> float:
    """Return the frames a second that a written frame time means, its rounding or truncation undone.

    Args:
        text: The frame time as written, whose digits limit its precision ('0.00833333' is 120 a second).
        frame_time: The same as a number [s].

    Returns:
        The nearest of the rates 1..2000 and of film and television (23.976, 29.97, 59.94 ...) that could have been
        written so, common rates first; 1 / frame_time where none fits; 30 where the frame time is no positive number.
    """
    if not (math.isfinite(frame_time) and 1e-9 < frame_time < 1e9):
        return _FALLBACK_RATE
    rate = 1.0 / frame_time
    if abs(rate - round(rate)) < 1e-9 * rate:
        return float(round(rate))
    digits, _, power = text.lower().partition("e")
    decimals = len(digits.partition(".")[2]) - (int(power) if power.lstrip("+-").isdigit() else 0)
    unit = 10.0**-decimals if decimals < 300 else 0.0
    least = 1e-4 * frame_time
    low = frame_time - min(max(0.55 * unit, least), 0.045 * frame_time)
    high = frame_time + min(max(1.0 * unit, least), 0.045 * frame_time)
    nearby = range(max(1, math.floor(1.0 / high)), min(2000, math.ceil(1.0 / low)) + 1)
    for rates in (COMMON_RATES, _FILM_RATES, nearby):
        fitting = [float(known) for known in rates if low <= 1.0 / known <= high]
        if fitting:
            return min(fitting, key=lambda known: abs(1.0 / known - frame_time))
    return rate
