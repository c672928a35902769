"""Quaternions as numpy arrays ``(..., 4)``, wxyz, unit length; everything broadcasts.

The convention is active: ``rotate(q, v)`` rotates the vector ``v``. Compiled code keeps its own scalar forms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crowdsim.core.types import Array

ArrayLike = Any
"""What numpy makes an array of; its own type does not let a parameter become that array under its name."""

AXES = {"X": 0, "Y": 1, "Z": 2}


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the product a b: rotation by b, then by a. Shapes (..., 4)."""
    a, b = np.asarray(a), np.asarray(b)
    aw, ax, ay, az, bw, bx, by, bz = (q[..., k] for q in (a, b) for k in range(4))
    return _joined(
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: ArrayLike) -> Array:
    """Return the inverse of unit quaternions. Shape (..., 4)."""
    return np.asarray(q) * np.array([1.0, -1.0, -1.0, -1.0], dtype=np.asarray(q).dtype)


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Rotate vectors v (..., 3) by quaternions q (..., 4)."""
    q, v = np.asarray(q), np.asarray(v)
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * cross(u, v)
    return v + w * t + cross(u, t)


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the cross product of vectors (..., 3), sooner than numpy does for short arrays."""
    a, b = np.asarray(a), np.asarray(b)
    ax, ay, az, bx, by, bz = a[..., 0], a[..., 1], a[..., 2], b[..., 0], b[..., 1], b[..., 2]
    return _joined(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def _joined(*parts: Array) -> Array:
    """Return components (...,) of one type as vectors (..., n), sooner than ``np.stack`` does for short arrays."""
    joined = np.empty((*parts[0].shape, len(parts)), parts[0].dtype)
    for k, part in enumerate(parts):
        joined[..., k] = part
    return joined


def normalise(q: ArrayLike) -> Array:
    """Return quaternions of unit length. Shape (..., 4)."""
    q = np.asarray(q)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def continuous(q: ArrayLike, axis: int = 0) -> Array:
    """Flip signs so that neighbours along ``axis`` lie in the same half of the sphere. Shape (..., 4)."""
    q = np.moveaxis(np.array(q), axis, 0)
    dots = np.sum(q[1:] * q[:-1], axis=-1)
    signs = np.cumprod(np.where(dots < 0.0, -1.0, 1.0), axis=0)
    q[1:] *= signs[..., None]
    return np.moveaxis(q, 0, axis)


def from_rotation_vector(v: ArrayLike) -> Array:
    """Return the rotation by ``|v|`` [rad] about ``v`` (..., 3). Shape (..., 4)."""
    v = np.asarray(v, dtype=float)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * v], axis=-1)


def to_rotation_vector(q: ArrayLike) -> Array:
    """Return the shortest rotation vector [rad] of unit quaternions (..., 4). Shape (..., 3)."""
    q = np.asarray(q, dtype=float)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    return np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0) * q[..., 1:]


def between(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the smallest rotation that takes direction a to direction b (..., 3). Shape (..., 4)."""
    a = np.asarray(a, dtype=float)
    b = np.asarray(b, dtype=float)
    a = a / np.linalg.norm(a, axis=-1, keepdims=True)
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    real = 0.5 * np.sum((a + b) ** 2, axis=-1, keepdims=True)  # 1 + a.b, without its cancellation near opposites
    q = np.concatenate([real, np.cross(a, b)], axis=-1)
    other = np.where(np.abs(a[..., :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    opposite = np.concatenate([np.zeros_like(real), np.cross(a, other)], axis=-1)
    return normalise(np.where(real < 1e-20, opposite, q))


def slerp(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> Array:
    """Interpolate on the shorter arc from a to b (..., 4) by t in 0..1, which broadcasts against their leading axes."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    t = np.asarray(t, dtype=float)[..., None]
    dot = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(dot < 0.0, -b, b)
    angle = np.arccos(np.clip(np.abs(dot), -1.0, 1.0))
    near = angle < 1e-6
    sine = np.where(near, 1.0, np.sin(angle))
    wa = np.where(near, 1.0 - t, np.sin((1.0 - t) * angle) / sine)
    wb = np.where(near, t, np.sin(t * angle) / sine)
    return normalise(wa * a + wb * b)


def about_y(angle: ArrayLike) -> Array:
    """Return the rotation about +y by ``angle`` [rad], which is a heading. Shape (..., 4)."""
    half = np.asarray(angle, dtype=float) * 0.5
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, np.sin(half), zero], axis=-1)


def from_euler(angles: ArrayLike, order: str) -> Array:
    """Return quaternions of intrinsic Euler angles [rad] (..., len(order)), applied in the letters' order, 'ZXY' say.

    Intrinsic means that each rotation is about the axes as the ones before it left them, which is how BVH reads.
    """
    angles = np.asarray(angles, dtype=float)
    q = np.zeros((*angles.shape[:-1], 4))
    q[..., 0] = 1.0
    for column, letter in enumerate(order):
        half = angles[..., column] * 0.5
        one = np.zeros_like(q)
        one[..., 0] = np.cos(half)
        one[..., 1 + AXES[letter]] = np.sin(half)
        q = multiply(q, one)
    return q
