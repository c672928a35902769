"""A root that drifts away from under its body, as that of inertial sensors."""

from __future__ import annotations

import numpy as np

from crowdsim.capture.evidence import Evidence, unit
from crowdsim.capture.faults.diagnosis import Diagnosis, by_confidence
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array

_DRIFTS = 0.06
"""Velocity of feet that bear a body of ``HEIGHT`` from which on they do not stand [m/s]."""
_SPREAD = 0.55
"""How much this velocity varies at the most, as a share of it: a drift goes the same way in all frames."""
_ALONG = 0.5
"""How far the root travels with the feet, as a share of that: a body on a moving belt stays."""
_PLAINLY = 0.3
"""Spread below which there is no doubt."""
_STRAIGHT, _STEPS, _WALKS, _RUNS = 0.95, 0.19, 0.5, 2.5
"""How much of its way a walk goes ahead, at the least; how far feet that bear it are from their median velocity, in the
median and at the most, as a share of its speed; and that speed, at the least and at the most [m/s]: in a run, feet
are hardly on the floor."""
_ASIDE, _AHEAD, _MOST = 0.055, 0.11, 0.4
"""Velocities aside and ahead of feet that bear a walk from which on they do not stand, as shares of its speed; where
they go ahead by more than the last, the root is in another unit."""
_ROLLS = 0.05
"""Velocity ahead of feet that roll from heel to toe, as a share of the walk's speed."""


class RootDrift:
    """Feet that bear the body and all slide the same way, and the root with them."""

    name = "root_drift"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Compare the velocity of feet near the floor with how much it varies from frame to frame."""
        evidence = reading.evidence
        if evidence is None or np.count_nonzero(evidence.inside) < 20:
            return None
        found = _standing(evidence) or _walking(evidence)
        if found is None:
            return None
        drift, confidence = found
        return Diagnosis(
            self.name,
            f"the root drifts: feet that bear the body slide the same way, at {np.linalg.norm(drift):.2f} m/s",
            confidence,
            by_confidence(confidence),
            "that velocity is taken from its path",
            lambda: _held(reading, drift * evidence.size),
        )


def _standing(evidence: Evidence) -> tuple[Array, float] | None:
    """The drift of a body that stands most of the time [m/s], and how sure it is."""
    velocities = evidence.planted[evidence.inside]
    drift = np.median(velocities, axis=0)
    speed = float(np.linalg.norm(drift))
    spread = float(np.median(np.linalg.norm(velocities - drift, axis=1)))
    travel = float(evidence.root_velocity[evidence.inside].mean(axis=0) @ drift)
    if speed < _DRIFTS or spread > _SPREAD * speed or travel < _ALONG * speed**2:
        return None
    drift[1] = _rise(evidence, evidence.inside)
    return drift, 0.95 if spread < _PLAINLY * speed else 0.91


def _walking(evidence: Evidence) -> tuple[Array, float] | None:
    """The drift of a body that walks straight ahead, whose feet are on the floor for a while each [m/s]."""
    up = np.array([0.0, 1.0, 0.0])
    ways = evidence.travel * (1.0 - up)
    speeds = np.linalg.norm(ways, axis=1)
    moves = evidence.inside & (speeds >= 0.5 * np.median(speeds[evidence.inside]))
    ahead, speed = unit(ways[moves]), float(np.median(speeds[moves]))
    if not _WALKS < speed < _RUNS or np.linalg.norm(ahead.mean(axis=0)) < _STRAIGHT:
        return None
    axes = np.stack([ahead, np.cross(up, ahead)], axis=1)
    velocities = np.einsum("fij,fj->fi", axes, evidence.planted[moves])
    drift = np.median(velocities, axis=0)
    spread = float(np.median(np.linalg.norm(velocities - drift, axis=1)))
    drift[0] -= _ROLLS * speed
    far, aside = np.abs(drift) / speed
    if spread > _STEPS * speed or far > _MOST or (far < _AHEAD and aside < _ASIDE):
        return None
    return unit(axes.mean(axis=0)).T @ drift + _rise(evidence, moves) * up, 0.91


def _rise(evidence: Evidence, frames: Array) -> float:
    """Velocity at which the lower foot rises throughout some frames [m/s]."""
    low = evidence.soles[frames][..., 1].min(axis=1)
    return float(np.polyfit(evidence.frames[frames] / evidence.fps, low, 1)[0])


def _held(reading: Reading, drift: Array) -> Reading:
    """The reading without a velocity of its root [m/s]. Shape (3,)."""
    seconds = np.arange(reading.clip.frame_count)[:, None] / reading.clip.fps
    return reading.with_path(reading.path - seconds * drift @ reading.to_world / (reading.scale or 1.0))
