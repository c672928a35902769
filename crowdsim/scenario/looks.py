"""Words for how pictures and bodies look, which never changes what avatars do."""

from __future__ import annotations

import re
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, WithJsonSchema

from crowdsim.config.schema import quoted
from crowdsim.errors import nearest

Marks = Literal["none", "landed", "all"]
Light = Literal["day", "soft", "evening", "night"]
Figure = Literal["auto", "body", "capsules"]
Sex = Literal["male", "female"]
Hands = Literal["gloves", "bare"]
MARKS, LIGHTS, FIGURES = get_args(Marks), get_args(Light), get_args(Figure)
BACKGROUNDS = ("day", "dark", "studio", "white", "black", "green")
MOST_BLUR = 64
"""Of how many moments a picture may be the mean."""
_COLOUR = "#[0-9a-fA-F]{6}"


def check_background(text: str) -> str:
    """Return the word or colour of a background.

    Raises:
        ValueError: It is none.
    """
    if text not in BACKGROUNDS and not re.fullmatch(_COLOUR, text):
        raise ValueError(f"expected {quoted(BACKGROUNDS)} or a colour as '#rrggbb'{nearest(text, BACKGROUNDS)}")
    return text


Background = Annotated[
    str,
    AfterValidator(check_background),
    WithJsonSchema(
        {"type": "string", "pattern": f"^({'|'.join(BACKGROUNDS)}|{_COLOUR})$", "examples": [*BACKGROUNDS, "#ff9000"]}
    ),
]
