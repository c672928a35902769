"""Strikes found in unlabelled motion: a fist's speed peak, then its furthest reach (paper section 6)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.tracks import Tracks, speeds

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


class Rejection(IntEnum):
    """Why a peak of a fist's speed is no strike."""

    NO_REACH = 0
    """The fist returns, or crosses the body: its reach has no maximum."""
    NOT_ARRIVED = 1
    """The fist still moves outwards at the end of the time in which a strike arrives, or of the clip."""
    SHORT = 2
    """The fist gets hardly further out than it was before the swing."""
    REPEATED = 3
    """A faster strike of the same hand is too near in time to be another one."""


REASONS = {
    Rejection.NO_REACH: "its reach comes to no maximum",
    Rejection.NOT_ARRIVED: f"it does not arrive within {_AFTER:g} s",
    Rejection.SHORT: f"it gets less than {MINIMUM_GAIN:g} m further out",
    Rejection.REPEATED: f"a faster one is less than {_APART:g} s away",
}
"""What each rejection means; lengths are those of a body of ``HEIGHT``."""


@dataclass(frozen=True)
class Rejected:
    """Peaks of fist speed that are high enough for a strike and are none, ordered by frame.

    Attributes:
        peaks: Frame of each peak. Shape (R,), int32.
        hands: 0 left, 1 right. Shape (R,), uint8.
        speeds: Speed there, relative to the pelvis [m/s]. Shape (R,), float32.
        reasons: Why each is none, values of ``Rejection``. Shape (R,), uint8.
    """

    peaks: Array
    hands: Array
    speeds: Array
    reasons: Array


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
        positions: Position of the fist at ``frames`` in that frame's ground frame [m]. Shape (S, 3), float32.
        highest_speed: Highest fist speed of the clip, strike or not [m/s].
        rejected: Fast swings that are no strikes.
    """

    frames: Array
    hands: Array
    peaks: Array
    speeds: Array
    positions: Array
    highest_speed: float
    rejected: Rejected


def fist_speed(tracks: Tracks, hand: int, fps: float) -> Array:
    """Return the speed of a fist relative to the pelvis, smoothed as ``find_strikes`` sees it [m/s]. Shape (F,)."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(speeds(tracks.fists[:, hand] - tracks.pelvises, fps), 0.01 * fps))


def _find_peaks(values: Array, least: float) -> Array:
    """Return where values are greatest in their neighbourhood, and no less than ``least``; the middle of level peaks.

    It does what ``scipy.signal.find_peaks`` does, whose import takes a second.
    """
    steps = np.diff(values)
    moves = np.flatnonzero(steps)
    rises = steps[moves] > 0.0
    tops = np.flatnonzero(rises[:-1] & ~rises[1:])
    peaks = (moves[tops] + 1 + moves[tops + 1]) // 2
    return np.asarray(peaks[values[peaks] >= least])


def find_strikes(tracks: Tracks, height: float, fps: float) -> Strikes:
    """Find the strikes of both hands.

    A fist's reach is its distance from the middle between the shoulders, which grows in straights, hooks and uppercuts
    alike. A strike is a peak of the fist's speed relative to the pelvis, after which the reach comes to a local maximum
    that lies well beyond where the swing began; a returning fist is fast too, but its reach only falls.

    Args:
        tracks: Paths of the body's points.
        height: Standing height of the body [m]; speeds and lengths scale with it.
        fps: Frames a second, 60 or more for true speeds.
    """
    from scipy.ndimage import gaussian_filter1d

    size = height / HEIGHT
    centre = tracks.shoulders.mean(axis=1)
    found: list[tuple[int, int, int, float]] = []
    rejected: list[tuple[int, int, float, Rejection]] = []
    highest = 0.0
    for hand in range(2):
        speed = fist_speed(tracks, hand, fps)
        reach = gaussian_filter1d(np.linalg.norm(tracks.fists[:, hand] - centre, axis=1), 0.01 * fps)
        highest = max(highest, float(speed.max(initial=0.0)))
        peaks = _find_peaks(speed, MINIMUM_SPEED * size)
        judged = {int(peak): _judge(int(peak), speed, reach, size, fps) for peak in peaks}
        kept = _apart([(frame, peak) for peak, frame in judged.items() if not isinstance(frame, Rejection)], speed, fps)
        found.extend((frame, hand, peak, float(speed[peak])) for frame, peak in kept)
        for peak in judged.keys() - {peak for _, peak in kept}:
            verdict = judged[peak]
            reason = verdict if isinstance(verdict, Rejection) else Rejection.REPEATED
            rejected.append((peak, hand, float(speed[peak]), reason))
    found.sort()
    frames = np.array([strike[0] for strike in found], np.int32)
    hands = np.array([strike[1] for strike in found], np.uint8)
    positions = ground.to_local(tracks.ground[frames], tracks.fists[frames, hands]) if found else np.zeros((0, 3))
    return Strikes(
        frames=frames,
        hands=hands,
        peaks=np.array([strike[2] for strike in found], np.int32),
        speeds=np.array([strike[3] for strike in found], np.float32),
        positions=positions.astype(np.float32),
        highest_speed=highest,
        rejected=_rejected(sorted(rejected)),
    )


def _rejected(swings: list[tuple[int, int, float, Rejection]]) -> Rejected:
    return Rejected(
        peaks=np.array([swing[0] for swing in swings], np.int32),
        hands=np.array([swing[1] for swing in swings], np.uint8),
        speeds=np.array([swing[2] for swing in swings], np.float32),
        reasons=np.array([swing[3] for swing in swings], np.uint8),
    )


def _judge(peak: int, speed: Array, reach: Array, size: float, fps: float) -> int | Rejection:
    """Frame of the furthest reach after a speed peak, or why the peak is no strike's."""
    stop = min(len(reach) - 1, peak + round(_AFTER * fps))
    rates = np.diff(reach[peak : stop + 1]) * fps
    if len(rates) == 0:
        return Rejection.NOT_ARRIVED
    if rates[0] > 0.0:
        arrived = np.flatnonzero(rates < _ARRIVED * speed[peak])
        if len(arrived) == 0:
            return Rejection.NOT_ARRIVED
        frame = peak + int(arrived[0])
        frame += int(np.argmax(reach[frame : frame + max(2, round(0.05 * fps))]))
    else:
        before = max(0, peak - round(_OVER * fps))
        frame = before + int(np.argmax(reach[before : peak + 1]))
        if frame == before or speed[frame] < _CROSSING * speed[peak]:
            return Rejection.NO_REACH
    began = max(0, peak - round(_BEFORE * fps))
    if reach[frame] - reach[began : peak + 1].min() < MINIMUM_GAIN * size:
        return Rejection.SHORT
    return frame


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
