"""Colours of skins: of a team or a type, and of each avatar."""

from __future__ import annotations

import colorsys

import numpy as np

from crowdsim.body.anatomy import GIRTHS, Build
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.core.types import Array

_GOLDEN = 0.6180339887498949
_HUES = (0.995, 0.605, 0.12, 0.40, 0.77, 0.53, 0.065, 0.90, 0.25, 0.69)
_SKINS = ((0.87, 0.66, 0.53), (0.76, 0.55, 0.42), (0.58, 0.40, 0.29), (0.40, 0.27, 0.20), (0.82, 0.61, 0.47))
HAIR = ((0.09, 0.07, 0.06), (0.17, 0.11, 0.07), (0.06, 0.05, 0.05), (0.30, 0.20, 0.11), (0.24, 0.15, 0.09))
_ROUGHNESS = {
    "skin": 0.55,
    "lips": 0.45,
    "eyes": 0.3,
    "pupils": 0.15,
    "hair": 0.75,
    "brows": 0.8,
    "gloves": 0.35,
    "shoes": 0.5,
}
_USUAL_ROUGHNESS = 0.85


def usual_build(girth: float) -> Build:
    """Return the build of an avatar of a girth."""
    return Build(kind=min(GIRTHS, key=lambda kind: abs(GIRTHS[kind] - girth)))


def colours(avatar: int, team: int, colour: Array | None = None) -> Array:
    """Return the colour of each of ``SKIN_PARTS``, sRGB in 0..1. Shape (P, 3).

    Args:
        avatar: Number of the avatar, which skin and hair follow.
        team: Its team, which clothes follow.
        colour: Colour of the clothes instead; NaN for none. Shape (3,).
    """
    hue, strong, bright = (_HUES[team] if team < len(_HUES) else (team * _GOLDEN + 0.17) % 1.0), 0.88, 0.74
    if colour is not None and np.isfinite(colour).all():
        hue, strong, bright = colorsys.rgb_to_hsv(*(float(value) for value in colour))
    kind = (avatar * 3 + avatar // 5) % len(_SKINS)
    skin, hair = np.array(_SKINS[kind]), np.array(HAIR[(avatar + kind) % len(HAIR)])
    cloth = np.array(colorsys.hsv_to_rgb(hue, strong, bright))
    light = np.array(colorsys.hsv_to_rgb(hue, 0.12 * strong, 0.92))
    of = {
        "skin": skin, "hair": hair, "brows": hair, "eyes": (0.80, 0.78, 0.75), "pupils": (0.06, 0.04, 0.03),
        "lips": skin * (0.86, 0.66, 0.66),
        "top": cloth, "shorts": cloth, "band": light, "gloves": cloth * 0.96, "cuffs": light,
        "shoes": (0.10, 0.10, 0.115), "soles": (0.85, 0.85, 0.83),
    }  # fmt: skip
    return np.array([of[part] for part in SKIN_PARTS], float)


def linear(colour: Array) -> Array:
    """Return linear values of sRGB values in 0..1."""
    colour = np.asarray(colour, float)
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def roughness(part: int) -> float:
    """Return how rough a part is, 0 a mirror and 1 chalk."""
    return _ROUGHNESS.get(SKIN_PARTS[part], _USUAL_ROUGHNESS)
