"""Compiled point clouds: points that ride on joints, in the world."""

import math
from typing import NamedTuple

from crowdsim.core.quaternions import rotate
from crowdsim.core.types import Array
from crowdsim.jit import kernel


class Riders(NamedTuple):
    """Points of a body, each riding on a joint; K points.

    Attributes:
        joints: Joint of each point. Shape (K,).
        positions: Position in that joint's frame [m]. Shape (K, 3).
        normals: Outward normal there. Shape (K, 3).
    """

    joints: Array
    positions: Array
    normals: Array


class Bodies(NamedTuple):
    """Joints in the world of n avatars at T times.

    Attributes:
        positions: NaN while absent [m]. Shape (T, n, J, 3).
        rotations: Shape (T, n, J, 4).
        scales: Body sizes. Shape (n,).
    """

    positions: Array
    rotations: Array
    scales: Array


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


class Points(NamedTuple):
    """Points in the world; P of them.

    Attributes:
        positions: Positions [m]. Shape (P, 3), float32.
        normals: Shape (P, 3), float32.
        velocities: Shape (3, P), float32 [m/s].
    """

    positions: Array
    normals: Array
    velocities: Array


@kernel(allocates=False)
def _write_velocity(bodies, n, j, low, high, rate, offset, velocity):
    """Write the mean velocity of a point of a joint between two rows; zero where they are one."""
    if high <= low:
        velocity[0], velocity[1], velocity[2] = 0.0, 0.0, 0.0
        return
    here, there = bodies.positions[low, n, j], bodies.positions[high, n, j]
    lx, ly, lz = rotate(bodies.rotations[low, n, j], offset[0], offset[1], offset[2])
    hx, hy, hz = rotate(bodies.rotations[high, n, j], offset[0], offset[1], offset[2])
    velocity[0] = (there[0] - here[0] + (hx - lx)) * rate
    velocity[1] = (there[1] - here[1] + (hy - ly)) * rate
    velocity[2] = (there[2] - here[2] + (hz - lz)) * rate


@kernel(allocates=False)
def place_points(bodies, when, columns, riders, first, points):
    """Put the points of some avatars into the world, with normals and velocities.

    Velocities are differences between the rows before and after; where the avatar is absent in one of them, or they
    are one row, only as far as the frame.

    Args:
        bodies: A ``Bodies``.
        when: A ``When``.
        columns: Avatars that are wanted, all there at the frame. Shape (c,).
        riders: A ``Riders``.
        first: Row of the outputs at which the first avatar's points begin.
        points: Written, a ``Points``.

    Returns:
        One past the last row written.
    """
    row, frame = first, when.frame
    for n in columns:
        low = when.before if math.isfinite(bodies.positions[when.before, n, 0, 0]) else frame
        high = when.after if math.isfinite(bodies.positions[when.after, n, 0, 0]) else frame
        rate = 1.0 / (when.seconds * (high - low)) if high > low else 0.0
        scale = bodies.scales[n]
        for i in range(riders.joints.shape[0]):
            j, own, normal = riders.joints[i], riders.positions[i], riders.normals[i]
            offset = own[0] * scale, own[1] * scale, own[2] * scale
            position, rotation = bodies.positions[frame, n, j], bodies.rotations[frame, n, j]
            point = points.positions[row]
            x, y, z = rotate(rotation, offset[0], offset[1], offset[2])
            point[0], point[1], point[2] = position[0] + x, position[1] + y, position[2] + z
            _write_velocity(bodies, n, j, low, high, rate, offset, points.velocities[:, row])
            turned = points.normals[row]
            turned[0], turned[1], turned[2] = rotate(rotation, normal[0], normal[1], normal[2])
            row += 1
    return row
