"""A floor that is not level in time: a root whose height drifts or sways, or a body that climbs."""

from __future__ import annotations

import numpy as np

from crowdsim.capture.evidence import gather_evidence
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.measuring import lead_in

_WINDOW = 1.0
"""Time in which a body comes down to its floor [s]."""
_LEVEL = 0.2
"""How far apart the lowest points of such times are on one floor, at the most, for a body of ``HEIGHT`` [m]."""
_ENDS = 0.05
"""Share of these times that do not count, at either end."""


class Floor:
    """Feet that bear a body at heights far apart, as on no level floor."""

    name = "floor"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Hold the lowest points of a body in each second against one another."""
        body = reading.body
        if body is None or not reading.finite or reading.clip.seconds < 2.0 * _WINDOW or reading.evidence is None:
            return None
        lowest = _lowest(reading)
        if not len(lowest):
            return None
        low, high = np.quantile(lowest, (_ENDS, 1.0 - _ENDS))
        if high - low < _LEVEL:
            return None
        return Diagnosis(
            self.name,
            f"the body stands on floors that are {high - low:.2f} m apart: its height drifts, or it climbs",
            0.9,
            "refuse",
            "the lowest points of each second are put on one floor",
            lambda: reading.with_path(_lowered(reading)),
        )


def _lowest(reading: Reading, whole: bool = False) -> Array:
    """The lowest height of joints and soles in the time of ``_WINDOW`` around frames, or around all.

    Shape (N,); empty where no stretch is that long.
    """
    from scipy.ndimage import minimum_filter1d

    assert reading.body is not None
    begun = np.arange(reading.clip.frame_count) < lead_in(reading.clip, reading.body)
    lost = begun if reading.lost is None else begun | reading.lost
    evidence = gather_evidence(reading.clip, reading.body, None if whole else lost, whole)
    soles = np.concatenate([evidence.tracks.heels, evidence.tracks.balls], axis=1)[..., 1].min(axis=1) / evidence.size
    low = np.minimum(soles, evidence.positions[..., 1].min(axis=1))
    width = max(3, round(_WINDOW * evidence.fps))
    edges = np.flatnonzero(np.diff(evidence.frames) != 1) + 1
    parts = [part for part in np.split(low, edges) if len(part) >= width or len(edges) == 0]
    return np.concatenate([low[:0], *(minimum_filter1d(part, width, mode="nearest") for part in parts)])


def _lowered(reading: Reading) -> Array:
    """The root's path in the file on a floor that is level."""
    from scipy.ndimage import gaussian_filter1d

    assert reading.body is not None
    low = gaussian_filter1d(_lowest(reading, whole=True), 0.5 * _WINDOW * reading.clip.fps, mode="nearest")
    moved = np.zeros((len(low), 3))
    moved[:, 1] = (low.min() - low) * reading.body.height / HEIGHT
    if reading.tilt is not None:
        moved = quaternion.rotate(quaternion.conjugate(reading.tilt), moved)
    return np.asarray(reading.path + moved @ reading.to_world / (reading.scale or 1.0))
