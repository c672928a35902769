"""From the poses of falls to tracks of the body's parts over time, and how these replace what the guard does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from crowdsim.core.types import Array
from crowdsim.motion import quaternion as quat
from crowdsim.performer.curves import noise, pulse, window
from crowdsim.performer.score import Fall, Pose

ONSET, RETURN = 0.22, 0.48
"""Times in which a fall takes the body out of the guard, and in which it comes back [s]."""
_SMOOTH = 0.035
"""Width of the smoothing of all tracks [s]."""
_BREATH, _BREATHS = 0.016, 0.34
"""How far the spine bends as a lying body breathes [rad], and how often it does [Hz]."""
_STIR = 0.012
"""Slow stirring of a lying body [rad]."""


@dataclass(frozen=True)
class Tumble:
    """What falls make of the body over F frames; see ``score.Pose``.

    Attributes:
        weight: 1 where a fall has the body, 0 in the guard. Shape (F,).
        hips: Shape (F, 3).
        rotation: Shape (F, 4).
        spine: Shape (F, 3).
        head: Shape (F, 2).
        hands: Shape (F, 2, 3).
        props: Shape (F, 2, 3).
        propped: Shape (F, 2).
        elbows: Shape (F, 2).
        balls: Shape (F, 2, 3).
        yaws: Shape (F, 2).
        pitches: Shape (F, 2).
        splays: Shape (F, 2).
    """

    weight: Array
    hips: Array
    rotation: Array
    spine: Array
    head: Array
    hands: Array
    props: Array
    propped: Array
    elbows: Array
    balls: Array
    yaws: Array
    pitches: Array
    splays: Array


_SHAPES: dict[str, tuple[int, ...]] = {
    "hips": (3,),
    "rotation": (4,),
    "spine": (3,),
    "head": (2,),
    "hands": (2, 3),
    "props": (2, 3),
    "propped": (2,),
    "elbows": (2,),
    "balls": (2, 3),
    "yaws": (2,),
    "pitches": (2,),
    "splays": (2,),
}


def trace_falls(falls: Sequence[Fall], times: Array, rng: np.random.Generator) -> Tumble:
    """Carry out falls, one after another, at the given times [s], evenly spaced. Shape (F,)."""
    weight = np.zeros(len(times))
    tracks = {name: np.zeros((len(times), *shape)) for name, shape in _SHAPES.items()}
    tracks["rotation"][:, 0] = 1.0
    for fall in falls:
        part = window(times, fall.start, fall.end)
        weight[part] = pulse(times[part], fall.start, fall.start + ONSET, fall.end - RETURN, fall.end)
        for name, track in _trace(fall.poses, times[part]).items():
            tracks[name][part] = track
        lying = pulse(times, fall.down - 0.3, fall.down + 0.4, fall.rise - 0.1, fall.rise + 0.4)
        breath = np.sin(2.0 * np.pi * _BREATHS * (times - fall.down)) * _BREATH
        tracks["spine"][:, 1] -= lying * breath
        tracks["spine"][:, 2] += lying * _STIR * noise(times, rng, 0.2, 0.8)
        tracks["head"] += (lying * _STIR * noise(times, rng, 0.2, 0.9))[:, None]
    return Tumble(weight=weight, **tracks)


def _trace(poses: Sequence[Pose], times: Array) -> dict[str, Array]:
    """Return tracks through poses that neither overshoot nor jerk."""
    at = np.array([pose.time for pose in poses])
    spacing = times[1] - times[0]
    found = {}
    for field in fields(Pose):
        if field.name == "time":
            continue
        values = np.array([getattr(pose, field.name) for pose in poses], dtype=float)
        if field.name == "rotation":
            values = quat.continuous(values)
        track = PchipInterpolator(at, values, axis=0)(np.clip(times, at[0], at[-1]))
        found[field.name] = gaussian_filter1d(track, _SMOOTH / spacing, axis=0, mode="nearest")
    found["rotation"] = quat.normalise(found["rotation"])
    return found


def mixed(guard: Array, fallen: Array, weight: Array) -> Array:
    """Return tracks (F, ...) of the guard where ``weight`` (F,) is 0 and of a fall where it is 1."""
    share = np.reshape(weight, (-1,) + (1,) * (guard.ndim - 1))
    return np.asarray(guard + share * (fallen - guard))
