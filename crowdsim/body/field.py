"""The smooth union of rounded cones and ellipsoids as a field, positive inside.

The field of a point is the logarithm of the sum over shapes of w exp(-d / k), with the distance d to the shape, the
width k of its blend, and its weight w, which is negative for dents.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from crowdsim.core.types import Array

_FAR = 5.0
"""Distance in widths of the blend from which a shape counts for nothing."""
_EMPTY = 1e-4


@dataclass(frozen=True)
class Shapes:
    """Rounded cones, stretched along axes of their own; S of them.

    Attributes:
        starts: One end of the axis [m]. Shape (S, 3).
        ends: The other end. Shape (S, 3).
        radii: Radius at both ends, across the first of the stretched axes [m]. Shape (S, 2).
        frames: From the world to the frame in which the shape is round: unit axes over their stretch. Shape (S, 3, 3).
        blends: Width of the blend with other shapes [m]. Shape (S,).
        weights: 1, or negative for dents. Shape (S,).
        groups: What each belongs to. Shape (S,), int64.
    """

    starts: Array
    ends: Array
    radii: Array
    frames: Array
    blends: Array
    weights: Array
    groups: Array

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """The boxes out of which shapes count for nothing: their lowest and highest corners. Shape (S, 3) each."""
        reach = self.radii.max(axis=1)[:, None] * np.linalg.norm(np.linalg.inv(self.frames), axis=2)
        reach += _FAR * self.blends[:, None]
        return np.minimum(self.starts, self.ends) - reach, np.maximum(self.starts, self.ends) + reach

    def distance(self, shape: int, points: Array) -> tuple[Array, Array]:
        """Return the distance (n,) of points to a shape to first order, and its gradient (n, 3)."""
        frame = self.frames[shape]
        own = (points - self.starts[shape]) @ frame.T
        axis = frame @ (self.ends[shape] - self.starts[shape])
        squared = float(axis @ axis)
        along = np.clip(own @ axis / squared, 0.0, 1.0) if squared > 1e-12 else np.zeros(len(own))
        away = own - along[:, None] * axis
        gap = np.maximum(np.sqrt(np.einsum("ij,ij->i", away, away)), 1e-9)
        radius = self.radii[shape, 0] + along * (self.radii[shape, 1] - self.radii[shape, 0])
        slope = (away / gap[:, None]) @ frame
        steep = np.maximum(np.sqrt(np.einsum("ij,ij->i", slope, slope)), 1e-9)
        return (gap - radius) / steep, slope / steep[:, None]


def evaluate(shapes: Shapes, points: Array) -> tuple[Array, Array]:
    """Return an estimate of the distance (n,) [m] of points to the surface, negative inside, and its normal (n, 3)."""
    total, slope = np.full(len(points), _EMPTY), np.zeros((len(points), 3))
    lows, highs = shapes.bounds
    x, y, z = np.ascontiguousarray(points.T)
    for shape, ((a, b, c), (d, e, f)) in enumerate(zip(lows, highs, strict=True)):
        near = np.flatnonzero((x > a) & (x < d) & (y > b) & (y < e) & (z > c) & (z < f))
        gap, normal = shapes.distance(shape, points[near])
        share = shapes.weights[shape] * np.exp(np.minimum(-gap / shapes.blends[shape], 60.0))
        total[near] += share
        slope[near] += (share / shapes.blends[shape])[:, None] * normal
    steep = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
    inside = np.maximum(total, _EMPTY)
    return -np.log(inside) * inside / steep, slope / steep[:, None]


def group_distances(shapes: Shapes, points: Array, count: int) -> Array:
    """Return the distance of points to the nearest shape of each group [m]. Shape (n, count)."""
    found = np.full((len(points), count), np.inf)
    for shape in np.flatnonzero(shapes.weights > 0):
        gap, _ = shapes.distance(int(shape), points)
        np.minimum(found[:, shapes.groups[shape]], gap, out=found[:, shapes.groups[shape]])
    return found


def sample(shapes: Shapes, spacing: float) -> tuple[Array, Array]:
    """Return the field on a grid, shape (X, Y, Z), float32, and the place of its first point [m]."""
    lows, highs = shapes.bounds
    low, high = lows.min(axis=0) - 2 * spacing, highs.max(axis=0) + 2 * spacing
    sizes = np.ceil((high - low) / spacing).astype(int) + 1
    total = np.full(sizes, _EMPTY, np.float32)
    firsts = np.maximum(np.floor((lows - low) / spacing).astype(int), 0)
    lasts = np.minimum(np.ceil((highs - low) / spacing).astype(int) + 1, sizes)
    for shape, (first, last) in enumerate(zip(firsts, lasts, strict=True)):
        axes = [low[axis] + spacing * np.arange(first[axis], last[axis]) for axis in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        gap, _ = shapes.distance(shape, points)
        share = shapes.weights[shape] * np.exp(np.minimum(-gap / shapes.blends[shape], 60.0))
        here = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        total[here] += share.reshape(last - first).astype(np.float32)
    return np.log(np.maximum(total, _EMPTY)), low
