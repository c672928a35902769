"""Where strikes touch what they hit."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.attachments import shield_radii
from crowdsim.crowd.record import TakeData
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.policy.rewards import TargetBody
from crowdsim.poses.capsules import PosedBodies
from crowdsim.poses.guards import guard_of, guard_points, unit
from crowdsim.poses.hits import Landed
from crowdsim.poses.kernels.fists import LEAN
from crowdsim.poses.layer import Part
from crowdsim.poses.outlines import Balls, Surface, find_outlines, touch_surface, upper_arms

PoseAt = Callable[[Array, Array], list[tuple[Array, Body, Array, Array, Array]]]
"""Poses avatars (E,) at times (E,): for each policy which of them, body, scales, joint positions and rotations."""

BallsAt = Callable[[Array, Array], Balls]
"""Returns strikers (n,) as balls, as they are turned where their middles are at points (n, 3) [m]."""
_SWINGS = 3
"""Times that what strikes goes onto a surface: how it is turned depends on where it is."""
_CLOSE_BY = 0.12
"""How near in time strikes of those whom they hit in turn are to count for the fists of those who are hit [s]."""
_FACING = 0.4
"""Least cosine of the angle between the outward direction of a point that is hit and the direction to the shoulder."""
_OUT = 12
"""Times that a point goes out of head or torso."""
_ON_ARM = 0.01
"""How far off an upper arm the surface of a fist is at the most that lands on it [m]."""
_SLIM = 0.77
"""Radius of a trunk's capsules as a share of that of the torso that counts as hit."""


def within(part: Part) -> float:
    """Return how far off strikes count for avatars [s]: less, the further these are from those that are shown."""
    return _CLOSE_BY if part.hops > 1 else LEAN


def strikes_near(landed: Landed, part: Part) -> Landed:
    """Return landed strikes by which avatars reach out, and few others."""
    moments, window = part.moments, part.window
    if part.hops == 0 and moments.times.shape[1] == 1:
        return landed.around(*part.span, window.columns())
    return landed.around_each(window.avatars[moments.columns], moments.times[0], within(part))


def surface_point(
    point: Array,
    head: Array,
    neck: Array,
    pelvis: Array,
    head_radius: Array,
    torso_radius: Array,
    origin: Array | None = None,
) -> Array:
    """Return the points of bodies' surfaces that are nearest to given points; all (E, 3), radii (E,) [m].

    A point on the head that lies in the torso, or vice versa, is no surface: such points go out of one and of
    the other until they lie on both. With ``origin`` points on the far side, as seen from there, come around: a fist
    does not go through a head to its back.
    """
    axis = pelvis - neck
    square = np.maximum(np.sum(axis * axis, axis=-1), 1e-12)
    found = np.array(point, dtype=float)
    if origin is not None:
        found = _near_side(found, head, neck, axis, square, head_radius, torso_radius, origin)
    for step in range(_OUT):
        share = np.sum((found - neck) * axis, axis=-1) / square
        centre = neck + np.clip(share, 0.0, 1.0)[:, None] * axis
        to_head, to_torso = found - head, found - centre
        far_head, far_torso = np.linalg.norm(to_head, axis=-1), np.linalg.norm(to_torso, axis=-1)
        above_head, above_torso = far_head - head_radius, far_torso - torso_radius
        on_head = (above_head <= above_torso)[:, None]
        middle = np.where(on_head, head, centre)
        out = np.where(on_head, to_head, to_torso)
        length = np.maximum(np.where(on_head[:, 0], far_head, far_torso), 1e-9)
        radius = np.where(on_head[:, 0], head_radius, torso_radius)
        surface = middle + out / length[:, None] * radius[:, None]
        inside = np.minimum(above_head, above_torso) < -1e-6
        if step > 0 and not inside.any():
            break
        found = np.where((inside | (step == 0))[:, None], surface, found)
    return found


def _near_side(
    point: Array,
    head: Array,
    neck: Array,
    axis: Array,
    square: Array,
    head_radius: Array,
    torso_radius: Array,
    origin: Array,
) -> Array:
    """Points that lie behind the head or torso that they are nearest to, or far in it, brought around it."""
    share = np.clip(np.sum((point - neck) * axis, axis=-1) / square, 0.0, 1.0)
    centre = neck + share[:, None] * axis
    gaps = [np.linalg.norm(point - middle, axis=-1) for middle in (head, centre)]
    on_head = gaps[0] - head_radius <= gaps[1] - torso_radius
    middle, radius = np.where(on_head[:, None], head, centre), np.where(on_head, head_radius, torso_radius)
    way, out = unit(origin - middle), unit(point - middle)
    ahead = np.sum(out * way, axis=-1)
    aside = unit(out - ahead[:, None] * way)
    around = middle + radius[:, None] * (_FACING * way + math.sqrt(1.0 - _FACING**2) * aside)
    return np.where((ahead < _FACING)[:, None], around, point)


def body_points(body: Body, positions: Array, rotations: Array, scales: Array) -> tuple[Array, Array, Array, Array]:
    """Return head (n, 3), neck (n, 3), pelvis (n, 3) and strikers (n, 11, 3) of posed bodies [m]."""
    roles = body.roles
    sizes = np.asarray(scales)[:, None]
    head = positions[:, roles["head"]] + sizes * quaternion.rotate(rotations[:, roles["head"]], body.head_offset)
    ends, offsets = body.strikers["joint"], body.strikers["offset"]
    strikers = positions[:, ends] + sizes[..., None] * quaternion.rotate(rotations[:, ends], offsets)
    return head, positions[:, roles["neck"]], positions[:, roles["pelvis"]], strikers


def find_surfaces(
    take: TakeData,
    near: Landed,
    fists: Array,
    shoulders: Array,
    radii: Array,
    pose_at: PoseAt,
    target: TargetBody,
    balls_at: BallsAt | None = None,
) -> tuple[Array, Array]:
    """Return where the middles of what strikes belong: their surface touches that of what is hit.

    Of blocked strikes it is the arm that is in the way. Scripted targets are as large as control takes them for.

    Args:
        take: The take.
        near: Strikes.
        fists: Middles of what strikes [m]. Shape (E, 3).
        shoulders: From where it comes [m]. Shape (E, 3).
        radii: How thick it is [m]. Shape (E,).
        pose_at: Poses those who are hit.
        target: The body of scripted targets.
        balls_at: Says what strikes, as balls; a single one when None.

    Returns:
        The middles (E, 3) [m], and the upper arms that are hit (E,), as of ``Landings.struck``.
    """
    points, struck = np.full((len(near.times), 3), np.nan), np.full(len(near.times), -1)
    people = np.flatnonzero(near.victims >= 0)
    for which, body, scales, positions, rotations in pose_at(near.victims[people], near.times[people]):
        chosen, numbers = people[which], near.victims[people[which]]
        widths, parts = take.cast.widths[numbers], body_points(body, positions, rotations, scales)[:3]
        thick = radii[chosen]
        # What counts as hit, thicker by what strikes: a middle on it touches.
        outline = *parts, body.head_radius * scales + thick, _SLIM * body.torso_radius * widths + thick
        points[chosen] = surface_point(fists[chosen], *outline, origin=shoulders[chosen])
        build = scales, take.cast.girths[numbers], take.cast.stretches[numbers]
        bodies = PosedBodies(body, np.arange(len(which)), *build, positions[None], rotations[None])
        # Fists that miss leave arms to these, which give way.
        surface, lower_arms = find_outlines(
            bodies, take.cast.sexes[numbers], ~near.missed[chosen], take.cast.bare[numbers]
        )
        goals = points[chosen]
        for _ in range(1 if balls_at is None else _SWINGS):
            alone = Balls(np.zeros((len(chosen), 1, 3)), thick[:, None])
            balls = alone if balls_at is None else balls_at(chosen, goals)
            # Fists that land stay out of forearms and hands: an arm that gives way would move what they hit. Each
            # time they set out from where they are: anew they could take turns between two sides of an arm.
            goals = touch_surface(goals, balls, surface, lower_arms)
        points[chosen] = goals
        gaps = surface.gaps(fists[chosen])[0] - thick
        for arm, columns in enumerate(upper_arms(body)):
            if not len(columns):
                continue
            far = Surface(*(values[:, columns] for values in surface)).gaps(points[chosen])[0] - thick
            hit = (far < _ON_ARM) & ~near.missed[chosen] & ~near.blocked[chosen]
            struck[chosen[hit]] = 2 * numbers[hit] + arm
        # A fist that misses is left alone where it is in no body.
        free = chosen[near.missed[chosen] & (gaps >= 0.0)]
        points[free] = fists[free]
        stopped = near.blocked[chosen]
        points[chosen[stopped]] = guard_points(
            near.points[chosen[stopped]],
            shoulders[chosen[stopped]],
            guard_of(
                body,
                positions[stopped],
                rotations[stopped],
                scales[stopped],
                widths[stopped],
                shield_radii(take.cast, numbers[stopped], body),
            ),
        )
    scripted = np.flatnonzero(near.victims < -1)
    if len(scripted):
        clock = near.times[scripted] * take.control_rate
        frames = np.clip(np.floor(clock + 1e-9).astype(int), 0, take.frame_count - 1)
        later = np.minimum(frames + 1, take.frame_count - 1)
        numbers = -2 - near.victims[scripted]
        low = np.stack([take.targets[int(f)][int(g)] for f, g in zip(frames, numbers, strict=True)])
        high = np.stack([take.targets[int(f)][int(g)] for f, g in zip(later, numbers, strict=True)])
        heads = low + (high - low) * np.clip(clock - frames, 0.0, 1.0)[:, None]
        around = target.head_radius * take.cast.scales[near.attackers[scripted]] + radii[scripted]
        points[scripted] = surface_point(
            fists[scripted], heads, heads, heads, around, 0.0 * around, origin=shoulders[scripted]
        )
    return points, struck
