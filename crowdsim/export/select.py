"""Which avatars to export, from what a user writes."""

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
