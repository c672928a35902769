"""The paths of the fists: the guard, out of it to a target, back into it, and never through the head."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion import quaternion as quat
from crowdsim.performer import skeleton as bones
from crowdsim.performer.curves import pulse, soft_cap, soft_floor, window
from crowdsim.performer.joints import Trunk
from crowdsim.performer.score import BENDS, Channel, Reach, Score

_GUARD_FOLLOWS = 0.45
"""How far the guard turns with the chest; the rest of it stays towards the opponent."""
_HEAD_CLEARANCE = 0.165
"""Least distance of the middle of a fist from the middle of the head [m]."""
_LEAST_DEPTH, _LEAST_BESIDE = 0.20, 0.07
"""Least distance of a fist before its shoulder, straight in front of it and beside it [m]."""
_BEHIND = 0.30
"""How much further back an arm may swing that hangs [m]."""
_LEAST_AWAY = 0.235
"""Least distance of a fist from its shoulder: a bent arm's flesh is in the way [m]."""
_FULL_REACH = 0.975 * (bones.UPPER_ARM + bones.FOREARM + bones.FIST_AHEAD)
"""How far from the shoulder a punch is aimed at the most [m]."""
_LEAST_REACH = 0.48
"""How far from the middle between the shoulders a punch is aimed at the least [m]."""
_SLOWEST, _FASTEST = 5.9, 11.0
"""Speeds between which a punching fist peaks relative to the pelvis [m/s]."""
_ATTEMPTS = 12
_SHORTEST = 0.105
"""Least time of a fist from guard to target [s]."""


def lead_fists(
    score: Score, times: Array, heading: Array, trunk: Trunk, channels: Array, shoulders: Array, resting: Array
) -> tuple[Array, tuple[Reach, ...]]:
    """Take the fists out of the moving guard to their targets and back.

    A fist that would be slower than a punch sets off later, and one that would be too fast sets off earlier.

    Args:
        score: What is performed.
        times: Times of the frames [s], evenly spaced. Shape (F,).
        heading: Heading of the stance [rad]. Shape (F,).
        trunk: The trunk.
        channels: Sums of the accents. Shape (F, channels).
        shoulders: Shoulder joints, lead and rear [m]. Shape (F, 2, 3).
        resting: 1 where arms hang and swing freely, 0 in the guard. Shape (F,).

    Returns:
        Position of the fists [m], shape (F, 2, 3), and the reaches as they were carried out.
    """
    style, stance = score.style, quat.about_y(heading)
    rest = quat.about_y(style.blade + style.twist)
    deviation = quat.multiply(quat.multiply(quat.conjugate(stance), trunk.chest_rotation), quat.conjugate(rest))
    frame = quat.multiply(stance, quat.from_rotation_vector(_GUARD_FOLLOWS * quat.to_rotation_vector(deviation)))
    held = zip(style.fists, (Channel.LEAD_HAND_X, Channel.REAR_HAND_X), strict=True)
    offsets = [np.array(fist) + channels[:, first : first + 3] for fist, first in held]
    guards = np.stack([trunk.chest + quat.rotate(frame, offset) for offset in offsets], axis=1)
    centre = shoulders.mean(axis=1)
    spacing = times[1] - times[0] if len(times) > 1 else 1.0
    ahead = quat.rotate(trunk.chest_rotation, np.array([0.0, 0.0, 1.0]))
    fists, arcs = guards.copy(), np.zeros(guards.shape[:2])
    done = []
    for planned in score.reaches:
        hand = planned.hand
        at = min(int(np.rint((planned.hit - times[0]) / spacing)), len(times) - 1)
        target = _target(planned, trunk.hips[at], float(heading[at]), shoulders[at, hand], centre[at]) - centre[at]
        first = min([accent.at[0] for accent in planned.path], default=planned.start)
        last = max([accent.at[3] for accent in planned.path], default=planned.end)
        part = window(times, min(first, planned.start) - 0.1, max(last, planned.end))
        bends = np.zeros((part.stop - part.start, 4))
        for accent in planned.path:
            bends[:, BENDS[hand].index(accent.channel)] += accent.size * pulse(times[part], *accent.at)
        swing, arc = quat.rotate(frame[part], bends[:, :3]), bends[:, 3]
        inside = at - part.start
        begin, end = 0.4 * planned.start + 0.6 * planned.hit - spacing, planned.hit - 0.5 * spacing
        out = (times[part] >= begin) & (times[part] <= end)
        reach, size = planned, 1.0
        for attempt in range(_ATTEMPTS):
            rotation = quat.about_y(arcs[part, hand] + size * arc)
            aim = centre[at] + quat.rotate(quat.conjugate(rotation[inside]), target) - size * swing[inside]
            gone = pulse(times[part], reach.start, reach.hit, reach.fall, reach.end, reach.skew)[:, None]
            path = fists[part, hand] + size * swing + gone * (aim - guards[part, hand])
            bent = centre[part] + quat.rotate(rotation, path - centre[part])
            relative = keep_ahead(bent, shoulders[part, hand], ahead[part])[out] - trunk.hips[part][out]
            speed = float(np.linalg.norm(np.diff(relative, axis=0), axis=-1).max(initial=0.0)) / spacing
            if _SLOWEST <= speed <= _FASTEST or attempt == _ATTEMPTS - 1:
                break
            later = min(max(speed / _SLOWEST, 0.8), 1.0) * min(max(speed / _FASTEST, 1.0), 1.25)
            begin = max(reach.hit - 0.97 * later * (reach.hit - reach.start), planned.start - 0.1)
            reach = replace(reach, start=min(begin, reach.hit - _SHORTEST))
            size *= min(max(_SLOWEST / max(speed, 0.1), 1.0), 1.12) * min(max(_FASTEST / max(speed, 0.1), 0.85), 1.0)
        fists[part, hand] = path
        arcs[part, hand] += size * arc
        done.append(reach)
    fists = centre[:, None] + quat.rotate(quat.about_y(arcs), fists - centre[:, None])
    return keep_ahead(fists, shoulders, ahead[:, None], _BEHIND * resting[:, None, None]), tuple(done)


def _target(reach: Reach, hips: Array, heading: float, shoulder: Array, centre: Array) -> Array:
    """Return a target in the world [m], within reach of the arm, and far enough for a punch."""
    position = np.array([reach.distance * np.sin(reach.bearing), reach.height, reach.distance * np.cos(reach.bearing)])
    target = ground.to_world(np.array([hips[0], hips[2], heading]), position)
    target = centre + _lengthen(target - centre, _LEAST_REACH, 0.02)
    gap = target - shoulder
    far = float(np.linalg.norm(gap))
    return np.asarray(shoulder + gap * (float(soft_cap(far, _FULL_REACH, 0.02)) / far))


def keep_ahead(fists: Array, shoulders: Array, ahead: Array, behind: ArrayLike = 0.0) -> Array:
    """Return fists (..., 3) held in front of their shoulders (..., 3), as the chest faces (..., 3), and off them.

    A fist beside its shoulder may be nearly level with it, so that the elbow does not go far behind the back. Arms
    that hang may swing behind it by as much as ``behind`` says [m].
    """
    gap = fists - shoulders
    depth = np.sum(gap * ahead, axis=-1, keepdims=True)
    aside = np.sum((gap - depth * ahead) ** 2, axis=-1, keepdims=True)
    least = (_LEAST_DEPTH - _LEAST_BESIDE) * np.exp(-aside / 0.15**2) + _LEAST_BESIDE - behind
    gap = gap + ahead * (soft_floor(depth, least, 0.03) - depth)
    return shoulders + _lengthen(gap, _LEAST_AWAY, 0.02)


def clear_head(fists: Array, head: Array) -> Array:
    """Return the fists (F, 2, 3) pushed out of the head (F, 3), smoothly."""
    return head[:, None] + _lengthen(fists - head[:, None], _HEAD_CLEARANCE, 0.008)


def _lengthen(gap: Array, least: float, softness: float) -> Array:
    """Return vectors (..., 3) that are no shorter than ``least``."""
    far = np.linalg.norm(gap, axis=-1, keepdims=True)
    return np.asarray(gap * (soft_floor(far, least, softness) / np.maximum(far, 1e-6)))
