"""Compiled point clouds: points that ride on joints, in the world."""

import numba as nb


@nb.njit(cache=True, nogil=True)
def place_points(positions, rotations, scales, joints, places, normals, first, out_places, out_normals):
    """Put every avatar's points into the world.

    Args:
        positions: Joint positions of the avatars [m]. Shape (n, J, 3).
        rotations: Joint rotations in the world. Shape (n, J, 4).
        scales: Body sizes. Shape (n,).
        joints: Joint that each point rides on. Shape (K,).
        places: Place of each point in its joint's frame [m]. Shape (K, 3).
        normals: Its normal there. Shape (K, 3).
        first: Row of ``out_places`` at which the first avatar's points begin.
        out_places: Shape (>= first + n * K, 3).
        out_normals: Likewise; untouched where it has no rows.
    """
    count = joints.shape[0]
    wanted = out_normals.shape[0] > 0
    for n in range(positions.shape[0]):
        for i in range(count):
            j = joints[i]
            row = first + n * count + i
            w, x, y, z = rotations[n, j, 0], rotations[n, j, 1], rotations[n, j, 2], rotations[n, j, 3]
            a, b, c = places[i, 0] * scales[n], places[i, 1] * scales[n], places[i, 2] * scales[n]
            tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
            out_places[row, 0] = positions[n, j, 0] + a + w * tx + y * tz - z * ty
            out_places[row, 1] = positions[n, j, 1] + b + w * ty + z * tx - x * tz
            out_places[row, 2] = positions[n, j, 2] + c + w * tz + x * ty - y * tx
            if wanted:
                a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
                tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
                out_normals[row, 0] = a + w * tx + y * tz - z * ty
                out_normals[row, 1] = b + w * ty + z * tx - x * tz
                out_normals[row, 2] = c + w * tz + x * ty - y * tx
