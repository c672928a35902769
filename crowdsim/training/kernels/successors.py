"""Where a target is seen after an action (``model.Model``): found where it is used, which costs less than keeping it.

Single precision throughout, in loops without calls or branches, which vectorise.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel
from crowdsim.policy.kernels.axes import Corners, find_layers_after

DISTANCE, BEARING = range(2)  # of ``Model.axes``

GROUND_AXIS = np.dtype([(name, np.float32) for name in ("first", "per_step", "count", "rate", "wraps", "stride")])
"""An axis over the ground: first point (squeezed), points a unit, count, rate, whether it wraps, stride in a table."""

END = np.dtype([(name, np.float32) for name in ("left", "ahead", "cos", "sin", "turn", "frames", "side")])
"""The ground frame where an action ends: what is added to a position along x and z [m], with the distance that the
target goes meanwhile; cosine and sine of the heading, and the heading [rad]; control frames that the action takes; -1
where it ends in the mirror image of a state, else 1. It is an ``axis.End``."""


class Layers(NamedTuple):
    """What L layers of a grid see of a target, where that changes while the avatar acts or says how the target moves.

    Attributes:
        axes: The axes of the layers, ``records.AXIS``; none where nothing changes.
        values: What these measure of the target of each layer. Shape (L, axes).
        runs: Layers from which on the target moves in another way than in the layer before, and L. Shape (R + 1,),
            int64; empty where no axis says how it moves.
        vxs: How far the target of each cell moves in a control frame, to the left [m]. Shape (C,), float32; empty as
            ``runs`` is.
        vzs: Ahead.
        lasts: For how many control frames; float32.
    """

    axes: Any
    values: Any
    runs: Any
    vxs: Any
    vzs: Any
    lasts: Any


class Successors(NamedTuple):
    """Where the targets of M moving cells are seen after an action; scratch space.

    Attributes:
        lowers: Cell of a table at the lower corner on both axes. Shape (M,), int32.
        steps: Cells from there to the corner with the next bearing. Shape (M,), int32.
        far: Share of the next distance. Shape (M,), float32.
        around: Share of the next bearing. Shape (M,), float32.
        xs: Where they are once they have moved, to the left [m]. Shape (M,), float32.
        zs: Ahead.
        corners: ``Corners`` of layers.
    """

    lowers: Any
    steps: Any
    far: Any
    around: Any
    xs: Any
    zs: Any
    corners: Any


@kernel(allocates=True)
def empty_successors(count):
    """Return scratch space for some moving cells."""
    return Successors(
        np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.float32), np.empty(count, np.float32),
        np.empty(count, np.float32), np.empty(count, np.float32),
        Corners(np.empty(64, np.int64), np.empty(64)),
    )  # fmt: skip


@kernel(inline=True)
def bearing_of(x, z):
    """Return atan2(x, z), with an error below 3e-6 (Hastings, "Approximations for digital computers", 1955)."""
    aside, along = abs(x), abs(z)
    ratio = min(aside, along) / max(max(aside, along), np.float32(1e-30))
    square = ratio * ratio
    angle = np.float32(-0.01172120) * square + np.float32(0.05265332)
    angle = angle * square + np.float32(-0.11643287)
    angle = angle * square + np.float32(0.19354346)
    angle = angle * square + np.float32(-0.33262347)
    angle = (angle * square + np.float32(0.99997726)) * ratio
    angle = np.float32(math.pi / 2) - angle if aside > along else angle
    angle = np.float32(math.pi) - angle if z < np.float32(0.0) else angle
    return -angle if x < np.float32(0.0) else angle


@kernel
def find_successors(axes, end, xs, zs, found):
    """Write where targets over (xs, zs) are seen from the end of an action to ``found`` (``Successors``).

    Args:
        axes: ``Model.axes``.
        end: The action's record of ``Model.ends``.
        xs: Where the targets are, to the left [m]. Shape (M,), float32.
        zs: Ahead.
        found: Written.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    left, ahead, cos, sin, side = end.left, end.ahead, end.cos, end.sin, end.side
    nearest, rate, rings = axes[DISTANCE].first, axes[DISTANCE].rate, axes[DISTANCE].per_step
    farthest = axes[DISTANCE].count - one
    least, sectors, count = axes[BEARING].first, axes[BEARING].per_step, axes[BEARING].count
    across, along = axes[DISTANCE].stride, axes[BEARING].stride
    wraps = axes[BEARING].wraps != zero
    last = count - one
    period, limit = (count, count) if wraps else (zero, last)
    below, before = max(farthest - one, zero), last if wraps else max(last - one, zero)
    for i in range(len(xs)):
        m = np.uint64(i)
        dx, dz = xs[m] + left, zs[m] + ahead
        x, z = side * (dx * cos - dz * sin), dx * sin + dz * cos
        distance = np.float32(math.sqrt(x * x + z * z))
        place = min(max((distance / (one + rate * distance) - nearest) * rings, zero), farthest)
        ring = np.float32(np.int32(min(place, below)))
        found.far[m] = place - ring
        place = (bearing_of(x, z) - least) * sectors
        place = place + period if place < zero else place
        place = place - period if place > limit else place
        place = min(max(place, zero), limit)
        sector = np.float32(np.int32(min(place, before)))
        found.around[m] = place - sector
        found.lowers[m] = np.int32(ring * across + sector * along)
        found.steps[m] = np.int32(along if sector < last else along - along * count)


@kernel(inline=True)
def corners_of(found, m, across):
    """Return the four cells around a successor: with the lower or upper distance, for the lower, then upper bearing."""
    lower = np.int64(found.lowers[m])
    upper = lower + np.int64(found.steps[m])
    return np.uint64(lower), np.uint64(lower + across), np.uint64(upper), np.uint64(upper + across)


@kernel(inline=True)
def weights_of(found, m, total):
    """Return the weights of the corners (``corners_of``), which add up to ``total``."""
    far, around = total * found.far[m], total * found.around[m]
    both = far * found.around[m]
    return total - far - around + both, far - both, around - both, both


@kernel
def find_successor(model, outcome, action, m, found):
    """Write where the target of one moving cell is seen after an action as the only entry of ``found``."""
    find_successors(model.axes, model.ends[outcome, action], model.xs[m : m + 1], model.zs[m : m + 1], found)


@kernel(allocates=True)
def list_corners(axes, ends, xs, zs, cells, weights):
    """Write the corners around the successors of targets over (xs, zs), and their weights.

    Args:
        axes: ``Model.axes``.
        ends: ``Model.ends``. Shape (O, A).
        xs: Where the targets are, to the left [m]. Shape (M,), float32.
        zs: Ahead.
        cells: Written: cells of a table, in its first layer. Shape (O, A, M, 4).
        weights: Written: their weights, which add up to 1. Shape (O, A, M, 4).
    """
    across, one, found = np.int64(axes[DISTANCE].stride), np.float32(1.0), empty_successors(len(xs))
    for outcome in range(ends.shape[0]):
        for action in range(ends.shape[1]):
            find_successors(axes, ends[outcome, action], xs, zs, found)
            for m in range(len(xs)):
                row, shares = cells[outcome, action, m], weights[outcome, action, m]
                row[0], row[1], row[2], row[3] = corners_of(found, m, across)
                shares[0], shares[1], shares[2], shares[3] = weights_of(found, m, one)


@kernel
def find_moved(model, layers, layer, end, found):
    """Do what ``find_successors`` does for targets that move as those of a layer of a ``SweepModel`` do."""
    frames = min(end.frames, model.layered.lasts)
    for m in range(len(model.xs)):
        c = m * layers + layer
        found.xs[m] = model.xs[m] + frames * model.layered.vxs[c]
        found.zs[m] = model.zs[m] + frames * model.layered.vzs[c]
    find_successors(model.axes, end, found.xs, found.zs, found)


@kernel
def see_layers(layered, end, layers, values, corners, later):
    """Write the values of a state as an avatar reads them that comes there by an action, where layers change with it.

    Args:
        layered: ``Layers``.
        end: The action's record of ``Model.ends``.
        layers: Layers of the grid.
        values: V of the state. Shape (C,), float32.
        corners: Scratch space, ``Corners``.
        later: Written: in each cell, what is read of the layers around the one that the target is seen in afterwards.
            Shape (C,), float32.
    """
    for c in range(len(later)):
        later[c] = np.float32(0.0)
    for h in range(layers):
        for corner in range(find_layers_after(layered.axes, layered.values[h], end, corners)):
            weight, source = np.float32(corners.weights[corner]), corners.cells[corner]
            if weight > np.float32(0.0):
                for m in range(0, len(later), layers):
                    later[m + h] += weight * values[m + source]
