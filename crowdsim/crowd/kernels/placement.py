"""Compiled dart throwing: random points in a disc, a least distance apart."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.random import mix, uniform
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import CLEAR, gap_at


class Squares(NamedTuple):
    """A hash grid over points.

    Attributes:
        size: Width of a square, and the least distance between points [m].
        heads: The last point of each bucket, -1 when empty; a power of two of them. Shape (buckets,), int32.
        following: The next point of the same bucket, or -1. Shape (N,), int32.
        xs: Positions of the points [m]. Shape (N,), float64.
        zs: Likewise.
    """

    size: float
    heads: Any
    following: Any
    xs: Any
    zs: Any


class Disc(NamedTuple):
    """A disc: centre and radius [m]."""

    x: float
    z: float
    radius: float


@kernel(inline=True)
def _bucket_of(squares, column, row):
    """Return the bucket of a square of the hash grid; neighbours in a row are neighbours in memory."""
    mask = np.uint64(squares.heads.shape[0] - 1)
    return np.int64((mix(np.uint64(row)) + np.uint64(column)) & mask)


@kernel(inline=True)
def _enter(squares, i):
    """Enter point ``i`` into the hash grid."""
    x, z = squares.xs[i], squares.zs[i]
    bucket = _bucket_of(squares, np.int64(math.floor(x / squares.size)), np.int64(math.floor(z / squares.size)))
    squares.following[i] = squares.heads[bucket]
    squares.heads[bucket] = i


@kernel
def _is_free(squares, x, z):
    """Return whether no point of the hash grid is nearer than the width of its squares."""
    least = squares.size
    column, row = np.int64(math.floor(x / least)), np.int64(math.floor(z / least))
    for k in range(9):
        # The middle first: where the disc is crowded, most darts fall next to a point of their own square.
        c, r = column + (k + 1) % 3 - 1, row + (k // 3 + 1) % 3 - 1
        i = squares.heads[_bucket_of(squares, c, r)]
        while i >= 0:
            dx, dz = squares.xs[i] - x, squares.zs[i] - z
            if dx * dx + dz * dz < least * least:
                return False
            i = squares.following[i]
    return True


@kernel
def insert_points(squares, start, stop):
    """Enter points ``start`` to ``stop`` into the hash grid."""
    for i in range(start, stop):
        _enter(squares, i)


@kernel
def _stride_through(count):
    """Return a stride near the golden section that visits all of ``count`` places before any twice."""
    stride = max(np.int64(1), np.int64(0.6180339887498949 * count))
    while True:
        a, b = count, stride
        while b > 0:
            a, b = b, a % b
        if a == 1:
            return stride
        stride += 1


@kernel
def throw_darts(stream, start, stop, disc, tries, squares, places):
    """Place avatars ``start`` to ``stop`` at the first of their ``tries`` darts that is free; return where it stops.

    Darts of an avatar are hashes of its number and the dart's. Where all miss, a lattice of a quarter of the least
    distance is searched, in leaps all over the disc and each of its points once in all: what was taken stays taken.
    """
    step = 0.25 * squares.size
    half = np.int64(disc.radius / step)
    width = 2 * half + 1
    lattice = width * width
    stride = _stride_through(lattice)
    searched, position = np.int64(0), np.int64(0)
    for i in range(start, stop):
        placed = False
        x, z = 0.0, 0.0
        for dart in range(tries):
            distance = disc.radius * math.sqrt(uniform(stream, i, 2 * dart))
            angle = 2.0 * math.pi * uniform(stream, i, 2 * dart + 1)
            cos, sin = cos_sin(angle)
            x, z = disc.x + distance * sin, disc.z + distance * cos
            if gap_at(places, 0, x, z) >= CLEAR and _is_free(squares, x, z):
                placed = True
                break
        while not placed and searched < lattice:
            dx, dz = (position % width - half) * step, (position // width - half) * step
            x, z = disc.x + dx, disc.z + dz
            position = (position + stride) % lattice
            searched += 1
            inside = dx * dx + dz * dz <= disc.radius * disc.radius
            placed = inside and gap_at(places, 0, x, z) >= CLEAR and _is_free(squares, x, z)
        if not placed:
            return i
        squares.xs[i], squares.zs[i] = x, z
        _enter(squares, i)
    return stop


@kernel
def first_conflict(squares):
    """Return the first point with an earlier one nearer than the least distance, or -1; enters all points before it."""
    for i in range(squares.xs.shape[0]):
        if not _is_free(squares, squares.xs[i], squares.zs[i]):
            return i
        _enter(squares, i)
    return -1
