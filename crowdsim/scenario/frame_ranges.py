"""Ranges of frames in a user's words, in frames or in seconds, and which frames of a given length they are."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from crowdsim.errors import TakeError

_END = r"\s*(\d+(?:\.\d+)?)\s*(s?)\s*"
_LENGTH = re.compile(_END)
_RANGE = re.compile(rf"(?:{_END})?\s*(?::|\.\.)\s*(?:{_END})?")


@dataclass(frozen=True)
class FrameRange:
    """A half-open range of output frames; an end that is None is the first frame or the one after the last.

    Attributes:
        start: First frame, or time of it [s].
        stop: The frame after the last, or time of it [s].
        start_in_seconds: Whether ``start`` is a time.
        stop_in_seconds: Whether ``stop`` is a time.
        text: The words that it was read from, for messages.
    """

    start: float | None = None
    stop: float | None = None
    start_in_seconds: bool = False
    stop_in_seconds: bool = False
    text: str = ""

    def resolve(self, count: int, fps: float) -> tuple[int, int]:
        """Return the first frame and the one after the last of a motion of ``count`` frames.

        Args:
            count: Number of frames.
            fps: Frames a second.

        Raises:
            TakeError: The range is empty or reaches beyond the motion.
        """
        start = _frame(self.start, self.start_in_seconds, fps, 0)
        stop = _frame(self.stop, self.stop_in_seconds, fps, count)
        result = f"frames {self.text or f'{start}:{stop}'!r}"
        if start >= count or stop > count:
            raise TakeError(f"{result}: there are frames 0 to {count - 1} at {fps:g} fps, {count / fps:g} s")
        if start >= stop:
            raise TakeError(f"{result}: is empty, expected the first frame before the last")
        return start, stop


def parse_frames(text: str) -> FrameRange:
    """Return the range that 'A:B' or 'A..B' means; ends are frames or seconds as in '2s:5s', and may be left out.

    Raises:
        TakeError: It means none, or the range is empty.
    """
    match = _RANGE.fullmatch(text)
    if match is None:
        raise TakeError(f"frames {text!r}: expected A:B, half-open, in frames or seconds, such as 0:120, 2s:5s or 100:")
    start, stop = (None if word is None else float(word) for word in (match[1], match[3]))
    for word, unit in ((match[1], match[2]), (match[3], match[4])):
        if word is not None and not unit and "." in word:
            raise TakeError(f"frames {text!r}: {word} is no whole number, expected frames, or seconds as in {word}s")
    in_seconds = (match[2] == "s", match[4] == "s")
    comparable = in_seconds[0] == in_seconds[1] or start is None
    if stop is not None and comparable and (start or 0) >= stop:
        raise TakeError(f"frames {text!r}: is empty, expected the first frame before the last")
    return FrameRange(start, stop, *in_seconds, text)


def parse_length(text: str) -> tuple[float, bool]:
    """Return the number that '300' or '20s' holds, and whether it is in seconds.

    Raises:
        TakeError: It holds none, or nothing above 0.
    """
    match = _LENGTH.fullmatch(text)
    if match is None or (not match[2] and "." in match[1]) or not float(match[1]) > 0:
        raise TakeError(f"frames {text!r}: expected a whole number of frames from 1, or seconds as in 20s")
    return float(match[1]), match[2] == "s"


def parse_times(text: str, rate: float, frames: int) -> list[float] | float:
    """Return the time that '4s' or '60' means, or those of the control frames that '2s:5s' means [s].

    Args:
        text: Seconds, or a number of control frames; or a half-open range of control frames, see ``parse_frames``.
        rate: Control frames a second.
        frames: How many there are.

    Raises:
        TakeError: It means none, or the range is not within the frames.
    """
    if ":" in text or ".." in text:
        start, stop = parse_frames(text).resolve(frames, rate)
        return [frame / rate for frame in range(start, stop)]
    match = _LENGTH.fullmatch(text)
    if match is None or (not match[2] and "." in match[1]):
        what = f"time {text!r}: expected seconds as in 4s, the number of a control frame, or a range as in 2s:5s"
        raise TakeError(what)
    return float(match[1]) / (1.0 if match[2] else rate)


def first_frame_at(seconds: float, fps: float) -> int:
    """Return the first frame that is not before a time."""
    return math.ceil(seconds * fps - 1e-6)


def output_frames(control_frames: int, rate: float, fps: float) -> int:
    """Return how many output frames a run has: those before its end, one control frame after its last one begins."""
    return first_frame_at(control_frames / rate, fps)


def _frame(value: float | None, in_seconds: bool, fps: float, default: int) -> int:
    if value is None:
        return default
    return first_frame_at(value, fps) if in_seconds else int(value)
