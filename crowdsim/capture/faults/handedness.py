"""Motion in left-handed coordinates, whose left and right limbs have kept their names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.bvh.io import Bvh
from crowdsim.capture.faults.diagnosis import Diagnosis, by_confidence
from crowdsim.capture.reading import Reading
from crowdsim.motion.joint_names import split_name

_TOES, _KNEES = 0.3, 0.03
"""From which on toes point ahead or back, as a cosine, and how far knees lie before or behind a leg's line [m]."""


class Handedness:
    """A body whose toes and knees point to where its names of left and right say that its back is."""

    name = "handedness"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Hold where toes and knees point against where a body faces by the names of its sides."""
        evidence = reading.evidence
        if evidence is None or not _sides_are_named(reading):
            return None
        toes, knees = evidence.toe_sense, evidence.knee_sense
        if knees > -_KNEES or (toes is not None and toes > -_TOES):
            return None
        confidence = 0.98 if toes is not None else 0.85
        seen = "toes and knees point" if toes is not None else "knees bend"
        return Diagnosis(
            self.name,
            f"coordinates are left-handed: {seen} backward by the names of left and right",
            confidence,
            by_confidence(confidence),
            "the file is mirrored at x",
            lambda: replace(reading, bvh=_mirrored(reading.bvh)),
        )


class Knees:
    """Knees that bend backward under feet that point ahead: rotations in another sense or order than is written."""

    name = "knees"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Hold where knees bend against where toes point."""
        evidence = reading.evidence
        if evidence is None or evidence.toe_sense is None:
            return None
        if evidence.toe_sense < _TOES or evidence.knee_sense > -_KNEES:
            return None
        return Diagnosis(
            self.name,
            f"knees bend backward, by {-evidence.knee_sense:.2f} m in the median: rotations have another sense or "
            "another order than their channels say",
            0.95,
            "refuse",
        )


def _sides_are_named(reading: Reading) -> bool:
    names, roles = reading.raw.skeleton.names, reading.roles
    sides = [
        (split_name(names[roles[f"left_{role}"]])[0], split_name(names[roles[f"right_{role}"]])[0])
        for role in ("hip", "knee", "foot", "hand")
    ]
    return sides.count((0, 1)) >= 3


def _mirrored(bvh: Bvh) -> Bvh:
    """The file mirrored at the plane x = 0."""
    signs = np.ones(bvh.channel_count)
    starts = bvh.first_channels()
    for joint, names in enumerate(bvh.channels):
        for place, name in enumerate(names):
            if name in ("Xposition", "Yrotation", "Zrotation"):
                signs[int(starts[joint]) + place] = -1.0
    mirror = np.array([-1.0, 1.0, 1.0])
    return replace(bvh, motion=bvh.motion * signs, offsets=bvh.offsets * mirror, end_offsets=bvh.end_offsets * mirror)
