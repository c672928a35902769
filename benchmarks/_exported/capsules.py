"""How deep the capsules of avatars are in one another, as pictures and clouds show them, from BVH files."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from _exported.plain_bvh import Array
from _exported.run import PELVIS, ExportedRun
from _exported.witness import PARTS

NEAR = 2.0
"""Distance of pelvises over the ground beyond which bodies do not touch, for avatars of size 1 [m]."""
SHALLOW = 0.02
"""Depth below which contacts are not kept [m]."""
ARMS = np.array([part.endswith(("arm", "fist")) for part in PARTS])
"""Whether each part is of an arm."""


@dataclass(frozen=True)
class Contacts:
    """Parts of avatars that are deeper than ``SHALLOW`` in parts of others; one row a frame, pair and pair of parts.

    Attributes:
        frames: Output frame. Shape (n,).
        one: First avatar. Shape (n,).
        other: Second avatar. Shape (n,).
        own: Part of the first, an index into ``PARTS``. Shape (n,).
        theirs: Part of the second. Shape (n,).
        depths: How deep they are in one another [m]. Shape (n,).
    """

    frames: Array
    one: Array
    other: Array
    own: Array
    theirs: Array
    depths: Array

    def rows(self, chosen: Any) -> Contacts:
        """Return some rows."""
        return Contacts(*(getattr(self, field.name)[chosen] for field in fields(Contacts)))

    def both_ways(self) -> Contacts:
        """Return each contact twice, once from either side."""
        swapped = (self.frames, self.other, self.one, self.theirs, self.own, self.depths)
        columns = [getattr(self, field.name) for field in fields(Contacts)]
        return Contacts(*(np.concatenate(pair) for pair in zip(columns, swapped, strict=True)))


def capsule_depths(p: Array, q: Array, radii: Array, r: Array, s: Array, others: Array) -> Array:
    """Return how deep capsules are in one another, negative where they are apart [m].

    Radii go evenly from one end to the other; they are taken where the axes are nearest. Shape (n,).

    Args:
        p: One end of the first [m]. Shape (n, 3).
        q: The other end. Shape (n, 3).
        radii: Radius at both ends. Shape (n, 2).
        r: One end of the second. Shape (n, 3).
        s: The other end. Shape (n, 3).
        others: Radius at both ends. Shape (n, 2).
    """
    one, two, way = q - p, s - r, p - r
    a, e, b = (np.sum(x * y, axis=1) for x, y in ((one, one), (two, two), (one, two)))
    c, f = np.sum(one * way, axis=1), np.sum(two * way, axis=1)
    square, tiny = a * e - b * b, 1e-12
    t = np.clip(np.where(square > 1e-9, (b * f - c * e) / np.maximum(square, 1e-9), 0.0), 0.0, 1.0)
    u = np.clip((b * t + f) / np.maximum(e, tiny), 0.0, 1.0)
    t = np.clip((b * u - c) / np.maximum(a, tiny), 0.0, 1.0)
    u = np.clip((b * t + f) / np.maximum(e, tiny), 0.0, 1.0)
    far = np.linalg.norm(way + one * t[:, None] - two * u[:, None], axis=1)
    own = radii[:, 0] + t * (radii[:, 1] - radii[:, 0])
    return np.asarray(own + others[:, 0] + u * (others[:, 1] - others[:, 0]) - far)


def find_contacts(run: ExportedRun) -> Contacts:
    """Compare all avatars with one another in all frames."""
    everything = np.arange(run.count)
    found = []
    for a, b in itertools.combinations(range(len(run.figures)), 2):
        near = everything[near_frames(run, a, b, everything)]
        for frames in np.array_split(near, len(near) // 1000 + 1):
            if len(frames):
                found.append(_compare(run, a, b, frames))
    columns = [np.concatenate(column) for column in zip(*found, strict=True)] if found else [np.zeros(0)] * 6
    frames, one, other, own, theirs = (column.astype(int) for column in columns[:5])
    return Contacts(frames, one, other, own, theirs, columns[5])


def touches(run: ExportedRun, avatar: int, frames: Array, room: float) -> Array:
    """Return at which of some frames (n,) any part of an avatar is nearer than ``room`` [m] to another avatar."""
    found = np.zeros(len(frames), bool)
    for other in range(len(run.figures)):
        at = np.flatnonzero(near_frames(run, avatar, other, frames) & ~found)
        if other != avatar and len(at):
            rows, _, _, depths = _depths(run, avatar, other, frames[at], room)
            found[at[rows[depths > -room]]] = True
    return found


def near_frames(run: ExportedRun, a: int, b: int, frames: Array) -> Array:
    """Return at which of some frames (n,) two avatars may touch. Shape (n,), bool."""
    ways = run.figures[a].joints[frames, PELVIS] - run.figures[b].joints[frames, PELVIS]
    return np.asarray(np.linalg.norm(ways[:, [0, 2]], axis=1) < NEAR * max(run.scales[a], run.scales[b]))


def _depths(run: ExportedRun, a: int, b: int, frames: Array, room: float) -> tuple[Array, Array, Array, Array]:
    """Index of the frame, capsules of both, and depth [m] of capsules of two avatars that may be within ``room``."""
    lengths = np.linalg.norm(np.diff(run.sizes.capsule_ends, axis=1)[:, 0], axis=1)
    radii = run.sizes.capsule_radii
    bounds = (0.5 * lengths + radii.max(axis=1)) * 1.001
    own, theirs = run.capsules[a][frames], run.capsules[b][frames]
    middles, others = own.mean(axis=2), theirs.mean(axis=2)
    reach = bounds[:, None] * run.scales[a] + bounds * run.scales[b] + room
    square = np.sum((middles[:, :, None] - others[:, None]) ** 2, axis=-1)
    at, i, j = np.nonzero(square < reach**2)
    depths = capsule_depths(
        own[at, i, 0].astype(float), own[at, i, 1].astype(float), radii[i] * run.scales[a],
        theirs[at, j, 0].astype(float), theirs[at, j, 1].astype(float), radii[j] * run.scales[b],
    )  # fmt: skip
    return at, i, j, depths


def _compare(run: ExportedRun, a: int, b: int, frames: Array) -> tuple[Array, ...]:
    """Columns of ``Contacts`` for two avatars and some frames."""
    at, i, j, depths = _depths(run, a, b, frames, 0.0)
    deep, parts = depths > SHALLOW, run.sizes.capsule_parts()
    at, i, j, depths = at[deep], parts[i[deep]], parts[j[deep]], depths[deep]
    # The deepest of the capsules of two parts.
    keys, rows = np.unique((at * len(PARTS) + i) * len(PARTS) + j, return_inverse=True)
    most = np.zeros(len(keys))
    np.maximum.at(most, rows, depths)
    at, i, j = keys // len(PARTS) ** 2, keys // len(PARTS) % len(PARTS), keys % len(PARTS)
    return frames[at], np.full(len(at), a), np.full(len(at), b), i, j, most


def deepest(contacts: Contacts, avatars: int, frames: int) -> Array:
    """Return the greatest depth of each avatar in any other [m]; 0 where there is none. Shape (N, F)."""
    found = np.zeros((avatars, frames))
    for avatar in (contacts.one, contacts.other):
        np.maximum.at(found, (avatar, contacts.frames), contacts.depths)
    return found
