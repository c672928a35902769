"""Compiled dart throwing: random points in a disc, a least distance apart."""

import math

import numpy as np

from crowdsim.jit import kernel


@kernel(inline=True)
def mix(bits):
    """Scramble 64 bits (SplitMix64's finaliser)."""
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@kernel(inline=True)
def uniform(stream, avatar, draw):
    """Return the number in [0, 1) of ``random.uniform``; ``stream`` is uint64."""
    golden = np.uint64(0x9E3779B97F4A7C15)
    bits = mix(stream + (np.uint64(avatar) + np.uint64(1)) * golden)
    bits = mix(bits + (np.uint64(draw) + np.uint64(1)) * golden)
    return np.float64(bits >> np.uint64(11)) * 2.0**-53


@kernel(inline=True)
def bucket_of(column, row, mask):
    """Return the bucket of a square of the hash grid; neighbours in a row are neighbours in memory."""
    return np.int64((mix(np.uint64(row)) + np.uint64(column)) & mask)


@kernel(inline=True)
def enter(i, x, z, size, mask, heads, following):
    """Enter point ``i`` into the hash grid, whose squares are ``size`` wide."""
    bucket = bucket_of(np.int64(math.floor(x / size)), np.int64(math.floor(z / size)), mask)
    following[i] = heads[bucket]
    heads[bucket] = i


@kernel
def is_free(x, z, least, mask, heads, following, xs, zs):
    """Return whether no point of the hash grid lies nearer than ``least``, the width of its squares."""
    column, row = np.int64(math.floor(x / least)), np.int64(math.floor(z / least))
    for k in range(9):
        # The middle first: where the disc is crowded, most darts fall next to a point of their own square.
        c, r = column + (k + 1) % 3 - 1, row + (k // 3 + 1) % 3 - 1
        i = heads[bucket_of(c, r, mask)]
        while i >= 0:
            dx, dz = xs[i] - x, zs[i] - z
            if dx * dx + dz * dz < least * least:
                return False
            i = following[i]
    return True


@kernel
def insert_points(start, stop, size, heads, following, xs, zs):
    """Enter points ``start`` to ``stop`` into the hash grid; ``heads`` has a power of two of buckets, -1 when empty."""
    mask = np.uint64(heads.shape[0] - 1)
    for i in range(start, stop):
        enter(i, xs[i], zs[i], size, mask, heads, following)


@kernel
def stride_through(count):
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
def throw_darts(stream, start, stop, centre_x, centre_z, radius, least, tries, heads, following, xs, zs):
    """Place avatars ``start`` to ``stop`` at the first of their ``tries`` darts that is free; return where it stops.

    Darts of an avatar are hashes of its number and the dart's. Where all miss, a lattice of a quarter of ``least`` is
    searched, in leaps all over the disc and each of its points once in all: what was taken stays taken.
    """
    mask = np.uint64(heads.shape[0] - 1)
    step = 0.25 * least
    half = np.int64(radius / step)
    width = 2 * half + 1
    lattice = width * width
    stride = stride_through(lattice)
    searched, position = np.int64(0), np.int64(0)
    for i in range(start, stop):
        placed = False
        x, z = 0.0, 0.0
        for dart in range(tries):
            distance = radius * math.sqrt(uniform(stream, i, 2 * dart))
            angle = 2.0 * math.pi * uniform(stream, i, 2 * dart + 1)
            x, z = centre_x + distance * math.sin(angle), centre_z + distance * math.cos(angle)
            if is_free(x, z, least, mask, heads, following, xs, zs):
                placed = True
                break
        while not placed and searched < lattice:
            dx, dz = (position % width - half) * step, (position // width - half) * step
            x, z = centre_x + dx, centre_z + dz
            position = (position + stride) % lattice
            searched += 1
            inside = dx * dx + dz * dz <= radius * radius
            placed = inside and is_free(x, z, least, mask, heads, following, xs, zs)
        if not placed:
            return i
        xs[i], zs[i] = x, z
        enter(i, x, z, least, mask, heads, following)
    return stop


@kernel
def first_conflict(least, heads, following, xs, zs):
    """Return the first point with an earlier one nearer than ``least``, or -1; enters all points before it."""
    mask = np.uint64(heads.shape[0] - 1)
    for i in range(xs.shape[0]):
        if not is_free(xs[i], zs[i], least, mask, heads, following, xs, zs):
            return i
        enter(i, xs[i], zs[i], least, mask, heads, following)
    return -1
