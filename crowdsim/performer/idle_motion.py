"""What never stops in the embedded boxer: bounce, breath, sway, wandering of guard and gaze, and tremor."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.performer.curves import noise, soft_floor
from crowdsim.performer.score import Channel as C
from crowdsim.performer.score import Style

# fmt: off
_WANDERING = (
    (C.PELVIS_TURN, 0.10, 0.4, 1.5), (C.PELVIS_TILT, 0.035, 0.3, 1.2), (C.PELVIS_BEND, 0.035, 0.4, 1.4),
    (C.TWIST, 0.08, 0.4, 1.5), (C.FLEX, 0.05, 0.25, 1.2), (C.BEND, 0.05, 0.3, 1.3), (C.HEAD_TURN, 0.07, 0.2, 1.0),
    (C.HEAD_NOD, 0.04, 0.2, 0.8), (C.HEAD_BEND, 0.05, 0.15, 0.7), (C.LEAD_FORTH, 0.05, 0.3, 1.2),
    (C.REAR_FORTH, 0.05, 0.3, 1.2), (C.LEAD_RAISE, 0.03, 0.2, 0.9), (C.REAR_RAISE, 0.03, 0.2, 0.9),
    (C.LEAD_ELBOW, 0.09, 0.2, 1.0), (C.REAR_ELBOW, 0.08, 0.2, 1.0), (C.LEAD_ROLL, 0.10, 0.2, 1.0),
    (C.REAR_ROLL, 0.10, 0.2, 1.0), (C.LEAD_HAND_X, 0.018, 0.4, 1.8), (C.LEAD_HAND_Y, 0.022, 0.4, 1.8),
    (C.LEAD_HAND_Z, 0.026, 0.4, 1.8), (C.REAR_HAND_X, 0.012, 0.4, 1.6), (C.REAR_HAND_Y, 0.016, 0.4, 1.6),
    (C.REAR_HAND_Z, 0.013, 0.4, 1.6),
)
"""Slow noise: channel, size, and the frequencies between which it lies [Hz]."""
_TREMOR: tuple[tuple[float, tuple[C, ...]], ...] = (
    (0.0018, (C.SHIFT_X,)), (0.0018, (C.SHIFT_Z,)), (0.0020, (C.HEIGHT,)), (0.014, (C.PELVIS_TURN, C.TWIST)),
    (0.012, (C.PELVIS_TILT, C.FLEX)), (0.011, (C.PELVIS_BEND, C.BEND)), (0.010, (C.TWIST, C.HEAD_TURN)),
    (0.006, (C.FLEX, C.HEAD_NOD)), (0.006, (C.BEND, C.HEAD_BEND)), (0.008, (C.HEAD_TURN,)), (0.009, (C.HEAD_NOD,)),
    (0.008, (C.HEAD_BEND,)), (0.012, (C.LEAD_YAW,)), (0.012, (C.REAR_YAW,)), (0.026, (C.LEAD_HEEL,)),
    (0.030, (C.REAR_HEEL,)), (0.008, (C.LEAD_FORTH,)), (0.008, (C.REAR_FORTH,)), (0.008, (C.LEAD_RAISE,)),
    (0.008, (C.REAR_RAISE,)), (0.012, (C.LEAD_ELBOW,)), (0.012, (C.REAR_ELBOW,)), (0.012, (C.LEAD_ROLL,)),
    (0.012, (C.REAR_ROLL,)), (0.0018, (C.LEAD_HAND_X,)), (0.0020, (C.LEAD_HAND_Y,)), (0.0018, (C.LEAD_HAND_Z,)),
    (0.0015, (C.REAR_HAND_X,)), (0.0018, (C.REAR_HAND_Y,)), (0.0015, (C.REAR_HAND_Z,)),
)
"""Size of a quick noise, the channel that it moves, and one that compensates for it, so that the head stays quieter
than what carries it. People never hold still: joints of captured boxers turn by some tenths of a radian per second at 3
to 15 Hz in their quietest moments."""
# fmt: on
_TREMBLING, _TREMOR_FALL = (2.5, 18.0), 1.4
"""Frequencies of the tremor [Hz], and how steeply it falls with them."""


def add_idle_motion(
    channels: Array, style: Style, times: Array, loads: Array, riding: Array, rng: np.random.Generator
) -> None:
    """Add what never stops to the channels (F, channels), in place.

    ``loads`` (F,) is the share of the weight that steps put on the lead foot. ``riding`` (F,) is 1 where a gait carries
    the body, and 0 where the guard bounces and rocks.
    """
    breath = np.sin(2.0 * np.pi * style.breath * times + 0.6 * noise(times, rng, 0.05, 0.15))
    _add_bounce(channels, style, times, riding, rng)
    channels[:, C.HEIGHT] += 0.003 * breath + 0.006 * noise(times, rng, 0.1, 0.5)
    channels[:, C.FLEX] -= 0.012 * breath
    for channel in (C.LEAD_RAISE, C.REAR_RAISE):
        channels[:, channel] += 0.02 * breath
    _add_sway(channels, style, times, loads, riding, rng)
    for channel, size, low, high in _WANDERING:
        channels[:, channel] += size * noise(times, rng, low, high)
    vigour = soft_floor(1.0 + 0.3 * noise(times, rng, 0.2, 1.0), 0.4, 0.1)
    for size, (moved, *giving) in _TREMOR:
        tremor = size * vigour * noise(times, rng, *_TREMBLING, waves=12, fall=_TREMOR_FALL)
        channels[:, moved] += tremor
        for channel in giving:
            channels[:, channel] -= 0.85 * tremor


def _add_bounce(channels: Array, style: Style, times: Array, riding: Array, rng: np.random.Generator) -> None:
    """Bounce on the balls of the feet; trunk and hands follow a little later."""
    spacing = times[1] - times[0] if len(times) > 1 else 0.0
    rate = style.bounce[1] * (1.0 + 0.06 * noise(times, rng, 0.05, 0.2))
    phase = 2.0 * np.pi * np.cumsum(rate) * spacing
    eager = soft_floor(0.55 + 0.5 * noise(times, rng, 0.06, 0.3), 0.0, 0.15) * (1.0 - riding)
    hop = eager * np.sin(phase + 0.3 * np.sin(phase))
    late, latest = eager * np.sin(phase - 0.6), eager * np.sin(phase - 1.1)
    waves = (
        (hop, {C.HEIGHT: 1.0, C.PELVIS_TILT: -0.8}),
        (hop + eager, {C.LEAD_HEEL: 1.6, C.REAR_HEEL: 2.2}),
        # The hands circle in the rhythm of the feet, the lead hand more.
        (latest, {C.LEAD_HAND_Y: -0.30, C.REAR_HAND_Y: -0.30, C.LEAD_HAND_Z: 1.1}),
        (late, {C.LEAD_HAND_Y: 0.7, C.REAR_HAND_Z: 0.5}),
        (late, {C.FLEX: -1.1, C.HEAD_NOD: 0.6, C.LEAD_RAISE: -1.2, C.REAR_RAISE: -1.2}),
    )
    for wave, sizes in waves:
        for channel, size in sizes.items():
            channels[:, channel] += size * style.bounce[0] * wave


def _add_sway(
    channels: Array, style: Style, times: Array, loads: Array, riding: Array, rng: np.random.Generator
) -> None:
    """Rock between the feet, and put the weight where steps want it."""
    rock = noise(times, rng, 0.35, 1.0)
    sway = style.sway * (1.0 - 0.8 * riding)
    along = np.subtract(*style.balls)
    along /= np.hypot(*along)
    channels[:, C.SHIFT_X] += along[0] * sway * rock + 0.4 * sway * noise(times, rng, 0.3, 0.9)
    channels[:, C.SHIFT_Z] += along[1] * sway * rock + 0.3 * sway * noise(times, rng, 0.3, 0.9)
    channels[:, C.SHIFT_X] += 0.028 * along[0] * loads
    channels[:, C.SHIFT_Z] += 0.028 * along[1] * loads
