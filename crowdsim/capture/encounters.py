"""Strikes between the people of one file: whom each is thrown at, and whether it lands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from crowdsim.capture.loading import ANALYSIS_RATE, Capture
from crowdsim.core.types import Array
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.strikes import LIMBS

FAR = 1.4
"""A strike at someone further away than this over the ground is thrown at the air [m]."""
_TOUCH = 0.06
"""Gap between surfaces up to which they touch in capture, whose bodies are no capsules [m]."""
_BEFORE, _AFTER = 0.1, 0.08
"""Time before and after the furthest reach in which a strike can land [s]: what it meets stops it earlier."""
_STRIKER, _ARM = 0.05, 0.045
"""Radius of a fist or foot, and of an arm, of a body of ``HEIGHT`` [m]."""

_MOVES = {"tilt", "root_path", "root_jumps", "handedness", "in_place", "time_base", "rotations"}
"""Repairs that move one person against the others."""

Outcome = Literal["landed", "blocked", "missed", "air"]


@dataclass(frozen=True)
class Encounter:
    """A strike of one person of a file, and what became of it.

    Attributes:
        seconds: When it reaches furthest, in the file [s].
        attacker: Number of the person in the list.
        victim: Number of the nearest other one.
        limb: Number of ``strikes.LIMBS``.
        outcome: Landed on head or trunk, blocked by an arm, missed, or thrown at the air with no other person near.
        gap: Least distance of the fist or foot from head and trunk [m].
    """

    seconds: float
    attacker: int
    victim: int
    limb: int
    outcome: Outcome
    gap: float


def find_encounters(captures: Sequence[Capture]) -> list[Encounter]:
    """Return what became of the strikes of the people of one file, by time.

    Args:
        captures: The people, as ``load_people`` returns them; those without a body take no part. Where one of them
            was moved by a repair, or has units or axes of its own, nothing is known of distances between them.
    """
    moved = any(one.done != "kept" and one.diagnosis.fault in _MOVES for each in captures for one in each.diagnoses)
    if moved or len({(one.unit_scale, one.up_axis) for one in captures if one.body is not None}) > 1:
        return []
    people = [(number, capture) for number, capture in enumerate(captures) if capture.analysis is not None]
    surfaces = {number: _Surfaces(capture) for number, capture in people} if len(people) > 1 else {}
    found: list[Encounter] = []
    for number, capture in people:
        others = {other: one for other, one in surfaces.items() if other != number}
        if others:
            found.extend(_encounters(number, capture, others))
    return sorted(found, key=lambda one: (one.seconds, one.attacker))


def _encounters(number: int, capture: Capture, surfaces: Mapping[int, _Surfaces]) -> list[Encounter]:
    """Return the strikes of one person at others."""
    analysis = capture.analysis
    assert analysis is not None
    found = []
    strikes = analysis.strikes
    for frame, limb in zip(strikes.frames.tolist(), strikes.limbs.tolist(), strict=True):
        window = np.arange(max(0, frame - round(_BEFORE * ANALYSIS_RATE)), frame + round(_AFTER * ANALYSIS_RATE) + 1)
        window = window[window < analysis.clip.frame_count]
        points = analysis.tracks.strikers[window, limb]
        at = capture.start + frame / ANALYSIS_RATE
        times = capture.start + window / ANALYSIS_RATE
        radius = _STRIKER * analysis.body.height / HEIGHT
        ground = analysis.tracks.ground[frame, :2]
        near = {other: one.distance(at, ground) for other, one in surfaces.items()}
        victim = min(near, key=lambda other: (near[other], other))
        trunk, arms = surfaces[victim].gaps(times, points, radius)
        # An arm that is met first takes the strike.
        on_trunk, on_arm = (int(np.argmax(gap < _TOUCH)) if (gap < _TOUCH).any() else len(gap) for gap in (trunk, arms))
        outcome: Outcome = "air" if near[victim] > FAR else "missed"
        if min(on_trunk, on_arm) < len(trunk):
            outcome = "landed" if on_trunk <= on_arm else "blocked"
        found.append(Encounter(at, number, victim, limb, outcome, float(trunk.min())))
    return found


class _Surfaces:
    """Head, trunk and arms of a person over time."""

    def __init__(self, capture: Capture) -> None:
        analysis = capture.analysis
        assert analysis is not None
        self.start, self.body, self.tracks = capture.start, analysis.body, analysis.tracks
        positions, _ = clip_kinematics(analysis.clip)
        roles = analysis.body.roles
        self.elbows = positions[:, [roles["left_elbow"], roles["right_elbow"]]]

    def _frames(self, times: Array) -> Array:
        frames = np.rint((np.asarray(times) - self.start) * ANALYSIS_RATE).astype(int)
        return np.asarray(np.clip(frames, 0, len(self.elbows) - 1))

    def distance(self, time: float, ground: Array) -> float:
        """How far the body is from a place on the ground at a time [m]."""
        return float(np.linalg.norm(self.tracks.ground[self._frames(np.array([time]))[0], :2] - ground))

    def gaps(self, times: Array, points: Array, radius: float) -> tuple[Array, Array]:
        """Gaps of a sphere at points (n, 3) at some times from head and trunk, and from the arms [m]. Shape (n,)."""
        at, size = self._frames(times), self.body.height / HEIGHT
        tracks = self.tracks
        head = np.linalg.norm(points - tracks.heads[at], axis=-1) - self.body.head_radius
        torso = _from_segment(points, tracks.pelvises[at], tracks.necks[at]) - self.body.torso_radius
        arms = [
            _from_segment(points, start[at, side], end[at, side]) - _ARM * size
            for side in range(2)
            for start, end in ((tracks.shoulders, self.elbows), (self.elbows, tracks.fists))
        ]
        return np.minimum(head, torso) - radius, np.min(arms, axis=0) - radius


def _from_segment(points: Array, start: Array, end: Array) -> Array:
    """Distance of points (n, 3) from segments [m]. Shape (n,)."""
    way = end - start
    share = np.sum((points - start) * way, axis=-1) / np.maximum(np.sum(way * way, axis=-1), 1e-12)
    return np.asarray(np.linalg.norm(points - start - np.clip(share, 0.0, 1.0)[..., None] * way, axis=-1))


def describe_encounters(captures: Sequence[Capture], encounters: Sequence[Encounter]) -> list[dict[str, object]]:
    """Return encounters as plain data, people by the names of their clips."""
    return [
        {
            "seconds": round(one.seconds, 4),
            "attacker": captures[one.attacker].clip.name,
            "victim": captures[one.victim].clip.name,
            "limb": LIMBS[one.limb],
            "outcome": one.outcome,
            "gap_m": round(one.gap, 3),
        }
        for one in encounters
    ]
