"""Accelerations of parts of bodies near transitions and landed strikes against those of the source, from BVH files.

A frame exceeds the source where the acceleration of a part is above the 99.9th percentile of that part's in the source:
1 per mille of the source's frames do. ``source_there`` is the share of frames that exceed it among the source's frames
that are played near the same events, which tells what belongs to the motion itself: strikes accelerate more than other
motion. ``beyond_source_there`` is the share of frames above the 99.9th percentile of those frames of the source, of
which 1 per mille is expected.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.plain_bvh import Array
from _exported.run import ExportedRun, worst_moments
from _exported.witness import JOINTS, Figure

AROUND_TRANSITION, AROUND_STRIKE = 0.1, 0.2
"""Time before and after a transition, and a landed strike, whose frames count [s]."""
QUANTILE = 99.9
GROUPS = {name.split("_")[-1]: [k for k, one in enumerate(JOINTS) if one.split("_")[-1] == name.split("_")[-1]]
          for name in JOINTS}  # fmt: skip
"""Joints of each part of the body; of limbs the left one comes first."""
ARM = ("shoulder", "elbow", "hand")


def angular_velocity(turns: Array, fps: float) -> Array:
    """Return angular velocities between frames [rad/s].

    Args:
        turns: Rotation matrices. Shape (F, ..., 3, 3).
        fps: Frames a second.

    Returns:
        Shape (F - 1, ..., 3).
    """
    change = np.einsum("...ij,...kj->...ik", turns[1:], turns[:-1]).astype(float)
    pairs = ((2, 1), (0, 2), (1, 0))
    axis = np.stack([change[..., i, j] - change[..., j, i] for i, j in pairs], axis=-1)
    sine, cosine = np.linalg.norm(axis, axis=-1), np.trace(change, axis1=-2, axis2=-1) - 1.0
    angle = np.arctan2(sine, cosine)
    return np.asarray(axis * (angle / np.maximum(sine, 1e-12))[..., None] * fps)


def accelerations(figure: Figure, fps: float) -> tuple[Array, Array]:
    """Return accelerations [m/s2] and angular accelerations [rad/s2] of joints, 0 in the first and last frame.

    Both of shape (F, J).
    """
    linear = np.linalg.norm(np.diff(figure.joints, 2, axis=0), axis=-1) * fps**2
    angular = np.linalg.norm(np.diff(angular_velocity(figure.turns, fps), axis=0), axis=-1) * fps
    ends = ((1, 1), (0, 0))
    return np.pad(linear, ends), np.pad(angular, ends)


def _near_strikes(run: ExportedRun) -> Array:
    """Frames near strikes that an avatar lands, with the left and the right hand. Shape (N, F, 2), bool."""
    near = np.zeros((len(run.figures), run.count, 2), bool)
    landed = [strike for strike in run.strikes() if strike.landed and strike.limb < 2]
    for avatar in range(len(run.figures)):
        for hand in (0, 1):
            times = [one.seconds for one in landed if one.attacker == avatar and one.limb == hand]
            near[avatar, :, hand] = run.near(np.array(times), AROUND_STRIKE, AROUND_STRIKE)
    return near


def _source_accelerations(run: ExportedRun) -> list[Array]:
    """Both accelerations of the source at its playback frames, at the rate of the files. Each of shape (P, J)."""
    source, step = run.source, run.step
    captured = [np.zeros((len(source.clips), len(JOINTS))) for _ in range(2)]
    for first, stop in zip(source.starts[:-1], source.starts[1:], strict=True):
        for phase in range(step):
            rows = slice(first + phase, stop, step)
            for kind, values in enumerate(accelerations(source.figure.part(rows), run.fps)):
                captured[kind][rows] = values
    return captured


def measure_accelerations(run: ExportedRun) -> dict[str, Any]:
    """Return, for each part, shares of frames above the source's percentile, in per mille; sizes and paces divided out.

    Near a landed strike joints of arms count on the side that strikes.
    """
    captured = _source_accelerations(run)
    units = np.stack([run.scales * run.speeds**2, run.speeds**2])
    shown = [accelerations(figure, run.fps) for figure in run.figures]
    played = np.clip(np.round(run.frames), 0, len(run.source.clips) - 1).astype(int)
    transitions = np.stack(
        [run.near(run.transitions(k), AROUND_TRANSITION, AROUND_TRANSITION) for k in range(len(run.figures))]
    )
    strikes = _near_strikes(run)
    outcome: dict[str, Any] = {"linear": {}, "angular": {}}
    for kind, name in enumerate(outcome):
        values = np.stack([one[kind] / units[kind, k] for k, one in enumerate(shown)])
        for part, joints in GROUPS.items():
            limit = float(np.percentile(captured[kind][:, joints], QUANTILE))
            own, there = values[..., joints], captured[kind][played][..., joints]
            events = {
                "near_transitions": np.repeat(transitions[..., None], len(joints), axis=2),
                "near_landed_strikes": strikes if part in ARM else np.repeat(
                    strikes.any(axis=2, keepdims=True), len(joints), axis=2),
                "everywhere": np.ones(own.shape, bool),
            }  # fmt: skip
            outcome[name][part] = {"limit": limit, **{
                event: {
                    "files": _per_mille(own[near] > limit),
                    "source_there": _per_mille(there[near] > limit),
                    "beyond_source_there": _per_mille(own[near] > np.percentile(there[near], QUANTILE))
                    if near.any()
                    else None,
                }
                for event, near in events.items()
            }}  # fmt: skip
            for event, near in events.items():
                if (part, event) in (("foot", "near_transitions"), ("hand", "near_landed_strikes")):
                    outcome[name][part]["moments"] = _moments(run, np.where(near, own / max(limit, 1e-9), 0.0), joints)
    for parts in outcome.values():
        parts["worst"] = {event: _worst(parts, event, "files") for event in events}
        parts["worst_beyond_source_there"] = {event: _worst(parts, event, "beyond_source_there") for event in events}
    return outcome


def _worst(parts: dict[str, Any], event: str, share: str) -> dict[str, Any]:
    """Return the part of the body that exceeds its limit in most frames; None where there is none."""
    found = {name: one[event][share] for name, one in parts.items() if name in GROUPS}
    part = max(found, key=lambda name: found[name] or 0.0)
    return {"part": part, **parts[part][event]}


def _per_mille(beyond: Array) -> float | None:
    return 1000.0 * float(beyond.mean()) if beyond.size else None


def _moments(run: ExportedRun, excess: Array, joints: list[int]) -> list[dict[str, Any]]:
    """Moments of the greatest values over the limit. Shape of ``excess`` (N, F, n)."""
    side = excess.argmax(axis=2)
    most = excess.max(axis=2).ravel()
    rows = np.argsort(-most, kind="stable")[:2000]
    avatars, frames = np.divmod(rows, run.count)
    names = [JOINTS[joints[k]] for k in side.ravel()[rows]]
    return worst_moments(most[rows], avatars, frames, run.fps, parts=names)
