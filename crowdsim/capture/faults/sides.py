"""Names of left and right that arms and legs contradict each other in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.bvh.io import Bvh
from crowdsim.capture.evidence import unit
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading

_ACROSS = -0.5
"""Cosine between the way across the hips and that across the shoulders below which one of them is the wrong way."""
_AHEAD = 0.02
"""How far knees lie before or behind the lines of legs, as a share of their length, to show where a body faces."""


class Sides:
    """A left arm that hangs on the right side by the names of the legs, or the other way round."""

    name = "sides"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Hold the way across the shoulders against the one across the hips."""
        roles, poses = reading.roles, reading.poses
        if not roles or not len(poses):
            return None
        hips = poses[:, roles["left_hip"]] - poses[:, roles["right_hip"]]
        arms = poses[:, roles["left_shoulder"]] - poses[:, roles["right_shoulder"]]
        if np.median(np.sum(unit(hips) * unit(arms), axis=1)) > _ACROSS:
            return None
        wrong = _wrong_limbs(reading)
        swapped = None if wrong is None else _exchanged(reading, wrong)
        what = "a left arm and a left leg are on different sides of the body: names of left and right are exchanged"
        if swapped is None:
            return Diagnosis(self.name, what, 0.95, "refuse")
        return Diagnosis(
            self.name,
            f"{what} in the {'arms' if wrong == 'shoulder' else 'legs'}",
            0.95,
            "repair",
            "they are exchanged back",
            lambda: replace(reading, bvh=swapped),
        )


def _wrong_limbs(reading: Reading) -> str | None:
    """Where the limbs begin whose names are exchanged, by where knees bend; None where they do not show it."""
    poses, roles = reading.poses, reading.roles
    hips = poses[:, roles["left_hip"]] - poses[:, roles["right_hip"]]
    up = poses[:, roles["head"]] - poses[:, roles["pelvis"]]
    ahead, bent = unit(np.cross(hips, up)), 0.0
    for side in ("left", "right"):
        hip, knee, foot = (poses[:, roles[f"{side}_{role}"]] for role in ("hip", "knee", "foot"))
        line, length = unit(foot - hip), np.linalg.norm(foot - hip, axis=1)
        off = knee - hip - np.sum((knee - hip) * line, axis=1, keepdims=True) * line
        bent += float(np.median(np.sum(off * ahead, axis=1) / np.maximum(length, 1e-9)))
    if abs(bent) < 2.0 * _AHEAD:
        return None
    return "shoulder" if bent > 0.0 else "hip"


def _exchanged(reading: Reading, limb: str) -> Bvh | None:
    """The file with the names of two limbs exchanged, joint by joint; None where they are not alike."""
    parents, names = reading.raw.skeleton.parents, list(reading.bvh.names)
    tops = [reading.roles[f"{side}_{limb}"] for side in ("left", "right")]
    while parents[tops[0]] != parents[tops[1]]:
        tops = [int(parents[top]) for top in tops]
        if min(tops) < 0:
            return None
    left, right = (_below(parents.tolist(), top) for top in tops)
    if len(left) != len(right):
        return None
    for a, b in zip(left, right, strict=True):
        names[a], names[b] = names[b], names[a]
    return replace(reading.bvh, names=tuple(names))


def _below(parents: list[int], top: int) -> list[int]:
    """A joint and all that hang on it, in file order."""
    found = {top}
    for joint in range(top + 1, len(parents)):
        if parents[joint] in found:
            found.add(joint)
    return sorted(found)
