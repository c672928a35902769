"""Rows that are written several times: motion of a lower rate in a file of a higher one, and motion that freezes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.bvh.file import snap_rate
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array
from crowdsim.motion.contacts import runs

_LEAST, _FEW = 0.12, 20
"""Share of rows that repeat the one before, and number of other rows, from which on that may be the file's rate."""
_EVEN = 2.5
"""How far, in rows, those that repeat none are from being spread evenly, where that is so."""
_FROZEN = 0.3
"""Time for which motion does not freeze by itself [s]."""


class Repeats:
    """Rows that repeat the one before, evenly throughout a file or for a while."""

    name = "repeats"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Find out how often rows are written, and whether motion freezes between others."""
        motion = reading.bvh.motion
        if len(motion) < _FEW:
            return None
        same = np.concatenate([[False], (motion[1:] == motion[:-1]).all(axis=1)])
        if not same.any():
            return None
        return _even(reading, same) or _freezes(reading, same)


def _even(reading: Reading, same: Array) -> Diagnosis | None:
    """Motion of a lower rate."""
    bvh, rows = reading.bvh, np.flatnonzero(~same)
    if len(rows) < _FEW or same.mean() < _LEAST:
        return None
    each = (rows[-1] - rows[0]) / (len(rows) - 1)
    if np.ptp(rows - each * np.arange(len(rows))) > _EVEN:
        return None
    rate = bvh.fps / each
    rate = snap_rate(f"{1.0 / rate:.4f}", 1.0 / rate)
    kept = replace(bvh, motion=np.ascontiguousarray(bvh.motion[rows]), fps=rate, frame_time=1.0 / rate)
    return Diagnosis(
        "repeats",
        f"{same.mean():.0%} of the rows repeat the one before: the motion has {rate:.4g} frames a second",
        0.97,
        "repair",
        "each is read once",
        lambda: replace(reading, bvh=kept),
    )


def _freezes(reading: Reading, same: Array) -> Diagnosis | None:
    """Motion that freezes between other motion; frozen ends are no motion of another kind (``Ends``)."""
    if reading.body is None or not reading.finite or same.mean() > 0.5:
        return None
    count, least = len(same), _FROZEN * reading.bvh.fps
    spans = [(int(a), int(b)) for a, b in runs(same) if b - a >= least and a > 1 and b < count]
    if not spans:
        return None
    lost = np.zeros(count, bool) if reading.lost is None else reading.lost.copy()
    for start, stop in spans:
        lost[start:stop] = True
    shown = ", ".join(f"{a} to {b - 1}" for a, b in spans[:4]) + (" ..." if len(spans) > 4 else "")
    return Diagnosis(
        "repeats",
        f"the motion is frozen in frames {shown}",
        0.95,
        "leave_out",
        "they are left out",
        lambda: replace(reading, lost=lost),
    )
