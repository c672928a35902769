"""Muscles, bones, clothes and gloves of a fighter as shapes on the segments of a body.

A row of ``_SHAPES``: segment; start and end, each (share of the segment's length, to its front, outwards) [cm]; radii
at both ends [cm]; stretch along the segment, to its front and outwards; width of the blend [cm]; and what it is, which
builds thicken: ``bone``, ``muscle``, ``fat``, ``face``, ``dress``. Those of the trunk and the head stand for both sides
unless they lie in the middle. Sizes are those of a man of 1.75 m.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from crowdsim.body.binding import Binding
from crowdsim.body.field import Shapes
from crowdsim.core.types import Array
from crowdsim.errors import nearest
from crowdsim.scenario.looks import Hands, Sex

Triple = tuple[float, float, float]
_ROUND = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Build:
    """What a body is like.

    Attributes:
        sex: ``male`` or ``female``.
        kind: ``lean``, ``athletic`` or ``heavy``.
        hands: ``gloves`` or ``bare``.

    Raises:
        ValueError: One is none of these.
    """

    sex: str = "male"
    kind: str = "athletic"
    hands: str = "gloves"

    def __post_init__(self) -> None:
        """Refuse what there is not."""
        for name, known in (("sex", SEXES), ("kind", KINDS), ("hands", HANDS)):
            value = getattr(self, name)
            if value not in known:
                raise ValueError(f"{name} is {value!r}, expected {', '.join(known)}{nearest(value, known)}")


SEXES, KINDS, HANDS = get_args(Sex), ("lean", "athletic", "heavy"), get_args(Hands)
GIRTHS = {"lean": 0.93, "athletic": 1.0, "heavy": 1.1}
"""Girth that each kind stands for."""

_TRUNK: list[tuple[Triple, Triple, float, float, Triple, float, str]] = [
    # Ribcage, shoulder girdle, waist, pelvis.
    ((0.62, -1.2, 0), (0.62, -1.2, 0), 15.2, 15.2, (1.12, 0.70, 1.0), 1.6, "bone"),
    ((0.875, -2.2, 13.0), (0.875, -2.2, -13.0), 5.6, 5.6, _ROUND, 1.5, "bone"),
    ((0.90, -2.4, 13.5), (0.90, -2.4, 17.5), 4.6, 4.4, _ROUND, 1.3, "trap"),
    ((0.30, -0.8, 0), (0.30, -0.8, 0), 12.6, 12.6, (1.10, 0.73, 1.0), 1.8, "waist"),
    ((0.03, -0.8, 0), (0.03, -0.8, 0), 15.2, 15.2, (0.90, 0.68, 1.0), 1.8, "hip"),
    ((-0.10, -1.0, 0), (-0.04, 2.5, 0), 6.0, 6.0, _ROUND, 1.2, "bone"),
    # Belly.
    ((0.24, 4.2, 0), (0.24, 4.2, 0), 9.0, 9.0, (1.15, 0.62, 1.05), 1.6, "belly"),
    # Chest.
    ((0.72, 6.6, 4.6), (0.81, 3.6, 14.0), 5.4, 4.0, (0.95, 0.62, 1.0), 0.8, "pec"),
    ((0.645, 7.6, 5.6), (0.66, 6.4, 10.0), 3.2, 2.6, (0.9, 0.62, 1.0), 0.7, "pec"),
    # Breasts.
    ((0.665, 7.6, 6.9), (0.665, 7.6, 6.9), 5.4, 5.4, (0.95, 0.86, 1.1), 1.6, "breast"),
    # Abdomen.
    ((0.555, 7.9, 3.0), (0.555, 7.9, 3.0), 3.3, 3.3, (0.82, 0.60, 1.0), 0.4, "abs"),
    ((0.450, 7.9, 3.0), (0.450, 7.9, 3.0), 3.3, 3.3, (0.88, 0.60, 1.0), 0.4, "abs"),
    ((0.340, 7.4, 2.9), (0.340, 7.4, 2.9), 3.3, 3.3, (0.92, 0.60, 1.0), 0.4, "abs"),
    ((0.19, 6.6, 2.6), (0.02, 5.2, 2.2), 3.2, 2.8, (1.0, 0.7, 1.0), 0.7, "abs"),
    ((0.46, 2.0, 10.8), (0.14, 1.4, 11.6), 3.6, 4.4, (1.0, 1.1, 0.66), 1.0, "muscle"),
    ((0.56, 4.4, 11.2), (0.47, 5.0, 9.6), 2.4, 2.0, (1.0, 1.0, 0.6), 0.6, "muscle"),
    # Back.
    ((0.80, -3.2, 14.6), (0.42, -3.8, 10.8), 5.6, 2.8, (1.0, 1.0, 0.85), 1.0, "muscle"),
    ((0.78, -9.0, 8.6), (0.62, -8.2, 9.4), 5.2, 4.0, (1.0, 0.55, 1.0), 0.8, "muscle"),
    ((0.58, -8.8, 3.1), (0.14, -6.6, 3.2), 3.0, 3.3, (1.0, 0.8, 0.9), 0.7, "muscle"),
    ((1.12, -4.2, 2.0), (0.955, -3.4, 12.5), 2.7, 2.9, _ROUND, 1.3, "trap"),
    ((0.97, -3.4, 8.0), (0.93, -2.8, 16.0), 3.0, 3.0, _ROUND, 1.2, "trap"),
    ((1.00, -6.8, 2.4), (0.72, -9.6, 3.4), 2.8, 2.6, (1.0, 0.7, 1.1), 0.8, "trap"),
    # Seat.
    ((-0.055, -6.4, 7.0), (-0.055, -6.4, 7.0), 8.2, 8.2, (1.02, 0.95, 0.92), 0.9, "seat"),
    # Neck.
    ((0.90, -2.2, 0), (1.20, 0.2, 0), 5.8, 5.1, _ROUND, 1.0, "neck"),
    ((0.93, 2.6, 2.2), (1.18, 0.2, 4.6), 1.5, 1.6, _ROUND, 0.6, "neck"),
    ((1.08, 3.6, 0), (1.10, 3.9, 0), 1.6, 1.6, _ROUND, 0.6, "apple"),
]

_HEAD: list[tuple[Triple, Triple, float, float, Triple, float, str]] = [
    # Up, to the front, outwards, from the middle of the head [cm].
    ((2.4, -1.2, 0), (2.4, -1.2, 0), 7.5, 7.5, (1.06, 1.24, 1.0), 0.7, "face"),
    ((3.2, 3.4, 0), (3.2, 3.4, 0), 6.6, 6.6, (0.88, 0.76, 0.95), 0.7, "face"),
    ((-3.4, 2.6, 0), (-3.4, 2.6, 0), 6.4, 6.4, (1.06, 0.94, 0.98), 0.7, "face"),
    ((-5.4, 1.2, 4.5), (-9.3, 6.0, 1.8), 1.9, 1.9, _ROUND, 0.8, "jaw"),
    ((-1.0, 1.0, 5.2), (-6.0, 3.6, 3.6), 2.2, 2.2, _ROUND, 0.9, "jaw"),
    ((-9.7, 6.9, 1.0), (-9.7, 6.9, -1.0), 1.75, 1.75, _ROUND, 0.6, "jaw"),
    ((-2.0, 6.0, 4.3), (-1.6, 3.0, 5.7), 1.7, 1.3, _ROUND, 0.7, "face"),
    ((1.2, 7.7, 1.2), (0.9, 6.3, 4.6), 1.15, 1.05, _ROUND, 0.5, "brow"),
    ((0.6, 7.6, 0), (-3.4, 9.7, 0), 0.85, 1.20, _ROUND, 0.35, "face"),
    ((-3.8, 8.6, 1.15), (-3.8, 8.2, 1.2), 0.85, 0.8, _ROUND, 0.3, "face"),
    ((-5.9, 7.9, 0.9), (-6.1, 6.9, 2.2), 0.75, 0.5, _ROUND, 0.25, "face"),
    ((-7.0, 7.7, 0.7), (-6.8, 6.9, 2.0), 0.80, 0.5, _ROUND, 0.25, "face"),
    ((-0.5, 8.2, 3.1), (-0.5, 8.2, 3.1), 1.35, 1.35, (0.8, 1.0, 1.15), -0.5, "face"),
    ((-0.5, 6.5, 3.0), (-0.5, 6.5, 3.0), 1.25, 1.25, _ROUND, 0.25, "face"),
    ((0.5, -1.7, 8.2), (-2.4, -0.8, 7.5), 2.0, 1.3, (1.0, 0.85, 0.42), 0.25, "face"),
    ((4.5, -11.5, 0), (3.9, -10.0, 0), 3.6, 3.2, _ROUND, 0.6, "bun"),
]

_LIMBS: dict[str, list[tuple[Triple, Triple, float, float, Triple, float, str]]] = {
    "upper_arm": [
        ((0.0, 0, 0), (1.0, 0, 0), 4.2, 3.4, _ROUND, 0.9, "bone"),
        ((0.02, 0.2, 1.4), (0.44, 0.2, 2.8), 5.2, 2.2, _ROUND, 0.6, "delt"),
        ((0.02, 2.6, 0.2), (0.40, 2.2, 1.8), 4.8, 2.0, _ROUND, 0.6, "delt"),
        ((0.02, -2.8, 0.2), (0.40, -1.8, 1.8), 4.6, 2.0, _ROUND, 0.6, "delt"),
        ((0.60, 2.8, -0.2), (0.60, 2.8, -0.2), 3.7, 3.7, (2.5, 1.0, 1.05), 0.5, "arm"),
        ((0.48, -2.6, -1.5), (0.48, -2.6, -1.5), 3.5, 3.5, (2.9, 1.0, 0.95), 0.5, "arm"),
        ((0.52, -2.3, 1.8), (0.52, -2.3, 1.8), 3.3, 3.3, (2.5, 1.0, 0.95), 0.5, "arm"),
    ],
    "forearm": [
        ((0.0, -0.6, 0), (0.0, -0.6, 0), 3.6, 3.6, (1.0, 1.0, 1.12), 0.8, "bone"),
        ((-0.02, -2.4, 0), (0.06, -2.2, 0), 1.7, 1.7, _ROUND, 0.6, "bone"),
        ((0.0, 0, 0), (1.0, 0, 0), 3.3, 2.3, (1.0, 0.9, 1.1), 0.8, "bone"),
        ((0.24, 1.2, 2.1), (0.24, 1.2, 2.1), 3.2, 3.2, (2.7, 1.0, 0.95), 0.5, "arm"),
        ((0.28, 0.8, -1.9), (0.28, 0.8, -1.9), 3.3, 3.3, (2.7, 1.0, 0.95), 0.5, "arm"),
        ((0.32, -1.5, 0.3), (0.32, -1.5, 0.3), 2.5, 2.5, (3.2, 1.0, 1.0), 0.6, "arm"),
    ],
    "glove": [
        ((-0.95, 0, 0), (0.0, 0, 0), 4.3, 4.6, (1.0, 1.0, 0.95), 0.5, "dress"),
        ((0.25, 0.0, 0.8), (1.0, 0.0, 0.6), 5.8, 6.2, (1.0, 1.04, 0.94), 0.6, "dress"),
        ((1.20, 0.0, -1.4), (0.95, 0.0, -2.4), 4.6, 4.2, (1.0, 1.1, 0.85), 0.6, "dress"),
        ((0.20, 4.2, -2.0), (1.0, 5.6, -3.0), 2.6, 2.3, _ROUND, 0.3, "dress"),
    ],
    "fist": [
        ((0.0, 0, 0), (0.7, 0, 0.2), 2.6, 3.2, (1.0, 1.25, 0.75), 0.7, "face"),
        *[
            row
            for at in (-3.0, -1.0, 1.0, 3.0)
            for row in (
                ((0.75, at, 0.9), (1.22, at, 0.5), 1.15, 1.2, _ROUND, 0.25, "face"),
                ((1.22, at, 0.3), (1.18, at, -2.2), 1.15, 1.1, _ROUND, 0.25, "face"),
                ((1.15, at, -2.6), (0.70, at, -2.4), 1.1, 0.9, _ROUND, 0.25, "face"),
            )
        ],
        ((0.30, 3.2, -1.0), (0.80, 4.2, -2.4), 1.6, 1.2, _ROUND, 0.35, "face"),
        ((0.80, 4.2, -2.6), (1.05, 1.8, -3.4), 1.2, 1.0, _ROUND, 0.3, "face"),
    ],
    "thigh": [
        ((-0.02, -0.6, -0.6), (1.0, -0.2, 0), 8.0, 5.0, _ROUND, 1.0, "leg"),
        ((0.10, -1.0, 2.6), (0.10, -1.0, 2.6), 6.6, 6.6, (1.6, 1.0, 0.9), 1.0, "hip"),
        ((0.44, 4.0, 0.4), (0.44, 4.0, 0.4), 5.2, 5.2, (3.3, 1.0, 1.05), 0.6, "leg"),
        ((0.55, 2.0, 4.0), (0.55, 2.0, 4.0), 4.6, 4.6, (3.2, 1.0, 0.95), 0.6, "leg"),
        ((0.79, 2.4, -2.9), (0.79, 2.4, -2.9), 3.6, 3.6, (2.0, 1.0, 1.0), 0.5, "leg"),
        ((0.20, -0.6, -3.2), (0.20, -0.6, -3.2), 5.0, 5.0, (2.4, 1.1, 1.0), 0.9, "leg"),
        ((0.50, -4.2, 1.8), (0.50, -4.2, 1.8), 4.4, 4.4, (3.6, 1.0, 0.95), 0.6, "leg"),
        ((0.52, -4.2, -1.9), (0.52, -4.2, -1.9), 4.2, 4.2, (3.5, 1.0, 0.95), 0.6, "leg"),
        ((0.98, 2.6, 0), (1.02, 2.6, 0), 3.0, 3.0, (1.1, 0.9, 1.1), 0.7, "bone"),
    ],
    "shank": [
        ((0.0, 0, 1.5), (0.0, 0, -1.5), 3.8, 3.8, (1.3, 1.0, 1.0), 1.0, "bone"),
        ((0.04, 0.2, 0), (1.0, 0.2, 0), 4.2, 2.9, _ROUND, 0.9, "bone"),
        ((0.10, 3.0, 0), (0.13, 2.9, 0), 1.6, 1.4, _ROUND, 0.6, "bone"),
        ((0.28, -3.6, -2.0), (0.28, -3.6, -2.0), 4.0, 4.0, (2.5, 1.0, 1.0), 0.5, "leg"),
        ((0.26, -3.3, 2.2), (0.26, -3.3, 2.2), 3.8, 3.8, (2.4, 1.0, 0.95), 0.5, "leg"),
        ((0.45, -1.8, 0.0), (0.45, -1.8, 0.0), 3.3, 3.3, (3.6, 1.0, 1.15), 0.7, "leg"),
        ((0.32, 1.4, 1.1), (0.32, 1.4, 1.1), 2.7, 2.7, (3.8, 1.0, 1.0), 0.7, "leg"),
        ((0.70, -2.0, 0), (0.98, -2.9, 0), 1.8, 1.5, _ROUND, 0.7, "bone"),
        ((0.98, 0.0, 2.2), (0.98, 0.3, -2.2), 2.3, 2.3, _ROUND, 0.7, "bone"),
    ],
    "shaft": [
        ((0.66, -0.4, 0), (1.02, -0.3, 0), 4.9, 4.5, _ROUND, 0.7, "dress"),
    ],
    "foot": [
        # Ahead as a share of the way from heel to ball, up from the sole, outwards.
        ((0.12, 3.6, 0.0), (0.12, 3.6, 0.0), 4.1, 4.1, (1.1, 1.05, 0.92), 0.8, "dress"),
        ((0.15, 7.5, 0.0), (0.55, 4.2, -0.2), 4.3, 4.2, (1.0, 0.95, 0.95), 0.9, "dress"),
        ((0.45, 3.0, 0.2), (0.98, 2.6, 0.2), 4.1, 4.5, (1.0, 0.82, 1.0), 0.9, "dress"),
        ((1.0, 2.5, 0.0), (1.24, 2.3, -0.6), 4.5, 3.8, (1.0, 0.72, 1.0), 0.8, "dress"),
    ],
}  # fmt: skip

_SCALES: dict[str, dict[str, float]] = {
    "male": {"breast": 0.0, "bun": 0.0, "belly": 0.80},
    "female": {
        "pec": 0.82, "abs": 0.86, "delt": 0.84, "arm": 0.84, "leg": 0.96, "waist": 0.90, "hip": 1.05, "seat": 1.06,
        "trap": 0.78, "neck": 0.82, "apple": 0.0, "jaw": 0.86, "brow": 0.72, "bone": 0.93, "muscle": 0.86, "belly": 0.8,
    },
    "lean": {"muscle": 0.92, "delt": 0.92, "arm": 0.89, "leg": 0.93, "pec": 0.90, "waist": 0.93, "seat": 0.94,
             "trap": 0.88, "neck": 0.94, "hip": 0.96, "belly": 0.92, "bone": 0.97},
    "athletic": {},
    "heavy": {"muscle": 1.08, "delt": 1.08, "arm": 1.12, "leg": 1.09, "pec": 1.10, "waist": 1.14, "seat": 1.10,
              "trap": 1.15, "neck": 1.14, "hip": 1.09, "belly": 1.42, "abs": 1.02, "bone": 1.06, "jaw": 1.12},
}  # fmt: skip
"""Factors of radii of what shapes are."""


def sculpt(binding: Binding, build: Build) -> tuple[Shapes, list[str]]:
    """Return the shapes of a body in its binding pose, and the segment of each group."""
    made = _Made(binding, build)
    for row in _TRUNK:
        made.add("trunk", *row)
    for row in _HEAD:
        made.add("head", *row)
    hands = "glove" if build.hands == "gloves" else "fist"
    for name, rows in _LIMBS.items():
        if name in ("glove", "fist") and name != hands:
            continue
        segment = {"glove": "hand", "fist": "hand", "shaft": "shank"}.get(name, name)
        for row in rows:
            for side in ("left", "right"):
                made.add(f"{side}_{segment}", *row)
    return made.finish()


@dataclass
class _Made:
    binding: Binding
    build: Build
    rows: list[tuple[Array, Array, float, float, Array, float, float, int]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def add(
        self, name: str, start: Triple, end: Triple, first: float, last: float, stretch: Triple, blend: float, what: str
    ) -> None:
        scale = _SCALES[self.build.sex].get(what, 1.0) * _SCALES[self.build.kind].get(what, 1.0)
        if scale == 0.0:
            return
        segment, size = self.binding.segments[name], 0.01 * self.binding.size
        if name not in self.names:
            self.names.append(name)
        both = name in ("trunk", "head") and (start[2] != 0 or end[2] != 0) and start[2] != -end[2]
        for sign in (1.0, -1.0) if both else (1.0,):
            ends = []
            for along, front, out in (start, end):
                wide = 1.0
                if name == "trunk":
                    share = float(np.clip(along, 0.0, 1.0))
                    wide = self.binding.hips * (1 - share) + self.binding.shoulders * share
                    wide *= 0.5 + 0.5 * scale if what in ("pec", "breast", "trap") else 1.0
                reach = along * (size if name == "head" else segment.length)
                grown = 1.0 + 0.6 * (scale - 1.0)
                ends.append(
                    segment.start + reach * segment.axes[0] + size * (grown * front * segment.axes[1]
                                                                      + wide * sign * out * segment.axes[2])
                )  # fmt: skip
            frame = segment.axes / np.asarray(stretch)[:, None]
            self.rows.append(
                (ends[0], ends[1], first * scale * size, last * scale * size, frame, abs(blend) * size,
                 1.0 if blend > 0 else -0.9, self.names.index(name))
            )  # fmt: skip

    def finish(self) -> tuple[Shapes, list[str]]:
        starts, ends, first, last, frames, blends, weights, groups = zip(*self.rows, strict=True)
        return (
            Shapes(np.array(starts), np.array(ends), np.stack([first, last], axis=1), np.array(frames),
                   np.array(blends), np.array(weights), np.array(groups, np.int64)),
            self.names,
        )  # fmt: skip
