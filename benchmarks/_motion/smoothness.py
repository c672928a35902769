"""How smooth shown motion is beside its capture: accelerations of points and joints, jumps of joints, pelvis drops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from _motion.shown_motion import PARTS, Shown
from crowdsim.core.types import Array
from crowdsim.motion import quaternion

NEAR = 0.25
"""Time around a transition or a strike that counts as near [s]."""
SHARE = 99.9
"""Percentile of the capture that counts as its limit."""
JUMP = np.deg2rad(10.0)
"""How much further a joint rotates in one frame than in the frames before and after where it jumps [rad]."""
DROP = 0.025
"""How far the pelvis goes down in two frames where it drops [m]."""


def accelerations(positions: Array, rate: float) -> Array:
    """Return the sizes of accelerations (..., T, P) of points (..., T, P, 3) [m/s2], 0 at both ends."""
    out = np.zeros(positions.shape[:-1], np.float32)
    change = positions[..., 2:, :, :] - 2.0 * positions[..., 1:-1, :, :] + positions[..., :-2, :, :]
    out[..., 1:-1, :] = np.linalg.norm(change, axis=-1) * rate**2
    return out


def _steps(rotations: Array) -> Array:
    """Rotation vectors (..., T - 1, R, 3) of joints from frame to frame, in their parents' frames or the world."""
    change = quaternion.multiply(rotations[..., 1:, :, :], quaternion.conjugate(rotations[..., :-1, :, :]))
    change = np.where(change[..., :1] < 0.0, -change, change)
    size = np.linalg.norm(change[..., 1:], axis=-1)
    share = np.where(size > 1e-9, 2.0 * np.arctan2(size, change[..., 0]) / np.maximum(size, 1e-9), 2.0)
    return np.asarray(change[..., 1:] * share[..., None], dtype=np.float32)


def angular_accelerations(rotations: Array, rate: float) -> Array:
    """Return the sizes of angular accelerations (..., T, R) of joints (..., T, R, 4) [rad/s2], 0 at both ends."""
    out = np.zeros(rotations.shape[:-1], np.float32)
    out[..., 1:-1, :] = np.linalg.norm(np.diff(_steps(rotations), axis=-3), axis=-1) * rate**2
    return out


def jumps(rotations: Array) -> Array:
    """Return where joints (..., T, R, 4) rotate in one frame alone. Shape (..., T, R), bool."""
    out = np.zeros(rotations.shape[:-1], bool)
    sizes = np.linalg.norm(_steps(rotations), axis=-1)
    around = np.maximum(sizes[..., 2:, :], sizes[..., :-2, :])
    out[..., 2:-1, :] = sizes[..., 1:-1, :] - around > JUMP
    return out


def drops(heights: Array) -> Array:
    """Return where a pelvis at heights (..., T) goes down; a drop counts once. Shape (..., T), bool."""
    down = np.zeros(heights.shape, bool)
    down[..., 2:] = heights[..., :-2] - heights[..., 2:] > DROP
    down[..., 1:] &= ~down[..., :-1]
    return down


def by_clip(shown: Shown, measure: Any, values: Array, *arguments: Any) -> Array:
    """Return what a measure gives for the capture (K, ...), clip by clip."""
    return np.concatenate([measure(values[a:b], *arguments) for a, b in shown.pieces])


def around(shown: Shown, owners: Array, times: Array) -> Array:
    """Return which frames are near moments (n,) of avatars. Shape (n, T), bool."""
    count, frames = shown.positions.shape[:2]
    reach = round(NEAR * shown.rate)
    marks = np.zeros((count, frames + 1), np.int64)
    low, high = np.clip(times - reach, 0, frames), np.clip(times + reach + 1, 0, frames)
    np.add.at(marks, (owners, low), 1)
    np.add.at(marks, (owners, high), -1)
    return np.asarray(np.cumsum(marks, axis=1)[:, :-1] > 0)


def near(shown: Shown) -> dict[str, Array]:
    """Return which frames are near what. Shapes (n, T), bool; of strikes by hand (n, T, 2)."""
    cut = shown.left != shown.entered
    hands = [shown.strikes[shown.strikes[:, 1] == hand] for hand in (0, 1)]
    struck = shown.blows[shown.blows[:, 0] >= 0]
    return {
        "transition": around(shown, shown.owners[cut], shown.times[cut]),
        "left strike": around(shown, hands[0][:, 0], hands[0][:, 2]),
        "right strike": around(shown, hands[1][:, 0], hands[1][:, 2]),
        "blow": around(shown, struck[:, 0], struck[:, 1]),
    }


def margins(shown: Shown) -> Array:
    """Return which frames are a second or more from the ends of the run. Shape (T,), bool."""
    inner = np.zeros(shown.positions.shape[1], bool)
    inner[round(shown.rate) : -round(shown.rate)] = True
    return inner


def excesses(
    shown: Shown, groups: Mapping[str, Array], arms: Mapping[str, Mapping[str, Array]]
) -> dict[str, dict[str, dict[str, dict[str, float]]]]:
    """Return how often accelerations exceed the limit of the capture [per mille].

    Args:
        shown: The motion.
        groups: The frames of each group. Shapes (n, T), bool.
        arms: Of some groups, frames that count for the points of the ``left`` and the ``right`` arm instead.

    Returns:
        Of each group and part of the body ``acceleration``, ``rotation`` and ``joint``, each ``shown`` and
        ``captured``.
    """
    inner = margins(shown)
    result: dict[str, Any] = {group: {part: {} for part in PARTS} for group in groups}
    captured = dict(zip(("positions", "rotations", "local"), shown.captured[:3], strict=True))
    for kind, name, measure in (
        ("acceleration", "positions", accelerations),
        ("rotation", "rotations", angular_accelerations),
        ("joint", "local", angular_accelerations),
    ):
        source = by_clip(shown, measure, captured[name], shown.rate)
        limits = np.percentile(source, SHARE, axis=0)
        over = measure(getattr(shown, name), shown.rate) > limits
        behind = (source > limits)[shown.frames]
        for group, mask in groups.items():
            for part in PARTS:
                cells = []
                for joint in shown.part(part):
                    if joint >= over.shape[-1]:
                        continue
                    side = shown.names[joint].split("_")[0]
                    chosen = (arms.get(group, {}).get(side, mask) if part == "arms" else mask) & inner
                    if chosen.any():
                        cells.append((over[..., joint][chosen].mean(), behind[..., joint][chosen].mean()))
                own, theirs = 1000.0 * np.mean(cells, axis=0) if cells else (np.nan, np.nan)
                result[group][part][kind] = {"shown": float(own), "captured": float(theirs)}
    return result


def measure_smoothness(shown: Shown) -> dict[str, Any]:
    """Return how often shown motion exceeds the limits of its capture [per mille], and its jumps and drops.

    Returns:
        ``near_transitions``, ``near_strikes`` and ``elsewhere``: of each part of the body ``acceleration``,
        ``rotation`` (in the world) and ``joint`` (in its parent). ``shown`` is the share of frames near transitions
        (and not near strikes and blows), near strikes that land, and near none of them, in which the acceleration
        exceeds the 99.9th percentile of the capture's, in the mean of the part's points; ``captured`` that of the
        capture behind these frames. Near strikes only the arm that strikes counts as ``arms``. Then
        ``jumps_per_minute`` and ``pelvis_drops_per_minute`` of an avatar, ``shown`` and ``captured`` (all of the
        capture).
    """
    where = near(shown)
    strike = where["left strike"] | where["right strike"]
    groups = {
        "near_transitions": where["transition"] & ~strike & ~where["blow"],
        "near_strikes": strike,
        "elsewhere": ~where["transition"] & ~strike & ~where["blow"],
    }
    inner = margins(shown)
    arms = {"near_strikes": {side: where[f"{side} strike"] for side in ("left", "right")}}
    result: dict[str, Any] = excesses(shown, groups, arms)
    minutes = inner.sum() * len(shown.positions) / shown.rate / 60.0
    minutes_captured = len(shown.clips) / shown.rate / 60.0
    jumped = by_clip(shown, jumps, shown.captured[2])
    result["jumps_per_minute"] = {
        "shown": float(jumps(shown.local)[:, inner].sum() / minutes),
        "captured": float(jumped.sum() / minutes_captured),
    }
    pelvis = shown.names.index("pelvis")
    dropped = by_clip(shown, drops, shown.captured[0][:, pelvis, 1])
    result["pelvis_drops_per_minute"] = {
        "shown": float(drops(shown.positions[..., pelvis, 1])[:, inner].sum() / minutes),
        "captured": float(dropped.sum() / minutes_captured),
    }
    return result
