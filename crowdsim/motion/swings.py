"""Swings of a limb: peaks of its speed, and where each one reaches furthest."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from crowdsim.core.types import Array

_BEFORE, _AFTER, _APART = 0.4, 0.3, 0.2
"""Time searched before a speed peak for where the swing began and after it for the reach; least time between strikes
of one limb [s]."""
_OVER = 0.06
"""How long after its furthest reach a hook's fist may still be at its fastest [s]."""
_CROSSING = 0.8
"""Share of its peak speed that such a fist has at the furthest reach: it crosses there, and does not turn back."""
_DRAWN = 0.25
"""How long after a fist was drawn back, behind the body, it may be at its fastest as it strikes [s]."""
_ARRIVED = 0.05
"""Share of its peak speed below which a fist that still creeps outwards has arrived: held punches creep on."""


class Rejection(IntEnum):
    """Why a peak of a limb's speed is no strike."""

    NO_REACH = 0
    """The limb returns, or crosses the body: its reach has no maximum."""
    NOT_ARRIVED = 1
    """The limb still moves outwards at the end of the time in which a strike arrives, or of the clip."""
    SHORT = 2
    """The limb gets hardly further out than it was before the swing."""
    REPEATED = 3
    """A faster strike of the same limb is too near in time to be another one."""
    BENT = 4
    """The leg is raised, but does not stretch: a knee that is lifted is no kick."""
    FAR = 5
    """The fist begins far from the body: an arm that swings, and does not strike."""
    AWAY = 6
    """The fist ends where no opponent could stand: aside, behind the body, below the hips or over the head."""


@dataclass(frozen=True)
class Swing:
    """What a limb of a clip does, as strikes are found in it; F frames.

    Attributes:
        speed: Its speed relative to the pelvis [m/s]. Shape (F,).
        reach: How far out it is [m]. Shape (F,).
        least_speed: Least speed of a strike [m/s].
        least_gain: How much further out than before the swing it must reach [m].
        raised: Where a strike may reach furthest: movements that end elsewhere are none, however fast. Shape (F,).
        stretched: Where the limb is stretched enough for a strike. Shape (F,).
        opposite: Where a strike that reaches furthest in a frame goes to where an opponent could stand. Shape (F,).
        near: How far out it may be where the swing begins [m].
        ahead: How far ahead of the body it is, where fists are drawn back before they strike [m]. Shape (F,).
    """

    speed: Array
    reach: Array
    least_speed: float
    least_gain: float
    raised: Array
    stretched: Array
    opposite: Array
    near: float
    ahead: Array


def judge_swings(swing: Swing, fps: float) -> tuple[list[tuple[int, int]], list[tuple[int, Rejection]]]:
    """Return the strikes of a limb, and the swings that are none.

    A strike is a peak of speed, after which the reach comes to a local maximum that lies well beyond where the swing
    began; a returning limb is fast too, but its reach only falls. So does that of a fist that was drawn back behind
    the body: it strikes where it is furthest ahead.

    Args:
        swing: What the limb does.
        fps: Frames a second.

    Returns:
        For each strike the frame of its furthest reach and that of its peak; for each other swing that is fast enough
        the frame of its peak, and why it is none.
    """
    found: list[tuple[int, int]] = []
    rejected: list[tuple[int, Rejection]] = []
    for peak in find_peaks(swing.speed, swing.least_speed).tolist():
        verdict = _judge(peak, swing, fps)
        if isinstance(verdict, Rejection):
            rejected.append((peak, verdict))
        elif verdict is not None:
            found.append((verdict, peak))
    for back in [peak for peak, reason in rejected if reason is Rejection.AWAY]:
        peak = next((at for at, why in rejected if why is Rejection.NO_REACH and 0 < at - back <= _DRAWN * fps), None)
        frame = None if peak is None else _from_behind(back, peak, swing, fps)
        if peak is not None and frame is not None:
            found.append((frame, peak))
            rejected = [(at, why) for at, why in rejected if at not in (back, peak)]
    found.sort()
    kept = _apart(found, swing.speed, fps)
    return kept, rejected + [(peak, Rejection.REPEATED) for frame, peak in found if (frame, peak) not in kept]


def find_peaks(values: Array, least: float) -> Array:
    """Return where values are greatest in their neighbourhood, and no less than ``least``; the middle of level peaks.

    It does what ``scipy.signal.find_peaks`` does, whose import takes a second.
    """
    steps = np.diff(values)
    moves = np.flatnonzero(steps)
    rises = steps[moves] > 0.0
    tops = np.flatnonzero(rises[:-1] & ~rises[1:])
    peaks = (moves[tops] + 1 + moves[tops + 1]) // 2
    return np.asarray(peaks[values[peaks] >= least])


def _judge(peak: int, swing: Swing, fps: float) -> int | Rejection | None:
    """Frame of the furthest reach after a speed peak, or why the peak is no strike's; None for what is no swing."""
    frame = _furthest(peak, swing, fps)
    if isinstance(frame, Rejection):
        return frame if swing.raised[peak] else None
    if not swing.raised[frame]:
        return None
    began = max(0, peak - round(_BEFORE * fps))
    start = swing.reach[began : peak + 1].min()
    if swing.reach[frame] - start < swing.least_gain:
        return Rejection.SHORT
    if start > swing.near:
        return Rejection.FAR
    if not swing.stretched[frame]:
        return Rejection.BENT
    return frame if swing.opposite[frame] else Rejection.AWAY


def _from_behind(back: int, peak: int, swing: Swing, fps: float) -> int | None:
    """Frame where a fist that was drawn back is furthest ahead after a speed peak; None where it does not strike."""
    stop = min(len(swing.reach) - 1, peak + round(_AFTER * fps))
    frame = peak + int(np.argmax(swing.ahead[peak : stop + 1]))
    gain = swing.ahead[frame] - swing.ahead[back:peak].min()
    strikes = peak < frame < stop and swing.speed[peak] >= swing.speed[back] and gain >= swing.least_gain
    return frame if strikes and swing.opposite[frame] else None


def _furthest(peak: int, swing: Swing, fps: float) -> int | Rejection:
    """Frame of the furthest reach after a speed peak, or why there is none."""
    speed, reach = swing.speed, swing.reach
    stop = min(len(reach) - 1, peak + round(_AFTER * fps))
    rates = np.diff(reach[peak : stop + 1]) * fps
    if len(rates) == 0:
        return Rejection.NOT_ARRIVED
    if rates[0] > 0.0:
        arrived = np.flatnonzero(rates < _ARRIVED * speed[peak])
        if len(arrived) == 0:
            return Rejection.NOT_ARRIVED
        frame = peak + int(arrived[0])
        return frame + int(np.argmax(reach[frame : frame + max(2, round(0.05 * fps))]))
    before = max(0, peak - round(_OVER * fps))
    frame = before + int(np.argmax(reach[before : peak + 1]))
    if frame == before or speed[frame] < _CROSSING * speed[peak]:
        return Rejection.NO_REACH
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
