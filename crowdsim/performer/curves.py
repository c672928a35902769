"""Smooth curves of time that the embedded boxer is made of: minimum-jerk steps and pulses, and band-limited noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import correlate1d, minimum_filter1d

from crowdsim.core.easing import ease
from crowdsim.core.types import Array


def step(times: Array, start: float, end: float, skew: float = 1.0) -> Array:
    """Return a minimum-jerk step from 0 at ``start`` to 1 at ``end``; a skew above 1 makes it fastest late."""
    x = (times - start) / (end - start)
    return ease(x if skew == 1.0 else np.minimum(np.maximum(x, 0.0), 1.0) ** skew)


def glide(times: Array, start: float, end: float, gain: float, loss: float) -> Array:
    """Return a step from 0 at ``start`` to 1 at ``end`` [s] at an even speed, but for smooth ramps at both ends.

    ``gain`` is the share of the time in which the speed grows, and ``loss`` that in which it falls; together at most 1.
    """
    x = np.clip((times - start) / (end - start), 0.0, 1.0)
    risen, fallen = np.minimum(x / gain, 1.0), np.maximum((x - 1.0) / loss + 1.0, 0.0)
    way = gain * risen**3 * (1.0 - 0.5 * risen) + np.maximum(x - gain, 0.0) - loss * fallen**3 * (1.0 - 0.5 * fallen)
    return np.asarray(way / (1.0 - 0.5 * (gain + loss)))


def pulse(times: Array, start: float, peak: float, fall: float, end: float, skew: float = 1.0) -> Array:
    """Return a smooth pulse: up from ``start`` to ``peak``, 1 until ``fall``, down to 0 at ``end``."""
    return step(times, start, peak, skew) * (1.0 - step(times, fall, end))


def window(times: Array, start: float, end: float) -> slice:
    """Return the frames whose times lie in start..end, one more on either side. ``times`` ascend."""
    return slice(max(int(times.searchsorted(start)) - 1, 0), min(int(times.searchsorted(end)) + 1, len(times)))


def noise(times: Array, rng: np.random.Generator, low: float, high: float, waves: int = 7, fall: float = 0.5) -> Array:
    """Return smooth noise of unit variance: waves of random phase at frequencies low..high [Hz]. Shape of ``times``.

    The size of a wave is proportional to its frequency to the power of ``-fall``.
    """
    frequencies = low * (high / low) ** ((np.arange(waves) + rng.uniform(0.0, 1.0, waves)) / waves)
    phases = rng.uniform(0.0, 2.0 * np.pi, waves)
    sizes = rng.uniform(0.7, 1.3, waves) * frequencies**-fall
    sizes *= np.sqrt(2.0 / np.sum(sizes**2))
    return np.sin(2.0 * np.pi * np.multiply.outer(times, frequencies) + phases) @ sizes


def soft_cap(x: ArrayLike, cap: ArrayLike, softness: float) -> Array:
    """Return x held below ``cap``, bent smoothly over a band of about ``softness``."""
    return np.asarray(cap) - softness * np.logaddexp(0.0, (np.asarray(cap) - np.asarray(x)) / softness)


def soft_floor(x: ArrayLike, floor: ArrayLike, softness: float) -> Array:
    """Return x held above ``floor``, bent smoothly over a band of about ``softness``."""
    return np.asarray(floor) + softness * np.logaddexp(0.0, (np.asarray(x) - np.asarray(floor)) / softness)


def smooth_below(x: Array, most: int) -> Array:
    """Return a smooth curve that is nowhere above x (F,), and depends on no more than ``most`` samples on either side.

    It averages the least values around each sample, by a window that is no wider than they are looked for. Ends repeat.
    """
    half = most // 2
    least = minimum_filter1d(x, 2 * half + 1, mode="nearest")
    weights = np.hanning(2 * half + 3)[1:-1]
    return np.asarray(correlate1d(least, weights / weights.sum(), mode="nearest"))
