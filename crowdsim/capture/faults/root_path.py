"""A root whose path is in other units, other axes, or another meaning than the body's."""

from __future__ import annotations

import itertools

import numpy as np

from crowdsim.capture.evidence import Evidence, correlation
from crowdsim.capture.faults.diagnosis import Diagnosis, by_confidence
from crowdsim.capture.reading import Reading
from crowdsim.capture.units import UNITS
from crowdsim.core.types import Array

_FOOT = 0.3048
_TOLERANCE, _FEWER = 2.6, 0.85
"""By which factor the measured ratio of units may differ from a known one."""
_BIASED = 0.75
"""What the ratio comes out as where units agree: soles of capture slide."""
_RELATED = 0.55
"""Correlation of the root's velocity with that of the feet against it from which on one measures the other."""
_FAR, _HARDLY = 8.0, 0.4
"""A ratio of units, up or down, that is plain, and the correlation that suffices for one."""
_UNRELATED = 0.3
"""Correlation below which the root's path is not that of the body."""
_APART = 4.5
"""Ratio of units, up or down, from which on they are not the same ..."""
_UNLIKE, _SURELY, _STANDS = 1.6, 0.85, 0.7
"""... or, where the root follows the feet closely, one from which on they may not be, if feet then slide less by so
much."""
_PLAINLY = 0.6
"""How much less feet slide, at the most, with a root whose path is longer or shorter by what no unit explains."""
_LATE, _SOON, _LATER = 0.5, 0.03, 0.6
"""Times by which a root may go before or behind the feet, at the most and at the least [s], and what remains of how far
the two are from going together, as a share."""
_NOTHING, _GOES = 0.35, 0.1
"""Correlation below which a root that goes at such a speed [m/s] is another body's, or feet are ..."""
_UPRIGHT, _MOSTLY = 0.5, 0.8
"""... if the pelvis is so high over the lower foot [m] in this share of the frames: a body that lies does not push."""
_SHORT = 0.3
"""Greatest displacement in a frame [m]."""
_BETTER = 1.5


class RootPath:
    """A root in another unit than the bones, with axes exchanged, or as displacements from frame to frame."""

    name = "root_path"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Hold the velocity of the root against the one at which the feet that bear the body would stand still."""
        evidence = reading.evidence
        if evidence is None or np.count_nonzero(evidence.inside) < 20:
            return None
        counted, relation = evidence.counted, evidence.relation
        push, velocity = evidence.bearing[counted], evidence.travel[counted]
        if np.linalg.norm(push, axis=1).mean() < 0.02:
            return None
        ratio = evidence.ratio / _BIASED
        late = _of_delay(reading, evidence)
        if late is not None:
            return late
        if relation > (_RELATED if 1.0 / _FAR < ratio < _FAR else _HARDLY):
            return _of_units(reading, ratio, relation)
        found = _of_displacements(reading, evidence, counted, relation) or _of_axes(reading, evidence, push, velocity)
        return found or _of_nothing(evidence, relation, velocity)


def _of_units(reading: Reading, ratio: float, relation: float) -> Diagnosis | None:
    apart = max(ratio, 1.0 / ratio)
    if apart < (_APART if relation < _SURELY else _UNLIKE):
        return None
    amount = f"{ratio:.3g} times too little" if ratio > 1.0 else f"{1.0 / ratio:.3g} times too far"
    what = f"the root travels {amount} for the feet"
    # Soles slide in most capture, so that the measured ratio is too low by as much: the feet decide between units.
    tried = []
    for unit in (*UNITS.values(), _FOOT):
        factor = unit / (reading.scale or 1.0)
        # Feet cannot tell units apart that are closer than that.
        if max(ratio / factor, factor / ratio) < _TOLERANCE and max(factor, 1.0 / factor) > 2.0:
            read = reading.with_path(reading.path * factor)
            if read.evidence is not None:
                tried.append((read.evidence.unrest, factor, read))
    tried.sort(key=lambda one: one[0])
    before = reading.evidence
    if apart < _APART and before is not None and (not tried or tried[0][0] > _STANDS * before.unrest):
        read = reading.with_path(reading.path * ratio)
        if read.evidence is None or read.evidence.unrest > _PLAINLY * before.unrest:
            return None
        remedy = f"they are multiplied by {ratio:.2g}, with which feet stand"
        return Diagnosis("root_path", what, 0.9, "refuse", remedy, lambda: read)
    if not tried or (len(tried) > 1 and tried[0][0] > _FEWER * tried[1][0]):
        return Diagnosis("root_path", what, 0.9, "refuse")
    _, factor, read = tried[0]
    confidence = 0.97 if relation > 0.7 else 0.92
    return Diagnosis(
        "root_path",
        f"{what}: its positions are in another unit than the bones",
        confidence,
        by_confidence(confidence),
        f"they are multiplied by {factor:.4g}",
        lambda: read,
    )


def _of_delay(reading: Reading, evidence: Evidence) -> Diagnosis | None:
    """A path that is that of the body some time before or after."""
    most = min(round(_LATE * evidence.fps), len(evidence.frames) // 4)
    push, velocity = evidence.bearing, evidence.travel
    if np.linalg.norm(velocity[evidence.counted], axis=1).mean() < _GOES:
        return None

    def relation(lag: int) -> float:
        """How the root goes with the feet of so many frames before."""
        now = slice(max(lag, 0), len(push) + min(lag, 0))
        then = slice(max(-lag, 0), len(push) - max(lag, 0))
        both = evidence.counted[now] & evidence.counted[then]
        return correlation(push[then][both], velocity[now][both])

    found = {lag: relation(lag) for lag in range(-most, most + 1)}
    lag = max(found, key=lambda frames: found[frames])
    if abs(lag) < max(2, _SOON * evidence.fps) or found[lag] < _SURELY or 1.0 - found[lag] > _LATER * (1.0 - found[0]):
        return None
    frames = np.clip(np.arange(len(reading.path)) + lag, 0, len(reading.path) - 1)
    read = reading.with_path(reading.path[frames])
    if read.evidence is None or read.evidence.unrest > _STANDS * evidence.unrest:
        return None
    return Diagnosis(
        "root_path",
        f"the root goes where the feet push it {abs(lag) / evidence.fps:.2f} s {'later' if lag > 0 else 'before'}",
        0.92,
        "repair",
        "it is moved to their time",
        lambda: read,
    )


def _of_nothing(evidence: Evidence, relation: float, velocity: Array) -> Diagnosis | None:
    """A path that has nothing to do with feet that a body stands on."""
    heights = evidence.at("pelvis")[:, 1] - evidence.soles[..., 1].min(axis=1)
    speed = float(np.sqrt(np.mean(np.sum(velocity[:, [0, 2]] ** 2, axis=1))))
    if relation > _NOTHING or speed < _GOES or np.mean(heights > _UPRIGHT) < _MOSTLY:
        return None
    what = f"the root goes at {speed:.2f} m/s, and not as the feet push it (correlation {relation:.2f}): they slide"
    return Diagnosis("root_path", what, 0.9, "refuse")


def _of_displacements(reading: Reading, evidence: Evidence, counted: Array, relation: float) -> Diagnosis | None:
    """Positions that are those of the frame before subtracted from the frame's own."""
    size = np.abs(evidence.root[counted]).max(axis=0)
    axes = np.flatnonzero(size < _SHORT)
    if relation > _UNRELATED or 0 not in axes or 2 not in axes:
        return None
    push, values = evidence.push[counted][:, axes], evidence.root[counted][:, axes]
    rate = float(np.sum(push * values) / max(np.sum(values**2), 1e-12))
    # A root that stays at one place has no course of its own.
    related = correlation(push, values), correlation(push - push.mean(axis=0), values - values.mean(axis=0))
    if related[0] < _RELATED or related[1] < _UNRELATED or not 0.4 < rate / evidence.fps < 2.5:
        return None

    def repair() -> Reading:
        path = reading.path @ reading.to_world.T
        path[:, axes] = np.cumsum(path[:, axes], axis=0)
        return reading.with_path(path @ reading.to_world)

    return Diagnosis(
        "root_path",
        "positions of the root are displacements from frame to frame",
        0.95,
        "repair",
        "they are added up",
        repair,
    )


def _of_axes(reading: Reading, evidence: Evidence, push: Array, velocity: Array) -> Diagnosis | None:
    """Axes of the root's path that are exchanged or have another sense than the body's."""
    if float(np.median(np.linalg.norm(velocity, axis=1))) < 0.02:
        return None
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turned = velocity[:, order] * np.array(signs)
            found.append((correlation(push, turned), order, signs))
    relation, order, signs = max(found)
    if relation < 0.75 or correlation(push, velocity) > _UNRELATED:
        return None

    def repair() -> Reading:
        # Exchanged in the world, and written back in the axes of the file.
        path = reading.path @ reading.to_world.T
        path = path[:, order] * np.array(signs)
        return reading.with_path(path @ reading.to_world)

    better = repair().evidence
    if better is None or better.unrest * _BETTER > evidence.unrest:
        return None
    names = ", ".join(f"{'-' if sign < 0 else ''}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True))
    return Diagnosis(
        "root_path",
        f"the root does not go where the feet push it: its path has other axes than the body ({names} for x, y, z)",
        0.93,
        "repair",
        "they are exchanged",
        repair,
    )
