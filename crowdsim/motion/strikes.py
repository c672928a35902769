"""Strikes found in unlabelled motion: a fist's speed peak, then its furthest reach (paper section 6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import ground
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.tracks import Tracks, speeds

Array = NDArray[Any]

MINIMUM_SPEED = 2.3
"""Lowest speed of a striking fist relative to the pelvis, for a body of ``HEIGHT`` [m/s]."""
MINIMUM_GAIN = 0.25
"""How much further out than before the swing a fist must reach, for a body of ``HEIGHT`` [m]."""
_BEFORE, _AFTER, _APART = 0.4, 0.3, 0.2
"""Time searched before a speed peak for where the swing began and after it for the reach; least time between strikes
of one hand [s]."""
_OVER = 0.06
"""How long after its furthest reach a hook's fist may still be at its fastest [s]."""
_CROSSING = 0.8
"""Share of its peak speed that such a fist has at the furthest reach: it crosses there, and does not turn back."""
_ARRIVED = 0.05
"""Share of its peak speed below which a fist that still creeps outwards has arrived: held punches creep on."""


def describe_strikes_needed(height: float) -> str:
    """Return in words what makes a movement of a fist a strike, for a body of a standing height [m]."""
    size = height / HEIGHT
    return (
        f"a strike is a fist that moves at {MINIMUM_SPEED * size:.1f} m/s or more relative to the pelvis "
        f"and then reaches {MINIMUM_GAIN * size:.2f} m or more further out"
    )


@dataclass(frozen=True)
class Strikes:
    """Strikes of one clip, ordered by frame.

    Attributes:
        frames: Frame at which each strike reaches furthest. Shape (S,), int32.
        hands: 0 left, 1 right. Shape (S,), uint8.
        peaks: Frame of the fist's highest speed before. Shape (S,), int32.
        speeds: That speed, relative to the pelvis [m/s]. Shape (S,), float32.
        places: Place of the fist at ``frames`` in that frame's ground frame [m]. Shape (S, 3), float32.
        highest_speed: Highest fist speed of the clip, strike or not [m/s].
    """

    frames: Array
    hands: Array
    peaks: Array
    speeds: Array
    places: Array
    highest_speed: float


def find_strikes(tracks: Tracks, height: float, fps: float) -> Strikes:
    """Find the strikes of both hands.

    A fist's reach is its distance from the middle between the shoulders, which grows in straights, hooks and uppercuts
    alike. A strike is a peak of the fist's speed relative to the pelvis, after which the reach comes to a local maximum
    that lies well beyond where the swing began; a fist on its way back is fast too, but its reach only falls.

    Args:
        tracks: Paths of the body's points.
        height: Standing height of the body [m]; speeds and lengths scale with it.
        fps: Frames a second, 60 or more for true speeds.
    """
    from scipy.ndimage import gaussian_filter1d
    from scipy.signal import find_peaks

    size = height / HEIGHT
    centre = tracks.shoulders.mean(axis=1)
    found: list[tuple[int, int, int, float]] = []
    highest = 0.0
    for hand in range(2):
        speed = gaussian_filter1d(speeds(tracks.fists[:, hand] - tracks.pelvises, fps), 0.01 * fps)
        reach = gaussian_filter1d(np.linalg.norm(tracks.fists[:, hand] - centre, axis=1), 0.01 * fps)
        highest = max(highest, float(speed.max(initial=0.0)))
        peaks, _ = find_peaks(speed, height=MINIMUM_SPEED * size)
        swings = [swing for peak in peaks if (swing := _swing(int(peak), speed, reach, size, fps)) is not None]
        found.extend((frame, hand, peak, float(speed[peak])) for frame, peak in _apart(swings, speed, fps))
    found.sort()
    frames = np.array([strike[0] for strike in found], np.int32)
    hands = np.array([strike[1] for strike in found], np.uint8)
    places = ground.to_local(tracks.ground[frames], tracks.fists[frames, hands]) if found else np.zeros((0, 3))
    return Strikes(
        frames=frames,
        hands=hands,
        peaks=np.array([strike[2] for strike in found], np.int32),
        speeds=np.array([strike[3] for strike in found], np.float32),
        places=places.astype(np.float32),
        highest_speed=highest,
    )


def _swing(peak: int, speed: Array, reach: Array, size: float, fps: float) -> tuple[int, int] | None:
    """Frame of the furthest reach after a speed peak, with the peak; None where the peak is no strike's."""
    stop = min(len(reach) - 1, peak + round(_AFTER * fps))
    rates = np.diff(reach[peak : stop + 1]) * fps
    if len(rates) == 0:
        return None
    if rates[0] > 0.0:
        arrived = np.flatnonzero(rates < _ARRIVED * speed[peak])
        if len(arrived) == 0:
            return None
        frame = peak + int(arrived[0])
        frame += int(np.argmax(reach[frame : frame + max(2, round(0.05 * fps))]))
    else:
        before = max(0, peak - round(_OVER * fps))
        frame = before + int(np.argmax(reach[before : peak + 1]))
        if frame == before or speed[frame] < _CROSSING * speed[peak]:
            return None
    began = max(0, peak - round(_BEFORE * fps))
    if reach[frame] - reach[began : peak + 1].min() < MINIMUM_GAIN * size:
        return None
    return frame, peak


def _apart(swings: list[tuple[int, int]], speed: Array, fps: float) -> list[tuple[int, int]]:
    """Leave the fastest of swings that follow one another too closely to be two."""
    kept: list[tuple[int, int]] = []
    for frame, peak in swings:
        if kept and frame - kept[-1][0] < _APART * fps:
            if speed[peak] > speed[kept[-1][1]]:
                kept[-1] = (frame, peak)
        else:
            kept.append((frame, peak))
    return kept
