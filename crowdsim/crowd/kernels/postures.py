"""Where the bodies of avatars are between two control frames."""

from typing import NamedTuple

from crowdsim.core.angles import cos_sin
from crowdsim.core.bodies import PosedBody
from crowdsim.crowd.kernels.interpolation import ground_at, point_at
from crowdsim.crowd.kernels.layout import (
    ACTION,
    ACTION_BEFORE,
    BASE_COS,
    BASE_SIN,
    BASE_TURN,
    BASE_X,
    BASE_Z,
    HEAD,
    HEAD_RADIUS,
    LENGTH,
    NECK,
    ORIGIN,
    PELVIS,
    PHASE,
    PHASE_BEFORE,
    POLICY,
    SCALE,
    STRIDE,
    TORSO_RADIUS,
    WIDTH,
)
from crowdsim.crowd.kernels.motion import base_before
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
    whole, real, actions = avatars.whole, avatars.real, model.actions
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
    size = real[SCALE, j]
    cos, sin = cos_sin(turn + heading)
    return Standing(frame, x, z, size, cos * size, sin * size, whole[POLICY, j], real[WIDTH, j])


@kernel(inline=True)
def posed_body(model, stands):
    """Return head and torso of an avatar."""
    frame, x, z, size, cos, sin, policy, width = stands
    return PosedBody(
        point_at(model.bodies, frame, HEAD, x, z, size, cos, sin),
        point_at(model.bodies, frame, NECK, x, z, size, cos, sin),
        point_at(model.bodies, frame, PELVIS, x, z, size, cos, sin),
        model.sizes[policy, HEAD_RADIUS] * size,
        model.sizes[policy, TORSO_RADIUS] * width,
    )
