"""Angles in another unit than degrees."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from crowdsim.capture.columns import rotation_columns
from crowdsim.capture.evidence import Evidence
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array

_UNITS = {
    "radians": (180.0 / np.pi, 4.0 * np.pi),
    "shares of a turn": (360.0, 2.0),
    "half turns": (180.0, 4.0),
    "degrees that were converted from radians twice": (np.pi / 180.0, np.inf),
}
"""Degrees in each unit, and the greatest angle that it has in a file."""
_TWICE = 2500.0
"""Angles beyond this [deg] are no degrees, however often a body turns round."""
_FROZEN = 0.25
"""A body of ``HEIGHT`` whose limbs stay within so much is frozen in its rest pose [m]."""
_PLAINLY, _BETTER = 2.5, 1.25
"""By how much the feet that bear a body slow down when angles are read right: beyond doubt, and at the least."""
_RESTLESS = 0.08
"""Speed of these feet from which on they are compared at all; a body that keeps still stays below it [m/s]."""
_FASTEST = 16.0


class Angles:
    """Rotation channels in radians, in turns, or in degrees that were converted from radians twice."""

    name = "angles"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Read angles in each unit that their size allows, and take the one in which the body stands on its feet."""
        columns, before = rotation_columns(reading.bvh), reading.evidence
        if not columns.size or before is None:
            return None
        # Some files have the root's angles in another unit than those of joints.
        below = columns >= (reading.bvh.first_channels()[1] if reading.bvh.joint_count > 1 else 0)
        found = [
            *self._read(reading, before, columns, ""),
            *self._read(reading, before, columns[below], " of all but the root"),
            *self._read(reading, before, columns[~below], " of the root alone"),
        ]
        if not found:
            return None
        unrest, most, words, read = min(found, key=lambda one: one[0])
        plainly = unrest * _PLAINLY < before.unrest or most > _TWICE
        if not plainly and (before.unrest < _RESTLESS or unrest * _BETTER > before.unrest):
            return None
        confidence = 0.98 if plainly else 0.92
        what = f"angles{words}: as degrees, of {most:.3g} at the most, " + (
            "joints spin" if most > _TWICE else "the body keeps its rest pose, or its heading, while it travels"
        )
        return Diagnosis(self.name, what, confidence, "repair", "they are read so", lambda: read)

    def _read(
        self, reading: Reading, before: Evidence, columns: Array, whose: str
    ) -> Iterator[tuple[float, float, str, Reading]]:
        """Yield readings of some angles in other units that make a body's motion: its unrest, the greatest, words."""
        angles = np.abs(reading.bvh.motion[:, columns])
        if not angles.size or not np.isfinite(angles).all():
            return
        most = float(np.quantile(angles.max(axis=1), 0.99))
        if most < 1e-3 or not (most > _TWICE or (most < 4.0 * np.pi and (whose or before.extent < _FROZEN))):
            return
        for unit, (factor, limit) in _UNITS.items():
            if (factor < 1.0) == (most > _TWICE) and most <= limit:
                motion = reading.bvh.motion.copy()
                motion[:, columns] *= factor
                read = replace(reading, bvh=replace(reading.bvh, motion=motion))
                evidence = read.evidence
                if evidence is not None and _plausible(evidence):
                    yield evidence.unrest, most, f"{whose} are {unit}", read


def _plausible(evidence: Evidence) -> bool:
    return (
        len(evidence.speeds) > 0
        and float(np.quantile(evidence.speeds, 0.95)) < _FASTEST
        and evidence.extent > _FROZEN
        and evidence.knee_sense > 0.0
    )
