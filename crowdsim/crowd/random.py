"""Random numbers without a generator: every draw is a hash of (seed, purpose, avatar, draw number).

Nothing is carried from one draw to the next, so results do not depend on threads, batches or the order of avatars. With
the finaliser of SplitMix64, ``mix`` (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014),

    stream  = mix(mix(seed + G) + purpose * G)
    bits    = mix(mix(stream + (avatar + 1) * G) + (draw + 1) * G)        G = 0x9E3779B97F4A7C15, modulo 2^64
    uniform = (bits >> 11) * 2^-53                                        in [0, 1)

``core/random.py`` holds the same in compiled form, equal to the bit.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


class Purpose(IntEnum):
    """What a number is drawn for; numbers of different purposes are independent. Values never change their meaning."""

    PLACE = 1
    FACING = 2
    TYPE = 3
    SCALE = 4
    SPEED = 5
    START = 6
    CHOICE = 7
    TARGET = 8
    BURST = 9
    TEMPO = 10
    AGGRESSION = 11
    RANGE = 12
    STANCE = 13
    GIRTH = 14
    LEGS = 15
    ARMS = 16
    PRE_ROLL = 17


def stream(seed: int, purpose: int) -> np.uint64:
    """Return what ``seed`` and ``purpose`` contribute to a draw: kernels take it as an argument of type uint64."""
    with np.errstate(over="ignore"):
        return np.uint64(_mix(_mix(np.uint64(seed % 2**64) + _GOLDEN) + np.uint64(purpose) * _GOLDEN))


def uniform(seed: int, purpose: int, avatar: ArrayLike, draw: ArrayLike = 0) -> Array:
    """Return numbers evenly spread over [0, 1), one for each avatar and draw.

    Args:
        seed: The scenario's seed.
        purpose: What the numbers are for, a :class:`Purpose`.
        avatar: Avatar numbers, 0 or more, of any shape.
        draw: Numbers of the draw, 0 or more, such as the frame or the count of decisions; broadcast against ``avatar``.

    Returns:
        Array of float64 of the broadcast shape.
    """
    avatars, draws = np.asarray(avatar).astype(np.uint64), np.asarray(draw).astype(np.uint64)
    with np.errstate(over="ignore"):
        one = np.uint64(1)
        bits = _mix(_mix(stream(seed, purpose) + (avatars + one) * _GOLDEN) + (draws + one) * _GOLDEN)
    return np.asarray(bits >> np.uint64(11)).astype(np.float64) * 2.0**-53


def normal(seed: int, purpose: int, avatar: ArrayLike, draw: ArrayLike = 0) -> Array:
    """Return standard normal numbers, one for each avatar and draw (Box and Muller, from draws 2n and 2n + 1)."""
    draws = np.asarray(draw) * 2
    radius = np.sqrt(-2.0 * np.log1p(-uniform(seed, purpose, avatar, draws)))
    return radius * np.cos(2.0 * np.pi * uniform(seed, purpose, avatar, draws + 1))


def _mix(bits: Any) -> Any:
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))
