"""What becomes of a strike: it lands, a forearm or glove blocks it, the victim has evaded it, or it misses.

Judged when it reaches furthest. A strike that would land is blocked where, on its way there, it meets an arm of the
victim before it is in the victim's head or torso. One that does not land was evaded where it would have landed on the
victim as it was when the attacker decided on the action.
"""

from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.bodies import PosedBody, comes_through, lands_on_posed_body
from crowdsim.crowd.kernels.bases import base_of, from_base
from crowdsim.crowd.kernels.guards import meet_guard
from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED, MISSED
from crowdsim.crowd.kernels.postures import posed_body, standing, standing_now
from crowdsim.jit import kernel

NOTED = 8  # strikes of an action of which is noted whether they would have landed; others are not evaded


class Strike(NamedTuple):
    """A strike that is judged.

    Attributes:
        strike: Its row in ``Model.strikes``.
        action: The action that it is in.
        opponent: Whom it is for.
        point: Where the fist or foot is [m].
        origin: Over what it comes from [m], see ``comes_through``.
        share: How much of the control frame has passed.
        old: Whether the action is the one before the present one.
    """

    strike: int
    action: int
    opponent: int
    point: Any
    origin: Any
    share: float
    old: bool


@kernel(inline=True)
def note_seen(model, avatars, targets, now, own, action):
    """Let an avatar note which strikes of the action that it has chosen would land on its opponent as that is now.

    That is a bit for each of the first ``NOTED`` strikes. Decisions take the two entries of ``Avatars.seen`` in turns:
    strikes of the action before are listed when the next one has begun.
    """
    actions, sizes, opponent = model.actions, model.sizes, avatars.fight[own].next_opponent
    j = np.int64(avatars.slot_of[opponent]) if opponent >= 0 else np.int64(now.present)
    seen = 0
    if opponent <= -2 or j < now.present:
        size, tolerance = np.float64(avatars.playback[own].scale), sizes[avatars.policy[own]].tolerance
        if opponent <= -2:
            target = targets[now.moment, -2 - opponent]
            body = ball_at(model, avatars, own, target[0], target[1], target[2])
        else:
            body = posed_body(model, standing_now(model, avatars, j))
        base_x, base_z, cos, sin, _ = base_of(model, avatars, own, action, np.float64(avatars.heading[own]))
        first = actions[action].strikes
        for k in range(first, min(actions[action + 1].strikes, first + NOTED)):
            strike = model.strikes[k]
            px, pz = from_base(model, action, base_x, base_z, cos, sin, strike.x, strike.z)
            origin = from_base(model, action, base_x, base_z, cos, sin, strike.from_x, strike.from_z)
            thrown = Strike(k, action, opponent, (px, strike.y * size, pz), origin, 0.0, False)
            seen |= np.int64(_hits(thrown, body, tolerance * size)) << (k - first)
    avatars.seen[avatars.number[own], avatars.fight[own].decisions & 1] = seen


@kernel(inline=True)
def judge(model, avatars, targets, now, i, thrown):
    """Return what becomes of a strike of avatar ``i``, and where it ends, blocked ones where they meet the arm."""
    sizes = model.sizes
    tolerance = sizes[avatars.policy[i]].tolerance * avatars.playback[i].scale
    seen = avatars.seen[avatars.number[i], (avatars.fight[i].decisions + (0 if thrown.old else 1)) & 1]
    noted = thrown.strike - model.actions[thrown.action].strikes
    evaded = noted < NOTED and (seen >> noted) & 1 != 0
    if thrown.opponent <= -2:
        before, after = targets[now.moment - 1, -2 - thrown.opponent], targets[now.moment, -2 - thrown.opponent]
        hx, hz = before[0] + thrown.share * (after[0] - before[0]), before[2] + thrown.share * (after[2] - before[2])
        hy = before[1] + thrown.share * (after[1] - before[1])
        if _hits(thrown, ball_at(model, avatars, i, hx, hy, hz), tolerance):
            return LANDED, thrown.point
        return EVADED if evaded else MISSED, thrown.point
    j = np.int64(avatars.slot_of[thrown.opponent]) if thrown.opponent >= 0 else np.int64(now.present)
    if j >= now.present:
        return MISSED, thrown.point
    whose, size = avatars.policy[j], np.float64(avatars.playback[j].scale)
    # As far as a body reaches, and moves in a frame: most strikes that miss are not even near.
    width = np.float64(avatars.motion[j].width)
    far = max(size, width) * sizes[whose].reach + tolerance
    if _is_near(thrown, avatars.x[j], avatars.z[j], far + size * avatars.motion[j].speed * sizes[whose].pace):
        stands = standing(model, avatars, j, thrown.share)
        body = posed_body(model, stands)
        if _hits(thrown, body, tolerance):
            blocked, point = meet_guard(model, avatars, i, j, thrown, body, stands)
            return BLOCKED if blocked else LANDED, point
    return EVADED if evaded else MISSED, thrown.point


@kernel(inline=True)
def _is_near(thrown, x, z, far):
    """Return whether a strike ends no further from a position than some distance."""
    dx, dz = x - thrown.point[0], z - thrown.point[2]
    return dx * dx + dz * dz <= far * far


@kernel(inline=True)
def _hits(thrown, body, tolerance):
    """Return whether a strike hits a body: near its surface, and no kick that comes through the body."""
    point, origin, neck = thrown.point, thrown.origin, body.neck
    if comes_through(point[0], point[2], origin[0], origin[1], neck[0], neck[2]):
        return False
    return lands_on_posed_body(point, body, tolerance)


@kernel(inline=True)
def ball_at(model, avatars, i, x, y, z):
    """Return a scripted target: a ball as large as the head of the avatar that strikes it."""
    centre = (x, y, z)
    radius = model.sizes[avatars.policy[i]].head_radius * avatars.playback[i].scale
    return PosedBody(centre, centre, centre, radius, 0.0)
