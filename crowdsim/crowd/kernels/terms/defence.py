"""Defence: what actions cost in hits, from strikes that an avatar sees coming and from those that it expects.

What an opponent has decided is seen after the avatar's reaction time, and nothing before. A strike that is seen ends at
a known place and time: each action, and where it is too short each one behind it, is held against that exactly. Where
none is seen, a learned table tells how many hits follow an action (``core.threats``).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.bodies import distance_from_body
from crowdsim.core.threats import DISTANCES
from crowdsim.crowd.kernels.bases import over_ground
from crowdsim.crowd.kernels.interpolation import ground_at
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.crowd.kernels.postures import Standing, posed_body
from crowdsim.jit import kernel

HIT = 100.0  # what a hit costs, in normalised values
NEAR = 0.8  # over the ground, how near an avatar a strike ends that may be for it [m]
MARGIN = 0.04  # how far beyond where it lands a strike still counts in part [m]


class Threat(NamedTuple):
    """What an avatar sees coming.

    Attributes:
        cell: The cell of the defence's table where no strike is seen, else -1.
        frames: Control frames until the strike reaches furthest; infinite where none is seen.
        point: Where it does [m].
    """

    cell: int
    frames: float
    point: Any


@kernel(inline=True)
def defend(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions by the hits that they cost an avatar that defends itself."""
    if model.defence.shape[0] == 0:
        return
    defence = model.defence
    cost = HIT * world.cohorts[avatars.playback[own].cohort].defence
    avatars.fight[own].threat = -1
    state = scratch.states[q]
    if cost <= 0.0 or state < 0:
        return
    threat = see_threat(model, avatars, world.cohorts, now, own, observed, q)
    avatars.fight[own].threat = threat.cell
    for k in range(model.offsets[state + 1] - model.offsets[state]):
        action = model.offsets[state] + k
        if threat.cell < 0:
            scratch.values[q, k] -= cost * _endured(model, avatars, own, action, threat)
        else:
            scratch.values[q, k] -= cost * defence[action, threat.cell]


@kernel(inline=True)
def see_threat(model, avatars, cohorts, now, own, observed, q):
    """Return the next strike that an avatar sees coming, from its opponent and from those whose opponent it is.

    An opponent that has decided within the reaction time is seen where its action began, and what it does is not seen.
    """
    motion, playback = avatars.motion, avatars.playback
    strikes = model.strikes
    x, z = position_of(avatars, own)
    size = np.float64(playback[own].scale)
    opponent, reaction = avatars.fight[own].next_opponent, cohorts[playback[own].cohort].reaction
    nearest, soonest = np.inf, np.inf
    fx, fy, fz = 0.0, 0.0, 0.0
    for m in range(-1, observed.counts[q]):
        j = np.int64(avatars.slot_of[opponent]) if m < 0 and opponent >= 0 else np.int64(now.present)
        if m >= 0 and avatars.opponent[observed.neighbours[q, m]] == avatars.number[own]:
            j = np.int64(observed.neighbours[q, m])
        if j >= now.present:
            continue
        action, phase, speed = motion[j].action, np.float64(motion[j].phase), np.float64(motion[j].speed)
        hidden = math.ceil(phase / speed) - 1.0 < reaction
        ox, oz = position_of(avatars, j)
        if hidden:
            ox, oz = over_ground(model, avatars, j, action, False, 0.0, 0.0)
        nearest = min(nearest, (ox - x) ** 2 + (oz - z) ** 2)
        if hidden:
            continue
        for k in range(model.actions[action].strikes, model.actions[action + 1].strikes):
            frames = (strikes[k].time - phase) / speed
            if frames <= 0.0 or frames >= soonest:
                continue
            sx, sz = over_ground(model, avatars, j, action, False, strikes[k].x, strikes[k].z)
            if (sx - x) ** 2 + (sz - z) ** 2 <= NEAR * NEAR * size * size:
                soonest, fx, fy, fz = frames, sx, strikes[k].y * np.float64(playback[j].scale), sz
    if soonest == np.inf:
        far, cell = math.sqrt(nearest) / size, 0
        for limit in DISTANCES:
            cell += far >= limit
        return Threat(cell, np.inf, (fx, fy, fz))
    return Threat(-1, soonest, (fx, fy, fz))


@kernel(inline=True)
def _endured(model, avatars, own, action, threat):
    """Return whether a strike that is seen would land in an action, or in the best one behind it: from 0 to 1."""
    x, z = position_of(avatars, own)
    start = x, z, np.float64(avatars.heading[own])
    length = np.float64(model.actions[action].length)
    frames = threat.frames * avatars.motion[own].speed
    if frames <= length:
        return _lands(model, avatars, own, action, start, frames, threat.point)
    start = _place(model, avatars, own, action, start, length)
    state, least = model.actions[action].next, 1.0
    for after in range(np.int64(model.offsets[state]), np.int64(model.offsets[state + 1])):
        done = min(frames - length, np.float64(model.actions[after].length))
        least = min(least, _lands(model, avatars, own, after, start, done, threat.point))
    return least


@kernel(inline=True)
def _place(model, avatars, own, action, start, frames):
    """Return where an action leads in some frames of motion from a ground frame: x, z [m], heading [rad]."""
    starts, size = model.starts, np.float64(avatars.playback[own].scale)
    stride = model.policies[avatars.policy[own]].stride
    gx, gz, turned = ground_at(model.ground, model.actions[action].origin + frames * stride)
    cos, sin = cos_sin(start[2] - starts[action].heading)
    dx, dz = (gx - starts[action].x) * size, (gz - starts[action].z) * size
    return start[0] + dx * cos + dz * sin, start[1] - dx * sin + dz * cos, start[2] + turned - starts[action].heading


@kernel(inline=True)
def _lands(model, avatars, own, action, start, frames, point):
    """Return whether a strike lands on an avatar that has done some frames of an action: from 0 to 1.

    One that would end inside the body counts as well, so that walking into a fist is no defence.
    """
    motion = avatars.motion
    size, policy = np.float64(avatars.playback[own].scale), avatars.policy[own]
    x, z, heading = _place(model, avatars, own, action, start, frames)
    cos, sin = cos_sin(heading)
    frame = model.actions[action].origin + frames * model.policies[policy].stride
    stands = Standing(frame, x, z, size, cos * size, sin * size, policy, np.float64(motion[own].width))
    tolerance = model.sizes[policy].tolerance * size
    return min(max((tolerance + MARGIN - distance_from_body(point, posed_body(model, stands))) / MARGIN, 0.0), 1.0)
