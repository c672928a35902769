"""Compiled point clouds: points that ride on joints, in the world."""

import math
from typing import NamedTuple

from crowdsim.core.types import Array
from crowdsim.jit import kernel

MOTION_COLUMNS = 21
"""What ``place_points`` keeps of a joint: two matrices and a velocity."""


class Riders(NamedTuple):
    """Points of a body, each riding on a joint; K points.

    Attributes:
        joints: Joint of each point. Shape (K,).
        positions: Position in that joint's frame [m]. Shape (K, 3).
        normals: Outward normal there. Shape (K, 3).
        swells: Where it goes for each unit of girth [m]. Shape (K, 3).
        cores: Where it goes for each unit of length of its bone [m]. Shape (K, 3).
        segments: Which bone that is. Shape (K,).
    """

    joints: Array
    positions: Array
    normals: Array
    swells: Array
    cores: Array
    segments: Array


class Bodies(NamedTuple):
    """Joints in the world of n avatars at T times.

    Attributes:
        positions: NaN while absent [m]. Shape (T, n, J, 3).
        rotations: Shape (T, n, J, 4).
        scales: Body sizes. Shape (n,).
        girths: How thick trunks and limbs are for their length. Shape (n,).
        stretches: How long bones of trunks, legs and arms are for the size of the body. Shape (n, 3).
    """

    positions: Array
    rotations: Array
    scales: Array
    girths: Array
    stretches: Array


class When(NamedTuple):
    """The rows of a frame and its neighbours.

    Attributes:
        before: Row of the earlier neighbour.
        frame: Row of the frame.
        after: Row of the later neighbour.
        seconds: Time from a row to the next [s].
    """

    before: int
    frame: int
    after: int
    seconds: float


class Wanted(NamedTuple):
    """Avatars of a cloud, all there at its frame; c of them.

    Attributes:
        columns: Which of the bodies each is. Shape (c,).
        numbers: Number of the avatar. Shape (c,), int32.
        teams: Its team. Shape (c,), int32.
    """

    columns: Array
    numbers: Array
    teams: Array


@kernel(inline=True)
def _matrix(q, scale):
    """Return the matrix of a rotation times a scale, row by row."""
    w, x, y, z = float(q[0]), float(q[1]), float(q[2]), float(q[3])
    return (
        scale * (1.0 - 2.0 * (y * y + z * z)), scale * 2.0 * (x * y - w * z), scale * 2.0 * (x * z + w * y),
        scale * 2.0 * (x * y + w * z), scale * (1.0 - 2.0 * (x * x + z * z)), scale * 2.0 * (y * z - w * x),
        scale * 2.0 * (x * z - w * y), scale * 2.0 * (y * z + w * x), scale * (1.0 - 2.0 * (x * x + y * y)),
    )  # fmt: skip


@kernel(allocates=False)
def _measure_joints(bodies, when, n, motions):
    """Write how an avatar's joints carry their points: position and normal matrices, velocity matrix and shift."""
    frame = when.frame
    low = when.before if math.isfinite(bodies.positions[when.before, n, 0, 0]) else frame
    high = when.after if math.isfinite(bodies.positions[when.after, n, 0, 0]) else frame
    rate = 1.0 / (when.seconds * (high - low)) if high > low else 0.0
    scale = float(bodies.scales[n])
    for j in range(motions.shape[0]):
        rotation = _matrix(bodies.rotations[frame, n, j], 1.0)
        here = _matrix(bodies.rotations[low, n, j], scale * rate)
        there = _matrix(bodies.rotations[high, n, j], scale * rate)
        for k in range(9):
            motions[j, k] = rotation[k]
            motions[j, 9 + k] = there[k] - here[k]
        for k in range(3):
            motions[j, 18 + k] = rate * (float(bodies.positions[high, n, j, k]) - float(bodies.positions[low, n, j, k]))


@kernel(allocates=False)
def place_points(bodies, when, wanted, riders, motions, values, labels):
    """Put the points of some avatars into the world, with normals, velocities and labels.

    Velocities are differences between the rows before and after; where the avatar is absent in one of them, or they
    are one row, only as far as the frame.

    Args:
        bodies: A ``Bodies``.
        when: A ``When``.
        wanted: A ``Wanted``.
        riders: A ``Riders``.
        motions: Scratch. Shape (J, MOTION_COLUMNS).
        values: Written: position [m], normal, velocity [m/s] of every point, avatar by avatar. Shape (c K, 9).
        labels: Written: avatar, team and joint of every point. Shape (c K, 3).
    """
    row = 0
    for c in range(wanted.columns.shape[0]):
        n = wanted.columns[c]
        scale, more = float(bodies.scales[n]), float(bodies.girths[n]) - 1.0
        _measure_joints(bodies, when, n, motions)
        for i in range(riders.joints.shape[0]):
            j, at, swell, normal = riders.joints[i], riders.positions[i], riders.swells[i], riders.normals[i]
            core, long = riders.cores[i], float(bodies.stretches[n, riders.segments[i]]) - 1.0
            own = (
                at[0] + more * swell[0] + long * core[0],
                at[1] + more * swell[1] + long * core[1],
                at[2] + more * swell[2] + long * core[2],
            )
            motion, position, value, label = motions[j], bodies.positions[when.frame, n, j], values[row], labels[row]
            for k in range(3):
                x, y, z = motion[3 * k], motion[3 * k + 1], motion[3 * k + 2]
                value[k] = position[k] + scale * (x * own[0] + y * own[1] + z * own[2])
                value[3 + k] = x * normal[0] + y * normal[1] + z * normal[2]
                x, y, z = motion[9 + 3 * k], motion[10 + 3 * k], motion[11 + 3 * k]
                value[6 + k] = motion[18 + k] + (x * own[0] + y * own[1] + z * own[2])
            label[0], label[1], label[2] = wanted.numbers[c], wanted.teams[c], j
            row += 1
