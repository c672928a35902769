"""What becomes of striking arms: how deep they go into whom they strike, and how long they stay, from BVH files."""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.bodies import DEEP, VERY_DEEP
from _exported.capsules import Contacts
from _exported.plain_bvh import Array
from _exported.run import WORST, ExportedRun, Strike
from _exported.witness import PARTS

AROUND = 0.3
"""Time before and after a strike in which its limb is buried if it is deeper than ``VERY_DEEP`` [s]."""
AFTER = 1.0
"""Time after a landed strike over which its stay is measured [s]."""
LIMBS = (("left_forearm", "left_fist"), ("right_forearm", "right_fist"), ("left_leg",), ("right_leg",))
"""Parts of a striking limb: left hand, right hand, left foot, right foot."""


def limb_depths(contacts: Contacts, strike: Strike, frames: Array) -> Array:
    """Return how deep a striking limb is in torso or head of whom it strikes [m]; 0 where it is not. Shape (n,).

    Args:
        contacts: Contacts of the attacker with the victim.
        strike: The strike.
        frames: Output frames, ascending. Shape (n,).
    """
    parts = [PARTS.index(part) for part in LIMBS[strike.limb]]
    body = np.isin(contacts.theirs, [PARTS.index("torso"), PARTS.index("head")])
    rows = contacts.rows(body & np.isin(contacts.own, parts) & np.isin(contacts.frames, frames))
    depths = np.zeros(len(frames))
    np.maximum.at(depths, np.searchsorted(frames, rows.frames), rows.depths)
    return depths


def measure_strikes(run: ExportedRun, contacts: Contacts) -> dict[str, Any]:
    """Return shares of buried strikes, and how long a landed limb stays deeper than ``DEEP`` [s]."""
    rows = contacts.both_ways()
    rows = rows.rows(np.lexsort((rows.frames, rows.other, rows.one)))
    keys = rows.one * len(run.figures) + rows.other
    buried: dict[bool, list[bool]] = {True: [], False: []}
    stays: list[float] = []
    moments: list[dict[str, Any]] = []
    for strike in run.strikes():
        key = strike.attacker * len(run.figures) + strike.victim
        pair = rows.rows(slice(*np.searchsorted(keys, [key, key + 1])))
        middle = round(strike.seconds * run.fps)
        first = max(middle - round(AROUND * run.fps), 0)
        frames = np.arange(first, min(middle + round(AFTER * run.fps) + 1, run.count))
        depths = limb_depths(pair, strike, frames)
        around = depths[frames <= middle + round(AROUND * run.fps)]
        buried[strike.landed].append(bool(around.max() > VERY_DEEP))
        if strike.landed:
            stays.append(longest(depths > DEEP) / run.fps)
        moments.append(
            {"value": float(around.max()), "avatar": strike.attacker, "frame": int(first + np.argmax(around)),
             "other": strike.victim, "parts": f"{'landed' if strike.landed else 'missed'} strike"}
        )  # fmt: skip
    return {
        **{f"{name}_buried": float(np.mean(buried[key])) if buried[key] else None
           for name, key in (("missed", False), ("landed", True))},
        "landed_stay": {
            name: float(np.percentile(stays, share)) if stays else None
            for name, share in (("median", 50), ("p95", 95), ("longest", 100))
        },
        "moments": sorted(moments, key=lambda one: -one["value"])[:WORST],
    }  # fmt: skip


def longest(inside: Array) -> int:
    """Return the length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return int((edges[1::2] - edges[::2]).max(initial=0))
