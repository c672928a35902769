"""Lays a fall over a posed guard: traces its poses, rests the body on the floor and out of it, and poses it again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from crowdsim.core.types import Array
from crowdsim.motion import quaternion as quat
from crowdsim.motion.body import Body, build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.performer import joints
from crowdsim.performer import skeleton as bones
from crowdsim.performer.curves import noise, pulse, smooth_below, soft_cap, soft_floor, window
from crowdsim.performer.score import Fall, Pose, Score

_ONSET, _RETURN = 0.22, 0.48
"""Times in which a fall takes the body out of the guard, and in which it comes back [s]."""
_SMOOTH = 0.035
"""Width of the smoothing of all tracks [s]."""
_BREATH, _BREATHS = 0.035, 0.6
"""How far the spine bends as a lying body breathes [rad], and how often it does [Hz]."""
_STIR = 0.012
"""Slow stirring of a lying body [rad]."""
_FIST_ROLL = 0.3
_RESTS = 0.006
"""Range over which the pelvis comes to rest on the floor [m]."""
_LANDS = 0.13
"""Time over which the floor takes the speed of a part of the body that meets it [s]."""
_KNEE_LIFT = 0.4
"""How far the pelvis is lifted for a knee that touches the floor, at the most [m]."""
_MOST_TOES = 1.1
"""Bend of the toes of a foot on its ball [rad]."""
_HIP, _KNEE, _SHOULDER, _ELBOW, _FIST = 0.092, 0.054, 0.062, 0.046, 0.062
"""Radii of thighs at the hip, knees, shoulders, elbows and fists, and a little more [m]."""
_LEAST_LEG = 0.24
"""Least distance from hip to ankle [m]: thigh and shank have flesh."""
_HANGS, _BACK = (joints.DOWN + joints.AHEAD) / np.sqrt(2.0), (joints.DOWN - joints.AHEAD) / np.sqrt(2.0)
"""Where an arm hangs, and where its elbow points then."""


def trace_fall(fall: Fall[float], poses: Sequence[Pose], times: Array, rng: np.random.Generator) -> tuple[Pose, Array]:
    """Carry out a fall at the given times [s], evenly spaced; tracks neither overshoot nor jerk. Shape (F,).

    Returns:
        Poses over F frames, and how far the fall has the body: 1 in the fall, 0 in the guard. Shape (F,).
    """
    part = window(times, fall.start, fall.end)
    inside, weight = times[part], np.zeros(len(times))
    weight[part] = pulse(inside, fall.start, fall.start + _ONSET, fall.end - _RETURN, fall.end)
    at = np.array([pose.time for pose in poses])
    tracks = {}
    for name in [field.name for field in fields(Pose)]:
        keys = np.array([getattr(pose, name) for pose in poses])
        keys = quat.continuous(keys) if name == "rotation" else keys
        tracks[name] = np.zeros((len(times), *keys.shape[1:]))
        track = PchipInterpolator(at, keys, axis=0)(np.clip(inside, at[0], at[-1]))
        tracks[name][part] = gaussian_filter1d(track, _SMOOTH / (inside[1] - inside[0]), axis=0, mode="nearest")
    rotations = quat.normalise(tracks["rotation"][part])
    tracks["rotation"][:] = 1.0, 0.0, 0.0, 0.0
    tracks["rotation"][part] = rotations
    lying = pulse(times, fall.down - 0.3, fall.down + 0.4, fall.rise - 0.1, fall.rise + 0.4)
    tracks["spine"][:, 1] -= lying * (np.sin(2.0 * np.pi * _BREATHS * (times - fall.down)) * _BREATH)
    tracks["spine"][:, 2] += lying * _STIR * noise(times, rng, 0.2, 0.8)
    tracks["head"] += (lying * _STIR * noise(times, rng, 0.2, 0.9))[:, None]
    return Pose(**tracks), weight


def _mixed(guard: Array, fallen: Array, weight: Array) -> Array:
    """Return tracks (F, ...) of the guard where ``weight`` (F,) is 0 and of a fall where it is 1."""
    share = np.reshape(weight, (-1,) + (1,) * (guard.ndim - 1))
    return np.asarray(guard + share * (fallen - guard))


def fall_over(
    skeleton: Skeleton, root_positions: Array, rotations: Array, score: Score, times: Array, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return the motion with the fall of a score laid over the guard.

    Args:
        skeleton: The boxer's skeleton.
        root_positions: Position of the pelvis in the guard [m]. Shape (F, 3).
        rotations: Local rotations in the guard. Shape (F, 22, 4).
        score: What is performed, with a fall.
        times: Times of the frames [s], evenly spaced. Shape (F,).
        rng: Where the stirring of a lying body is drawn from.

    Returns:
        Position of the pelvis (F, 3) [m], local rotations (F, 22, 4), and how far a fall has the body (F,), 0 to 1.
    """
    (fall,) = score.falls
    tumble, weight = trace_fall(fall, score.poses, times, rng)
    body, found = build_body(skeleton), rotations.copy()
    hips = _mixed(root_positions, tumble.hips, weight)
    found[:, bones.HIPS] = quat.slerp(rotations[:, bones.HIPS], tumble.rotation, weight)
    spine = joints.pose_trunk(skeleton, hips, found[:, bones.HIPS], *tumble.spine.T).spine
    for index, joint in enumerate((bones.SPINE, bones.SPINE1, bones.SPINE2)):
        found[:, joint] = quat.slerp(rotations[:, joint], spine[:, index], weight)
    for joint, share in ((bones.NECK, joints.NECK_SHARE), (bones.HEAD, 1.0 - joints.NECK_SHARE)):
        nod, turn = share * tumble.head.T
        local = quat.from_euler(np.stack([turn, nod, np.zeros_like(nod)], axis=-1), "YXZ")
        found[:, joint] = quat.slerp(rotations[:, joint], local, weight)
    around = round(_LANDS * (len(times) - 1) / (times[-1] - times[0]))
    lift = soft_floor(hips[:, 1], _rest_height(body, skeleton, hips, found), _RESTS) - hips[:, 1]
    hips[:, 1] += weight * -smooth_below(-lift, around)
    guard = forward_kinematics(skeleton, root_positions, rotations)
    _set_legs(body, guard, tumble, weight, hips, found, around)
    _set_arms(skeleton, tumble, weight, hips, rotations, found)
    return hips, quat.continuous(found), weight


def _rest_height(body: Body, skeleton: Skeleton, hips: Array, rotations: Array) -> Array:
    """Return the least height of the pelvis at which trunk, head and limb roots are above the floor [m]. Shape (F,)."""
    positions, turned = forward_kinematics(skeleton, hips, rotations)
    least = [
        positions[:, joint, 1] + quat.rotate(turned[:, joint], end)[:, 1] - radius
        for joint, starts, ends, radii in zip(
            body.capsule_joints, body.capsule_starts, body.capsule_ends, body.capsule_radii, strict=True
        )
        if joint <= bones.HEAD
        for end, radius in zip((starts, ends), radii, strict=True)
    ]
    shoulders = positions[:, list(bones.ARMS), 1].min(axis=1) - _SHOULDER
    low = np.minimum(np.min([*least, shoulders], axis=0), positions[:, list(bones.UP_LEGS), 1].min(axis=1) - _HIP)
    return np.asarray(hips[:, 1] - low)


def _set_legs(
    body: Body, guard: tuple[Array, Array], tumble: Pose, weight: Array, hips: Array, found: Array, around: int
) -> None:
    """Put the feet where they are, rest the pelvis (F, 3) on knees that touch the floor, and bend the legs.

    ``guard`` are positions (F, 22, 3) and rotations (F, 22, 4) of all joints in the guard.
    """
    positions, rotations = guard
    turned = found[:, bones.HIPS]
    axis = joints.unit(positions[:, list(bones.FEET)] - positions[:, list(bones.UP_LEGS)])
    out = positions[:, list(bones.LEGS)] - positions[:, list(bones.UP_LEGS)]
    knees = joints.unit(out - axis * np.sum(out * axis, axis=-1, keepdims=True))
    soles, ankles = [], np.empty((len(hips), 2, 3))
    for foot in range(2):
        sole = joints.foot_rotation(tumble.yaws[:, foot], tumble.pitches[:, foot])
        soles.append(quat.slerp(rotations[:, bones.FEET[foot]], sole, weight))
        ball = tumble.balls[:, foot] + [0.0, bones.BALL_HEIGHT, 0.0]
        ankles[:, foot] = joints.ankle_position(_mixed(positions[:, bones.TOES[foot]], ball, weight), soles[foot])
        near = np.clip((0.10 - ball[:, 1]) / 0.06, 0.0, 1.0)
        toes = joints.about_x(-np.clip(tumble.pitches[:, foot], -0.3, _MOST_TOES) * near)
        found[:, bones.TOES[foot]] = quat.slerp(found[:, bones.TOES[foot]], toes, weight)
    ankles[..., 1] += weight[:, None] * _clear_feet(body, ankles, (soles[0], soles[1]))
    sockets = [quat.rotate(turned, joints.hip_offset(foot)) for foot in range(2)]

    def legs(lift: Array) -> list[tuple[Array, Array, Array]]:
        """Return hip, ankle and direction of the knee of each leg, the pelvis lifted (F,)."""
        parts = []
        for foot, socket in enumerate(sockets):
            hip = hips + socket
            hip[:, 1] += lift
            held = joints.within_limb(ankles[:, foot], hip, _LEAST_LEG, 0.02, joints.LEG_REACH)
            held[:, 1] = soft_floor(held[:, 1], ankles[:, foot, 1], 0.003)
            ankle = _mixed(ankles[:, foot], held, weight)
            # The knee is ahead of the pelvis where the leg hangs.
            ahead, out = joints.carry(turned, joints.DOWN, ankle - hip, joints.AHEAD, foot)
            ahead = joints.swivelled(ahead, out, tumble.splays[:, foot])
            parts.append((hip, ankle, joints.unit(_mixed(knees[:, foot], ahead, weight))))
        return parts

    hips[:, 1] += weight * -smooth_below(-_knee_lift(legs, len(hips)), around)
    for foot, (hip, ankle, ahead) in enumerate(legs(np.zeros(len(hips)))):
        thigh, shank, sole = joints.pose_leg(turned, hip, ankle, soles[foot], ahead)
        found[:, bones.UP_LEGS[foot]], found[:, bones.LEGS[foot]], found[:, bones.FEET[foot]] = thigh, shank, sole


def _knee_lift(legs: Callable[[Array], list[tuple[Array, Array, Array]]], count: int) -> Array:
    """Return how far the pelvis has to rise so that no knee is in the floor [m], by bisection. Shape (F,)."""
    low, high = np.zeros(count), np.full(count, _KNEE_LIFT)
    for _ in range(24):
        middle = 0.5 * (low + high)
        solved = [(leg, joints.solve_leg(*leg)) for leg in legs(middle)]
        least = np.min([leg[0][:, 1] + bones.THIGH * bone[:, 1] for leg, (bone, _, _) in solved], axis=0)
        sunk = least < _KNEE
        low, high = np.where(sunk, middle, low), np.where(sunk, high, middle)
    return high


def _set_arms(skeleton: Skeleton, tumble: Pose, weight: Array, hips: Array, rotations: Array, found: Array) -> None:
    """Bend the arms to their fists, in the guard as they are there."""
    positions, turned = forward_kinematics(skeleton, hips, found)
    chest, chest_rotation = positions[:, bones.SPINE2], turned[:, bones.SPINE2]
    for side in range(2):
        shoulder, collar = positions[:, bones.ARMS[side]], turned[:, bones.SHOULDERS[side]]
        fist = chest + quat.rotate(chest_rotation, tumble.hands[:, side])
        fist = _mixed(fist, tumble.props[:, side], tumble.propped[:, side])
        fist = joints.within_reach(fist, shoulder)
        fist[:, 1] = soft_floor(fist[:, 1], _FIST, 0.004)
        # Arms of a falling body go any way but up and back, where these directions would be undefined.
        back, out = joints.carry(chest_rotation, _HANGS, fist - shoulder, _BACK, side)
        swivel = _clear_elbow(shoulder, fist, back, out, tumble.elbows[:, side])
        pole, roll = joints.swivelled(back, out, swivel), np.full(len(hips), _FIST_ROLL)
        posed = joints.bend_arm(side, collar, shoulder, fist, pole, roll)
        for joint, local in zip((bones.ARMS, bones.FOREARMS, bones.HANDS), posed, strict=True):
            found[:, joint[side]] = quat.slerp(rotations[:, joint[side]], local, weight)


def _clear_feet(body: Body, ankles: Array, soles: tuple[Array, Array]) -> Array:
    """Return how far each foot must rise, so that its shoe is out of the floor [m]. Shape (F, 2)."""
    lifts = np.empty(ankles.shape[:2])
    for foot in range(2):
        (shoe,) = np.flatnonzero(body.capsule_joints == bones.FEET[foot])
        low = ankles[:, foot, 1] - 0.037
        for end, radius in zip((body.capsule_starts, body.capsule_ends), body.capsule_radii[shoe], strict=True):
            low = np.minimum(low, ankles[:, foot, 1] + quat.rotate(soles[foot], end[shoe])[:, 1] - radius)
        lifts[:, foot] = soft_floor(-low, 0.0, 0.003)
    return lifts


def _clear_elbow(shoulder: Array, fist: Array, down: Array, out: Array, swivel: Array) -> Array:
    """Return the swivel of an elbow (F,) nearest to the given one at which it is out of the floor [rad].

    Args:
        shoulder: Position of the shoulder joint [m]. Shape (F, 3).
        fist: Position of the fist [m]. Shape (F, 3).
        down: Where the elbow points at a swivel of 0. Shape (F, 3).
        out: Where it points at a quarter of a circle. Shape (F, 3).
        swivel: The swivel wanted [rad]. Shape (F,).
    """
    lower = bones.FOREARM + bones.FIST_AHEAD
    gap = fist - shoulder
    distance = np.linalg.norm(gap, axis=-1)
    cosine = np.clip((bones.UPPER_ARM**2 + distance**2 - lower**2) / (2.0 * bones.UPPER_ARM * distance), -1.0, 1.0)
    middle = shoulder[:, 1] + bones.UPPER_ARM * cosine * gap[:, 1] / distance
    size = bones.UPPER_ARM * np.sqrt(1.0 - cosine**2) * np.hypot(down[:, 1], out[:, 1])
    highest = np.arctan2(out[:, 1], down[:, 1])
    most = np.arccos(np.clip((_ELBOW - middle) / np.maximum(size, 1e-6), -1.0, 1.0))
    away = (swivel - highest + np.pi) % (2.0 * np.pi) - np.pi
    held = np.sign(away) * soft_cap(np.abs(away), most, 0.05)
    return np.asarray(swivel + np.where(most < np.pi - 1e-9, held - away, 0.0))
