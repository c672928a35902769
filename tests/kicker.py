"""Legs that kick, or only seem to, on the embedded boxer's skeleton: clips with known strikes of feet."""

from itertools import pairwise

import numpy as np

from crowdsim.motion import quaternion
from crowdsim.motion.skeleton import Clip
from crowdsim.performer.skeleton import ARMS, FOREARMS, HIPS, LEGS, PELVIS_HEIGHT, UP_LEGS, build_skeleton

FPS = 60.0
KINDS = ("front", "side", "round")
SIDES = ("left", "right")

_FRONT = ((-0.45, 0, 0), (-0.15, -105, 110), (0.0, -95, 5), (0.2, -100, 110), (0.55, 0, 0))
_SIDE = ((-0.5, 0, 0), (-0.16, 75, 115), (0.0, 90, 5), (0.2, 75, 110), (0.6, 0, 0))
_KNEE = ((-0.45, 0, 0), (-0.05, -135, 110), (0.05, -135, 110), (0.5, 0, 0))
_HEEL = ((-0.25, 0, 0), (0.0, 25, 110), (0.25, -30, 20), (0.5, 0, 0))
"""Keys of a leg: time from its furthest reach [s], hip and knee [degrees]."""


def stand(seconds: float) -> Clip:
    """Return someone who stands still at the origin, hands up, facing +z."""
    skeleton, frames = build_skeleton(), round(seconds * FPS)
    rotations = np.zeros((frames, skeleton.joint_count, 4))
    rotations[..., 0] = 1.0
    for side, sign in enumerate((1.0, -1.0)):
        rotations[:, ARMS[side]] = quaternion.from_rotation_vector(np.array([0.0, 0.0, -1.2 * sign]))
        rotations[:, FOREARMS[side]] = quaternion.from_rotation_vector(np.array([0.0, -2.0 * sign, 0.0]))
    roots = np.tile([0.0, PELVIS_HEIGHT, 0.0], (frames, 1))
    # Nobody stands as still as a rig whose root is fixed.
    roots[:, 0] = roots[:, 2] = 0.003 * np.sin(np.arange(frames) / FPS)
    return Clip("kicker", skeleton, FPS, roots, rotations)


def swing(clip: Clip, at: float, side: int, keys: tuple[tuple[float, float, float], ...], axis: str = "x") -> None:
    """Let a leg follow keys around a time, in place; the hip turns about an axis, the knee about its hinge."""
    times = np.arange(clip.frame_count) / FPS - at
    hip, knee = (_smooth(times, [(key[0], key[1 + k]) for key in keys]) for k in range(2))
    vectors = np.zeros((len(times), 3))
    vectors[:, "xyz".index(axis)] = hip * (1.0 if axis == "x" or side == 0 else -1.0)
    bends = np.zeros((len(times), 3))
    bends[:, 0] = knee
    moving = np.abs(times) < 0.7
    clip.rotations[moving, UP_LEGS[side]] = quaternion.from_rotation_vector(vectors[moving])
    clip.rotations[moving, LEGS[side]] = quaternion.from_rotation_vector(bends[moving])


def kick(clip: Clip, at: float, side: int, kind: str) -> None:
    """Let a leg kick, in place: furthest out at a time [s]."""
    if kind == "front":
        swing(clip, at, side, _FRONT)
    elif kind == "side":
        swing(clip, at, side, _SIDE, "z")
    else:
        # The thigh rises to the side and ahead, and the shank swings round.
        swing(clip, at, side, _SIDE, "z")
        times = np.arange(clip.frame_count) / FPS - at
        turn = np.zeros((clip.frame_count, 3))
        turn[:, 1] = _smooth(times, [(-0.5, 0), (-0.2, 20), (0.05, -60), (0.6, 0)]) * (1.0 if side == 0 else -1.0)
        clip.rotations[:, UP_LEGS[side]] = quaternion.multiply(
            quaternion.from_rotation_vector(turn), clip.rotations[:, UP_LEGS[side]]
        )


def lift_knee(clip: Clip, at: float, side: int) -> None:
    """Let a knee rise fast, without a kick, in place."""
    swing(clip, at, side, _KNEE)


def swing_heel(clip: Clip, at: float, side: int) -> None:
    """Let a heel swing up behind, as in a sprint, in place."""
    swing(clip, at, side, _HEEL)


def jump(clip: Clip, at: float, height: float = 0.6) -> None:
    """Let the body jump, with legs that tuck and stretch in the air, in place."""
    times = np.arange(clip.frame_count) / FPS - at
    clip.root_positions[:, 1] += height * np.clip(1.0 - (times / 0.35) ** 2, 0.0, None)
    for side in range(2):
        swing(clip, at, side, ((-0.35, 0, 0), (-0.1, -60, 90), (0.1, -40, 5), (0.35, 0, 0)))


def fall(clip: Clip, at: float) -> None:
    """Let the body fall backwards and throw its legs up, in place."""
    times = np.arange(clip.frame_count) / FPS - at
    vectors = np.zeros((clip.frame_count, 3))
    vectors[:, 0] = _smooth(times, [(-0.5, 0), (0.0, -100), (1.0, -100)])
    clip.rotations[:, HIPS] = quaternion.from_rotation_vector(vectors)
    clip.root_positions[:, 1] -= _smooth(times, [(-0.5, 0), (0.0, 45), (1.0, 45)]) / np.pi
    swing(clip, at + 0.2, 0, _FRONT)


def kicks(sides: tuple[int, ...] = (0, 1), kind: str = "front", apart: float = 1.5) -> tuple[Clip, list[float]]:
    """Return a clip of kicks one after another, and when each reaches furthest [s]."""
    times = [1.0 + apart * k for k in range(len(sides))]
    clip = stand(times[-1] + 1.0)
    for time, side in zip(times, sides, strict=True):
        kick(clip, time, side, kind)
    return clip, times


def _smooth(times: np.ndarray, keys: list[tuple[float, float]]) -> np.ndarray:
    """Angles [rad] at times by keys [s, degrees], at rest at each of them."""
    result = np.full(len(times), np.deg2rad(keys[0][1]))
    for (begin, first), (end, last) in pairwise(keys):
        share = np.clip((times - begin) / (end - begin), 0.0, 1.0)
        result += np.deg2rad(last - first) * share * share * (3.0 - 2.0 * share)
    return result
