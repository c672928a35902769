"""How pictures look: light, background, marks of strikes."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import CrowdsimError, nearest
from crowdsim.scenario.looks import BACKGROUNDS, FIGURES, LIGHTS, MARKS, MOST_BLUR, check_background

_LIGHTS: dict[str, tuple[float, ...]] = {
    "day": (1.22, 1.19, 1.11, 0.40, 0.45, 0.53, 0.20, 0.20, 0.19),
    "soft": (0.70, 0.69, 0.66, 0.72, 0.74, 0.78, 0.42, 0.42, 0.41),
    "evening": (1.45, 0.98, 0.58, 0.36, 0.34, 0.44, 0.24, 0.17, 0.12),
    "night": (0.40, 0.50, 0.72, 0.13, 0.16, 0.26, 0.05, 0.06, 0.09),
}
"""Light of sun, sky and floor by its name: red, green and blue of each."""
_SKIES: dict[str, tuple[float, ...]] = {
    "day": (0.66, 0.73, 0.81, 0.24, 0.37, 0.61),
    "soft": (0.74, 0.77, 0.80, 0.55, 0.62, 0.70),
    "evening": (0.86, 0.55, 0.36, 0.24, 0.22, 0.42),
    "night": (0.10, 0.13, 0.22, 0.02, 0.03, 0.08),
}
"""Colour of the sky at the horizon and above, by the light."""
_FLAT = {"studio": "#b9bcc2", "white": "#ffffff", "black": "#000000", "green": "#00b140"}
"""Backgrounds of one colour, with shadows."""
_DAY_FLOOR, _DARK_FLOOR = (0.40, 0.055, 0.34, 0.13), (0.10, 0.016, 0.40, 0.16)
"""How bright a floor is, and how strong its squares, lines and fine lines are."""
_DARK_SKY = (0.07, 0.08, 0.10, 0.015, 0.018, 0.03)
_SHADOW = 0.55


@dataclass(frozen=True)
class Look:
    """How pictures look.

    Attributes:
        marks: Which strikes have marks: ``none``, those that ``landed``, or ``all``.
        grid: Whether the floor has squares and lines.
        background: ``day``, ``dark``, ``studio``, ``white``, ``black``, ``green`` or a colour as '#rrggbb'.
        light: ``day``, ``soft``, ``evening`` or ``night``.
        transparent: Whether pictures hold the figures alone, and how they cover.
        caption: Whether pictures have a small caption.
        motion_blur: How many moments a picture is the mean of, while a shutter is open for half a frame; 0 for none.
        figure: ``body``, ``capsules``, or ``auto``: bodies where they are seen from near.
    """

    marks: str = "all"
    grid: bool = True
    background: str = "day"
    light: str = "day"
    transparent: bool = False
    caption: bool = True
    motion_blur: int = 0
    figure: str = "auto"

    def __post_init__(self) -> None:
        """Refuse words that mean nothing."""
        words = ("marks", self.marks, MARKS), ("light", self.light, LIGHTS), ("figure", self.figure, FIGURES)
        for name, word, choices in words:
            if word not in choices:
                raise CrowdsimError(f"{name} {word!r}: expected {', '.join(choices)}{nearest(word, choices)}")
        if not 0 <= self.motion_blur <= MOST_BLUR:
            raise CrowdsimError(f"motion blur {self.motion_blur}: expected 0 to {MOST_BLUR} moments")
        try:
            check_background(self.background)
        except ValueError as error:
            raise CrowdsimError(f"background {self.background!r}: {error}") from None

    def pack(self) -> Array:
        """Return what kernels take of it: the columns of a light from ``SUN_RED`` on. Shape (21,)."""
        colour = "#000000" if self.transparent else _FLAT.get(self.background, self.background)
        flat = colour.startswith("#")
        sky = _DARK_SKY if self.background == "dark" else _SKIES[self.light]
        floor = _DARK_FLOOR if self.background == "dark" else _DAY_FLOOR
        if flat:
            red_green_blue = tuple(linear(int(colour[i : i + 2], 16) / 255.0) for i in (1, 3, 5))
            sky = (*red_green_blue, *red_green_blue)
        pattern = floor if self.grid else (floor[0], 0.0, 0.0, 0.0)
        return np.array([*_LIGHTS[self.light], *pattern, *sky, float(flat), _SHADOW])

    @classmethod
    def of(cls, source: Any) -> Look:
        """Return the look that an object's attributes of the same names describe."""
        return cls(**{one.name: getattr(source, one.name) for one in fields(cls)})

    def plain(self) -> Look:
        """Return it without a caption."""
        return replace(self, caption=False)


def linear(value: float) -> float:
    """Return the light that a picture shows as a value in 0..1: the inverse of what develops pictures."""
    light = value * value
    return light if light <= 0.8 else 0.8 + (light - 0.8) / (1.0 - 2.0 * (light - 0.8))


__all__ = ["BACKGROUNDS", "FIGURES", "LIGHTS", "MARKS", "Look", "linear"]
