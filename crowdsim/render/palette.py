"""Colours: a hue for each team, a shade for each avatar."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import PARTS

_GOLDEN = 0.6180339887498949
_HUES = (0.995, 0.605, 0.12, 0.40, 0.77, 0.53, 0.065, 0.90, 0.25, 0.69)
"""Hues of the first teams: red, blue, yellow, green, violet, cyan, orange, pink, lime, indigo."""
_SKINS = ((0.93, 0.75, 0.62), (0.80, 0.60, 0.46), (0.62, 0.44, 0.33), (0.45, 0.31, 0.24), (0.87, 0.68, 0.53))
EYES = len(PARTS)
"""Number of the paint of eyes, which comes after those of the parts of a body."""
_EYES = (0.02, 0.02, 0.03, 0.30)
_GLOSS = {"skin": 0.10, "head": 0.12, "glove": 0.55, "shirt": 0.04, "trunks": 0.16, "shoe": 0.25}


def team_hue(team: int) -> float:
    """Return the hue of a team, 0..1; the first ten are chosen, later ones spread by the golden ratio."""
    return _HUES[team] if team < len(_HUES) else (team * _GOLDEN + 0.17) % 1.0


def avatar_paints(teams: Sequence[int] | Array, colours: Array | None = None) -> Array:
    """Return the paint of every part and the eyes of every avatar: linear red, green, blue and gloss.

    Shape (N, 7, 4), float32; the last row is ``EYES``.

    Where all avatars are of one team, or each is a team of its own, avatars have hues of their own.

    Args:
        teams: Team of each avatar. Shape (N,).
        colours: Colour that an avatar has instead, NaN for none: red, green, blue in 0..1. Shape (N, 3).
    """
    teams = np.asarray(teams, dtype=int)
    _, numbers = np.unique(teams, return_inverse=True)
    alone = len(teams) > 1 and (numbers.max() == 0 or numbers.max() + 1 == len(teams) > 2)
    paints = np.zeros((len(teams), len(PARTS) + 1, 4), np.float32)
    paints[:, EYES] = _EYES
    for avatar, team in enumerate(numbers):
        shade = (avatar * _GOLDEN + 0.3) % 1.0
        if alone:
            hue, vivid = (avatar * _GOLDEN) % 1.0, 0.62 + 0.25 * ((avatar * 0.7548776662 + 0.1) % 1.0)
        else:
            hue, vivid = (team_hue(int(team)) + 0.036 * (shade - 0.5)) % 1.0, 0.80
        if colours is not None and np.isfinite(colours[avatar]).all():
            red, green, blue = (float(value) for value in colours[avatar])
            hue, vivid, _ = colorsys.rgb_to_hsv(red, green, blue)
        skin = np.array(_SKINS[(avatar * 3 + avatar // 5) % len(_SKINS)])
        dress = {
            "skin": skin,
            "head": skin * 0.97,
            "glove": np.array(colorsys.hsv_to_rgb(hue, 0.88, 0.86)),
            "shirt": skin if alone else np.array(colorsys.hsv_to_rgb(hue, 0.62, 0.52 + 0.36 * shade)),
            "trunks": np.array(colorsys.hsv_to_rgb(hue, vivid - 0.38 * abs(shade - 0.5), 0.42 + 0.5 * shade)),
            "shoe": np.array((0.20, 0.20, 0.22)),
        }
        for part, name in enumerate(PARTS):
            paints[avatar, part, :3] = dress[name] ** 2.0
            paints[avatar, part, 3] = _GLOSS[name]
    return paints
