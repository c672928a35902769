"""Colours: a hue for each team, a shade for each avatar."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

import numpy as np

from crowdsim.body.parts import SKIN_PARTS
from crowdsim.core.types import Array
from crowdsim.motion.body import PARTS

_GOLDEN = 0.6180339887498949
_TEAMS = (
    (0.82, 0.16, 0.15), (0.15, 0.36, 0.90), (0.98, 0.95, 0.10), (0.12, 0.42, 0.54), (0.28, 0.09, 0.49),
    (0.53, 0.76, 0.94), (0.98, 0.47, 0.04), (0.96, 0.77, 0.74), (0.74, 0.92, 0.52), (0.39, 0.10, 0.14),
)  # fmt: skip
"""Colours of the first teams: red, blue, yellow, teal, violet, light blue, orange, rose, lime, maroon. Eyes that lack
the cones for red or green tell them apart: by CIELAB distances of 28 at the least, as Machado et al. (2009) simulate
them."""
_SKINS = ((0.93, 0.75, 0.62), (0.80, 0.60, 0.46), (0.62, 0.44, 0.33), (0.45, 0.31, 0.24), (0.87, 0.68, 0.53))
EYES = len(PARTS)
"""Number of the paint of eyes, which comes after those of the parts of a body."""
_HAIR = ((0.09, 0.07, 0.06), (0.17, 0.11, 0.07), (0.06, 0.05, 0.05), (0.30, 0.20, 0.11), (0.24, 0.15, 0.09))
_EYES = (0.02, 0.02, 0.03, 0.30)
_TRUNKS = 0.8
"""How bright trunks are for the colour of a team."""
_DRESSES = ("skin", "glove", "shirt", "trunks", "shoe")
_GLOSS = {"skin": 0.10, "head": 0.12, "glove": 0.55, "shirt": 0.04, "trunks": 0.16, "shoe": 0.25}


def team_colour(team: int) -> tuple[float, float, float]:
    """Return the colour of a team, red, green and blue in 0..1; the first ten are chosen, later ones spread."""
    if team < len(_TEAMS):
        return _TEAMS[team]
    return colorsys.hsv_to_rgb((team * _GOLDEN + 0.17) % 1.0, 0.75, 0.55 + 0.4 * ((team * 0.7548776662) % 1.0))


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
        skin = np.array(_SKINS[(avatar * 3 + avatar // 5) % len(_SKINS)])
        given = colours is not None and bool(np.isfinite(colours[avatar]).all())
        if alone and not given:
            hue, vivid = (avatar * _GOLDEN) % 1.0, 0.62 + 0.25 * ((avatar * 0.7548776662 + 0.1) % 1.0)
            glove = np.array(colorsys.hsv_to_rgb(hue, 0.88, 0.86))
            trunks = np.array(colorsys.hsv_to_rgb(hue, vivid - 0.38 * abs(shade - 0.5), 0.42 + 0.5 * shade))
        else:
            # A colour means itself; those of a team differ a little, by how light they are.
            glove = np.array(colours[avatar] if given and colours is not None else team_colour(int(team)), float)
            glove = glove * (1.0 if given else 0.9 + 0.1 * shade)
            trunks = glove * (_TRUNKS if given else _TRUNKS - 0.15 + 0.3 * shade)
        dress = {
            "skin": skin,
            "head": skin * 0.97,
            "glove": glove,
            "shirt": skin if alone and not given else glove,
            "trunks": trunks,
            "shoe": np.array((0.20, 0.20, 0.22)),
        }
        for part, name in enumerate(PARTS):
            paints[avatar, part, :3] = dress[name] ** 2.0
            paints[avatar, part, 3] = _GLOSS[name]
    return paints


def capsule_paints(paints: Array, bare: Array) -> Array:
    """Return paints of capsules, on which the gloves of avatars with bare hands are skin.

    Args:
        paints: Those of ``avatar_paints``. Shape (N, 7, 4).
        bare: Which avatars have bare hands. Shape (N,), bool.
    """
    found = paints.copy()
    found[bare, PARTS.index("glove")] = paints[bare, PARTS.index("skin")]
    return found


def skin_paints(avatar: int, paints: Array, kind: int = 0) -> Array:
    """Return the paint of each of ``body.parts.SKIN_PARTS`` of an avatar. Shape (P, 4), float32.

    Args:
        avatar: Its number, which the colour of its hair follows.
        paints: Its row of ``avatar_paints``. Shape (7, 4).
        kind: Number of its type: types in turn have plain shorts, or such with stripes, hems, or both.
    """
    skin, glove, shirt, trunks, shoe = (paints[PARTS.index(name)] for name in _DRESSES)
    hair = np.array((*(value**2.0 for value in _HAIR[(avatar * 7 + avatar // 3) % len(_HAIR)]), 0.10))
    bright = np.array((*(0.25 * glove[:3] + 0.55), 0.12))
    of = {
        "skin": skin, "hair": hair, "brows": hair, "eyes": (0.62, 0.60, 0.56, 0.4), "pupils": (0.01, 0.01, 0.01, 0.6),
        "lips": skin * (0.80, 0.52, 0.52, 2.0), "top": shirt, "shorts": trunks, "band": bright, "gloves": glove,
        "cuffs": bright, "shoes": shoe, "soles": (0.70, 0.70, 0.68, 0.1),
        "stripes": bright if kind % 2 else trunks, "hems": bright if kind % 4 > 1 else trunks,
        "crossings": bright if kind % 4 else trunks,
    }  # fmt: skip
    return np.array([of[part] for part in SKIN_PARTS], np.float32)
