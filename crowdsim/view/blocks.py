"""Blocks of quantised poses and tables of arrays, deflated: the form in which a page holds a recording.

A block holds some successive frames. For each figure in turn it has, avatar by avatar and joint by joint:

- one byte per joint: which component of its quaternions (w, x, y, z) is left out, 4 for none. A component is left out
  where its sign never changes and it is never small; it is the positive root of what the others leave of 1.
- the other components as whole numbers in steps of ``1 / (2 ** (bits - 1) - 1)``, a track a component; ``bits`` depends
  on how far the body, and what it carries, reaches beyond the joint.
- the positions of the joints that move against their parents, the root first, in whole steps of ``STEP`` metres.

Every track is its second differences over time (what comes before the first frame counts as 0), with the sign in the
lowest bit. Tracks lie one after the other, first the low byte of all their values, then the next one: two bytes of
rotations, four of positions.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from crowdsim.core.types import Array

STEP = 0.0005
"""Step of positions [m]."""
FINEST, COARSEST = 14, 9
"""Most and least bits of a component."""
_SMALL = 0.2
"""A component that is never smaller than this may be left out."""


def rotation_bits(reaches: Array) -> Array:
    """Return how many bits components of rotations have, for joints beyond which a body reaches so far (J,) [m]."""
    reaches = np.maximum(np.asarray(reaches, float), 1e-3)
    return np.clip(13 + np.rint(np.log2(reaches) + 0.2), COARSEST, FINEST).astype(int)


def pack_block(parts: Sequence[tuple[Array, Array, Array]]) -> bytes:
    """Return a block of poses.

    Args:
        parts: For each figure bits of its joints (J,), positions of the joints that move (F, n, M, 3) [m] and local
            rotations (F, n, J, 4); NaN while an avatar is absent.
    """
    data = b"".join(_pack_figure(bits, *_filled(moves, rotations)) for bits, moves, rotations in parts)
    # Differences hardly ever repeat but in runs: looking for more takes six times as long, and saves 3 % of the bytes.
    return deflate(data, zlib.Z_RLE)


def _filled(moves: Array, rotations: Array) -> tuple[Array, Array]:
    """Return poses without NaN: what an absent avatar does is what it did last, or will do first."""
    there = np.isfinite(moves[:, :, 0, 0])
    if there.all():
        return moves, rotations
    rows = np.where(there, np.arange(len(there))[:, None], -1)
    rows = np.maximum.accumulate(rows, axis=0)
    rows = np.where(rows < 0, np.argmax(there, axis=0), rows)
    columns = np.arange(there.shape[1])
    moves, rotations = moves[rows, columns], rotations[rows, columns]
    never = ~there.any(axis=0)
    moves[:, never], rotations[:, never] = 0.0, [1.0, 0.0, 0.0, 0.0]
    return moves, rotations


def _pack_figure(bits: Array, moves: Array, rotations: Array) -> bytes:
    frames = len(rotations)
    steps = (2 ** (np.asarray(bits) - 1) - 1)[:, None]
    turned = rotations.astype(np.float32)
    signs = np.where(np.einsum("fnjk,fnjk->fnj", turned[1:], turned[:-1]) < 0.0, np.float32(-1.0), np.float32(1.0))
    turned[1:] *= np.cumprod(signs, axis=0)[..., None]
    keeps_sign = (turned > 0.0).all(axis=0) | (turned < 0.0).all(axis=0)
    least = np.abs(turned).min(axis=0, initial=1.0) * keeps_sign
    left_out = np.where(least.max(axis=-1) > _SMALL, least.argmax(axis=-1), 4)
    first = np.take_along_axis(turned[0], np.minimum(left_out, 3)[..., None], axis=-1)
    turned *= np.where((left_out[..., None] < 4) & (first < 0.0), np.float32(-1.0), np.float32(1.0))
    # Two differences of at most 14 bits have 16.
    values = np.rint(turned * steps).astype(np.int16).reshape(frames, -1)
    kept = (np.arange(4) != left_out[..., None]).ravel()
    places = np.rint(moves.astype(np.float64) / STEP).astype(np.int64).reshape(frames, -1)
    return left_out.astype(np.uint8).tobytes() + _planes(values[:, kept], 2) + _planes(places, 4)


def _planes(values: Array, count: int) -> bytes:
    """Second differences of tracks (F, K) as planes of bytes."""
    tracks = np.ascontiguousarray(values.T)
    for _ in range(2):
        tracks[:, 1:] -= tracks[:, :-1].copy()
    coded = (tracks << 1) ^ (tracks >> (8 * tracks.itemsize - 1))
    split = coded.astype(f"<i{coded.itemsize}", copy=False).view(np.uint8).reshape(*coded.shape, -1)
    return b"".join(split[..., plane].tobytes() for plane in range(count))


def deflate(data: bytes, strategy: int = zlib.Z_FILTERED) -> bytes:
    """Return data compressed, as a browser's ``DecompressionStream('deflate')`` reads it."""
    packer = zlib.compressobj(6, zlib.DEFLATED, zlib.MAX_WBITS, 9, strategy)
    return packer.compress(data) + packer.flush()


def pack_tables(document: Mapping[str, Any], tables: Mapping[str, Array]) -> bytes:
    """Return a JSON document and arrays by name in one piece; the document gets the key ``tables``.

    The piece begins with the length of the document, four bytes with the lowest first. Arrays are int32, float32 or
    uint8, each at a multiple of four bytes: ``tables`` gives type, count and position behind the document.
    """
    places: dict[str, tuple[str, int, int]] = {}
    data, at = [], 0
    for name, table in tables.items():
        array = np.ascontiguousarray(table)
        kind = {"f": "f4", "i": "i4", "u": "u1", "b": "u1"}[array.dtype.kind]
        packed = array.astype(f"<{kind}").tobytes()
        places[name] = kind, array.size, at
        data.append(packed + b"\0" * (-len(packed) % 4))
        at += len(data[-1])
    text = json.dumps({**document, "tables": places}, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    return deflate(b"".join([struct.pack("<I", len(text)), text, *data]))
