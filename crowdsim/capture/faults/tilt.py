"""A floor that is not level: capture in the axes of a camera, or of a frame that was not aligned or drifts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crowdsim.capture.evidence import Evidence
from crowdsim.capture.faults.diagnosis import Diagnosis, by_confidence
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array
from crowdsim.motion import quaternion

_LEAST = np.deg2rad(7.0)
"""Tilt from which on it is one of the file and not of the way a body stands."""
_SLOW, _LOW = 0.3, 0.25
"""Soles that are planted: speed [m/s], and height over the lowest sole of a frame in a world that may be tilted [m]."""
_WIDE = 0.1
"""Spread of planted soles along a direction from which on they show how the floor lies along it [m]."""
_TRAVELS = 0.4
"""Spread of planted soles along a direction in which a body goes [m]."""
_CLEARLY, _BENT = np.deg2rad(5.0), np.deg2rad(10.0)
"""Tilt from which on a floor is not level, and how far bodies lean on a level floor."""
_AGREE = 0.5
"""Share of a tilt by which floor and balance may differ."""
_LEANS = np.deg2rad(9.0)
"""How far, at the least, a body that travels leans to its side in a tilted world."""
_AHEAD = np.tan(np.deg2rad(6.5))
"""How far bodies lean ahead by themselves."""
_DRIFTS, _LASTS, _CONTRADICTS = np.tan(np.deg2rad(12.0)), 2.0, 1.05
"""How much further a body leans at the end than at the start in a world that tilts, the time for which it is seen [s],
and how many times further planted soles are from a plane that tilts so than from one that does not, on a floor that is
level for a body that leans on something."""
_STANDS, _UPRIGHT, _RAISED = 0.6, 0.9, 0.15
"""Least height of the pelvis over the lower sole while a body stands [m], the least share of frames in which it stands
for a clip to be judged, and how far a foot is lifted over the other one in kicks [m]."""
_UP = np.array([0.0, 1.0, 0.0])


class Tilt:
    """A body that leans as its floor does, all the time or ever further."""

    name = "tilt"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Fit a plane to planted soles, and see whether bodies stand square on it."""
        evidence = reading.evidence
        if evidence is None:
            return None
        drift = _drift(evidence)
        if drift > _DRIFTS:
            what = f"the world tilts slowly, by {np.rad2deg(np.arctan(drift)):.0f} degrees from the start to the end"
            return Diagnosis(self.name, f"{what}, and the body leans as it does", 0.9, "refuse")
        floor = _floor(evidence)
        if floor is None:
            return None
        # Along directions in which soles lie close together only the balance of the body shows the tilt.
        leans = _leans(evidence).mean(axis=0) @ floor.directions
        tilts = np.where(floor.wide, floor.tilts, leans)
        size = float(np.linalg.norm(tilts))
        apart = float(np.linalg.norm(tilts - leans))
        if size < np.tan(_LEAST) or apart > max(_AGREE * size, np.tan(_BENT)) or apart > float(np.linalg.norm(leans)):
            return None
        by_floor = bool((floor.wide & (np.abs(floor.tilts) > np.tan(_CLEARLY))).any())
        if by_floor and floor.rest > 0.6 * floor.spread:
            return None
        if not by_floor and (size < np.tan(_LEANS) or not floor.travels):
            return None
        confidence = 0.95 if by_floor else 0.91
        normal = np.array([0.0, 1.0, 0.0])
        normal[[0, 2]] = floor.directions @ tilts
        normal /= np.linalg.norm(normal)
        seen = "the floor is tilted by {:.0f} degrees, and the body leans as it does"
        if not by_floor:
            seen = "the body leans sideways by {:.0f} degrees all the time and does not fall: its world is tilted"
        return Diagnosis(
            self.name,
            seen.format(np.rad2deg(np.arctan(size))),
            confidence,
            by_confidence(confidence),
            "it is put upright",
            lambda: replace(reading, tilt=quaternion.between(normal, _UP)),
        )


@dataclass(frozen=True)
class _Floor:
    """The plane through planted soles.

    Attributes:
        directions: Two horizontal directions, columns. Shape (2, 2).
        wide: Whether soles are spread along each.
        tilts: Tangents of the angles by which its normal leans along each. Shape (2,).
        spread: Spread of soles in height.
        rest: Spread of soles about the plane.
        travels: Whether the body goes somewhere.
    """

    directions: Array
    wide: Array
    tilts: Array
    spread: float
    rest: float
    travels: bool


def _floor(evidence: Evidence) -> _Floor | None:
    """The plane through planted soles; None where there are few, or all are in one place."""
    points, soles = _planted(evidence)
    planted = points[soles]
    if len(planted) < 50:
        return None
    planted = planted - planted.mean(axis=0)
    level = planted[:, [0, 2]]
    values, directions = np.linalg.eigh(level.T @ level / len(level))
    spreads = np.sqrt(np.maximum(values, 0.0))
    wide = spreads > _WIDE
    if not wide.any():
        return None
    along = level @ directions
    slopes = np.where(wide, along.T @ planted[:, 1] / np.maximum(np.sum(along**2, axis=0), 1e-12), 0.0)
    rest = planted[:, 1] - along @ slopes
    travels = bool(spreads.max() > _TRAVELS)
    return _Floor(directions, wide, -slopes, float(planted[:, 1].std()), float(rest.std()), travels)


def _planted(evidence: Evidence) -> tuple[Array, Array]:
    """Heels and balls of both feet (N, 4, 3), and which of them are planted (N, 4)."""
    points = np.concatenate([evidence.tracks.heels, evidence.tracks.balls], axis=1) / evidence.size
    speeds = np.full(points.shape[:2], np.inf)
    speeds[1:-1] = np.linalg.norm(points[2:] - points[:-2], axis=-1) * 0.5 * evidence.fps
    speeds[~evidence.inside] = np.inf
    return points, (speeds < _SLOW) & (points[..., 1] < points[..., 1].min(axis=1, keepdims=True) + _LOW)


def _leans(evidence: Evidence) -> Array:
    """How far a body leans along x and z, beyond how it leans ahead by itself. Shape (N, 2).

    That is how far the middle of the trunk lies from between the feet, by its height.
    """
    trunk = 0.5 * (evidence.at("pelvis") + evidence.at("chest"))
    away = trunk - evidence.soles.mean(axis=1)
    return np.asarray((away / max(float(away[:, 1].mean()), 1e-6) - _AHEAD * evidence.forward)[:, [0, 2]])


def _drift(evidence: Evidence) -> float:
    """How much further a body leans at the end than at the start, on a floor that may tilt so; 0 on others."""
    heights = evidence.soles[..., 1]
    stands = evidence.at("pelvis")[:, 1] - heights.min(axis=1) > _STANDS
    counted = stands & (np.ptp(heights, axis=1) < _RAISED)
    times = evidence.frames - evidence.frames.mean()
    if np.ptp(times) < _LASTS * evidence.fps or stands.mean() < _UPRIGHT or counted.sum() < 20:
        return 0.0
    times /= np.ptp(times)
    design = np.stack([np.ones(counted.sum()), times[counted]], axis=1)
    drift = np.linalg.lstsq(design, _leans(evidence)[counted], rcond=None)[0][1]
    # Planted soles of a frame, as seen from between them, on a plane that is still and on one that tilts.
    points, planted = _planted(evidence)
    shares = planted / np.maximum(planted.sum(axis=1, keepdims=True), 1)
    points = (points - np.einsum("np,npc->nc", shares, points)[:, None])[planted]
    rises = points[:, [0, 2]] @ drift * np.repeat(times, planted.sum(axis=1))
    if _rest(points, rises) > _CONTRADICTS * _rest(points, 0.0 * rises):
        return 0.0
    return float(np.linalg.norm(drift))


def _rest(points: Array, rises: Array) -> float:
    """Distance of points (n, 3), raised by some heights (n,), from the plane through them, root mean square."""
    heights = points[:, 1] + rises
    slopes = np.linalg.lstsq(points[:, [0, 2]], heights, rcond=None)[0]
    return float(np.sqrt(np.mean((heights - points[:, [0, 2]] @ slopes) ** 2))) if len(points) else 0.0
