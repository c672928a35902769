"""A root that drifts away from under its body, as that of inertial sensors."""

from __future__ import annotations

import numpy as np

from crowdsim.capture.faults.diagnosis import Diagnosis, by_confidence
from crowdsim.capture.reading import Reading

_DRIFTS = 0.06
"""Velocity of feet that bear a body of ``HEIGHT`` from which on they do not stand [m/s]."""
_SPREAD = 0.55
"""How much this velocity varies at the most, as a share of it: a drift goes the same way in all frames."""
_ALONG = 0.5
"""How far the root travels with the feet, as a share of that: a body on a moving belt stays."""
_PLAINLY = 0.3
"""Spread below which there is no doubt."""


class RootDrift:
    """Feet that bear the body and all slide the same way, and the root with them."""

    name = "root_drift"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Compare the velocity of feet near the floor with how much it varies from frame to frame."""
        evidence = reading.evidence
        if evidence is None or np.count_nonzero(evidence.inside) < 20:
            return None
        velocities = evidence.planted[evidence.inside]
        drift = np.median(velocities, axis=0)
        speed = float(np.linalg.norm(drift))
        spread = float(np.median(np.linalg.norm(velocities - drift, axis=1)))
        travel = float(evidence.root_velocity[evidence.inside].mean(axis=0) @ drift)
        if speed < _DRIFTS or spread > _SPREAD * speed or travel < _ALONG * speed**2:
            return None
        confidence = 0.95 if spread < _PLAINLY * speed else 0.91
        return Diagnosis(
            self.name,
            f"the root drifts: feet that bear the body slide the same way, at {speed:.2f} m/s",
            confidence,
            by_confidence(confidence),
            "that velocity is taken from its path",
            lambda: _held(reading, drift * evidence.size),
        )


def _held(reading: Reading, drift: np.ndarray) -> Reading:
    """The reading without a velocity of its root [m/s]. Shape (3,)."""
    seconds = np.arange(reading.clip.frame_count)[:, None] / reading.clip.fps
    return reading.with_path(reading.path - seconds * drift @ reading.to_world / (reading.scale or 1.0))
