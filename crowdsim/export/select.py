"""Which avatars to export, from what a user writes."""

from __future__ import annotations

import re

from crowdsim.crowd.cast import Cast
from crowdsim.errors import TakeError


def parse_avatars(text: str | None, cast: Cast) -> list[int] | None:
    """Return the numbers that '0-9' or '0,3,red_1,blue' means, ascending; None for all.

    A name is that of an avatar, a group, a type or a team.

    Raises:
        TakeError: It means none, or avatars that the take does not have.
    """
    if text is None:
        return None
    numbers: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part)
        try:
            if match is None:
                numbers.update(cast.members(part.strip()).tolist())
                continue
            first, last = int(match[1]), int(match[2] or match[1])
            cast.number(last)
        except TakeError as error:
            raise TakeError(f"avatars {text!r}: {error}{'' if match else ', or a range as in 0-9'}") from None
        if first > last:
            raise TakeError(f"avatars {text!r}: {part.strip()!r} runs backwards, expected {last}-{first}")
        numbers.update(range(first, last + 1))
    return sorted(numbers)
