"""Strikes thrown since the frame before, and whether they land."""

from typing import NamedTuple

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.bodies import PosedBody, comes_through, lands_on_posed_body
from crowdsim.crowd.kernels.interpolation import ground_at, point_at
from crowdsim.crowd.kernels.layout import (
    ACTION,
    ACTION_BEFORE,
    AHEAD,
    BASE_COS,
    BASE_SIN,
    BASE_TURN,
    BASE_X,
    BASE_Z,
    FIST_SPEED,
    FIST_X,
    FIST_Y,
    FIST_Z,
    FROM_X,
    FROM_Z,
    HEAD,
    HEAD_RADIUS,
    HIT_BY,
    HIT_FRAME,
    HIT_X,
    HIT_Z,
    LENGTH,
    LIMB,
    NECK,
    NECK_DROP,
    NUMBER,
    OPPONENT,
    OPPONENT_BEFORE,
    ORIGIN,
    PACE,
    PELVIS,
    PELVIS_DROP,
    PENDING,
    PHASE,
    PHASE_BEFORE,
    POLICY,
    REACH,
    SCALE,
    SPEED,
    STRIDE,
    STRIKES,
    STRONG,
    TIME,
    TOLERANCE,
    TORSO_RADIUS,
    X,
    Z,
)
from crowdsim.crowd.kernels.motion import base_before
from crowdsim.crowd.kernels.prefetch import ask_for
from crowdsim.jit import kernel

ATTACKER, VICTIM, STRIKER, LANDED = range(4)
WHEN, POINT_X, POINT_Y, POINT_Z, FAST = range(5)


class Stretch(NamedTuple):
    """The motion of an avatar in one action within a control frame.

    Attributes:
        action: The action.
        opponent: Whom it is for.
        low: The phase that it begins behind.
        high: The last phase.
        passed: Frames of motion that came before in this control frame.
        motion: Frames of motion in this control frame.
    """

    action: int
    opponent: int
    low: float
    high: float
    passed: float
    motion: float


@kernel(inline=True)
def strike(model, avatars, world, now, first, last, who, strikes, held):
    """List the strikes that avatars have thrown since the frame before; return how many ``held`` and they are.

    Within a control frame motion runs evenly, through the end of an action where there is one; strikes and opponents
    are placed in between accordingly. Where ``strikes`` has no room, they are only counted. ``who[first:last]`` is
    scratch space.
    """
    whole, real = avatars.whole, avatars.real
    listed = first
    for i in range(first, last):  # no branch, since it cannot be predicted which avatars strike
        who[listed] = i
        listed += real[PHASE, i] > whole[PENDING, i]
    for k in range(first, listed):
        if k + AHEAD < listed:
            _ask_for_strike(model, avatars, who[k + AHEAD])
        i = np.int64(who[k])
        if whole[ACTION_BEFORE, i] >= 0:
            held = _list_strikes(model, avatars, world.targets, now, i, True, strikes, held)
        held = _list_strikes(model, avatars, world.targets, now, i, False, strikes, held)
    return held


@kernel(inline=True)
def note_hits(model, avatars, frame, strikes, first, last):
    """Let avatars note by whom they were hit in strikes ``first`` to ``last``, which are those of ``frame``.

    A hit is as strong as its speed over ``Model.sizes`` says: 1 for a strong one. Of several hits in a frame the
    strongest counts, among equals that of the lower number, so that their order does not matter.
    """
    whole, real, slot_of = avatars.whole, avatars.real, avatars.slot_of
    for k in range(first, last):
        attacker, victim = strikes.whole[k, ATTACKER], strikes.whole[k, VICTIM]
        if strikes.whole[k, LANDED] == 0 or victim < 0:
            continue
        i, j = slot_of[attacker], slot_of[victim]
        strength = strikes.real[k, FAST] / model.sizes[whole[POLICY, i], STRONG]
        dx, dz = real[X, j] - real[X, i], real[Z, j] - real[Z, i]
        part = strength / max(np.sqrt(dx * dx + dz * dz), 1e-9)
        hit_x, hit_z = part * dx, part * dz
        if real[HIT_FRAME, j] == frame:
            more = hit_x * hit_x + hit_z * hit_z - real[HIT_X, j] ** 2 - real[HIT_Z, j] ** 2
            if more < 0.0 or (more == 0.0 and whole[HIT_BY, j] < attacker):
                continue
        whole[HIT_BY, j] = attacker
        real[HIT_X, j], real[HIT_Z, j], real[HIT_FRAME, j] = hit_x, hit_z, frame


@kernel(inline=True)
def _ask_for_strike(model, avatars, i):
    """Ask memory for the strikes of an avatar and the body of its opponent."""
    whole, actions = avatars.whole, model.actions
    ask_for(model.strikes, model.strikes.shape[1] * actions[whole[ACTION, i], STRIKES])
    ask_for(model.starts, 3 * whole[ACTION, i])
    j = avatars.slot_of[max(whole[OPPONENT, i], 0)]
    frame = int(avatars.real[PHASE, j]) * model.policies[whole[POLICY, j], STRIDE]
    frame += actions[whole[ACTION, j], ORIGIN]
    ask_for(model.bodies, 9 * frame)
    ask_for(model.ground, 3 * frame)


@kernel(inline=True)
def _list_strikes(model, avatars, targets, now, i, old, out, held):
    """List the strikes of one avatar in its action, or in its ``old`` one; return how many ``held`` and they are."""
    part = _stretch_of(model, avatars, i, old)
    for k in range(model.actions[part.action, STRIKES], model.actions[part.action + 1, STRIKES]):
        time = np.float64(model.strikes[k, TIME])
        if not part.low < time <= part.high:
            continue
        if held < out.whole.shape[0]:
            whole, real = out.whole[held], out.real[held]
            reach = model.strikes[k]
            px, pz = _over_ground(model, avatars, i, part.action, old, reach[FIST_X], reach[FIST_Z])
            py = reach[FIST_Y] * avatars.real[SCALE, i]
            origin = _over_ground(model, avatars, i, part.action, old, reach[FROM_X], reach[FROM_Z])
            whole[ATTACKER], whole[VICTIM] = avatars.whole[NUMBER, i], part.opponent
            whole[STRIKER] = model.strikes[k, LIMB]
            # Between two frames, and as exact as a number that is written: landing is judged then.
            real[WHEN] = now.frame - 1.0 + (time - part.low + part.passed) / part.motion
            real[POINT_X], real[POINT_Y], real[POINT_Z] = px, py, pz
            real[FAST] = model.strikes[k, FIST_SPEED] * avatars.real[SCALE, i] * avatars.real[SPEED, i]
            share = real[WHEN] - (now.frame - 1.0)
            whole[LANDED] = _lands(model, avatars, targets, now, i, part.opponent, share, (px, py, pz), origin)
        held += 1
    return held


@kernel(inline=True)
def _stretch_of(model, avatars, i, old):
    """Return the motion of an avatar in its action, or in its ``old`` one."""
    whole, real, actions = avatars.whole, avatars.real, model.actions
    switched = whole[ACTION_BEFORE, i] >= 0
    before = whole[ACTION_BEFORE, i] if switched else whole[ACTION, i]
    shown = min(real[PHASE, i], np.float64(actions[whole[ACTION, i], LENGTH]))
    rest = actions[before, LENGTH] - real[PHASE_BEFORE, i] if switched else 0.0
    return Stretch(
        before if old else whole[ACTION, i],
        whole[OPPONENT_BEFORE, i] if old else whole[OPPONENT, i],
        real[PHASE_BEFORE, i] if old or not switched else 0.0,
        np.float64(actions[before, LENGTH]) if old else shown,
        0.0 if old or not switched else rest,
        rest + shown if switched else shown - real[PHASE_BEFORE, i],
    )


@kernel(inline=True)
def _over_ground(model, avatars, i, action, old, fx, fz):
    """Return over what a point lies that is seen from the start of an avatar's action, or of its ``old`` one."""
    real, starts = avatars.real, model.starts
    base_x, base_z, cos, sin = real[BASE_X, i], real[BASE_Z, i], real[BASE_COS, i], real[BASE_SIN, i]
    if old:
        base_x, base_z, cos, sin, _ = base_before(model, avatars, i)
    gx, gz, gh = starts[action, 0], starts[action, 1], starts[action, 2]
    wx, wz = cos_sin(gh)
    gx, gz = gx + fx * wx + fz * wz, gz - fx * wz + fz * wx
    return base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos


@kernel(inline=True)
def _lands(model, avatars, targets, now, i, opponent, share, point, origin):
    """Return whether a strike of avatar ``i`` lands: near the surface of the opponent's head or torso then.

    A kick does not that comes through the body from over ``origin``.
    """
    real, sizes, policy, scale = avatars.real, model.sizes, avatars.whole[POLICY, i], avatars.real[SCALE, i]
    tolerance = sizes[policy, TOLERANCE] * scale
    if opponent <= -2:
        before, after = targets[now.moment - 1, -2 - opponent], targets[now.moment, -2 - opponent]
        hx, hz = before[0] + share * (after[0] - before[0]), before[2] + share * (after[2] - before[2])
        hy = before[1] + share * (after[1] - before[1])
        if comes_through(point[0], point[2], origin[0], origin[1], hx, hz):
            return False
        neck = (hx, hy - sizes[policy, NECK_DROP] * scale, hz)
        pelvis = (hx, hy - sizes[policy, PELVIS_DROP] * scale, hz)
        head_radius, torso_radius = sizes[policy, HEAD_RADIUS] * scale, sizes[policy, TORSO_RADIUS] * scale
        return lands_on_posed_body(point, PosedBody((hx, hy, hz), neck, pelvis, head_radius, torso_radius), tolerance)
    j = np.int64(avatars.slot_of[opponent]) if opponent >= 0 else np.int64(now.present)
    if j >= now.present:
        return False
    whose, size = avatars.whole[POLICY, j], real[SCALE, j]
    dx, dz = real[X, j] - point[0], real[Z, j] - point[2]
    # As far as a body reaches, and moves in a frame: most strikes that miss are not even near.
    far = size * (sizes[whose, REACH] + real[SPEED, j] * sizes[whose, PACE]) + tolerance
    if dx * dx + dz * dz > far * far:
        return False
    body = _body_at(model, avatars, j, share)
    if comes_through(point[0], point[2], origin[0], origin[1], body.neck[0], body.neck[2]):
        return False
    return lands_on_posed_body(point, body, tolerance)


@kernel(inline=True)
def _body_at(model, avatars, j, share):
    """Return the body of an avatar, interpolated by ``share`` between the frame before and this one."""
    whole, real, actions, sizes = avatars.whole, avatars.real, model.actions, model.sizes
    action, phase = whole[ACTION, j], min(real[PHASE, j], actions[whole[ACTION, j], LENGTH])
    bx, bz, cos, sin = real[BASE_X, j], real[BASE_Z, j], real[BASE_COS, j], real[BASE_SIN, j]
    turn = real[BASE_TURN, j]
    if whole[ACTION_BEFORE, j] < 0:
        phase = real[PHASE_BEFORE, j] + share * (phase - real[PHASE_BEFORE, j])
    else:
        before = actions[whole[ACTION_BEFORE, j], LENGTH] - real[PHASE_BEFORE, j]
        moved = share * (before + phase)
        if moved < before:
            action = whole[ACTION_BEFORE, j]
            phase = real[PHASE_BEFORE, j] + moved
            bx, bz, cos, sin, turn = base_before(model, avatars, j)
        else:
            phase = moved - before
    frame = actions[action, ORIGIN] + phase * model.policies[whole[POLICY, j], STRIDE]
    gx, gz, heading = ground_at(model.ground, frame)
    x, z = bx + gx * cos + gz * sin, bz - gx * sin + gz * cos
    size, policy = real[SCALE, j], whole[POLICY, j]
    cos, sin = cos_sin(turn + heading)
    cos, sin = cos * size, sin * size
    return PosedBody(
        point_at(model.bodies, frame, HEAD, x, z, size, cos, sin),
        point_at(model.bodies, frame, NECK, x, z, size, cos, sin),
        point_at(model.bodies, frame, PELVIS, x, z, size, cos, sin),
        sizes[policy, HEAD_RADIUS] * size,
        sizes[policy, TORSO_RADIUS] * size,
    )
