"""Whether an arm of the victim is in the way of a strike."""

import numpy as np

from crowdsim.core.segments import square_between, square_from
from crowdsim.crowd.kernels.bases import over_ground
from crowdsim.crowd.kernels.interpolation import point_at
from crowdsim.crowd.kernels.layout import LEFT_ELBOW, LEFT_FIST, RIGHT_ELBOW, RIGHT_FIST
from crowdsim.jit import kernel

STEPS = 6
"""Steps of a strike's way from each of its points (``Model.ways``) to the next."""


@kernel(inline=True)
def meet_guard(model, avatars, i, j, thrown, body, stands):
    """Return whether a strike on its way meets an arm of the victim before it is in head or torso, and where it does.

    The arms are as they are when the strike reaches furthest; those of avatar ``j`` with a shield are as thick as that.
    It meets one where the middle of the fist or foot comes through the surface of forearm or glove: what only grazes
    them goes on. Where it meets none is where it ends.
    """
    frame, x, z, size, cos, sin, policy, width = stands
    forearm, glove = model.sizes[policy].forearm_radius * width, model.sizes[policy].glove_radius * size
    left_elbow = point_at(model.arms, frame, LEFT_ELBOW, x, z, size, cos, sin)
    right_elbow = point_at(model.arms, frame, RIGHT_ELBOW, x, z, size, cos, sin)
    left_fist = point_at(model.arms, frame, LEFT_FIST, x, z, size, cos, sin)
    right_fist = point_at(model.arms, frame, RIGHT_FIST, x, z, size, cos, sin)
    way, own = model.ways[thrown.strike], np.float64(avatars.playback[i].scale)
    first = _way_point(model, avatars, i, thrown, way, own, 0)
    middle = _way_point(model, avatars, i, thrown, way, own, 1)
    left_arm, right_arm, left_glove, right_glove = forearm, forearm, glove, glove
    if model.shields.shape[0] > 0:
        shield = model.shields[avatars.number[j]]
        left_arm, right_arm = max(forearm, size * shield[0]), max(forearm, size * shield[1])
        left_glove, right_glove = max(glove, size * shield[2]), max(glove, size * shield[3])
    # Most strikes that land come nowhere near an arm.
    left_reach = 1.0001 * max(left_arm, left_glove) * max(left_arm, left_glove)
    right_reach = 1.0001 * max(right_arm, right_glove) * max(right_arm, right_glove)
    left = square_between(first, middle, left_elbow, left_fist) <= left_reach
    left |= square_between(middle, thrown.point, left_elbow, left_fist) <= left_reach
    right = square_between(first, middle, right_elbow, right_fist) <= right_reach
    right |= square_between(middle, thrown.point, right_elbow, right_fist) <= right_reach
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
        if left and _is_in_arm(point, left_elbow, left_fist, left_arm, left_glove):
            return True, point
        if right and _is_in_arm(point, right_elbow, right_fist, right_arm, right_glove):
            return True, point
        if _is_in_body(point, body):
            return False, thrown.point
    return False, thrown.point


@kernel(inline=True)
def _way_point(model, avatars, i, thrown, way, own, part):
    """Return a point of the way of a strike [m]."""
    x, z = over_ground(model, avatars, i, thrown.action, thrown.old, way[part, 0], way[part, 2])
    return x, way[part, 1] * own, z


@kernel(inline=True)
def _is_in_arm(point, elbow, fist, forearm, glove):
    """Return whether a point is in a forearm or in the glove at its end."""
    far = square_from(point, fist, elbow)
    dx, dy, dz = point[0] - fist[0], point[1] - fist[1], point[2] - fist[2]
    return far <= forearm * forearm or dx * dx + dy * dy + dz * dz <= glove * glove


@kernel(inline=True)
def _is_in_body(point, body):
    """Return whether a point is in head or torso."""
    dx, dy, dz = point[0] - body.head[0], point[1] - body.head[1], point[2] - body.head[2]
    if dx * dx + dy * dy + dz * dz <= body.head_radius * body.head_radius:
        return True
    return square_from(point, body.neck, body.pelvis) <= body.torso_radius * body.torso_radius
