"""The player turns a score into motion: it adds up accents, carries pelvis and fists, and poses all joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion import quaternion as quat
from crowdsim.motion.skeleton import Skeleton
from crowdsim.performer import joints
from crowdsim.performer import skeleton as bones
from crowdsim.performer.curves import pulse, smooth_below, soft_cap, soft_floor, window
from crowdsim.performer.falling import fall_over
from crowdsim.performer.fists import clear_head, lead_fists
from crowdsim.performer.footwork import Footwork, trace_feet
from crowdsim.performer.idle_motion import add_idle_motion
from crowdsim.performer.score import Channel, Reach, Score, Style
from crowdsim.performer.sticks import lower_fist, tilted

_SINKS = 0.31
"""How long before a leg is at its longest the pelvis begins to sink for it [s]."""
_LOWEST = 0.68
"""Height of the pelvis in the deepest crouch [m]."""
_MOST_FLEX, _MOST_BEND = (-0.58, 0.60), (-0.55, 0.55)
"""How far the spine flexes and bends on top of the guard, where moves add up [rad]."""
_HIGHEST_HEEL = 0.95
"""Lift of a heel over the ball of the foot at the most, in the guard [rad]."""
_STEEPEST_HEEL = 1.05
"""The same of a foot that leaves the floor behind the body [rad]."""
_SOLE = bones.BALL_AHEAD + 0.05
"""From the heel to the ball of a foot [m]."""
_GRIPS = 8
"""Rounds in which both hands come to where they hold one stick."""
_GAZE_FOLLOWS = 0.25
"""How far the head turns with the chest; the rest of it stays on the opponent."""


@dataclass(frozen=True)
class Played:
    """Motion of an orthodox boxer over F frames, with what the ground truth needs.

    Attributes:
        root_positions: Position of the pelvis [m]. Shape (F, 3).
        rotations: Local rotations. Shape (F, 22, 4).
        footwork: Tracks of the feet.
        fists: Position of the fists, lead and rear [m]. Shape (F, 2, 3).
        shoulders: Position of the shoulder joints [m]. Shape (F, 2, 3).
        reaches: The punches as they were carried out.
    """

    root_positions: Array
    rotations: Array
    footwork: Footwork
    fists: Array
    shoulders: Array
    reaches: tuple[Reach, ...]


def add_accents(score: Score, times: Array) -> Array:
    """Return the sum of all accents. Shape (F, channels)."""
    channels = np.zeros((len(times), len(Channel)))
    for accent in score.accents:
        part = window(times, accent.at[0], accent.at[3])
        channels[part, accent.channel] += accent.size * pulse(times[part], *accent.at)
    return channels


def _add_pulses(times: Array, pulses: Sequence[tuple[float, float, float, float]]) -> Array:
    """Return a sum of pulses: 1 in them, 0 elsewhere, and what lies between on the way. Shape (F,)."""
    total = np.zeros(len(times))
    for at in pulses:
        total += pulse(times, *at)
    return total


def _carry_pelvis(score: Score, times: Array, feet: Footwork, channels: Array, ankles: Array) -> tuple[Array, Array]:
    """Return position and rotation of the pelvis, as high as both legs let it be. Shapes (F, 3) and (F, 4)."""
    style = score.style
    rotation = joints.turned(
        feet.heading + style.blade + channels[:, Channel.PELVIS_TURN],
        0.45 * style.lean + channels[:, Channel.PELVIS_TILT],
        channels[:, Channel.PELVIS_BEND],
    )
    base = np.stack([feet.carried[:, 0], feet.carried[:, 1], feet.heading], axis=-1)
    shift = np.stack([channels[:, Channel.SHIFT_X], np.zeros(len(base)), channels[:, Channel.SHIFT_Z]], axis=-1)
    hips = ground.to_world(base, shift)
    height = soft_floor(style.height + channels[:, Channel.HEIGHT], _LOWEST, 0.04)
    highest = np.full(len(base), np.inf)
    for foot in range(2):
        drop = quat.rotate(rotation, joints.hip_offset(foot))
        flat = ankles[:, foot] - hips - drop
        far = flat[:, 0] ** 2 + flat[:, 2] ** 2
        up = np.sqrt(np.maximum(joints.LEG_REACH**2 - far, 0.05))
        highest = np.minimum(highest, ankles[:, foot, 1] + up - drop[:, 1])
    most = round(_SINKS * (len(times) - 1) / max(float(times[-1] - times[0]), 1e-9))
    hips[:, 1] = soft_cap(height, smooth_below(highest, most), 0.008)
    return hips, rotation


def play_score(score: Score, skeleton: Skeleton, times: Array, rng: np.random.Generator) -> Played:
    """Perform a score at the given times [s], evenly spaced from 0. Shape (F,)."""
    feet = trace_feet(score, times)
    style = score.style
    channels = add_accents(score, times)
    walks = [(one.start, one.end) for one in score.travels if one.gait in ("walk", "jog")]
    riding = _add_pulses(times, [(start - 0.2, start + 0.2, end - 0.2, end + 0.2) for start, end in walks])
    resting = _add_pulses(times, [(rest.start, rest.down, rest.up, rest.end) for rest in score.rests])
    add_idle_motion(channels, style, times, feet.loads, np.minimum(riding + resting, 1.0), rng)
    for channel, (least, most) in ((Channel.FLEX, _MOST_FLEX), (Channel.BEND, _MOST_BEND)):
        channels[:, channel] = soft_cap(soft_floor(channels[:, channel], least, 0.06), most, 0.06)
    rotations = np.zeros((len(times), skeleton.joint_count, 4))
    rotations[..., 0] = 1.0

    ankles, soles, yaws = _set_feet(style, feet, channels, rotations)
    hips, hips_rotation = _carry_pelvis(score, times, feet, channels, ankles)
    trunk = joints.pose_trunk(
        skeleton,
        hips,
        hips_rotation,
        style.twist + channels[:, Channel.TWIST],
        0.55 * style.lean + channels[:, Channel.FLEX],
        channels[:, Channel.BEND],
    )
    rotations[:, bones.HIPS] = hips_rotation
    rotations[:, bones.SPINE : bones.SPINE2 + 1] = trunk.spine
    for foot in range(2):
        hip = hips + quat.rotate(hips_rotation, joints.hip_offset(foot))
        ahead = np.stack([np.sin(yaws[foot]), np.zeros(len(times)), np.cos(yaws[foot])], axis=-1)
        posed = joints.pose_leg(hips_rotation, hip, ankles[:, foot], soles[foot], ahead)
        for bone, local in zip((bones.UP_LEGS, bones.LEGS, bones.FEET), posed, strict=True):
            rotations[:, bone[foot]] = local
    head = _turn_head(style, skeleton, feet, channels, trunk, rotations)
    collars, shoulders = _raise_shoulders(skeleton, channels, trunk, rotations)
    reached, reaches = lead_fists(score, times, feet.heading, trunk, channels, shoulders, resting)
    fists = joints.within_reach(clear_head(reached, head), shoulders)
    bend = partial(_bend_arm, style, channels, trunk, collars, shoulders, fists, rotations)
    if score.two_hands:
        for _ in range(_GRIPS):
            bend(1)
            upper, forearm, hand = (rotations[:, bone[1]] for bone in (bones.ARMS, bones.FOREARMS, bones.HANDS))
            held = quat.multiply(quat.multiply(quat.multiply(collars[1], upper), forearm), hand)
            lower = lower_fist(fists[:, 1], held)
            fists[:, 0] = joints.within_reach(lower, shoulders[:, 0])
            # Where the lower hand does not come, the upper one goes no further either.
            fists[:, 1] = joints.within_reach(fists[:, 1] + fists[:, 0] - lower, shoulders[:, 1])
    for side in range(2):
        bend(side)
    if score.falls:
        hips, rotations, weight = fall_over(skeleton, hips, rotations, score, times, rng)
        feet = replace(feet, planted=feet.planted & (weight == 0.0)[:, None])
    return Played(hips, quat.continuous(rotations), feet, fists, shoulders, reaches)


def _bend_arm(
    style: Style,
    channels: Array,
    trunk: joints.Trunk,
    collars: list[Array],
    shoulders: Array,
    fists: Array,
    rotations: Array,
    side: int,
) -> None:
    """Write the rotations of an arm whose fist is where it should be, and of its hand."""
    posed = joints.pose_arm(
        side,
        trunk.chest_rotation,
        collars[side],
        shoulders[:, side],
        fists[:, side],
        style.elbows[side] + channels[:, Channel.LEAD_ELBOW + side],
        0.3 + channels[:, Channel.LEAD_ROLL + side],
    )
    for bone, local in zip((bones.ARMS, bones.FOREARMS, bones.HANDS), posed, strict=True):
        rotations[:, bone[side]] = local
    wrist = channels[:, Channel.LEAD_WRIST + side]
    if wrist.any():
        rotations[:, bones.HANDS[side]] = tilted(rotations[:, bones.HANDS[side]], wrist, side)


def _set_feet(
    style: Style, feet: Footwork, channels: Array, rotations: Array
) -> tuple[Array, list[Array], list[Array]]:
    """Write the rotations of the toes, and return positions of ankles (F, 2, 3), rotations and headings of the feet."""
    ankles = np.empty((len(rotations), 2, 3))
    soles, yaws = [], []
    for foot in range(2):
        raised = style.heels[foot] + feet.heels[:, foot] + channels[:, Channel.LEAD_HEEL + foot]
        heel = soft_cap(soft_floor(raised, 0.0, 0.025), _HIGHEST_HEEL, 0.08)
        heel = soft_cap(heel + feet.rolls[:, foot], _STEEPEST_HEEL, 0.04)
        yaw = feet.yaws[:, foot] + channels[:, Channel.LEAD_YAW + foot]
        # A foot on its heel has its ball as high as the heel is low.
        lift = feet.lifts[:, foot] + _SOLE * np.sin(feet.toes_up[:, foot])
        ball = np.stack([feet.balls[:, foot, 0], bones.BALL_HEIGHT + lift, feet.balls[:, foot, 1]], axis=-1)
        soles.append(joints.foot_rotation(yaw, heel - feet.toes_up[:, foot]))
        ankles[:, foot] = joints.ankle_position(ball, soles[foot])
        rotations[:, bones.TOES[foot]] = joints.about_x(-heel * feet.points[:, foot])
        yaws.append(yaw)
    return ankles, soles, yaws


def _turn_head(
    style: Style, skeleton: Skeleton, feet: Footwork, channels: Array, trunk: joints.Trunk, rotations: Array
) -> Array:
    """Write the rotations of neck and head, and return the centre of the head [m]. Shape (F, 3)."""
    gaze = joints.turned(
        feet.heading + channels[:, Channel.HEAD_TURN],
        0.2 + channels[:, Channel.HEAD_NOD] + 0.35 * channels[:, Channel.FLEX],
        channels[:, Channel.HEAD_BEND] + 0.45 * channels[:, Channel.BEND],
    )
    facing = quat.multiply(trunk.chest_rotation, quat.about_y(-style.blade - style.twist))
    gaze = quat.slerp(gaze, facing, _GAZE_FOLLOWS)
    rotations[:, [bones.NECK, bones.HEAD]] = joints.pose_head(trunk.chest_rotation, gaze)
    neck = trunk.chest + quat.rotate(trunk.chest_rotation, skeleton.offsets[bones.NECK])
    neck_rotation = quat.multiply(trunk.chest_rotation, rotations[:, bones.NECK])
    skull = neck + quat.rotate(neck_rotation, skeleton.offsets[bones.HEAD])
    head_rotation = quat.multiply(neck_rotation, rotations[:, bones.HEAD])
    return np.asarray(skull + quat.rotate(head_rotation, np.array([0.0, bones.HEAD_CENTRE, 0.0])))


def _raise_shoulders(
    skeleton: Skeleton, channels: Array, trunk: joints.Trunk, rotations: Array
) -> tuple[list[Array], Array]:
    """Write the rotations of the collar bones, and return them in the world, (F, 4) each, and shoulders (F, 2, 3)."""
    collars, shoulders = [], np.empty((len(rotations), 2, 3))
    for side in range(2):
        forth, raised = 0.12 + channels[:, Channel.LEAD_FORTH + side], 0.08 + channels[:, Channel.LEAD_RAISE + side]
        sign = 1 - 2 * side
        local = quat.from_euler(np.stack([-forth * sign, raised * sign, np.zeros_like(forth)], axis=-1), "YZX")
        rotations[:, bones.SHOULDERS[side]] = local
        collars.append(quat.multiply(trunk.chest_rotation, local))
        root = trunk.chest + quat.rotate(trunk.chest_rotation, skeleton.offsets[bones.SHOULDERS[side]])
        shoulders[:, side] = root + quat.rotate(collars[side], skeleton.offsets[bones.ARMS[side]])
    return collars, shoulders
