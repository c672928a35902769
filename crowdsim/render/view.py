"""A camera at one moment: where the eye is, where it looks and how wide."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from crowdsim.core.types import Array

FIELD = math.radians(36.0)
"""Angle between the upper and lower edge of the picture [rad]."""
HAZE, LEAST_HAZE = 3.6, 34.0
"""Haze hides half at so many times the distance to what a camera looks at, and no nearer than this [m]."""
_APART, _FEWEST, _MOST = 2.5, 8, 64
"""How far apart the pictures through a lens lie of what is furthest out of focus [px]; fewest and most of them."""
_MIDDLE, _NEAREST = 1.0, 0.1
"""Height of the middle of an avatar, and half its extent; and least distance at which one is seen [m]."""
_ROOM = 7.0
"""How far out of view the middle of an avatar may be that is seen, or its shadow [m]."""


@dataclass(frozen=True)
class View:
    """An eye in the world.

    Attributes:
        eye: Its position [m]. Shape (3,).
        ahead: Unit direction in which it looks. Shape (3,).
        right: Unit direction to the right of the picture. Shape (3,).
        distance: How far away what it looks at is [m].
        field: Angle between the upper and lower edge of the picture [rad].
        aperture: Radius of the opening of the lens [m]; 0 where everything is sharp.
        focus: Distance at which the picture is sharp [m]; that of what it looks at when None.
        sees_through: Whether obstacles that hide avatars are left out.
    """

    eye: Array
    ahead: Array
    right: Array
    distance: float = 25.0
    field: float = FIELD
    aperture: float = 0.0
    focus: float | None = None
    sees_through: bool = False

    @property
    def haze(self) -> float:
        """Distance at which haze hides half of what is seen [m]."""
        return max(HAZE * self.distance, LEAST_HAZE)

    def through_lens(self, height: int) -> list[View]:
        """Return views from points of the lens that look at one point in focus; their mean has depth of field.

        Args:
            height: Height of the picture [px].
        """
        if self.aperture <= 0.0:
            return [self]
        focus = self.distance if self.focus is None else self.focus
        blur = self.aperture * height / math.tan(0.5 * self.field) / focus
        count = min(max(math.ceil((blur / _APART) ** 2), _FEWEST), _MOST)
        up, point, views = np.cross(self.right, self.ahead), self.eye + focus * self.ahead, []
        for k in range(count):
            radius, angle = self.aperture * math.sqrt((k + 0.5) / count), k * math.pi * (3.0 - math.sqrt(5.0))
            eye = self.eye + radius * (math.cos(angle) * self.right + math.sin(angle) * up)
            ahead = (point - eye) / np.linalg.norm(point - eye)
            right = np.cross(ahead, up)
            views.append(replace(self, eye=eye, ahead=ahead, right=right / np.linalg.norm(right), aperture=0.0))
        return views

    def pack(self, width: int, height: int) -> Array:
        """Return the camera as the kernels want it for a picture of this size. Shape (16,), see ``draw_tiles``."""
        up = np.cross(self.right, self.ahead)
        focal = 0.5 * height / math.tan(0.5 * self.field)
        return np.concatenate(
            [self.eye, self.right, up, self.ahead, [focal, 0.5 * width, 0.5 * height, self.haze]]
        ).astype(np.float64)

    def scales(self, ground: Array, size: tuple[int, int]) -> Array:
        """Return at how many pixels a metre avatars show at the most, 0 where neither they nor their shadows do.

        Args:
            ground: Their ground transforms. Shape (N, 3).
            size: Width and height of the picture [px].

        Returns:
            Shape (N,).
        """
        packed, beside = self.pack(*size), np.array([0.5 * size[0], 0.5 * size[1]])
        focal = packed[12]
        away = np.stack([ground[:, 0], np.full(len(ground), _MIDDLE), ground[:, 1]], axis=1) - self.eye
        right, up, ahead = (away @ packed[3:12].reshape(3, 3).T).T
        tangents = beside / focal
        room = _ROOM * np.sqrt(1.0 + tangents**2)
        there = (ahead > -_ROOM) & (np.abs(right) - tangents[0] * ahead < room[0])
        there &= np.abs(up) - tangents[1] * ahead < room[1]
        return np.where(there, focal / np.maximum(ahead - _MIDDLE, _NEAREST), 0.0)


def directions(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """Return right, up and ahead of an eye that looks down by ``elevation`` [rad] towards heading ``azimuth`` [rad]."""
    sin, cos = math.sin(azimuth), math.cos(azimuth)
    low, level = math.sin(elevation), math.cos(elevation)
    right = np.array([-cos, 0.0, sin])
    ahead = np.array([sin * level, -low, cos * level])
    return right, np.cross(right, ahead), ahead


def look_at(eye: Array, target: Array, field: float = FIELD, distance: float | None = None) -> View:
    """Return the view of an eye that looks at a target, ahead (+z) where it is there itself; both shapes (3,) [m].

    Args:
        eye: The eye.
        target: The target.
        field: Angle between the upper and lower edge of the picture [rad].
        distance: How far away what it looks at is [m]; the target when None.
    """
    ahead = np.asarray(target, float) - np.asarray(eye, float)
    away = np.linalg.norm(ahead)
    ahead = ahead / away if away > 1e-9 else np.array([0.0, 0.0, 1.0])
    azimuth = math.atan2(ahead[0], ahead[2])
    right = np.array([-math.cos(azimuth), 0.0, math.sin(azimuth)])
    return View(np.asarray(eye, float), ahead, right, float(away) if distance is None else distance, field)
