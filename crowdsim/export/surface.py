"""Points spread evenly over a body's capsules, its skin, or any triangles, once for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.body.skin import Skin
from crowdsim.core.types import Array
from crowdsim.motion.body import Body
from crowdsim.motion.skeleton import Skeleton
from crowdsim.places.mesh import triangle_areas
from crowdsim.poses.builds import capsule_segments
from crowdsim.poses.capsules import swelling_capsules
from crowdsim.poses.kernels.columns import TRUNK

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True)
class Surface:
    """Points on a body, each riding on a joint; K points.

    Attributes:
        joints: Joint of each point. Shape (K,), int32.
        positions: Position in that joint's frame [m]. Shape (K, 3).
        normals: Outward normal there. Shape (K, 3).
        swells: Where it goes for each unit of girth: along the normal, or nowhere [m]. Shape (K, 3).
        cores: Point of the bone under it, which goes along with the length of that bone [m]. Shape (K, 3).
        segments: Which bone that is, see ``builds.capsule_segments``. Shape (K,), int64.
    """

    joints: Array
    positions: Array
    normals: Array
    swells: Array
    cores: Array
    segments: Array


@dataclass(frozen=True)
class SkinSurface:
    """Points on the triangles of a skin, each between three corners; K points.

    Attributes:
        joints: Joints and helpers that carry each corner. Shape (K, 3, 4), uint8.
        weights: How much. Shape (K, 3, 4), float32.
        positions: Corners in the binding pose [m]. Shape (K, 3, 3), float32.
        normals: Their normals. Shape (K, 3, 3), float32.
        shares: Share of each corner. Shape (K, 3).
        labels: Joint that carries most of each point, helpers counted to their joints. Shape (K,), int32.
    """

    joints: Array
    weights: Array
    positions: Array
    normals: Array
    shares: Array
    labels: Array


def build_skin_surface(skin: Skin, points: int) -> SkinSurface:
    """Spread points over a skin, by area.

    Args:
        skin: The skin.
        points: Number of points K.
    """
    found, shares = spread_points(skin.vertices[skin.triangles].astype(float), points)
    faces = skin.triangles[found]
    joints, weights = skin.joints[faces], skin.weights[faces]
    owners = np.concatenate([np.arange(len(skin.parents)), skin.helpers])
    carried = np.zeros((points, len(skin.parents)))
    rows = np.broadcast_to(np.arange(points)[:, None, None], joints.shape)
    np.add.at(carried, (rows, owners[joints]), weights * shares[:, :, None])
    labels = np.argmax(carried, axis=1).astype(np.int32)
    return SkinSurface(joints, weights, skin.vertices[faces], skin.normals[faces], shares, labels)


def spread_points(corners: Array, points: int) -> tuple[Array, Array]:
    """Spread points over triangles, by area.

    Triangles are walked along a curve that fills space, so that points an equal area apart are spread evenly.

    Args:
        corners: Corners of the triangles [m]. Shape (T, 3, 3).
        points: Number of points K.

    Returns:
        Triangle of each point (K,), and the shares of its corners (K, 3).
    """
    areas = triangle_areas(corners)
    middles = corners.mean(axis=1)
    cells = ((middles - middles.min(axis=0)) / np.ptp(middles, axis=0).max() * 1023.0).astype(np.int64)
    keys = sum(((cells[:, axis] >> bit) & 1) << (3 * bit + axis) for bit in range(10) for axis in range(3))
    order = np.argsort(keys, kind="stable")
    ends = np.cumsum(areas[order])
    numbers = np.arange(points)
    found = order[np.searchsorted(ends, (numbers + 0.5) / points * ends[-1])]
    # Fractions of multiples of these roots fill the unit square evenly (R2, Roberts 2018).
    first, second = (numbers * 0.7548776662466927 + 0.5) % 1.0, (numbers * 0.5698402909980532 + 0.5) % 1.0
    root = np.sqrt(first)
    shares = np.stack([1.0 - root, root * (1.0 - second), root * second], axis=1)
    return found, shares


def build_surface(skeleton: Skeleton, body: Body, points: int) -> Surface:
    """Spread points over the capsules of a body, by area, leaving out what lies inside other capsules at rest.

    Args:
        skeleton: The skeleton.
        body: The body on it.
        points: Number of points K.
    """
    rest = skeleton.rest_positions()
    centres = rest[body.capsule_joints]
    wanted = points
    while True:
        capsules, spread = _spread(body, wanted)
        joints = body.capsule_joints[capsules]
        outside = _outside(body, centres, rest[joints] + spread[0])
        kept = np.flatnonzero(outside)
        if len(kept) >= points:
            # Evenly spaced picks keep the spread even.
            kept = kept[np.floor(np.arange(points) * (len(kept) / points)).astype(int)]
            segments = capsule_segments(body)[capsules[kept]]
            positions, normals, swells, cores = (values[kept] for values in spread)
            return Surface(joints[kept].astype(np.int32), positions, normals, swells, cores, segments)
        wanted += max(1, points - len(kept))


def build_prop_surface(props: Array, points: int) -> Surface:
    """Spread points over what an avatar carries, by area.

    Args:
        props: Its capsules. Shape (P,), ``crowd.props.PROP``; one at the least.
        points: Number of points K.
    """
    starts, ends, radii = (props[name].astype(float) for name in ("start", "end", "radius"))
    areas = prop_areas(props)
    edges = np.round(np.cumsum(areas) / areas.sum() * points).astype(int)
    counts = np.diff(edges, prepend=0)
    found = [
        _on_capsule(starts[row], ends[row], np.repeat(radii[row], 2), int(count)) for row, count in enumerate(counts)
    ]
    places, normals, _ = (np.concatenate(values) for values in zip(*found, strict=True))
    none = np.zeros((points, 3))
    joints = np.repeat(props["joint"], counts).astype(np.int32)
    return Surface(joints, places, normals, none, none, np.full(points, TRUNK, np.int64))


def prop_areas(props: Array) -> Array:
    """Return the area of each capsule that avatars carry [m2]. Shape (P,)."""
    lengths = np.linalg.norm(props["end"].astype(float) - props["start"], axis=1)
    return np.asarray(2.0 * np.pi * props["radius"] * (2.0 * props["radius"] + lengths))


def _spread(body: Body, count: int) -> tuple[Array, list[Array]]:
    """About ``count`` points over all capsules, on golden spirals: capsules; positions, normals, swells and cores."""
    lengths = np.linalg.norm(body.capsule_ends - body.capsule_starts, axis=1)
    areas = 2 * np.pi * (body.capsule_radii**2).sum(axis=1) + np.pi * body.capsule_radii.sum(axis=1) * lengths
    shares = np.maximum(1, np.round(count * areas / areas.sum()).astype(int))
    found = []
    thickens = swelling_capsules(body.capsule_parts)
    for capsule, share in enumerate(shares):
        place, normal, radius = _on_capsule(
            body.capsule_starts[capsule], body.capsule_ends[capsule], body.capsule_radii[capsule], int(share)
        )
        found.append((place, normal, normal * (radius * thickens[capsule])[:, None], place - radius[:, None] * normal))
    return np.repeat(np.arange(len(shares)), shares), [np.concatenate(values) for values in zip(*found, strict=True)]


def _on_capsule(start: Array, end: Array, radii: Array, count: int) -> tuple[Array, Array, Array]:
    """Points, normals and radii on a capsule whose radius runs from one end's to the other's."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    axis = axis / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    low, high = 2 * np.pi * radii[0] ** 2, 2 * np.pi * radii[1] ** 2
    middle = np.pi * (radii[0] + radii[1]) * length
    at = (np.arange(count) + 0.5) / count * (low + middle + high)
    # By Archimedes a sphere's area is even along its axis; the sides are taken as a cylinder's of the mean radius.
    along = np.where(at < low, at / low - 1.0, np.where(at < low + middle, 0.0, (at - low - middle) / high))
    share = np.clip((at - low) / max(middle, 1e-12), 0.0, 1.0)
    radius = radii[0] + (radii[1] - radii[0]) * share
    turn = np.arange(count) * _GOLDEN
    ring = np.sqrt(np.maximum(0.0, 1.0 - along**2))
    around = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    normals = ring[:, None] * around + along[:, None] * axis
    positions = start + (share * length)[:, None] * axis + radius[:, None] * normals
    return positions, normals, radius


def _outside(body: Body, centres: Array, points: Array) -> Array:
    """Whether rest-pose points lie in no capsule but at the skin of their own."""
    outside = np.ones(len(points), bool)
    for capsule, centre in enumerate(centres):
        start, end = centre + body.capsule_starts[capsule], centre + body.capsule_ends[capsule]
        axis = end - start
        share = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        radius = body.capsule_radii[capsule, 0] * (1 - share) + body.capsule_radii[capsule, 1] * share
        outside &= np.linalg.norm(points - start - share[:, None] * axis, axis=1) > 0.985 * radius
    return outside
