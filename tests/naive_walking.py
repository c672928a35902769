"""Whether a walk at ease is free, the slow and obvious way: the twin of ``crowd.kernels.walking.is_free``."""

import math

import numpy as np
from avatar_fields import fields

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.lying import axis_of
from crowdsim.crowd.kernels.walking import BESIDE, CLEAR, NEARER, SETS_OFF
from crowdsim.crowd.random import Purpose, uniform


def distance(points, one, other):
    """The least distance of points (..., 2) from a line between two others."""
    points, one, other = (np.asarray(p, float) for p in (points, one, other))
    along = other - one
    shares = np.zeros(points.shape[:-1]) if not along.any() else (points - one) @ along / (along @ along)
    on_line = one + np.clip(shares, 0.0, 1.0)[..., None] * along
    return float(np.linalg.norm(on_line - points, axis=-1).min())


def way_of(one, slot, walk, start=None):
    """The points of a walk on the floor, from where an avatar is, or from a start: x, z, heading and scale."""
    x, z, heading, scale = fields(one.avatars, "x z heading scale", slot) if start is None else start
    points = one.model.walk_points[walk] * scale
    ahead = x + points[:, 0] * math.cos(heading) + points[:, 1] * math.sin(heading)
    return np.column_stack([ahead, z - points[:, 0] * math.sin(heading) + points[:, 1] * math.cos(heading)])


def lines_of(one, slot):
    """Where an avatar is, will be at the end of its action, and halts; or where its body lies."""
    number = one.avatars.number[slot]
    row = one.avatars.conditions[number]
    if one.avatars.team[slot] < 0 and layout.FALLING <= row["standing"] <= layout.RISING:
        axis = axis_of(one.model, one.avatars, slot)
        return [((axis.x, axis.z), (axis.to_x, axis.to_z))]
    here, end, halt = (fields(one.avatars, names, slot) for names in ("x z", "end_x end_z", "halt_x halt_z"))
    return [(here, end), (end, halt)]


def draws(one, slot):
    """What an avatar draws in its next decision."""
    number, decision = one.avatars.number[slot], one.avatars.fight["decisions"][slot]
    return float(uniform(one.crowd.seed, Purpose.CHOICE, number, decision))


def may_go_first(one, own, other, reach):
    """Whether another avatar, of a lower number, may set off in the same frame."""
    number = one.avatars.number[other]
    row = one.avatars.conditions[number]
    due = one.avatars.motion["phase"][other] >= one.model.actions["length"][one.avatars.motion["action"][other]]
    rests = row["does"] == layout.RESTS != row["mode"]
    near = math.hypot(*(fields(one.avatars, "x z", other) - fields(one.avatars, "x z", own))) < reach
    return number < one.avatars.number[own] and due and rests and near and draws(one, other) < SETS_OFF


def clear_of(line, start):
    """How far a walk keeps from a body on the floor: where it begins nearer, it leads away."""
    return min(BESIDE, distance(start, *line) - NEARER)


def naive_is_free(one, own, walk):
    """Whether a walk stays in the arena and clear of all others."""
    way, arena = way_of(one, own, walk), one.crowd.arena
    if arena[0] == layout.CIRCLE and any(math.hypot(x - arena[1], z - arena[2]) > arena[3] for x, z in way):
        return False
    reach = 2.0 * (one.model.walks["reach"][walk] * one.avatars.playback["scale"][own] + CLEAR)
    for other in range(one.present):
        if other == own:
            continue
        lines = lines_of(one, other)
        if len(lines) > 1 and may_go_first(one, own, other, reach):
            return False
        clear = CLEAR if len(lines) > 1 else clear_of(lines[0], fields(one.avatars, "x z", own))
        if any(distance(way, *line) < clear for line in lines):
            return False
    return True
