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
_SECTORS = np.array([(0, 3, 1), (2, 0, 1), (1, 0, 3), (1, 2, 0), (3, 1, 0), (0, 1, 2)])
"""Which level red, green and blue have in each sixth of the hues: the value, the least, the falling, the rising one."""
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
    alone = bool(len(teams) > 1 and (numbers.max() == 0 or numbers.max() + 1 == len(teams) > 2))
    avatars = np.arange(len(teams))
    shades = ((avatars * _GOLDEN + 0.3) % 1.0)[:, None]
    skins = np.array(_SKINS)[(avatars * 3 + avatars // 5) % len(_SKINS)]
    given = np.zeros(len(teams), bool)
    if colours is not None:
        given[:] = np.isfinite(colours).all(axis=1)
    plain, own = ~given & (not alone), ~given & alone
    # A colour means itself; those of a team differ a little, by how light they are.
    gloves = np.zeros((len(teams), 3)) if colours is None else np.array(colours, float)
    trunks = gloves * _TRUNKS
    which, inverse = np.unique(numbers[plain], return_inverse=True)
    gloves[plain] = np.array([team_colour(int(team)) for team in which]).reshape(-1, 3)[inverse]
    gloves[plain] *= 0.9 + 0.1 * shades[plain]
    trunks[plain] = gloves[plain] * (_TRUNKS - 0.15 + 0.3 * shades[plain])
    hues, vivid = (avatars * _GOLDEN) % 1.0, 0.62 + 0.25 * ((avatars * 0.7548776662 + 0.1) % 1.0)
    gloves[own] = _from_hues(hues, np.full(len(teams), 0.88), np.full(len(teams), 0.86))[own]
    trunks[own] = _from_hues(hues, vivid - 0.38 * np.abs(shades[:, 0] - 0.5), 0.42 + 0.5 * shades[:, 0])[own]
    dress = {
        "skin": skins,
        "head": skins * 0.97,
        "glove": gloves,
        "shirt": np.where(own[:, None], skins, gloves),
        "trunks": trunks,
        "shoe": np.array((0.20, 0.20, 0.22)),
    }
    paints = np.zeros((len(teams), len(PARTS) + 1, 4), np.float32)
    paints[:, EYES] = _EYES
    for part, name in enumerate(PARTS):
        paints[:, part, :3] = dress[name] ** 2.0
        paints[:, part, 3] = _GLOSS[name]
    return paints


def _from_hues(hues: Array, vivid: Array, bright: Array) -> Array:
    """Return colours of hues, saturations and values (N,), as ``colorsys.hsv_to_rgb`` does. Shape (N, 3)."""
    sector = np.floor(hues * 6.0).astype(int)
    part = hues * 6.0 - sector
    levels = np.stack([bright, bright * (1.0 - vivid), bright * (1.0 - vivid * part),
                       bright * (1.0 - vivid * (1.0 - part))], axis=1)  # fmt: skip
    return np.take_along_axis(levels, _SECTORS[sector % 6], axis=1)


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
