"""Compiled point clouds: points that ride on joints, in the world."""

import math
from typing import NamedTuple

from crowdsim.body.kernels import carry_skin
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


class SkinRiders(NamedTuple):
    """Points on the triangles of a skin, each between three corners; K points.

    Attributes:
        joints: Joints and helpers that carry each corner. Shape (K, 3, 4).
        weights: How much. Shape (K, 3, 4).
        positions: Corners in the binding pose [m]. Shape (K, 3, 3).
        normals: Their normals. Shape (K, 3, 3).
        shares: Share of each corner. Shape (K, 3).
        labels: Joint that each point is counted to. Shape (K,).
    """

    joints: Array
    weights: Array
    positions: Array
    normals: Array
    shares: Array
    labels: Array


class Frames(NamedTuple):
    """What carries the skin of an avatar; C joints and helpers.

    Attributes:
        growths: From the skin as built to that of the avatar, in the binding pose. Shape (C, 3, 4).
        slopes: Inverses of their linear part, which normals follow, transposed. Shape (C, 3, 3).
        bindings: From the binding pose into the frames of joints and helpers. Shape (C, 3, 4).
        parents: Parent of each joint. Shape (J,).
        helpers: Elbow or knee of each helper. Shape (C - J,).
        straights: From the frame of a helper's joint to its parent's in the binding pose. Shape (C - J, 4).
    """

    growths: Array
    slopes: Array
    bindings: Array
    parents: Array
    helpers: Array
    straights: Array


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


@kernel(inline=True)
def _neighbours(bodies, when, n):
    """Return the rows between which an avatar's velocity is taken, and by how much differences count [1/s]."""
    low = when.before if math.isfinite(bodies.positions[when.before, n, 0, 0]) else when.frame
    high = when.after if math.isfinite(bodies.positions[when.after, n, 0, 0]) else when.frame
    return low, high, 1.0 / (when.seconds * (high - low)) if high > low else 0.0


@kernel
def _measure_joints(bodies, when, n, motions):
    """Write how an avatar's joints carry their points: position and normal matrices, velocity matrix and shift."""
    frame = when.frame
    low, high, rate = _neighbours(bodies, when, n)
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


@kernel
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


@kernel(inline=True)
def _apply(matrix, x, y, z):
    """Return a point that a matrix (3, 4) has moved."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3],
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3],
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3],
    )


@kernel
def place_skin_points(bodies, when, n, riders, frames, matrices, values, labels):
    """Put the points on the skin of an avatar into the world, with normals, velocities and joints.

    Velocities are as of ``place_points``.

    Args:
        bodies: A ``Bodies``.
        when: A ``When``.
        n: Which of the bodies it is.
        riders: A ``SkinRiders``.
        frames: A ``Frames``.
        matrices: Scratch. Shape (3, C, 3, 4).
        values: Written: position [m], normal, velocity [m/s] of every point. Shape (K, 9).
        labels: Written in its last column: joint of every point. Shape (K, 3).
    """
    low, high, rate = _neighbours(bodies, when, n)
    for part in range(3):
        row = when.frame if part == 0 else (low if part == 1 else high)
        carry_skin(
            bodies.positions[row, n],
            bodies.rotations[row, n],
            float(bodies.scales[n]),
            frames.bindings,
            frames.parents,
            frames.helpers,
            frames.straights,
            matrices[part],
        )
    for i in range(riders.shares.shape[0]):
        value = values[i]
        for k in range(9):
            value[k] = 0.0
        for corner in range(3):
            share = riders.shares[i, corner]
            at, normal = riders.positions[i, corner], riders.normals[i, corner]
            x, y, z, u, v, w, p, q, r = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for slot in range(4):
                joint, weight = riders.joints[i, corner, slot], float(riders.weights[i, corner, slot])
                a, b, c = _apply(frames.growths[joint], float(at[0]), float(at[1]), float(at[2]))
                x, y, z = x + weight * a, y + weight * b, z + weight * c
                slope = frames.slopes[joint]
                u += weight * (slope[0, 0] * normal[0] + slope[0, 1] * normal[1] + slope[0, 2] * normal[2])
                v += weight * (slope[1, 0] * normal[0] + slope[1, 1] * normal[1] + slope[1, 2] * normal[2])
                w += weight * (slope[2, 0] * normal[0] + slope[2, 1] * normal[1] + slope[2, 2] * normal[2])
            for slot in range(4):
                joint, weight = riders.joints[i, corner, slot], float(riders.weights[i, corner, slot])
                here = matrices[0, joint]
                before, after = _apply(matrices[1, joint], x, y, z), _apply(matrices[2, joint], x, y, z)
                place = _apply(here, x, y, z)
                for k in range(3):
                    value[k] += share * weight * place[k]
                    value[6 + k] += share * weight * rate * (after[k] - before[k])
                p += weight * (here[0, 0] * u + here[0, 1] * v + here[0, 2] * w)
                q += weight * (here[1, 0] * u + here[1, 1] * v + here[1, 2] * w)
                r += weight * (here[2, 0] * u + here[2, 1] * v + here[2, 2] * w)
            share /= max(math.sqrt(p * p + q * q + r * r), 1e-12)
            value[3], value[4], value[5] = value[3] + share * p, value[4] + share * q, value[5] + share * r
        length = max(math.sqrt(value[3] * value[3] + value[4] * value[4] + value[5] * value[5]), 1e-12)
        for k in range(3):
            value[3 + k] /= length
        labels[i, 2] = riders.labels[i]
