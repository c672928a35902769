"""What stands between an eye and the points that a picture is about."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import PARTS
from crowdsim.render.figure import dress
from crowdsim.render.scene import build_cast
from crowdsim.render.source import Shown

if TYPE_CHECKING:
    from crowdsim.render.source import PoseSource

_STRIKERS = (PARTS.index("glove"), PARTS.index("shoe"))
_REACHES = 0.7
"""How far from the point of a strike the head of its victim may be [m]."""
_NEAR = 3.5
"""How far from a strike avatars may be that stand in the way [m]."""
_SCALE = 400.0
"""Pixels a metre at which avatars near a strike are posed."""
FACE = math.radians(70.0)
"""A face is the part of a head that lies within this angle of where it looks [rad]."""
PROFILE = 0.25
"""A face that looks smaller than this share of one seen straight on, as from behind, counts as hidden by its head."""
_POINTS = 24
_MARGIN = 1e-6
"""What rounding may add to a distance [m]."""


@dataclass(frozen=True)
class Strike:
    """A strike at the moment at which it reaches furthest, with the bodies around it.

    Attributes:
        frame: Its frame.
        attacker: Avatar whose fist or foot it is; -1 if none is near.
        victim: Avatar whose head is nearest; -1 if none is near.
        limb: Points all over the glove or shoe (n, 3), and the direction away from it at each (n, 3).
        face: Points all over the face of the victim and the direction away from it, likewise.
        shapes: Capsules of the avatars around. Shape (K, 8).
        limb_capsule: That of the glove or shoe.
        head_capsules: Those that are part of the victim's head.
    """

    frame: int
    attacker: int
    victim: int
    limb: tuple[Array, Array]
    face: tuple[Array, Array]
    shapes: Array
    limb_capsule: int
    head_capsules: Array

    def limb_shown(self, eyes: Array) -> Array:
        """Return which share of the limb's side that is turned towards each eye (E, 3) is seen. Shape (E,)."""
        return _share(*self.limb, eyes, np.delete(self.shapes, self.limb_capsule, axis=0), 0.0)

    def face_shown(self, eyes: Array) -> Array:
        """Return which share of the face each eye (E, 3) sees, little of one that is turned away. Shape (E,)."""
        points, normals = self.face
        least = PROFILE * float(np.linalg.norm(normals.sum(axis=0)))
        return _share(points, normals, eyes, np.delete(self.shapes, self.head_capsules, axis=0), least)


def _share(points: Array, normals: Array, eyes: Array, shapes: Array, least: float) -> Array:
    """Return which share of the side of a surface that is turned towards each eye (E, 3) is seen.

    Sides that look smaller than ``least``, in points seen straight on, count as that large.
    """
    if not len(points):
        return np.ones(len(eyes))
    ways = eyes[:, None] - points
    facing = np.maximum((ways * normals).sum(axis=-1) / np.linalg.norm(ways, axis=-1), 0.0)
    seen = are_in_sight(points, eyes, shapes)
    return np.asarray((facing * seen).sum(axis=1) / np.maximum(facing.sum(axis=1), max(least, 1e-9)))


def are_in_sight(points: Array, eyes: Array, shapes: Array) -> Array:
    """Return which points each eye sees past capsules.

    Args:
        points: Shape (P, 3).
        eyes: Shape (E, 3).
        shapes: Both ends and both radii of capsules. Shape (K, 8).

    Returns:
        Shape (E, P).
    """
    if not len(shapes):
        return np.ones((len(eyes), len(points)), bool)
    start, along = shapes[:, :3], shapes[:, 3:6] - shapes[:, :3]
    way = eyes[:, None] - points
    eye, body = _near_sight(points, eyes, shapes)
    # The least distance of two segments, as in Ericson's Real-Time Collision Detection, section 5.1.9.
    offset = (points - start[:, None])[body]
    a = (way * way).sum(axis=-1)[eye]
    b = (way @ along.T)[eye, :, body]
    c = np.maximum((along * along).sum(axis=-1), 1e-12)[body, None]
    d = (way @ start.T)[eye, :, body]
    d = (way * points).sum(axis=-1)[eye] - d
    e = (offset * along[body, None]).sum(axis=-1)
    s = np.clip((b * e - c * d) / np.maximum(a * c - b * b, 1e-12), 0.0, 1.0)
    t = np.clip((b * s + e) / c, 0.0, 1.0)
    s = np.clip((b * t - d) / a, 0.0, 1.0)
    square = (offset * offset).sum(axis=-1) + s * s * a + t * t * c + 2.0 * (s * d - t * e - s * t * b)
    radius = shapes[body, 6, None] + t * (shapes[body, 7] - shapes[body, 6])[:, None]
    pair, point = np.nonzero(~(square >= radius * radius))
    seen = np.ones((len(eyes), len(points)), bool)
    seen[eye[pair], point] = False
    return seen


def _near_sight(points: Array, eyes: Array, shapes: Array) -> tuple[Array, Array]:
    """Return pairs of an eye and a capsule that may hide some of the points from it; most capsules are far aside.

    All points lie in a ball, and so does each capsule: they are pairs where the way from eye to ball meets the other.
    """
    middle = points.mean(axis=0)
    along = shapes[:, 3:6] - shapes[:, :3]
    sizes = np.linalg.norm(points - middle, axis=1).max() + 0.5 * np.linalg.norm(along, axis=1)
    sizes += shapes[:, 6:].max(axis=1) + _MARGIN
    ways, places = eyes - middle, shapes[:, :3] + 0.5 * along - middle
    s = np.clip(ways @ places.T / np.maximum((ways * ways).sum(axis=1), 1e-12)[:, None], 0.0, 1.0)
    gaps = np.linalg.norm(places - s[..., None] * ways[:, None], axis=-1)
    # Capsules without a position, which are no number, count as near.
    eye, body = np.nonzero(~(gaps > sizes))
    return eye, body


def strikes_of(source: PoseSource, outcomes: Sequence[int]) -> tuple[Array, Array, Array]:
    """Return the frames (S,), points (S, 3) and outcomes (S,) of all strikes of a source with some outcomes."""
    frames, points, found = [np.zeros(0, int)], [np.zeros((0, 3))], [np.zeros(0, int)]
    for frame in range(source.frame_count):
        where, ages, _, kinds = source.recent_strikes(frame)
        new = (np.asarray(ages) < 1.0 / source.fps - 1e-6) & np.isin(kinds, outcomes)
        if new.any():
            points.append(np.asarray(where)[new])
            # The nearest frame: the one after the strike, or the one before.
            frames.append(frame - (np.asarray(ages)[new] > 0.5 / source.fps).astype(int))
            found.append(np.asarray(kinds, int)[new])
    return np.concatenate(frames), np.concatenate(points), np.concatenate(found)


class StrikeFinder:
    """Poses the avatars around strikes of a source."""

    def __init__(self, source: PoseSource) -> None:
        self.source = source
        self._cast = build_cast(
            source.figures,
            source.avatar_figures,
            source.avatar_teams,
            source.avatar_scales,
            None,
            source.avatar_girths,
            source.avatar_stretches,
        )
        parts, bare = [], []
        for figure, members in zip(source.figures, self._cast.members, strict=True):
            dressed = dress(figure).capsule_parts
            parts.append(np.tile(dressed, len(members)))
            # What a figure is dressed with comes after its body: a headguard is no glove.
            bare.append(np.tile(np.arange(len(dressed)) < len(figure.capsule_parts), len(members)))
        self._parts, self._bare = np.concatenate(parts), np.concatenate(bare)

    def find(self, frame: int, point: Array) -> Strike | None:
        """Return the strike at a frame and point (3,); None where no limb or head is near."""
        ground = self.source.ground(np.array([frame]))[0]
        away = np.linalg.norm(ground[:, :2] - point[[0, 2]], axis=1)
        near = np.nan_to_num(away, nan=np.inf) < _NEAR
        scales = np.where(near, _SCALE, 0.0)
        capsules = self._cast.place(self.source.poses(frame, Shown(frame + 1, lambda _: scales)))
        there = np.isfinite(capsules.shapes).all(axis=1) & near[capsules.owners]
        shapes, owners = capsules.shapes[there].astype(float), capsules.owners[there]
        parts, bare = self._parts[there], self._bare[there]
        limbs = np.flatnonzero(np.isin(parts, _STRIKERS) & bare)
        heads = np.flatnonzero((parts == PARTS.index("head")) & bare)
        if not len(limbs) or not len(heads):
            return None
        limb = limbs[np.argmin(_distances(shapes[limbs], point))]
        others = heads[owners[heads] != owners[limb]]
        gaps = np.linalg.norm(shapes[others, :3] - point, axis=1)
        if not len(others) or gaps.min() > _REACHES:
            return None
        head = others[np.argmin(gaps)]
        own = owners == owners[head]
        of_head = np.flatnonzero(
            own
            & (np.linalg.norm(shapes[:, :3] - shapes[head, :3], axis=1) < 1.5 * shapes[head, 6])
            & (~bare | (parts == PARTS.index("head")))
        )
        # A nose is part of the head, and points ahead.
        nose = of_head[(parts[of_head] == PARTS.index("head")) & ~bare[of_head]]
        ahead = shapes[nose[0], :3] - shapes[head, :3] if len(nose) else np.zeros(3)
        return Strike(
            frame,
            int(owners[limb]),
            int(owners[head]),
            _surface(shapes[limb]),
            _cap(shapes[head, :3], float(shapes[head, 6]), ahead),
            shapes,
            int(limb),
            of_head,
        )


def _distances(shapes: Array, point: Array) -> Array:
    """Distance of a point from the surface of capsules [m]."""
    along = shapes[:, 3:6] - shapes[:, :3]
    t = ((point - shapes[:, :3]) * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-12)
    t = np.clip(t, 0.0, 1.0)
    radii = shapes[:, 6] + t * (shapes[:, 7] - shapes[:, 6])
    return np.asarray(np.linalg.norm(point - shapes[:, :3] - t[:, None] * along, axis=1) - radii)


def _sphere(count: int) -> Array:
    """Directions spread evenly over a sphere (count, 3): Fibonacci's lattice."""
    i = np.arange(count) + 0.5
    height, angle = 1.0 - 2.0 * i / count, math.pi * (1.0 + math.sqrt(5.0)) * i
    level = np.sqrt(1.0 - height * height)
    return np.stack([level * np.cos(angle), height, level * np.sin(angle)], axis=1)


_DIRECTIONS = _sphere(_POINTS)
_MANY = _sphere(4 * _POINTS)


def _surface(shape: Array) -> tuple[Array, Array]:
    """Points all over a capsule and the directions away from it (n, 3)."""
    along = shape[3:6] - shape[:3]
    t = np.where(_DIRECTIONS @ along > 0.0, 1.0, 0.0)[:, None]
    radii = shape[6] + t * (shape[7] - shape[6])
    return shape[:3] + t * along + 1.02 * radii * _DIRECTIONS, _DIRECTIONS


def _cap(centre: Array, radius: float, ahead: Array) -> tuple[Array, Array]:
    """Points all over the face of a head and the directions away from it (n, 3); none where it looks nowhere."""
    length = float(np.linalg.norm(ahead))
    if length < 1e-6:
        return np.zeros((0, 3)), np.zeros((0, 3))
    normals = _MANY[_MANY @ (ahead / length) > math.cos(FACE)]
    return centre + 1.1 * radius * normals, normals
