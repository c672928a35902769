"""Compiled preparation of capsules for one camera: placing, culling, projection, light space and neighbours."""

import math

from crowdsim.core.quaternions import rotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import TRUNK
from crowdsim.render.kernels.columns import (
    A_RADIUS,
    AHEAD_X,
    AHEAD_Y,
    AHEAD_Z,
    ALONG_U,
    ALONG_V,
    AX,
    AY,
    B_RADIUS,
    BY,
    CENTRE_X,
    CENTRE_Y,
    CENTRE_Z,
    END_RADIUS,
    END_X,
    EYE_X,
    EYE_Y,
    EYE_Z,
    FIRST_ROW,
    FLOOR_PER_METRE,
    FLOOR_X,
    FLOOR_Z,
    FOCAL,
    GREATEST_U,
    GREATEST_V,
    GRID_U,
    GRID_V,
    HALF_X,
    HALF_Y,
    HALF_Z,
    LAST_ROW,
    LEAST_U,
    LEAST_V,
    MIDDLE_X,
    MIDDLE_Y,
    PER_METRE,
    PER_SQUARE,
    RADIUS,
    REACH,
    RIGHT_X,
    RIGHT_Y,
    RIGHT_Z,
    SHADE_RADIUS,
    SHADE_TAPER,
    SHADE_U,
    SHADE_V,
    SOFTNESS,
    START_RADIUS,
    START_X,
    START_Y,
    START_Z,
    SUN_X,
    SUN_Y,
    TAPER,
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
def place_capsules(positions, rotations, sizes, girths, joints, segments, offsets, radii, swells, out_shapes):
    """Write the capsules of bodies in the world: both ends (3, 3) and both radii. Shape (n * K, 8), float32.

    Those that swell, whose ``swells`` (K,) is 1, are as many times thicker as the girth says. ``sizes`` (n, 3) are
    those of the bones of trunk, legs and arms, one of which each capsule lies on, by ``segments`` (K,); ``offsets``
    (2, K, 3) are its ends in its joint's frame.
    """
    count = joints.shape[0]
    for n in range(positions.shape[0]):
        scale = sizes[n, TRUNK]
        for k in range(count):
            j, row = joints[k], n * count + k
            size = sizes[n, segments[k]]
            width = scale * (1.0 + swells[k] * (girths[n] - 1.0))
            for end in range(2):
                o = offsets[end, k]
                x, y, z = rotate(rotations[n, j], o[0], o[1], o[2])
                out_shapes[row, START_X + 3 * end] = positions[n, j, 0] + size * x
                out_shapes[row, START_Y + 3 * end] = positions[n, j, 1] + size * y
                out_shapes[row, START_Z + 3 * end] = positions[n, j, 2] + size * z
                out_shapes[row, START_RADIUS + end] = width * radii[k, end]


@kernel
def _from_eye(values, first, camera):
    """Return the vector from the eye to the point whose coordinates begin at a column."""
    return values[first] - camera[EYE_X], values[first + 1] - camera[EYE_Y], values[first + 2] - camera[EYE_Z]


@kernel
def _depth(cone, camera):
    """Return how far ahead of the eye the centre of a cone is [m]."""
    return cone[CENTRE_X] * camera[AHEAD_X] + cone[CENTRE_Y] * camera[AHEAD_Y] + cone[CENTRE_Z] * camera[AHEAD_Z]


@kernel
def choose_capsules(shapes, camera, width, height, margin, smallest, out_chosen):
    """Write the capsules that show, or whose shadow may, ascending, and return how many.

    A capsule shows when the sphere about it, widened by ``margin`` [m], reaches into the view, and when it covers
    ``smallest`` pixels or more.
    """
    count = 0
    tx, ty = 0.5 * width / camera[FOCAL], 0.5 * height / camera[FOCAL]
    lx, ly = math.sqrt(1.0 + tx * tx), math.sqrt(1.0 + ty * ty)
    for c in range(shapes.shape[0]):
        ax, ay, az = _from_eye(shapes[c], START_X, camera)
        bx, by, bz = _from_eye(shapes[c], END_X, camera)
        ra, rb = shapes[c, START_RADIUS], shapes[c, END_RADIUS]
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
def view_capsules(shapes, chosen, camera, light, out_cones, out_shades, out_segments, out_spans):
    """Write the chosen capsules as ``draw_tiles`` wants them, and as segments of the screen in tiles."""
    for n in range(chosen.shape[0]):
        c = chosen[n]
        ax, ay, az = _from_eye(shapes[c], START_X, camera)
        bx, by, bz = _from_eye(shapes[c], END_X, camera)
        ra, rb = shapes[c, START_RADIUS], shapes[c, END_RADIUS]
        cone = out_cones[n]
        cone[CENTRE_X], cone[CENTRE_Y], cone[CENTRE_Z] = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        cone[HALF_X], cone[HALF_Y], cone[HALF_Z] = 0.5 * (bx - ax), 0.5 * (by - ay), 0.5 * (bz - az)
        cone[RADIUS], cone[TAPER] = 0.5 * (ra + rb), 0.5 * (rb - ra)
        for axis in range(3):
            o = (U_X, V_X, SUN_X)[axis]
            out_shades[n, SHADE_U + axis] = ax * light[o] + ay * light[o + 1] + az * light[o + 2]
            out_shades[n, ALONG_U + axis] = (bx - ax) * light[o] + (by - ay) * light[o + 1] + (bz - az) * light[o + 2]
        out_shades[n, SHADE_RADIUS], out_shades[n, SHADE_TAPER] = ra, rb - ra
        out_shades[n, PER_SQUARE] = 1.0 / max(out_shades[n, ALONG_U] ** 2 + out_shades[n, ALONG_V] ** 2, 1e-9)
        za = ax * camera[AHEAD_X] + ay * camera[AHEAD_Y] + az * camera[AHEAD_Z]
        zb = bx * camera[AHEAD_X] + by * camera[AHEAD_Y] + bz * camera[AHEAD_Z]
        near = CLOSEST + max(ra, rb)
        if za < near and zb < near:
            out_segments[n, A_RADIUS] = -1.0
            out_spans[n, FIRST_ROW], out_spans[n, LAST_ROW] = 0, -1
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
        low = min(max(8.0 * min(segment[AY] - segment[A_RADIUS], segment[BY] - segment[B_RADIUS]), -1e6), 1e6)
        high = min(max(8.0 * max(segment[AY] + segment[A_RADIUS], segment[BY] + segment[B_RADIUS]), -1e6), 1e6)
        out_spans[n, FIRST_ROW], out_spans[n, LAST_ROW] = math.floor(low), math.floor(high)


@kernel
def _project(x, y, z, radius, camera, segment, end):
    """Write a circle in tiles of 8 pixels that encloses the picture of a sphere, and a pixel more."""
    u = x * camera[RIGHT_X] + y * camera[RIGHT_Y] + z * camera[RIGHT_Z]
    v = x * camera[UP_X] + y * camera[UP_Y] + z * camera[UP_Z]
    w = x * camera[AHEAD_X] + y * camera[AHEAD_Y] + z * camera[AHEAD_Z]
    over = 1.0 / (w * w - radius * radius)
    across = camera[FOCAL] * radius * math.sqrt(max(u * u + v * v + w * w - radius * radius, 0.0)) * over
    segment[AX + 2 * end] = (camera[MIDDLE_X] + camera[FOCAL] * u * w * over) / 8.0
    segment[AY + 2 * end] = (camera[MIDDLE_Y] - camera[FOCAL] * v * w * over) / 8.0
    segment[A_RADIUS + end] = (across + 1.0) / 8.0


@kernel
def shadow_bounds(shades, out):
    """Write the least and greatest u and v that the capsules reach in light space. Shape (4,)."""
    out[LEAST_U], out[LEAST_V], out[GREATEST_U], out[GREATEST_V] = 1e30, 1e30, -1e30, -1e30
    for c in range(shades.shape[0]):
        for end in range(2):
            radius = shades[c, SHADE_RADIUS] + end * shades[c, SHADE_TAPER]
            for axis in range(2):
                along = shades[c, SHADE_U + axis] + end * shades[c, ALONG_U + axis]
                out[LEAST_U + axis] = min(out[LEAST_U + axis], along - radius)
                out[GREATEST_U + axis] = max(out[GREATEST_U + axis], along + radius)


@kernel
def shadow_segments(shades, cones, camera, light, thinnest, out):
    """Write the capsules as segments of the grid of shadows, widened by the softest edge that they can cast.

    Those that show thinner than ``thinnest`` pixels are left out.
    """
    for c in range(shades.shape[0]):
        ahead = _depth(cones[c], camera)
        if 2.0 * (cones[c, RADIUS] + abs(cones[c, TAPER])) * camera[FOCAL] < thinnest * max(ahead, 1.0):
            out[c, A_RADIUS] = -1.0
            continue
        cone = cones[c]
        over = max(camera[EYE_Y] + cone[CENTRE_Y] + abs(cone[HALF_Y]) + cone[RADIUS] + abs(cone[TAPER]), 0.0)
        pad = light[SOFTNESS] * over / light[SUN_Y] + light[WIDEST]
        for end in range(2):
            out[c, AX + 2 * end] = (shades[c, SHADE_U] + end * shades[c, ALONG_U] - light[GRID_U]) * light[PER_METRE]
            out[c, AY + 2 * end] = (shades[c, SHADE_V] + end * shades[c, ALONG_V] - light[GRID_V]) * light[PER_METRE]
            out[c, A_RADIUS + end] = (shades[c, SHADE_RADIUS] + end * shades[c, SHADE_TAPER] + pad) * light[PER_METRE]


@kernel
def contact_segments(cones, camera, floor, out):
    """Write the capsules within ``floor[REACH]`` [m] of the floor as segments of the grid of contacts."""
    reach, per_metre = floor[REACH], floor[FLOOR_PER_METRE]
    for c in range(cones.shape[0]):
        cone = cones[c]
        low = camera[EYE_Y] + cone[CENTRE_Y] - abs(cone[HALF_Y]) - cone[RADIUS] - abs(cone[TAPER])
        if low > reach:
            out[c, A_RADIUS] = -1.0
            continue
        for end in range(2):
            sign = 2.0 * end - 1.0
            out[c, AX + 2 * end] = (cone[CENTRE_X] + sign * cone[HALF_X] - floor[FLOOR_X]) * per_metre
            out[c, AY + 2 * end] = (cone[CENTRE_Z] + sign * cone[HALF_Z] - floor[FLOOR_Z]) * per_metre
            out[c, A_RADIUS + end] = (cone[RADIUS] + sign * cone[TAPER] + reach) * per_metre


@kernel
def _axis_distance(p, q):
    """Return the distance between the axes of two cones."""
    # With x = p + s hp and y = q + t hq, s and t in -1..1: solve for s, clamp, solve for t, clamp, solve for s again.
    rx, ry, rz = p[CENTRE_X] - q[CENTRE_X], p[CENTRE_Y] - q[CENTRE_Y], p[CENTRE_Z] - q[CENTRE_Z]
    a = p[HALF_X] * p[HALF_X] + p[HALF_Y] * p[HALF_Y] + p[HALF_Z] * p[HALF_Z]
    e = q[HALF_X] * q[HALF_X] + q[HALF_Y] * q[HALF_Y] + q[HALF_Z] * q[HALF_Z]
    b = p[HALF_X] * q[HALF_X] + p[HALF_Y] * q[HALF_Y] + p[HALF_Z] * q[HALF_Z]
    c = p[HALF_X] * rx + p[HALF_Y] * ry + p[HALF_Z] * rz
    f = q[HALF_X] * rx + q[HALF_Y] * ry + q[HALF_Z] * rz
    s = min(max((b * f - c * e) / max(a * e - b * b, 1e-9), -1.0), 1.0)
    t = min(max((b * s + f) / max(e, 1e-9), -1.0), 1.0)
    s = min(max((b * t - c) / max(a, 1e-9), -1.0), 1.0)
    dx = rx + s * p[HALF_X] - t * q[HALF_X]
    dy = ry + s * p[HALF_Y] - t * q[HALF_Y]
    dz = rz + s * p[HALF_Z] - t * q[HALF_Z]
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
        ahead = _depth(cones[start], camera)
        if camera[FOCAL] >= smallest * max(ahead, 0.5):
            for c in range(start, stop):
                used = 0
                for other in range(start, stop):
                    if other == c or used == slots:
                        continue
                    touch = cones[c, RADIUS] + abs(cones[c, TAPER]) + cones[other, RADIUS] + abs(cones[other, TAPER])
                    if _axis_distance(cones[c], cones[other]) < touch + NEIGHBOUR_GAP:
                        out[c, used] = other
                        used += 1
                if used < slots:
                    out[c, used] = -1
        start = stop
