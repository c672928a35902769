"""Compiled point clouds: points that ride on joints, in the world."""

import math

from crowdsim.jit import kernel


@kernel
def _turn(rotation, a, b, c):
    """Return a vector of a joint's frame in the world."""
    w, x, y, z = rotation[0], rotation[1], rotation[2], rotation[3]
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


@kernel
def place_points(
    positions, rotations, before, frame, after, seconds, columns, scales, joints, places, normals,
    first, out_places, out_normals, out_velocities,
):  # fmt: skip
    """Put the points of some avatars into the world, with normals and velocities.

    Velocities are differences between the rows ``before`` and ``after``; where the avatar is absent in one of them, or
    they are one row, only as far as ``frame``.

    Args:
        positions: Joint positions of the avatars [m], NaN while absent. Shape (T, n, J, 3).
        rotations: Joint rotations in the world. Shape (T, n, J, 4).
        before: Row of the earlier neighbour.
        frame: Row of the frame.
        after: Row of the later neighbour.
        seconds: Time from a row to the next [s].
        columns: Avatars that are wanted, all there at the frame. Shape (c,).
        scales: Body sizes. Shape (n,).
        joints: Joint that each point rides on. Shape (K,).
        places: Place of each point in its joint's frame [m]. Shape (K, 3).
        normals: Its normal there. Shape (K, 3).
        first: Row of the outputs at which the first avatar's points begin.
        out_places: Places [m]. Shape (>= first + c * K, 3).
        out_normals: Normals. Likewise.
        out_velocities: Velocities [m/s]. Shape (3, >= first + c * K).

    Returns:
        One past the last row written.
    """
    count = joints.shape[0]
    row = first
    for n in columns:
        low = before if math.isfinite(positions[before, n, 0, 0]) else frame
        high = after if math.isfinite(positions[after, n, 0, 0]) else frame
        rate = 1.0 / (seconds * (high - low)) if high > low else 0.0
        for i in range(count):
            j = joints[i]
            a, b, c = places[i, 0] * scales[n], places[i, 1] * scales[n], places[i, 2] * scales[n]
            x, y, z = _turn(rotations[frame, n, j], a, b, c)
            out_places[row, 0] = positions[frame, n, j, 0] + x
            out_places[row, 1] = positions[frame, n, j, 1] + y
            out_places[row, 2] = positions[frame, n, j, 2] + z
            if high > low:
                lx, ly, lz = _turn(rotations[low, n, j], a, b, c)
                hx, hy, hz = _turn(rotations[high, n, j], a, b, c)
                out_velocities[0, row] = (positions[high, n, j, 0] - positions[low, n, j, 0] + (hx - lx)) * rate
                out_velocities[1, row] = (positions[high, n, j, 1] - positions[low, n, j, 1] + (hy - ly)) * rate
                out_velocities[2, row] = (positions[high, n, j, 2] - positions[low, n, j, 2] + (hz - lz)) * rate
            else:
                out_velocities[0, row], out_velocities[1, row], out_velocities[2, row] = 0.0, 0.0, 0.0
            nx, ny, nz = _turn(rotations[frame, n, j], normals[i, 0], normals[i, 1], normals[i, 2])
            out_normals[row, 0], out_normals[row, 1], out_normals[row, 2] = nx, ny, nz
            row += 1
    return row
