"""Compiled contact: strikers, as balls, that go onto bodies."""

import math

from crowdsim.jit import kernel

_ROUNDS, _BESIDE, _ENOUGH = 60, 12, 1e-4
"""Rounds at most in which a striker goes onto the surface, the first of them in which it also goes out of forearms and
hands, and distance from the surface that may be left [m]."""


@kernel
def _deepest_ball(point, offsets, radii, first, stop, starts, axes, thick):
    """Return how far outside of capsules the ball is that is deepest in them, and the way out, of length 1."""
    least, x, y, z = math.inf, 0.0, 0.0, 0.0
    for ball in range(first, stop):
        px, py, pz = point[0] + offsets[ball, 0], point[1] + offsets[ball, 1], point[2] + offsets[ball, 2]
        for piece in range(starts.shape[0]):
            wx, wy, wz = px - starts[piece, 0], py - starts[piece, 1], pz - starts[piece, 2]
            ax, ay, az = axes[piece, 0], axes[piece, 1], axes[piece, 2]
            along = (wx * ax + wy * ay + wz * az) / max(ax * ax + ay * ay + az * az, 1e-12)
            along = min(max(along, 0.0), 1.0)
            wx, wy, wz = wx - along * ax, wy - along * ay, wz - along * az
            far = math.sqrt(wx * wx + wy * wy + wz * wz)
            gap = far - thick[piece, 0] - along * (thick[piece, 1] - thick[piece, 0]) - radii[ball]
            if gap < least:
                far = max(far, 1e-9)
                least, x, y, z = gap, wx / far, wy / far, wz / far
    return least, x, y, z


@kernel(inline=True)
def _go_out(point, way, far):
    """Move a point along a way."""
    point[0] += far * way[1]
    point[1] += far * way[2]
    point[2] += far * way[3]


@kernel
def touch_bodies(low, high, offsets, radii, deep, lifted, surface, beside, found):
    """Move strikers ``low`` to ``high`` so that they touch bodies, see ``outlines.touch_surface``.

    Args:
        low: First striker.
        high: One past the last.
        offsets: Balls from the first of each [m]. Shape (n, B, 3).
        radii: Of the balls [m]. Shape (n, B).
        deep: How deep balls behind the first may be [m].
        lifted: How far off the first may be in the end where others are deeper [m].
        surface: A ``Surface``.
        beside: Likewise, what all balls stay out of.
        found: Middles of the first balls, moved [m]. Shape (n, 3).
    """
    balls = radii.shape[1]
    for n in range(low, high):
        own, point = (offsets[n], radii[n]), found[n]
        if not math.isfinite(point[0] + point[1] + point[2]):
            continue
        body, arms = (surface.starts[n], surface.axes[n], surface.radii[n]), (
            beside.starts[n], beside.axes[n], beside.radii[n])  # fmt: skip
        for step in range(_ROUNDS):
            x, y, z = point[0], point[1], point[2]
            if balls > 1:
                way = _deepest_ball(point, own[0], own[1], 1, balls, body[0], body[1], body[2])
                _go_out(point, way, max(-deep - way[0], 0.0))
            if step < _BESIDE and arms[0].shape[0] > 0:
                way = _deepest_ball(point, own[0], own[1], 0, balls, arms[0], arms[1], arms[2])
                _go_out(point, way, max(-way[0], 0.0))
            way = _deepest_ball(point, own[0], own[1], 0, 1, body[0], body[1], body[2])
            _go_out(point, way, -way[0])
            if (point[0] - x) ** 2 + (point[1] - y) ** 2 + (point[2] - z) ** 2 <= _ENOUGH * _ENOUGH:
                break
        if balls > 1:
            way = _deepest_ball(point, own[0], own[1], 1, balls, body[0], body[1], body[2])
            _go_out(point, way, min(max(-deep - way[0], 0.0), lifted))
