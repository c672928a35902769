"""Where actions are based: on what their ground transforms of playback frames are set, and what is seen from there."""

from crowdsim.core.angles import cos_sin
from crowdsim.core.easing import minimum_jerk
from crowdsim.crowd.kernels.layout import ENTERED
from crowdsim.jit import kernel


@kernel(inline=True)
def base_of(model, avatars, i, action, heading):
    """Return where an action is based that starts where an avatar is, and how it heads: x, z, cos, sin, turn.

    Positions are in metres; cosine and sine are times the scale.
    """
    origin = model.actions[action].origin
    gx, gz, gh = model.starts[action].x, model.starts[action].z, model.starts[action].heading
    if avatars.playback[i].action_before == ENTERED:
        # What came before was not seen, so the position is exact without a shift.
        gx, gz, gh = model.ground[origin].x, model.ground[origin].z, model.ground[origin].heading
    turn = heading - gh
    cos, sin = scaled_turn(avatars, i, turn)
    return avatars.x[i] - gx * cos - gz * sin, avatars.z[i] + gx * sin - gz * cos, cos, sin, turn


@kernel(inline=True)
def base_at(model, avatars, i):
    """Return where the action of an avatar is based now, from where it ends: x, z, cos, sin. Bodies that fall slide."""
    motion, action = avatars.motion, avatars.motion[i].action
    length = model.actions[action].length
    end = model.ground[model.actions[action].origin + length * model.policies[avatars.policy[i]].stride]
    cos, sin = scaled_turn(avatars, i, avatars.playback[i].base_turn)
    x, z = motion[i].end_x - end.x * cos - end.z * sin, motion[i].end_z + end.x * sin - end.z * cos
    if avatars.conditions.shape[0] > 0 and (avatars.slides[i].x != 0.0 or avatars.slides[i].z != 0.0):
        left = 1.0 - minimum_jerk(motion[i].phase / length)
        x, z = x - left * avatars.slides[i].x, z - left * avatars.slides[i].z
    return x, z, cos, sin


@kernel(inline=True)
def base_before(model, avatars, i):
    """Return where the action before the present one is based: x, z, cos, sin, turn."""
    motion, playback = avatars.motion, avatars.playback
    actions, ground, starts = model.actions, model.ground, model.starts
    new = motion[i].action
    gx, gz = starts[new].x, starts[new].z
    x, z, cos, sin = base_at(model, avatars, i)
    x, z = x + gx * cos + gz * sin, z - gx * sin + gz * cos
    old = playback[i].action_before
    end = actions[old].origin + actions[old].length * model.policies[avatars.policy[i]].stride
    turn = playback[i].base_turn + starts[new].heading - ground[end].heading
    cos, sin = scaled_turn(avatars, i, turn)
    gx, gz = ground[end].x, ground[end].z
    return x - gx * cos - gz * sin, z + gx * sin - gz * cos, cos, sin, turn


@kernel(inline=True)
def scaled_turn(avatars, i, turn):
    """Return cosine and sine of a turn, times the scale of an avatar."""
    cos, sin = cos_sin(turn)
    return cos * avatars.playback[i].scale, sin * avatars.playback[i].scale


@kernel(inline=True)
def over_ground(model, avatars, i, action, old, fx, fz):
    """Return over what a point lies that is seen from the start of an avatar's action, or of its ``old`` one."""
    if old:
        base_x, base_z, cos, sin, _ = base_before(model, avatars, i)
    else:
        base_x, base_z, cos, sin = base_at(model, avatars, i)
    return from_base(model, action, base_x, base_z, cos, sin, fx, fz)


@kernel(inline=True)
def from_base(model, action, base_x, base_z, cos, sin, fx, fz):
    """Return over what a point lies that is seen from the start of an action, by where that is based."""
    starts = model.starts
    gx, gz, gh = starts[action].x, starts[action].z, starts[action].heading
    wx, wz = cos_sin(gh)
    gx, gz = gx + fx * wx + fz * wz, gz - fx * wz + fz * wx
    return base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
