"""Which avatars and frames to export, from what a user writes."""

from __future__ import annotations

import re

from crowdsim.errors import TakeError


def parse_avatars(text: str | None, count: int) -> list[int] | None:
    """Return the numbers that '0-9' or '0,3,5-7' means, ascending; None for all.

    Raises:
        TakeError: It means none, or avatars that the take does not have.
    """
    if text is None:
        return None
    numbers: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part)
        if match is None:
            raise TakeError(f"avatars {text!r}: {part.strip()!r} is no number or range, expected 0-9 or 0,3,5-7")
        first, last = int(match[1]), int(match[2] or match[1])
        if last >= count:
            raise TakeError(f"avatars {text!r}: there is no avatar {last}, the take has 0 to {count - 1}")
        if first > last:
            raise TakeError(f"avatars {text!r}: {part.strip()!r} runs backwards, expected {last}-{first}")
        numbers.update(range(first, last + 1))
    return sorted(numbers)


def parse_range(text: str | None, count: int, fps: float) -> tuple[int, int] | None:
    """Return the half-open range of output frames that 'A:B' means; either may be left out; None for all.

    Raises:
        TakeError: It means none, or lies outside the take.
    """
    if text is None:
        return None
    match = re.fullmatch(r"\s*(\d*)\s*:\s*(\d*)\s*", text)
    if match is None:
        raise TakeError(f"frames {text!r}: expected A:B, half-open, such as 0:120")
    start, stop = int(match[1] or 0), int(match[2] or count)
    if start >= stop:
        raise TakeError(f"frames {text!r}: is empty, expected the first frame before the last")
    if stop > count:
        raise TakeError(f"frames {text!r}: the take has frames 0 to {count - 1} at {fps:g} fps")
    return start, stop
