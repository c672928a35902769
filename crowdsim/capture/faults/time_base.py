"""A frame time in another unit than seconds, or of another clock than the motion's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.bvh.file import COMMON_RATES, snap_rate
from crowdsim.capture.evidence import Evidence
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading

_RATES = (4.0, 1000.0)
"""Rates at which motion is captured or exported [1/s]."""
_MORE_RATES = (10.0, 15.0, 20.0, 40.0)
"""Rates in use besides those of capture [1/s]."""
_USUAL = 3.0
"""A usual speed of the fastest limb [m/s]."""
_FASTEST = 18.0
"""Speed against the pelvis that hands, feet and head of a body of ``HEIGHT`` keep below in 95 of 100 frames [m/s]."""
_HARDEST = 380.0
"""Likewise of their acceleration [m/s^2]."""
_SLOWEST = 0.12
"""How often a second, at the least, the fastest limb could cover all the room it uses."""
_EARTH, _FLOATS, _DROPS = 9.81, 1.1, 30.0
"""Acceleration downward of someone who is in the air, and bounds beyond which it is that of another clock [m/s^2]."""
_SWAYS, _SNAPS = 1.4, 130.0
"""Likewise of gravity by how a body on one foot is accelerated (``Evidence.balance``) [m/s^2]."""
_WALKS, _TRIPS, _QUICK = 0.43, 0.21, 0.4
"""How far a step of a walk goes times how long it takes (``Evidence.pace``), what it is no less than [m s] where steps
are quick, and how long such a step takes at the most [s]: shuffling has short steps, and no quick ones."""
_USUAL_DRIVE, _MOST_DRIVE = 1.5, 5.5
"""How hard steps of a walk usually accelerate a trunk over the ground (``Evidence.drive``), and at the most [m/s^2]."""
_READINGS = {
    "milliseconds": lambda value: 1000.0 / value,
    "microseconds": lambda value: 1e6 / value,
    "frames per second": lambda value: value,
    "thousands of seconds": lambda value: 1e-3 / value,
}
"""Frames a second by what a number after ``Frame Time:`` may be."""
FALLBACK = 30.0
"""Rate at which motion is read whose own is impossible and unknown [1/s]."""


class TimeBase:
    """Motion that is a thousand times too fast or too slow, or as many times as its clock is wrong."""

    name = "time_base"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Hold the speeds of limbs against those of bodies, at the rate that is written and at others."""
        bvh, evidence = reading.bvh, reading.evidence
        if bvh.frame_count < 2 or bvh.frame_time <= 0.0:
            return None
        written = bvh.fps
        if _fits(written, evidence) or (evidence is None and 1.0 <= written <= 2000.0):
            return None
        outside = not _RATES[0] <= written <= _RATES[1]
        found = {}
        for unit, rate in _READINGS.items():
            fps = rate(bvh.frame_time)
            if np.isfinite(fps) and _fits(fps, evidence) and _speed(fps, evidence) > 0.3:
                found[unit] = snap_rate(f"{1.0 / fps:.6f}", 1.0 / fps)
        found = _likely(found, evidence)
        what = f"frame time {bvh.frame_time:g} means {written:.6g} frames a second"
        if evidence is not None and len(evidence.speeds):
            what += f", at which limbs move at {_speed(written, evidence):.3g} m/s"
        if len(found) == 1:
            unit, fps = next(iter(found.items()))
            return Diagnosis(
                self.name,
                f"{what}; as {unit} it means {fps:g}, at which they move at {_speed(fps, evidence):.3g} m/s",
                0.97 if evidence is not None else 0.6,
                "repair" if evidence is not None else "refuse",
                f"it is read as {fps:g} frames a second",
                lambda: replace(reading, bvh=replace(bvh, fps=fps)),
                needed=outside,
            )
        for falls, gravity in () if evidence is None else _falls(evidence):
            if gravity is not None and gravity > 0.0:
                rate = written * np.sqrt(_EARTH / gravity)
                what += f", and {falls} at {gravity:.3g} m/s^2, as on earth at about {rate:.0f} frames a second"
        if evidence is not None and evidence.pace is not None and _trips(written, evidence):
            drive = evidence.drive or 0.0
            usual = written * (np.sqrt(_USUAL_DRIVE / drive) if drive > _MOST_DRIVE else evidence.pace / _WALKS)
            what += f", and steps follow one another as those of a walk do at about {usual:.0f} frames a second"
        return Diagnosis(
            self.name,
            f"{what}; no other reading of that number makes a body's motion of it"
            if not found
            else f"{what}; {' and '.join(found)} are as likely",
            0.95,
            "refuse",
            f"it is read at {FALLBACK:g} frames a second, or at those given instead" if outside else "",
            (lambda: replace(reading, bvh=replace(bvh, fps=FALLBACK))) if outside else None,
            needed=outside,
            given="a number of frames a second",
        )


def _likely(found: dict[str, float], evidence: Evidence | None) -> dict[str, float]:
    """Those of several readings that are rates in use, and the one of them whose speeds are plainly more usual."""
    found = {unit: fps for unit, fps in found.items() if fps in (*COMMON_RATES, *_MORE_RATES)} or found
    odd = {unit: abs(float(np.log(_speed(fps, evidence) / _USUAL))) for unit, fps in found.items()}
    if len(found) < 2:
        return found
    first, second = sorted(odd, key=lambda unit: odd[unit])[:2]
    return {first: found[first]} if odd[first] + 1.0 < odd[second] else found


def _speed(fps: float, evidence: Evidence | None) -> float:
    """The 95th percentile of the speeds of limbs if the rate were another one [m/s]; 1 where nothing is known."""
    if evidence is None or not len(evidence.speeds):
        return 1.0
    return float(np.quantile(evidence.speeds, 0.95)) * fps / evidence.fps


def _fits(fps: float, evidence: Evidence | None) -> bool:
    """Whether a rate is one of capture at which limbs move like a body's."""
    if not _RATES[0] <= fps <= _RATES[1]:
        return False
    if evidence is None or evidence.extent < 0.1 or len(evidence.accelerations) < 10:
        return True
    highest = float(np.quantile(evidence.speeds, 0.99)) * fps / evidence.fps
    hardest = float(np.quantile(evidence.accelerations, 0.95)) * (fps / evidence.fps) ** 2
    fall, sway = (_EARTH if value is None else value * (fps / evidence.fps) ** 2 for _, value in _falls(evidence))
    return (
        _speed(fps, evidence) < _FASTEST
        and hardest < _HARDEST
        and highest > _SLOWEST * evidence.extent
        and not 0.0 < fall < _FLOATS
        and fall < _DROPS
        and _SWAYS < sway < _SNAPS
        and not _trips(fps, evidence)
    )


def _trips(fps: float, evidence: Evidence) -> bool:
    """Whether steps at a rate are quick, and short for that, or accelerate the trunk harder than those of a walk."""
    if evidence.pace is None:
        return False
    slower = evidence.fps / fps
    if evidence.drive is not None and evidence.drive > _MOST_DRIVE * slower**2:
        return True
    return evidence.pace * slower < _TRIPS and evidence.pace * slower**2 < _QUICK**2 * evidence.speed


def _falls(evidence: Evidence) -> tuple[tuple[str, float | None], ...]:
    """What falls, and its acceleration if it is known [m/s^2]."""
    return ("bodies in the air fall", evidence.gravity), ("bodies fall away from the foot below", evidence.balance)
