"""The smooth union of rounded cones and ellipsoids as a field, positive inside.

The field of a point is the logarithm of the sum over shapes of w exp(-d / k), with the distance d to the shape, the
width k of its blend, and its weight w, which is negative for dents.
"""

from __future__ import annotations

from dataclasses import dataclass

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

    def bounds(self, shape: int, margin: float) -> tuple[Array, Array]:
        """Return the box around a shape and a margin."""
        reach = self.radii[shape].max() * np.linalg.norm(np.linalg.inv(self.frames[shape]), axis=1) + margin
        ends = np.stack([self.starts[shape], self.ends[shape]])
        return ends.min(axis=0) - reach, ends.max(axis=0) + reach

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
    for shape in range(len(shapes.starts)):
        near = _near(shapes, shape, points)
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
    boxes = [shapes.bounds(shape, _FAR * shapes.blends[shape]) for shape in range(len(shapes.starts))]
    low = np.min([box[0] for box in boxes], axis=0) - 2 * spacing
    high = np.max([box[1] for box in boxes], axis=0) + 2 * spacing
    sizes = np.ceil((high - low) / spacing).astype(int) + 1
    total = np.full(sizes, _EMPTY, np.float32)
    for shape, box in enumerate(boxes):
        first = np.maximum(np.floor((box[0] - low) / spacing).astype(int), 0)
        last = np.minimum(np.ceil((box[1] - low) / spacing).astype(int) + 1, sizes)
        axes = [low[axis] + spacing * np.arange(first[axis], last[axis]) for axis in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        gap, _ = shapes.distance(shape, points)
        share = shapes.weights[shape] * np.exp(np.minimum(-gap / shapes.blends[shape], 60.0))
        here = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        total[here] += share.reshape(last - first).astype(np.float32)
    return np.log(np.maximum(total, _EMPTY)), low


def _near(shapes: Shapes, shape: int, points: Array) -> Array:
    low, high = shapes.bounds(shape, _FAR * shapes.blends[shape])
    return np.flatnonzero(np.all((points > low) & (points < high), axis=1))
