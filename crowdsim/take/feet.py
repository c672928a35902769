"""Planted feet stay planted: where the ball of each foot belongs, and how firmly, at any time.

Captured motion keeps a planted foot in its place; a cut moves it by delta, the gap between where the old motion has it
and where the new one does. The place where a foot belongs is the motion's own, less blends, plus what cuts have moved:
``home(t) = motion(t) + sum over cuts of delta h(t)``, where h jumps by one at the cut, so that home does not. h is
constant while the foot stays planted and goes to nothing in the swing before or after, whichever is nearer. A foot that
stays planted longer than ``HOLD`` on both sides slides by delta over that time instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import ground
from crowdsim.take.window import Cuts, Places, Window

Array = NDArray[Any]

HOLD = 0.6
"""How long after or before a cut a foot is held at the most [s]."""
SWING = 0.16
"""How long it takes to let go of a foot, or to guide it to where it lands [s]."""
_TICK = 1.0 / 60.0
_TICKS = round((HOLD + SWING) / _TICK)
_SWING_TICKS = round(SWING / _TICK)


@dataclass(frozen=True)
class FootCuts:
    """What cuts do to feet, in the order of ``Cuts``.

    Attributes:
        gaps: How far the ball of each foot is moved, old motion less new [m]. Shape (C, 2, 3).
        after: How much of it is carried on after the cut; the rest is taken before it. Shape (C, 2).
        holds: How long it is held before and after the cut [s]. Shape (C, 2, 2).
        fades: How long it takes to come and go [s]. Shape (C, 2, 2).
    """

    gaps: Array
    after: Array
    holds: Array
    fades: Array


def measure_feet(window: Window, cuts: Cuts) -> FootCuts:
    """Find how far cuts move feet, and when those can be let go of."""
    motion, count = window.motion, len(cuts.times)
    if count == 0:
        none = np.zeros((0, 2, 2))
        return FootCuts(np.zeros((0, 2, 3)), np.zeros((0, 2)), none, none)
    scales = window.scales[cuts.owners]
    local = (motion.balls[cuts.before].astype(float) - motion.balls[cuts.after]) * scales[:, None, None]
    here = window.place(cuts.times, cuts.owners).ground
    turned = here.copy()
    turned[:, :2] = 0.0
    gaps = ground.to_world(turned[:, None], local)
    ticks = np.arange(-_TICKS, _TICKS + 1) * _TICK
    frames = window.frames(cuts.times[:, None] + ticks, cuts.owners[:, None])
    planted = motion.contacts[np.maximum(frames, 0.0).astype(np.int64)] & (frames >= 0)[..., None]
    at_cut = motion.contacts[cuts.before] | motion.contacts[cuts.after]
    # Time to the end of contact after the cut and to its beginning before it; swing feet have none to wait for.
    later = _first_false(planted[:, _TICKS + 1 :])
    earlier = _first_false(planted[:, :_TICKS][:, ::-1])
    waits = np.stack([earlier, later], axis=-1) * _TICK
    next_plant = _first_false(~planted[:, _TICKS + 1 :])
    last_plant = _first_false(~planted[:, :_TICKS][:, ::-1])
    free = np.minimum(np.stack([last_plant, next_plant], axis=-1) * _TICK, SWING)
    stuck = waits >= HOLD
    holds = np.where(at_cut[..., None], np.where(stuck, 0.0, waits), 0.0)
    fades = np.where(at_cut[..., None], np.where(stuck, HOLD + SWING, SWING), np.maximum(free, _TICK))
    nearer_after = np.where(waits[..., 1] <= waits[..., 0], 1.0, 0.0)
    planted_after = np.where(stuck.all(axis=-1), 0.5, nearer_after)
    swing_after = fades[..., 1] / (fades[..., 0] + fades[..., 1])
    return FootCuts(gaps, np.where(at_cut, planted_after, swing_after), holds, fades)


def _first_false(flags: Array) -> Array:
    """Number of leading trues along axis 1. Shape (C, n, 2) to (C, 2)."""
    return np.where(flags.all(axis=1), flags.shape[1], np.argmin(flags, axis=1))


def find_homes(
    window: Window, cuts: Cuts, feet: FootCuts, places: Places, times: Array, columns: Array
) -> tuple[Array, Array]:
    """Return where the ball of each foot belongs and how firmly, for avatars at times.

    Args:
        window: The stretch of the take.
        cuts: Its cuts.
        feet: What they do to feet.
        places: Where the avatars are, shape (T, n).
        times: Shape (T, 1) [s].
        columns: Shape (n,).

    Returns:
        Places in the world [m], shape (T, n, 2, 3), and firmness from 0 (swings freely) to 1 (planted), (T, n, 2).
    """
    motion = window.motion
    frames = np.maximum(places.frames, 0)
    part = places.fractions[..., None, None]
    beyond = np.minimum(frames + 1, len(motion.balls) - 1)
    balls = motion.balls[frames] * (1.0 - part) + motion.balls[beyond] * part
    homes = ground.to_world(places.ground[..., None, :], balls * window.scales[columns][:, None, None])
    for shift, share in _shifts(cuts, feet, times[:, 0], columns):
        homes[share] += shift
    ticks = np.arange(-_SWING_TICKS, _SWING_TICKS + 1) * _TICK
    around = window.frames(times[..., None] + ticks, columns[None, :, None])
    planted = motion.contacts[np.maximum(around, 0.0).astype(np.int64)] & (around >= 0)[..., None]
    apart = np.abs(ticks)[None, None, :, None]
    nearest = np.where(planted, apart, SWING).min(axis=2)
    return homes, _ease(1.0 - nearest / SWING)


def _shifts(cuts: Cuts, feet: FootCuts, times: Array, columns: Array) -> list[tuple[Array, Any]]:
    """What each cut adds, as (values, index) pairs into homes (T, n, 2, 3)."""
    told: list[tuple[Array, Any]] = []
    reach = HOLD + SWING
    for place, column in enumerate(columns):
        low, high = int(cuts.offsets[column]), int(cuts.offsets[column + 1])
        for cut in range(low, high):
            first, stop = np.searchsorted(times, (cuts.times[cut] - reach, cuts.times[cut] + reach))
            if first >= stop:
                continue
            apart = times[first:stop, None] - cuts.times[cut]
            later = apart >= 0.0
            hold = np.where(later, feet.holds[cut, :, 1], feet.holds[cut, :, 0])
            fade = np.where(later, feet.fades[cut, :, 1], feet.fades[cut, :, 0])
            size = np.where(later, feet.after[cut], feet.after[cut] - 1.0)
            height = size * _ease(1.0 - (np.abs(apart) - hold) / fade)
            told.append((height[..., None] * feet.gaps[cut], (slice(first, stop), place)))
    return told


def _ease(share: Array) -> Array:
    """A step from 0 to 1 with no speed and no acceleration at its ends."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s * s * s * (10.0 - 15.0 * s + 6.0 * s * s))
