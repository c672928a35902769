"""A slow, obvious limb solver: search the angle of the bend, then turn by scipy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation


def flexion_at(length, other, distance):
    """Flexion at which two bones have their ends so far apart, by the law of cosines [rad]."""
    cosine = (distance**2 - length**2 - other**2) / (2.0 * length * other)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def shortest_turn(way, target):
    """The shortest rotation that lays one direction along another."""
    way, target = way / np.linalg.norm(way), target / np.linalg.norm(target)
    axis = np.cross(way, target)
    if np.linalg.norm(axis) < 1e-12:
        return Rotation.identity()
    angle = np.arctan2(np.linalg.norm(axis), way @ target)
    return Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle)


def bend(upper, middle, end, hinge, target, distance, most, steps=40001):
    """Return how the upper bone turns in the world, and how the lower one does.

    The bend is about the axis that the limb is bent about, which the hinge takes over as the limb gets straight. Among
    many angles that one is taken that brings the end nearest to the distance.

    Args:
        upper: Position of the upper joint [m]. Shape (3,).
        middle: Position of the middle joint [m]. Shape (3,).
        end: Position of the end [m]. Shape (3,).
        hinge: Axis of flexion in the world. Shape (3,).
        target: Where the limb points to [m]. Shape (3,).
        distance: How far the end is from the upper joint afterwards [m].
        most: Flexion that is not exceeded [rad].
        steps: Number of angles that are tried.
    """
    bone, other = middle - upper, end - middle
    length, rest = np.linalg.norm(bone), np.linalg.norm(other)
    now = flexion_at(length, rest, np.linalg.norm(end - upper))
    wanted = min(flexion_at(length, rest, distance), max(most, now))
    normal = np.cross(bone, other) / (length * rest)
    square = hinge - bone * (hinge @ bone) / length**2
    axis = normal + max(0.0, 0.2 - np.linalg.norm(normal)) * square / np.linalg.norm(square)
    angles = np.linspace(-now, np.pi - now, steps)[:, None]
    ends = bone + Rotation.from_rotvec(angles * axis / np.linalg.norm(axis)).apply(other)
    reach = np.sqrt(length**2 + rest**2 + 2.0 * length * rest * np.cos(wanted))
    best = int(np.argmin(np.abs(np.linalg.norm(ends, axis=1) - reach)))
    swing = shortest_turn(ends[best], target - upper)
    return swing, swing * Rotation.from_rotvec(angles[best] * axis / np.linalg.norm(axis))
