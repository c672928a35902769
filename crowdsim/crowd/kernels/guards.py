"""Whether an arm of the victim is in the way of a strike."""

from crowdsim.crowd.kernels.interpolation import point_at
from crowdsim.crowd.kernels.layout import (
    FOREARM_RADIUS,
    GLOVE_RADIUS,
    LEFT_ELBOW,
    LEFT_FIST,
    SCALE,
    WAY_POINTS,
)
from crowdsim.crowd.kernels.motion import over_ground
from crowdsim.jit import kernel

STEPS = 6
"""Steps of a strike's way from each of its points to the next."""


@kernel(inline=True)
def is_blocked(model, avatars, i, blow, body, stands):
    """Return whether a strike on its way meets an arm of the victim before it is in head or torso.

    The arms are as they are when the strike reaches furthest. It meets one where the middle of the fist or foot comes
    through the surface of forearm or glove: what only grazes them goes on.
    """
    frame, x, z, size, cos, sin, policy = stands
    forearm, glove = model.sizes[policy, FOREARM_RADIUS] * size, model.sizes[policy, GLOVE_RADIUS] * size
    left_elbow = point_at(model.arms, frame, LEFT_ELBOW, x, z, size, cos, sin)
    right_elbow = point_at(model.arms, frame, LEFT_ELBOW + 3, x, z, size, cos, sin)
    left_fist = point_at(model.arms, frame, LEFT_FIST, x, z, size, cos, sin)
    right_fist = point_at(model.arms, frame, LEFT_FIST + 3, x, z, size, cos, sin)
    way, own = model.ways[blow.strike], avatars.real[SCALE, i]
    for part in range(WAY_POINTS):
        start, end = _way_point(model, avatars, i, blow, way, own, part), blow.point
        if part + 1 < WAY_POINTS:
            end = _way_point(model, avatars, i, blow, way, own, part + 1)
        for step in range(1, STEPS + 1):
            t = step / STEPS
            px = start[0] + t * (end[0] - start[0])
            py = start[1] + t * (end[1] - start[1])
            pz = start[2] + t * (end[2] - start[2])
            point = (px, py, pz)
            if _is_in_arm(point, left_elbow, left_fist, forearm, glove):
                return True
            if _is_in_arm(point, right_elbow, right_fist, forearm, glove):
                return True
            if _is_in_body(point, body):
                return False
    return False


@kernel(inline=True)
def _way_point(model, avatars, i, blow, way, own, part):
    """Return a point of the way of a strike [m]."""
    x, z = over_ground(model, avatars, i, blow.action, blow.old, way[3 * part], way[3 * part + 2])
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
