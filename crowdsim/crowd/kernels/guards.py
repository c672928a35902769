"""Whether an arm of the victim is in the way of a strike."""

from crowdsim.crowd.kernels.interpolation import point_at
from crowdsim.crowd.kernels.layout import (
    FOREARM_RADIUS,
    GLOVE_RADIUS,
    LEFT_ELBOW,
    LEFT_FIST,
    SCALE,
)
from crowdsim.crowd.kernels.motion import over_ground
from crowdsim.jit import kernel

STEPS = 6
"""Steps of a strike's way from each of its points (``Model.ways``) to the next."""


@kernel(inline=True)
def meet_guard(model, avatars, i, thrown, body, stands):
    """Return whether a strike on its way meets an arm of the victim before it is in head or torso, and where it does.

    The arms are as they are when the strike reaches furthest. It meets one where the middle of the fist or foot comes
    through the surface of forearm or glove: what only grazes them goes on. Where it meets none is where it ends.
    """
    frame, x, z, size, cos, sin, policy, width = stands
    forearm, glove = model.sizes[policy, FOREARM_RADIUS] * width, model.sizes[policy, GLOVE_RADIUS] * size
    left_elbow = point_at(model.arms, frame, LEFT_ELBOW, x, z, size, cos, sin)
    right_elbow = point_at(model.arms, frame, LEFT_ELBOW + 3, x, z, size, cos, sin)
    left_fist = point_at(model.arms, frame, LEFT_FIST, x, z, size, cos, sin)
    right_fist = point_at(model.arms, frame, LEFT_FIST + 3, x, z, size, cos, sin)
    way, own = model.ways[thrown.strike], avatars.real[SCALE, i]
    first = _way_point(model, avatars, i, thrown, way, own, 0)
    middle = _way_point(model, avatars, i, thrown, way, own, 1)
    # Most strikes that land come nowhere near an arm.
    reach = 1.0001 * max(forearm, glove) * max(forearm, glove)
    left = square_between(first, middle, left_elbow, left_fist) <= reach
    left |= square_between(middle, thrown.point, left_elbow, left_fist) <= reach
    right = square_between(first, middle, right_elbow, right_fist) <= reach
    right |= square_between(middle, thrown.point, right_elbow, right_fist) <= reach
    if not left and not right:
        return False, thrown.point
    for step in range(1, 2 * STEPS + 1):
        start, end, t = first, middle, step / STEPS
        if step > STEPS:
            start, end, t = middle, thrown.point, (step - STEPS) / STEPS
        px = start[0] + t * (end[0] - start[0])
        py = start[1] + t * (end[1] - start[1])
        pz = start[2] + t * (end[2] - start[2])
        point = (px, py, pz)
        if left and _is_in_arm(point, left_elbow, left_fist, forearm, glove):
            return True, point
        if right and _is_in_arm(point, right_elbow, right_fist, forearm, glove):
            return True, point
        if _is_in_body(point, body):
            return False, thrown.point
    return False, thrown.point


@kernel(inline=True)
def _way_point(model, avatars, i, thrown, way, own, part):
    """Return a point of the way of a strike [m]."""
    x, z = over_ground(model, avatars, i, thrown.action, thrown.old, way[3 * part], way[3 * part + 2])
    return x, way[3 * part + 1] * own, z


@kernel(inline=True)
def _is_in_arm(point, elbow, fist, forearm, glove):
    """Return whether a point is in a forearm or in the glove at its end."""
    far = _square_from(point, fist, elbow)
    dx, dy, dz = point[0] - fist[0], point[1] - fist[1], point[2] - fist[2]
    return far <= forearm * forearm or dx * dx + dy * dy + dz * dz <= glove * glove


@kernel(inline=True)
def _is_in_body(point, body):
    """Return whether a point is in head or torso."""
    dx, dy, dz = point[0] - body.head[0], point[1] - body.head[1], point[2] - body.head[2]
    if dx * dx + dy * dy + dz * dz <= body.head_radius * body.head_radius:
        return True
    return _square_from(point, body.neck, body.pelvis) <= body.torso_radius * body.torso_radius


@kernel(inline=True)
def _square_from(point, start, end):
    """Return the square of a point's distance from the line between two others."""
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    lx, ly, lz = point[0] - start[0], point[1] - start[1], point[2] - start[2]
    square = dx * dx + dy * dy + dz * dz
    t = 0.0
    if square > 0.0:
        t = min(max((lx * dx + ly * dy + lz * dz) / square, 0.0), 1.0)
    lx, ly, lz = lx - t * dx, ly - t * dy, lz - t * dz
    return lx * lx + ly * ly + lz * lz


@kernel(inline=True)
def square_between(start, end, first, last):
    """Return the square of the least distance between two lines, each from a point to another.

    After Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    ux, uy, uz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    vx, vy, vz = last[0] - first[0], last[1] - first[1], last[2] - first[2]
    wx, wy, wz = start[0] - first[0], start[1] - first[1], start[2] - first[2]
    a, e, b = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    c, f = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    across = a * e - b * b
    s = min(max((b * f - c * e) / across, 0.0), 1.0) if across > 1e-12 else 0.0
    t = (b * s + f) / e if e > 1e-12 else 0.0
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((b * t - c) / a, 0.0), 1.0) if a > 1e-12 else 0.0
    dx, dy, dz = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return dx * dx + dy * dy + dz * dz
