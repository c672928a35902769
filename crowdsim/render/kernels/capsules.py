"""Compiled preparation of capsules for one camera: placing, culling, projection, light space and neighbours."""

import math

from crowdsim.core.quaternions import rotate
from crowdsim.jit import kernel
from crowdsim.render.kernels.columns import (
    AHEAD_X,
    AHEAD_Y,
    AHEAD_Z,
    EYE_X,
    EYE_Y,
    EYE_Z,
    FLOOR_PER_METRE,
    FLOOR_X,
    FLOOR_Z,
    FOCAL,
    GRID_U,
    GRID_V,
    MIDDLE_X,
    MIDDLE_Y,
    PER_METRE,
    REACH,
    RIGHT_X,
    RIGHT_Y,
    RIGHT_Z,
    SOFTNESS,
    SUN_X,
    SUN_Y,
    U_X,
    UP_X,
    UP_Y,
    UP_Z,
    V_X,
    WIDEST,
)

CLOSEST = 0.05
NEIGHBOUR_GAP = 0.15


@kernel
def place_capsules(positions, rotations, scales, joints, starts, ends, radii, out_places):
    """Write the capsules of bodies in the world: both ends (3, 3) and both radii. Shape (n * K, 8), float32."""
    count = joints.shape[0]
    for n in range(positions.shape[0]):
        scale = scales[n]
        for k in range(count):
            j, row = joints[k], n * count + k
            for end in range(2):
                if end == 0:
                    a, b, c = starts[k, 0], starts[k, 1], starts[k, 2]
                else:
                    a, b, c = ends[k, 0], ends[k, 1], ends[k, 2]
                x, y, z = rotate(rotations[n, j], a, b, c)
                out_places[row, 3 * end] = positions[n, j, 0] + scale * x
                out_places[row, 3 * end + 1] = positions[n, j, 1] + scale * y
                out_places[row, 3 * end + 2] = positions[n, j, 2] + scale * z
                out_places[row, 6 + end] = scale * radii[k, end]


@kernel
def choose_capsules(places, camera, width, height, margin, smallest, out_chosen):
    """Write the capsules that show, or whose shadow may, ascending, and return how many.

    A capsule shows when the sphere about it, widened by ``margin`` [m], reaches into the view, and when it covers
    ``smallest`` pixels or more.
    """
    count = 0
    tx, ty = 0.5 * width / camera[FOCAL], 0.5 * height / camera[FOCAL]
    lx, ly = math.sqrt(1.0 + tx * tx), math.sqrt(1.0 + ty * ty)
    for c in range(places.shape[0]):
        ax, ay, az = places[c, 0] - camera[EYE_X], places[c, 1] - camera[EYE_Y], places[c, 2] - camera[EYE_Z]
        bx, by, bz = places[c, 3] - camera[EYE_X], places[c, 4] - camera[EYE_Y], places[c, 5] - camera[EYE_Z]
        ra, rb = places[c, 6], places[c, 7]
        mx, my, mz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        long = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2)
        wide = max(ra, rb)
        size = 0.5 * long + wide + margin
        x = mx * camera[RIGHT_X] + my * camera[RIGHT_Y] + mz * camera[RIGHT_Z]
        y = mx * camera[UP_X] + my * camera[UP_Y] + mz * camera[UP_Z]
        z = mx * camera[AHEAD_X] + my * camera[AHEAD_Y] + mz * camera[AHEAD_Z]
        if not (z > -size and abs(x) - tx * z < size * lx and abs(y) - ty * z < size * ly):
            continue
        if smallest > 0.0:
            per_metre = camera[FOCAL] / max(z, 1.0)
            if 2.0 * wide * (long + 1.6 * wide) * per_metre * per_metre < smallest:
                continue
        out_chosen[count] = c
        count += 1
    return count


@kernel
def view_capsules(places, chosen, camera, light, out_cones, out_shades, out_segments, out_spans):
    """Write the chosen capsules as ``draw_tiles`` wants them, and as segments of the screen in tiles."""
    for n in range(chosen.shape[0]):
        c = chosen[n]
        ax, ay, az = places[c, 0] - camera[EYE_X], places[c, 1] - camera[EYE_Y], places[c, 2] - camera[EYE_Z]
        bx, by, bz = places[c, 3] - camera[EYE_X], places[c, 4] - camera[EYE_Y], places[c, 5] - camera[EYE_Z]
        ra, rb = places[c, 6], places[c, 7]
        out_cones[n, 0], out_cones[n, 1], out_cones[n, 2] = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        out_cones[n, 3], out_cones[n, 4], out_cones[n, 5] = 0.5 * (bx - ax), 0.5 * (by - ay), 0.5 * (bz - az)
        out_cones[n, 6], out_cones[n, 7] = 0.5 * (ra + rb), 0.5 * (rb - ra)
        for axis in range(3):
            o = (U_X, V_X, SUN_X)[axis]
            out_shades[n, axis] = ax * light[o] + ay * light[o + 1] + az * light[o + 2]
            out_shades[n, 3 + axis] = (bx - ax) * light[o] + (by - ay) * light[o + 1] + (bz - az) * light[o + 2]
        out_shades[n, 6], out_shades[n, 7] = ra, rb - ra
        out_shades[n, 8] = 1.0 / max(out_shades[n, 3] ** 2 + out_shades[n, 4] ** 2, 1e-9)
        za = ax * camera[AHEAD_X] + ay * camera[AHEAD_Y] + az * camera[AHEAD_Z]
        zb = bx * camera[AHEAD_X] + by * camera[AHEAD_Y] + bz * camera[AHEAD_Z]
        near = CLOSEST + max(ra, rb)
        if za < near and zb < near:
            out_segments[n, 4] = -1.0
            out_spans[n, 0], out_spans[n, 1] = 0, -1
            continue
        # An end behind the eye moves along the axis to where it can be projected.
        if za < near:
            s = (near - za) / (zb - za)
            ax, ay, az = ax + s * (bx - ax), ay + s * (by - ay), az + s * (bz - az)
        elif zb < near:
            s = (near - zb) / (za - zb)
            bx, by, bz = bx + s * (ax - bx), by + s * (ay - by), bz + s * (az - bz)
        _project(ax, ay, az, ra, camera, out_segments[n], 0)
        _project(bx, by, bz, rb, camera, out_segments[n], 1)
        segment = out_segments[n]
        low = min(max(8.0 * min(segment[1] - segment[4], segment[3] - segment[5]), -1e6), 1e6)
        high = min(max(8.0 * max(segment[1] + segment[4], segment[3] + segment[5]), -1e6), 1e6)
        out_spans[n, 0], out_spans[n, 1] = math.floor(low), math.floor(high)


@kernel
def _project(x, y, z, radius, camera, segment, end):
    """Write a circle in tiles of 8 pixels that encloses the picture of a sphere, and a pixel more."""
    u = x * camera[RIGHT_X] + y * camera[RIGHT_Y] + z * camera[RIGHT_Z]
    v = x * camera[UP_X] + y * camera[UP_Y] + z * camera[UP_Z]
    w = x * camera[AHEAD_X] + y * camera[AHEAD_Y] + z * camera[AHEAD_Z]
    over = 1.0 / (w * w - radius * radius)
    across = camera[FOCAL] * radius * math.sqrt(max(u * u + v * v + w * w - radius * radius, 0.0)) * over
    segment[2 * end] = (camera[MIDDLE_X] + camera[FOCAL] * u * w * over) / 8.0
    segment[2 * end + 1] = (camera[MIDDLE_Y] - camera[FOCAL] * v * w * over) / 8.0
    segment[4 + end] = (across + 1.0) / 8.0


@kernel
def shadow_bounds(shades, out):
    """Write the least and greatest u and v that the capsules reach in light space. Shape (4,)."""
    out[0], out[1], out[2], out[3] = 1e30, 1e30, -1e30, -1e30
    for c in range(shades.shape[0]):
        for end in range(2):
            radius = shades[c, 6] + end * shades[c, 7]
            for axis in range(2):
                place = shades[c, axis] + end * shades[c, 3 + axis]
                out[axis] = min(out[axis], place - radius)
                out[2 + axis] = max(out[2 + axis], place + radius)


@kernel
def shadow_segments(shades, cones, camera, light, thinnest, out):
    """Write the capsules as segments of the grid of shadows, widened by the softest edge that they can cast.

    Those that show thinner than ``thinnest`` pixels are left out.
    """
    for c in range(shades.shape[0]):
        ahead = cones[c, 0] * camera[AHEAD_X] + cones[c, 1] * camera[AHEAD_Y] + cones[c, 2] * camera[AHEAD_Z]
        if 2.0 * (cones[c, 6] + abs(cones[c, 7])) * camera[FOCAL] < thinnest * max(ahead, 1.0):
            out[c, 4] = -1.0
            continue
        over = max(camera[EYE_Y] + cones[c, 1] + abs(cones[c, 4]) + cones[c, 6] + abs(cones[c, 7]), 0.0)
        pad = light[SOFTNESS] * over / light[SUN_Y] + light[WIDEST]
        for end in range(2):
            out[c, 2 * end] = (shades[c, 0] + end * shades[c, 3] - light[GRID_U]) * light[PER_METRE]
            out[c, 2 * end + 1] = (shades[c, 1] + end * shades[c, 4] - light[GRID_V]) * light[PER_METRE]
            out[c, 4 + end] = (shades[c, 6] + end * shades[c, 7] + pad) * light[PER_METRE]


@kernel
def contact_segments(cones, camera, floor, out):
    """Write the capsules within ``floor[REACH]`` [m] of the floor as segments of the grid of contacts."""
    reach = floor[REACH]
    for c in range(cones.shape[0]):
        low = camera[EYE_Y] + cones[c, 1] - abs(cones[c, 4]) - cones[c, 6] - abs(cones[c, 7])
        if low > reach:
            out[c, 4] = -1.0
            continue
        for end in range(2):
            sign = 2.0 * end - 1.0
            out[c, 2 * end] = (cones[c, 0] + sign * cones[c, 3] - floor[FLOOR_X]) * floor[FLOOR_PER_METRE]
            out[c, 2 * end + 1] = (cones[c, 2] + sign * cones[c, 5] - floor[FLOOR_Z]) * floor[FLOOR_PER_METRE]
            out[c, 4 + end] = (cones[c, 6] + sign * cones[c, 7] + reach) * floor[FLOOR_PER_METRE]


@kernel
def _axis_distance(p, q):
    """Return the distance between the axes of two cones."""
    # With x = p + s hp and y = q + t hq, s and t in -1..1: solve for s, clamp, solve for t, clamp, solve for s again.
    rx, ry, rz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    a = p[3] * p[3] + p[4] * p[4] + p[5] * p[5]
    e = q[3] * q[3] + q[4] * q[4] + q[5] * q[5]
    b = p[3] * q[3] + p[4] * q[4] + p[5] * q[5]
    c = p[3] * rx + p[4] * ry + p[5] * rz
    f = q[3] * rx + q[4] * ry + q[5] * rz
    s = min(max((b * f - c * e) / max(a * e - b * b, 1e-9), -1.0), 1.0)
    t = min(max((b * s + f) / max(e, 1e-9), -1.0), 1.0)
    s = min(max((b * t - c) / max(a, 1e-9), -1.0), 1.0)
    dx, dy, dz = rx + s * p[3] - t * q[3], ry + s * p[4] - t * q[4], rz + s * p[5] - t * q[5]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def near_capsules(cones, owners, camera, smallest, out):
    """Write for each capsule those of the same avatar whose surface is near, ascending, then -1.

    Avatars that show smaller than ``smallest`` pixels a metre have none. Capsules of one avatar lie beside one another.
    """
    slots = out.shape[1]
    count = cones.shape[0]
    start = 0
    while start < count:
        stop = start + 1
        while stop < count and owners[stop] == owners[start]:
            stop += 1
        for c in range(start, stop):
            out[c, 0] = -1
        ahead = (
            cones[start, 0] * camera[AHEAD_X] + cones[start, 1] * camera[AHEAD_Y] + cones[start, 2] * camera[AHEAD_Z]
        )
        if camera[FOCAL] >= smallest * max(ahead, 0.5):
            for c in range(start, stop):
                used = 0
                for other in range(start, stop):
                    if other == c or used == slots:
                        continue
                    touch = cones[c, 6] + abs(cones[c, 7]) + cones[other, 6] + abs(cones[other, 7])
                    if _axis_distance(cones[c], cones[other]) < touch + NEIGHBOUR_GAP:
                        out[c, used] = other
                        used += 1
                if used < slots:
                    out[c, used] = -1
        start = stop
