"""Foot contacts from motion alone: a foot is planted while its ball is low and slow."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.tracks import Tracks, speeds

PLANT_SPEED, RELEASE_SPEED = 0.35, 0.5
"""Speeds of the ball of the foot below which it is planted and above which it is released, for a body of ``HEIGHT``
[m/s]: two, so that noise does not make a contact flicker. Boxers bounce on their toes: a foot that stays down for a
tenth of a second never comes to rest."""
SKATING = 0.15
"""Share of the pelvis's speed that is added to both: capture on a skeleton of other lengths than the actor's skates."""
CONTACT_HEIGHT = 0.07
"""Height over the floor under which a foot can be planted, for a body of ``HEIGHT`` [m]."""
_SMOOTH = 0.02
"""Width of the smoothing of paths [s]."""
_LEAST_CONTACT, _LEAST_GAP = 0.07, 0.07
"""Shorter contacts and shorter gaps between contacts are noise [s]."""


def find_contacts(tracks: Tracks, height: float, fps: float, floor: float = 0.0) -> Array:
    """Find when the left and right foot are planted.

    Args:
        tracks: Paths of the body's points.
        height: Standing height of the body [m]; speeds and lengths scale with it.
        fps: Frames a second.
        floor: Height of the floor [m].

    Returns:
        Whether each foot is planted. Shape (F, 2), bool.
    """
    from scipy.ndimage import gaussian_filter1d

    size = height / HEIGHT
    contacts = np.zeros(tracks.balls.shape[:2], bool)
    travel = np.linalg.norm(np.gradient(tracks.pelvises[:, [0, 2]], axis=0), axis=1) * fps if len(contacts) > 1 else 0.0
    skate = SKATING * gaussian_filter1d(travel, 0.1 * fps) if len(contacts) > 1 else 0.0
    for foot in range(2):
        # Noise of the path cancels out in its mean, not in the mean of its speed.
        speed = speeds(gaussian_filter1d(tracks.balls[:, foot], _SMOOTH * fps, axis=0), fps)
        low = tracks.balls[:, foot, 1] - floor < CONTACT_HEIGHT * size
        planted = _hysteresis(low & (speed < PLANT_SPEED * size + skate), low & (speed < RELEASE_SPEED * size + skate))
        planted = ~_without_short(~planted, round(_LEAST_GAP * fps))
        contacts[:, foot] = _without_short(planted, round(_LEAST_CONTACT * fps))
    return contacts


def find_floor(tracks: Tracks, fps: float) -> float:
    """Return the height of the floor under the feet [m]: the median of soles that do not move."""
    soles = np.concatenate([tracks.heels, tracks.balls], axis=1)
    lowest = soles[..., 1].min(axis=1)
    still = speeds(soles, fps).min(axis=1)
    return float(np.median(lowest[still <= np.quantile(still, 0.5)]))


def runs(flags: Array) -> Array:
    """Return the half-open ranges in which flags (F,) hold. Shape (n, 2)."""
    edges = np.diff(np.concatenate([[0], np.asarray(flags, np.int8), [0]]))
    return np.stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)], axis=1)


def _hysteresis(enter: Array, stay: Array) -> Array:
    """Flags that begin where ``enter`` holds and last, in both directions, as long as ``stay`` does."""
    flags = np.zeros(len(enter), bool)
    for start, stop in runs(stay):
        if enter[start:stop].any():
            flags[start:stop] = True
    return flags


def _without_short(flags: Array, least: int) -> Array:
    flags = flags.copy()
    for start, stop in runs(flags):
        if stop - start < least and start > 0 and stop < len(flags):
            flags[start:stop] = False
    return flags


def plant_spans(contacts: Array, starts: Array) -> Array:
    """Return the first and last frame of the foot plant that each foot is in; the frame itself while it is in the air.

    Args:
        contacts: Whether each foot is planted. Shape (F, 2), bool.
        starts: First frame of each clip, and F: foot plants end with their clip. Shape (C + 1,).

    Returns:
        Shape (F, 2, 2), int64.
    """
    frames = np.arange(len(contacts))
    opens, closes = np.isin(frames, starts[:-1]), np.isin(frames, np.asarray(starts[1:]) - 1)
    spans = np.empty((len(contacts), 2, 2), np.int64)
    for foot in range(2):
        planted = np.asarray(contacts[:, foot], dtype=bool)
        begins = np.flatnonzero(planted & (opens | ~np.r_[False, planted[:-1]]))
        ends = np.flatnonzero(planted & (closes | ~np.r_[planted[1:], False]))
        plant = np.searchsorted(begins, frames, side="right") - 1
        for k, edges in enumerate((begins, ends)):
            spans[:, foot, k] = np.where(planted, np.append(edges, 0)[plant], frames)
    return spans
