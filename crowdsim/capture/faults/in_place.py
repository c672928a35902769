"""A body that walks and stays where it is."""

from __future__ import annotations

import numpy as np

from crowdsim.capture.evidence import gather_evidence
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array

_SLIDES = 0.35
"""Median speed at which the slower foot near the floor slides from which on nothing bears the body [m/s]."""
_STAYS = 0.2
"""Share of that speed below which the root does not travel."""
_MAIN = 0.5
"""Share of the feet's speed from which on an axis is one along which the body walks."""
_EXACT, _ALIVE = 1e-3, 0.08
"""Room within which a root is fixed [m], and motion of the feet against it that moves any body [m/s]."""
_WIDTH = 0.05
"""Width of the smoothing of a path that is made from feet [s]."""


class InPlace:
    """Feet that slide under a root that does not travel, or not along one axis, be it the one that is up."""

    name = "in_place"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Compare how fast feet slide and how fast the root travels, along x and along z."""
        evidence = reading.evidence
        if evidence is None or np.count_nonzero(evidence.inside) < 20:
            return None
        inside = evidence.inside
        slip = float(np.median(evidence.slip[inside]))
        push, velocity = evidence.push[inside], evidence.root_velocity[inside]
        axes = [
            axis
            for axis in (0, 2)
            if np.median(np.abs(push[:, axis])) > max(0.7 * _SLIDES, _MAIN * np.median(np.linalg.norm(push, axis=1)))
            and np.sqrt(np.mean(velocity[:, axis] ** 2)) < _STAYS * np.median(np.abs(push[:, axis]))
        ]
        # A body that moves never keeps its root over one point to the last digit.
        root = evidence.at("pelvis")
        fixed = [
            axis
            for axis in range(3)
            if np.ptp(root[:, axis]) < _EXACT and np.sqrt(np.mean(push[:, axis] ** 2)) > _ALIVE
        ]
        if (slip < _SLIDES or not axes) and not fixed:
            return None
        axes = sorted({*axes, *fixed})
        along = "" if len(axes) == 3 or axes == [0, 2] else f" along {' and '.join('xyz'[axis] for axis in axes)}"
        return Diagnosis(
            self.name,
            f"the body moves in place: its feet slide at {slip:.2f} m/s and the root does not travel{along}",
            0.97 if fixed else 0.9,
            "refuse",
            "its path follows the feet that bear it",
            lambda: reading.with_path(_followed(reading, np.array(axes))),
        )


def _followed(reading: Reading, axes: Array) -> Array:
    """The root's path in the file, along some axes of the world as the lower foot pushes it."""
    from scipy.ndimage import gaussian_filter1d

    assert reading.body is not None
    clip = reading.clip
    whole = gather_evidence(clip, reading.body, whole=True)
    push = gaussian_filter1d(whole.push, _WIDTH * clip.fps, axis=0, mode="nearest")
    moved = np.zeros_like(push)
    moved[:, axes] = np.cumsum(push[:, axes], axis=0) / clip.fps * whole.size
    return np.asarray(reading.path + moved @ reading.to_world / (reading.scale or 1.0))
