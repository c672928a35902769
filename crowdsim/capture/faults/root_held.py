"""A root that stands still for several frames at a time and then moves by as many at once."""

from __future__ import annotations

import numpy as np

from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array
from crowdsim.motion.body import HEIGHT

_HELD = 0.4
"""Share of the frames of a travelling body in which its root is held."""
_TRAVEL = 0.3
"""Length of the root's path, for a body of ``HEIGHT``, from which on it can be seen to be held [m]."""
_STEP = 0.001
"""Least median of its steps, for a body of ``HEIGHT`` [m]; shorter ones are those of rounding."""
_MOVES = 1e-5
"""Mean rotation of joints between frames that are not copies of each other [rad]."""


class RootHeld:
    """Root positions at a lower rate than the file's, or rounded."""

    name = "root_held"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Find out whether the root keeps exactly one place while joints rotate."""
        body, clip = reading.body, reading.clip
        if body is None or not reading.finite or clip.frame_count < 20:
            return None
        moves = np.linalg.norm(np.diff(reading.path, axis=0), axis=1) * (reading.scale or 1.0) * HEIGHT / body.height
        dots = np.abs(np.einsum("fjc,fjc->fj", clip.rotations[1:], clip.rotations[:-1]))
        alive = (1.0 - dots).mean(axis=1) > _MOVES**2
        if reading.lost is not None:
            alive &= ~(reading.lost[1:] | reading.lost[:-1])
        held = alive & (moves <= 1e-7)
        stepping = alive & (moves > 1e-7)
        if not stepping.any() or moves[alive].sum() < _TRAVEL:
            return None
        step = float(np.median(moves[stepping]))
        share = float(held.sum() / alive.sum())
        if share < _HELD or step < _STEP:
            return None
        return Diagnosis(
            self.name,
            f"the root stands still in {share:.0%} of the frames and moves by {100.0 * step:.1f} cm in others",
            0.95,
            "repair",
            "its path is drawn evenly through the places where it arrives",
            lambda: reading.with_path(_drawn(reading.path)),
        )


def _drawn(path: Array) -> Array:
    """A path through the first frames of all places at which it stays, and on as it goes after the last of them."""
    known = np.flatnonzero(np.concatenate([[True], (np.diff(path, axis=0) != 0.0).any(axis=1)]))
    places = path[known]
    if known[-1] < len(path) - 1:
        further = (len(path) - 1 - known[-1]) / (known[-1] - known[-2])
        places = np.concatenate([places, places[-1:] + min(further, 1.0) * (places[-1:] - places[-2:-1])])
        known = np.append(known, len(path) - 1)
    return np.stack([np.interp(np.arange(len(path)), known, places[:, axis]) for axis in range(3)], axis=1)
