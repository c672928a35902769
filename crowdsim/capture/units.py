"""How large a file's unit is and which axis is up in it, found from the body: its rest pose, its poses, its floor."""

from __future__ import annotations

import math

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError, nearest

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "cmu": 0.0254 / 0.45}
"""Metres in one unit; ``cmu`` is that of the CMU motion capture library's own files, 0.05644 m."""

PLAUSIBLE_HEIGHT = (1.0, 2.4)
"""Standing heights of human bodies [m]."""
_TYPICAL_HEIGHT = 1.7
_PLAINLY = 2.0
"""How much further from the typical height another unit must put a body for a unit to be plain, as a share of logs."""
_UPRIGHT = 0.75
_AXES = ("x", "y", "z", "-x", "-y", "-z")


def parse_unit(unit: str | float) -> float:
    """Return metres in a unit that is given by name or as a number.

    Raises:
        MotionError: The name is unknown or the number is not positive and finite.
    """
    if isinstance(unit, str) and unit in UNITS:
        return UNITS[unit]
    try:
        scale = float(unit)
    except ValueError:
        raise MotionError(
            f"unit {unit!r} is unknown{nearest(str(unit), UNITS)}; expected {', '.join(UNITS)} or metres as a number"
        ) from None
    if not (math.isfinite(scale) and scale > 0.0):
        raise MotionError(f"unit is {scale:g}, expected a positive number of metres")
    return scale


def find_scale(height: float) -> float | None:
    """Return metres in a file unit, from a human body's standing height in it; None when no unit fits, or two do.

    Where two units would make a human of it, the one that makes the more usual one is taken if that is plain.
    """
    if not (math.isfinite(height) and height > 0.0):
        return None
    low, high = PLAUSIBLE_HEIGHT
    fitting = sorted(
        (abs(math.log(height * scale / _TYPICAL_HEIGHT)), scale)
        for scale in UNITS.values()
        if low <= height * scale <= high
    )
    if not fitting or (len(fitting) > 1 and fitting[1][0] < _PLAINLY * fitting[0][0]):
        return None
    return fitting[0][1]


def describe_heights(height: float) -> str:
    """Return in words why no unit is known for a body of a standing height in file units."""
    low, high = PLAUSIBLE_HEIGHT
    sizes = {name: height * scale for name, scale in UNITS.items()}
    result = ", ".join(f"{size:.3g} m in {name}" for name, size in sizes.items())
    fitting = [name for name, size in sizes.items() if low <= size <= high]
    if len(fitting) > 1:
        return f"unknown scale: the body's height would be {result}; {' and '.join(fitting)} are as likely"
    return f"unknown scale: the body's height would be {result}; expected {low:g} m to {high:g} m"


def find_up_axis(rest: Array | None, poses: Array, heads: list[int], feet: list[int]) -> str | None:
    """Return the axis that is up, 'y' or '-z' say; None when neither poses nor floor show it.

    People are on their feet most of the time, so the direction from feet to head is up. Where that is unclear (someone
    lies or crawls) or contradicts the rest pose, the floor decides: the lowest point of a body stays at one height.

    Args:
        rest: The rest pose, shape (J, 3), any unit; None where it is no pose of a body.
        poses: Poses of the clip in its world. Shape (n, J, 3), same unit.
        heads: Joints at the upper end of the body; none where it is unknown what is up in it.
        feet: Joints at the lower end.
    """
    posed, clear = _way_up(poses, heads, feet)
    rested, upright = _way_up(poses[:0] if rest is None else rest[None], heads, feet)
    if clear >= _UPRIGHT and (posed == rested or upright < _UPRIGHT or len(poses) < 2):
        return posed
    candidates = [name for name, strength in ((posed, clear), (rested, upright)) if strength >= _UPRIGHT]
    if candidates == [rested] and len(poses) > 1 and _unrest(poses, posed) < 0.5 * _unrest(poses, rested):
        # A body that lies most of the time, on a floor along another axis than that of the rest pose.
        return posed
    if not candidates:
        candidates = ["y", "z"] if len(poses) > 1 else []
    if not candidates:
        return None
    restless = {name: _unrest(poses, name) for name in candidates}
    steadiest = min(candidates, key=lambda name: restless[name])
    # Capture that is clearly upright along an axis overrules a rest pose, unless the floor clearly supports the rest
    # pose.
    if clear >= _UPRIGHT and restless[steadiest] > 0.5 * restless[posed]:
        return posed
    return steadiest


def _way_up(group: Array, heads: list[int], feet: list[int]) -> tuple[str, float]:
    """The axis along which heads lie over feet, and how plainly so: 0 not at all, 1 in every pose."""
    if not heads or not feet or len(group) == 0:
        return "y", 0.0
    spans = group[:, heads].mean(axis=1) - group[:, feet].mean(axis=1)
    lengths = np.linalg.norm(spans, axis=-1, keepdims=True)
    mean = np.mean(spans / np.where(lengths > 1e-9, lengths, 1.0), axis=0)
    axis = int(np.argmax(np.abs(mean)))
    return ("" if mean[axis] > 0 else "-") + "xyz"[axis], float(np.abs(mean[axis]))


def _unrest(poses: Array, axis: str) -> float:
    """How much the lowest point along an axis wanders, against the body's size."""
    along = poses[:, :, "xyz".index(axis[-1])] * (-1.0 if axis.startswith("-") else 1.0)
    size = float(np.linalg.norm(poses.max(axis=1) - poses.min(axis=1), axis=-1).mean())
    lowest = along.min(axis=1)
    return float(np.percentile(lowest, 90) - np.percentile(lowest, 10)) / max(size, 1e-9)


def parse_up_axis(axis: str) -> str:
    """Return the axis if it is one; a ``MotionError`` otherwise."""
    if axis not in _AXES:
        raise MotionError(f"up axis {axis!r} is unknown{nearest(axis, _AXES)}; expected {', '.join(_AXES)}")
    return axis
