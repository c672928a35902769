"""Where the bodies of avatars are between two control frames."""

from typing import NamedTuple

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.bodies import PosedBody
from crowdsim.crowd.kernels.bases import base_at, base_before
from crowdsim.crowd.kernels.interpolation import ground_at, point_at
from crowdsim.crowd.kernels.layout import HEAD, NECK, PELVIS
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.jit import kernel


class Standing(NamedTuple):
    """Where an avatar is, and in which playback frame.

    Attributes:
        frame: The playback frame, of the run's.
        x: Position [m].
        z: Likewise.
        size: Scale of the body.
        cos: Cosine of the heading times the scale.
        sin: Sine likewise.
        policy: Its policy.
        width: Scale of the body times its girth.
    """

    frame: float
    x: float
    z: float
    size: float
    cos: float
    sin: float
    policy: int
    width: float


@kernel(inline=True)
def standing(model, avatars, j, share):
    """Return where an avatar is, interpolated by ``share`` between the frame before and this one."""
    motion, playback = avatars.motion, avatars.playback
    actions = model.actions
    action, phase = motion[j].action, min(motion[j].phase, actions[motion[j].action].length)
    bx, bz, cos, sin = base_at(model, avatars, j)
    turn = playback[j].base_turn
    if playback[j].action_before < 0:
        phase = playback[j].phase_before + share * (phase - playback[j].phase_before)
    else:
        before = actions[playback[j].action_before].length - playback[j].phase_before
        moved = share * (before + phase)
        if moved < before:
            action = playback[j].action_before
            phase = playback[j].phase_before + moved
            bx, bz, cos, sin, turn = base_before(model, avatars, j)
        else:
            phase = moved - before
    frame = actions[action].origin + phase * model.policies[avatars.policy[j]].stride
    gx, gz, heading = ground_at(model.ground, frame)
    x, z = bx + gx * cos + gz * sin, bz - gx * sin + gz * cos
    size = np.float64(playback[j].scale)
    cos, sin = cos_sin(turn + heading)
    return Standing(frame, x, z, size, cos * size, sin * size, avatars.policy[j], np.float64(motion[j].width))


@kernel(inline=True)
def standing_now(model, avatars, j):
    """Return where an avatar is in this frame."""
    motion, action = avatars.motion[j], model.actions[avatars.motion[j].action]
    frame = action.origin + min(motion.phase, action.length) * model.policies[avatars.policy[j]].stride
    x, z = position_of(avatars, j)
    size = np.float64(avatars.playback[j].scale)
    cos, sin = cos_sin(avatars.heading[j])
    return Standing(frame, x, z, size, cos * size, sin * size, avatars.policy[j], np.float64(motion.width))


@kernel(inline=True)
def posed_body(model, stands):
    """Return head and torso of an avatar."""
    frame, x, z, size, cos, sin, policy, width = stands
    return PosedBody(
        point_at(model.bodies, frame, HEAD, x, z, size, cos, sin),
        point_at(model.bodies, frame, NECK, x, z, size, cos, sin),
        point_at(model.bodies, frame, PELVIS, x, z, size, cos, sin),
        model.sizes[policy].head_radius * size,
        model.sizes[policy].torso_radius * width,
    )
