"""Lays falls over a staged guard: mixes both, rests the body on the floor, and poses it again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion as quat
from crowdsim.motion.body import Body, build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.performer import floor
from crowdsim.performer import skeleton as bones
from crowdsim.performer.curves import smooth_below, soft_floor
from crowdsim.performer.footwork import Footwork
from crowdsim.performer.pose import (
    ankle_position,
    bend_arm,
    foot_rotation,
    level_toes,
    pose_leg,
    pose_trunk,
    unit,
    within_reach,
)
from crowdsim.performer.score import Fall
from crowdsim.performer.tumbling import Tumble, mixed, trace_falls

_NECK_SHARE = 0.42
_FIST_ROLL = 0.3
_RESTS = 0.006
"""Range over which the pelvis comes to rest on the floor [m]."""
_LANDS = 0.13
"""Time over which the floor takes the speed of a part of the body that meets it [s]."""
_KNEE_LIFT = 0.4
"""How far the pelvis is lifted for a knee that touches the floor, at the most [m]."""
_MOST_TOES = 1.1
"""Bend of the toes of a foot on its ball [rad]."""


@dataclass(frozen=True)
class Guarded:
    """The guard over F frames, by the parts that falls mix it with; feet and hands lead, rear.

    Attributes:
        root_positions: Position of the pelvis [m]. Shape (F, 3).
        rotations: Local rotations. Shape (F, 22, 4).
        balls: Position of the joints at the balls of the feet [m]. Shape (F, 2, 3).
        soles: Rotations of the feet in the world. Shape (F, 2, 4).
        knees: Directions in which the knees point, at right angles to the legs. Shape (F, 2, 3).
    """

    root_positions: Array
    rotations: Array
    balls: Array
    soles: Array
    knees: Array


def fall_over(
    skeleton: Skeleton,
    root_positions: Array,
    rotations: Array,
    falls: Sequence[Fall],
    times: Array,
    rng: np.random.Generator,
) -> tuple[Array, Array, Array]:
    """Return the motion with falls laid over the guard.

    Args:
        skeleton: The boxer's skeleton.
        root_positions: Position of the pelvis in the guard [m]. Shape (F, 3).
        rotations: Local rotations in the guard. Shape (F, 22, 4).
        falls: The falls, one after another.
        times: Times of the frames [s], evenly spaced. Shape (F,).
        rng: Where the stirring of a lying body is drawn from.

    Returns:
        Position of the pelvis (F, 3) [m], local rotations (F, 22, 4), and how far a fall has the body (F,), 0 to 1.
    """
    tumble = trace_falls(falls, times, rng)
    guard, body, found = _measure(skeleton, root_positions, rotations), build_body(skeleton), rotations.copy()
    hips = mixed(root_positions, tumble.hips, tumble.weight)
    found[:, bones.HIPS] = quat.slerp(rotations[:, bones.HIPS], tumble.rotation, tumble.weight)
    trunk = pose_trunk(skeleton, hips, found[:, bones.HIPS], *tumble.spine.T)
    _bend_trunk(trunk.spine, tumble, rotations, found)
    rest = floor.rest_height(body, skeleton, hips, found)
    around = round(_LANDS * (len(times) - 1) / (times[-1] - times[0]))
    lift = soft_floor(hips[:, 1], rest, _RESTS) - hips[:, 1]
    hips[:, 1] += tumble.weight * -smooth_below(-lift, around)
    _set_legs(body, guard, tumble, hips, found, around)
    _set_arms(skeleton, tumble, hips, rotations, found)
    return hips, quat.continuous(found), tumble.weight


def _measure(skeleton: Skeleton, root_positions: Array, rotations: Array) -> Guarded:
    """Return the guard by its parts."""
    positions, turned = forward_kinematics(skeleton, root_positions, rotations)
    hips, knees = positions[:, list(bones.UP_LEGS)], positions[:, list(bones.LEGS)]
    axis = unit(positions[:, list(bones.FEET)] - hips)
    out = knees - hips
    out = out - axis * np.sum(out * axis, axis=-1, keepdims=True)
    return Guarded(
        root_positions, rotations, positions[:, list(bones.TOES)], turned[:, list(bones.FEET)], unit(out)
    )  # fmt: skip


def _bend_trunk(spine: Array, tumble: Tumble, rotations: Array, found: Array) -> None:
    """Write the rotations of spine, neck and head."""
    for index, joint in enumerate((bones.SPINE, bones.SPINE1, bones.SPINE2)):
        found[:, joint] = quat.slerp(rotations[:, joint], spine[:, index], tumble.weight)
    for joint, share in ((bones.NECK, _NECK_SHARE), (bones.HEAD, 1.0 - _NECK_SHARE)):
        nod, turn = share * tumble.head.T
        local = quat.from_euler(np.stack([turn, nod, np.zeros_like(nod)], axis=-1), "YXZ")
        found[:, joint] = quat.slerp(rotations[:, joint], local, tumble.weight)


def _set_legs(body: Body, guard: Guarded, tumble: Tumble, hips: Array, found: Array, around: int) -> None:
    """Put the feet where they are, rest the pelvis (F, 3) on knees that touch the floor, and bend the legs."""
    weight, turned = tumble.weight, found[:, bones.HIPS]
    soles, ankles = [], np.empty((len(hips), 2, 3))
    for foot in range(2):
        sole = foot_rotation(tumble.yaws[:, foot], tumble.pitches[:, foot])
        soles.append(quat.slerp(guard.soles[:, foot], sole, weight))
        ball = tumble.balls[:, foot] + [0.0, bones.BALL_HEIGHT, 0.0]
        ankles[:, foot] = ankle_position(mixed(guard.balls[:, foot], ball, weight), soles[foot])
        toes = level_toes(np.clip(tumble.pitches[:, foot], -0.3, _MOST_TOES), _near_floor(ball[:, 1]))
        found[:, bones.TOES[foot]] = quat.slerp(found[:, bones.TOES[foot]], toes, weight)
    ankles[..., 1] += weight[:, None] * floor.clear_feet(body, ankles, (soles[0], soles[1]))
    sockets = [quat.rotate(turned, np.array([bones.HIP_HALF * (1 - 2 * f), -bones.HIP_DROP, 0.0])) for f in range(2)]

    def legs(lift: Array) -> list[tuple[Array, Array, Array]]:
        """Return hip, ankle and direction of the knee of each leg, the pelvis lifted (F,)."""
        parts = []
        for foot, socket in enumerate(sockets):
            hip = hips + socket
            hip[:, 1] += lift
            ankle = mixed(ankles[:, foot], floor.within_leg(ankles[:, foot], hip), weight)
            ahead = floor.knee_direction(turned, hip, ankle, tumble.splays[:, foot], 1 - 2 * foot)
            parts.append((hip, ankle, unit(mixed(guard.knees[:, foot], ahead, weight))))
        return parts

    hips[:, 1] += weight * -smooth_below(-_knee_lift(legs, len(hips)), around)
    for foot, (hip, ankle, ahead) in enumerate(legs(np.zeros(len(hips)))):
        thigh, shank, sole = pose_leg(turned, hip, ankle, soles[foot], ahead)
        found[:, bones.UP_LEGS[foot]], found[:, bones.LEGS[foot]], found[:, bones.FEET[foot]] = thigh, shank, sole


def _near_floor(height: Array) -> Array:
    """Return 1 where the ball of a foot is on the floor, 0 where it is in the air. Shape (F,)."""
    return np.asarray(np.clip((0.10 - height) / 0.06, 0.0, 1.0))


def _knee_lift(legs: Callable[[Array], list[tuple[Array, Array, Array]]], count: int) -> Array:
    """Return how far the pelvis has to rise so that no knee is in the floor [m], by bisection. Shape (F,)."""
    low, high = np.zeros(count), np.full(count, _KNEE_LIFT)
    for _ in range(24):
        middle = 0.5 * (low + high)
        least = np.min([floor.knee_height(*leg) for leg in legs(middle)], axis=0)
        sunk = least < floor.KNEE
        low, high = np.where(sunk, middle, low), np.where(sunk, high, middle)
    return high


def _set_arms(skeleton: Skeleton, tumble: Tumble, hips: Array, rotations: Array, found: Array) -> None:
    """Bend the arms to their fists, in the guard as they are there."""
    positions, turned = forward_kinematics(skeleton, hips, found)
    chest, chest_rotation = positions[:, bones.SPINE2], turned[:, bones.SPINE2]
    for side in range(2):
        shoulder, collar = positions[:, bones.ARMS[side]], turned[:, bones.SHOULDERS[side]]
        fist = chest + quat.rotate(chest_rotation, tumble.hands[:, side])
        fist = mixed(fist, tumble.props[:, side], tumble.propped[:, side])
        fist = within_reach(fist, shoulder)
        fist[:, 1] = soft_floor(fist[:, 1], floor.FIST, 0.004)
        back, out = floor.elbow_frame(chest_rotation, unit(fist - shoulder), 1 - 2 * side)
        swivel = floor.clear_elbow(shoulder, fist, back, out, tumble.elbows[:, side])
        pole = np.cos(swivel)[:, None] * back + np.sin(swivel)[:, None] * out
        posed = bend_arm(side, collar, shoulder, fist, pole, np.full(len(hips), _FIST_ROLL))
        for joint, local in zip((bones.ARMS, bones.FOREARMS, bones.HANDS), posed, strict=True):
            found[:, joint[side]] = quat.slerp(rotations[:, joint[side]], local, tumble.weight)


def without_plants(feet: Footwork, weight: Array) -> Footwork:
    """Return footwork whose feet are not planted while a fall has the body, to the given extent (F,)."""
    return replace(feet, planted=feet.planted & (weight == 0.0)[:, None])
