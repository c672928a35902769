"""Valid names of groups, types and avatars, which are names of files too; and what spreadsheets take for a formula."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

NAME = r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}"
"""Names in scenarios. They are stems of files too, so nothing in them may lead to another folder."""
NAME_RULE = (
    "letters, digits, '_', '-' and '.', at most 64, a letter or digit first, no '.' last, and none that Windows "
    "reserves, such as CON, NUL or COM1"
)

_RESERVED = r"(?i:con|prn|aux|nul|com[0-9]|lpt[0-9])(\.|$)"
_NAME = re.compile(rf"(?!{_RESERVED}){NAME}(?<!\.)")
_AVATAR_NAME = re.compile(rf"(?!{_RESERVED}){NAME}(_[0-9]{{1,9}})?(?<!\.)")
_FILE_NAME = re.compile(rf"""(?!{_RESERVED})[^<>:"|?*\\/\x00-\x1f]+(?<![. ])""")


def is_name(text: str) -> bool:
    """Whether a text follows ``NAME_RULE``."""
    return _NAME.fullmatch(text) is not None


def is_portable(part: str) -> bool:
    """Whether every system can have a file or folder of this name, Windows included."""
    return _FILE_NAME.fullmatch(part) is not None


def harmless_cell(value: Any) -> Any:
    """Return a value of which no spreadsheet makes a formula: text that looks like one has a quote before it."""
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value


def avatar_name_fault(names: Sequence[str]) -> str:
    """Say what is wrong with the names of all avatars; an empty text when nothing is.

    An avatar's name is a name, with the avatar's number in its group behind it. No two may be alike, even on file
    systems whose file names are not case-sensitive.
    """
    # At once where all is well: there may be a million.
    if all(map(_AVATAR_NAME.fullmatch, names)) and len(set(map(str.casefold, names))) == len(names):
        return ""
    for number, name in enumerate(names):
        if not _AVATAR_NAME.fullmatch(name):
            return f"avatar {number} is named {name!r}, expected {NAME_RULE}, and '_' and its number"
    seen: dict[str, int] = {}
    for number, name in enumerate(names):
        other = seen.setdefault(name.casefold(), number)
        if other != number:
            both = f"{names[other]!r} and {name!r}"
            return f"avatars {other} and {number} are named {both}, expected a name of its own each"
    return ""
