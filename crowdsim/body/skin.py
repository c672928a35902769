"""A skinned body: built once for each skeleton and build, and carried by poses."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crowdsim.body.anatomy import GIRTHS, Build, sculpt
from crowdsim.body.binding import SIDES, Binding, bind
from crowdsim.body.field import evaluate, sample
from crowdsim.body.kernels import skin_vertices
from crowdsim.body.meshing import largest_piece, refine, relax, surface_nets, thin, vertex_normals
from crowdsim.body.parts import SKIN_PARTS, dress, wanted_lengths
from crowdsim.body.store import kept_arrays
from crowdsim.body.textures import texture_places
from crowdsim.body.weights import bending_joints, bind_vertices, bone_axes, limb_shares
from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.skeleton import Skeleton

HELPERS = 4
"""Helper joints, at elbows and knees."""
_POSES = 200
"""Poses from which a skin learns how its joints bend."""
_SPACING = 0.0145
"""Of the grid on which the skin is found, for a body of the usual size [m]."""


@dataclass(frozen=True)
class Skin:
    """A skin in its binding pose, and what carries it; V vertices, F triangles, J joints and 4 helpers.

    Helper h has the number J + h; it lies at an elbow or a knee and turns half as far.

    Attributes:
        vertices: In the binding pose, y up, facing +z [m]. Shape (V, 3), float32.
        normals: Unit. Shape (V, 3), float32.
        triangles: Outwards counter-clockwise, sorted by part. Shape (F, 3), int32.
        parts: Index into ``parts.SKIN_PARTS`` of each triangle. Shape (F,), uint8.
        joints: Which carry each vertex. Shape (V, 4), uint8.
        weights: How much, adding up to 1. Shape (V, 4), float32.
        helpers: Elbow or knee of each helper. Shape (4,), int64.
        parents: Parent of each joint. Shape (J,), int64.
        positions: Of joints and helpers in the binding pose [m]. Shape (J + 4, 3).
        rotations: Shape (J + 4, 4).
        offsets: Of joints in the frames of their parents [m]. Shape (J, 3).
        axes: Along which bones grow longer, in the frames of joints. Shape (J + 4, 3).
        thickens: Which are thicker the greater the girth. Shape (J + 4,), bool.
        girth: Girth of an avatar whose skin this is as it is.
        places: Where vertices lie on textures, see ``texture_places``. Shape (V, 2), float32.
    """

    vertices: Array
    normals: Array
    triangles: Array
    parts: Array
    joints: Array
    weights: Array
    helpers: Array
    parents: Array
    positions: Array
    rotations: Array
    offsets: Array
    axes: Array
    thickens: Array
    girth: float
    places: Array

    def growth(self, girth: float, lengths: Array) -> tuple[Array, Array]:
        """Return what an avatar of another girth and other lengths of bones has instead, in the same binding pose.

        Args:
            girth: How thick its trunk and limbs are.
            lengths: How long the bones of each joint are for the size of its body. Shape (J,).

        Returns:
            Positions of joints and helpers, shape (J + 4, 3) [m]; and what takes the skin that each of them carries
            into its new shape, shape (J + 4, 3, 4).
        """
        own, joints = girth / self.girth, len(self.parents)
        positions = self.positions.copy()
        for index, parent in enumerate(self.parents):
            if parent >= 0:
                bone = quaternion.rotate(self.rotations[parent], self.offsets[index] * lengths[parent])
                positions[index] = positions[parent] + bone
        positions[joints:] = positions[self.helpers]
        longer = np.append(lengths, 0.5 * (lengths[self.parents[self.helpers]] + lengths[self.helpers]))
        wide, long = (np.where(self.thickens, value, 1.0)[:, None, None] for value in (own, longer))
        ways = quaternion.rotate(self.rotations, self.axes)
        grown = wide * np.eye(3) + (long - wide) * ways[:, :, None] * ways[:, None, :]
        moves = positions - np.einsum("kij,kj->ki", grown, self.positions)
        return positions, np.concatenate([grown, moves[:, :, None]], axis=2)

    def shaped(self, girth: float, lengths: Array) -> Skin:
        """Return the skin of an avatar of another girth and other lengths of bones, see ``growth``."""
        if girth == self.girth and (lengths == 1.0).all():
            return self
        positions, grown = self.growth(girth, lengths)
        vertices = np.zeros((len(self.vertices), 3))
        normals = np.zeros_like(vertices)
        steep = np.linalg.inv(grown[:, :, :3])
        for column in range(self.joints.shape[1]):
            joint, weight = self.joints[:, column], self.weights[:, column, None]
            moved = np.einsum("vij,vj->vi", grown[joint, :, :3], self.vertices) + grown[joint, :, 3]
            vertices += weight * moved
            normals += weight * np.einsum("vij,vj->vi", steep[joint], self.normals)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        shape = vertices.astype(np.float32), normals.astype(np.float32)
        return replace(self, vertices=shape[0], normals=shape[1], positions=positions, girth=girth)

    def inverse_bindings(self) -> Array:
        """Return what takes the skin into the frames of joints and helpers. Shape (J + 4, 3, 4)."""
        turned = _matrices(quaternion.conjugate(self.rotations))
        return np.concatenate([turned, -turned @ self.positions[:, :, None]], axis=2)

    def straights(self) -> Array:
        """Return the rotations of the helpers' parents in the frames of their joints, when bound. Shape (4, 4)."""
        above = self.rotations[self.parents[self.helpers]]
        return np.asarray(quaternion.multiply(quaternion.conjugate(self.rotations[self.helpers]), above))

    def helper_rotations(self, rotations: Array) -> Array:
        """Return rotations of helpers in their parents' frames (..., 4, 4) from local ones of joints (..., J, 4)."""
        bent = quaternion.multiply(np.asarray(rotations)[..., self.helpers, :], self.straights())
        # Half of a rotation: the middle of it and none, on the shorter way.
        half = bent * np.where(bent[..., :1] < 0.0, -1.0, 1.0)
        half[..., 0] += 1.0
        return np.asarray(quaternion.normalise(half))

    def matrices(self, positions: Array, rotations: Array, scales: Array) -> Array:
        """Return what takes the skin into the world, by joints and helpers. Shape (n, J + 4, 3, 4), float32.

        Args:
            positions: Of joints in the world [m]. Shape (n, J, 3).
            rotations: Of joints in the world. Shape (n, J, 4).
            scales: Sizes of the bodies. Shape (n,).
        """
        above = self.parents[self.helpers]
        local = np.zeros((len(rotations), len(self.parents), 4))
        local[:, self.helpers] = quaternion.multiply(
            quaternion.conjugate(rotations[:, above]), rotations[:, self.helpers]
        )
        halves = quaternion.multiply(rotations[:, above], self.helper_rotations(local))
        turned = _matrices(np.concatenate([rotations, halves], axis=1))
        result = np.asarray(scales, float)[:, None, None, None] * turned @ self.inverse_bindings()
        result[..., 3] += np.concatenate([positions, positions[:, self.helpers]], axis=1)
        return result.astype(np.float32)


def pose_skins(skins: Sequence[Skin], matrices: Array, threads: int = 1) -> tuple[Array, Array]:
    """Return the vertices (n, V, 3) [m] and normals (n, V, 3) in the world of avatars of one build, float32.

    This is what readers of exported skins are held against, and for Python.

    Args:
        skins: Skin of each avatar.
        matrices: What ``Skin.matrices`` returns, a row an avatar. Shape (n, J + 4, 3, 4).
        threads: Threads.
    """
    out = [np.empty((len(skins), len(skins[0].vertices), 3), np.float32) for _ in range(2)]
    vertices, normals = (np.stack([getattr(skin, name) for skin in skins]) for name in ("vertices", "normals"))
    share(len(skins), skin_vertices, matrices, skins[0].joints, skins[0].weights, vertices, normals, *out,
          threads=threads, least=1)  # fmt: skip
    return out[0], out[1]


_MOST_SKINS, _MOST_JOINTS = 64, 256
"""Skins that are kept, and joints that a vertex can name with a byte."""
_skins: dict[bytes, Skin] = {}
_building = threading.Lock()


def build_skin(
    skeleton: Skeleton, body: Body, build: Build, poses: Array | None = None, coarseness: float = 1.0
) -> Skin:
    """Return the skin of a body, made on the first call with these arguments.

    The last ``_MOST_SKINS`` are kept in memory, and more in the user's cache.

    Args:
        skeleton: The skeleton [m].
        body: The body on it.
        build: What it is like.
        poses: Local rotations of some poses, see ``binding.bind``. Shape (n, J, 4).
        coarseness: How many times as long edges are, for bodies that are seen from far away.

    Raises:
        MotionError: The rest pose is no upright body, and no pose is given that is.
    """
    digest = hashlib.sha256(repr((build, coarseness, skeleton.names, sorted(body.roles.items()))).encode())
    for array in (skeleton.parents, skeleton.offsets, body.sole_offsets, body.fist_offsets, body.head_offset, poses):
        digest.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
    key = digest.digest()
    with _building:
        if key not in _skins:
            if skeleton.joint_count + HELPERS > _MOST_JOINTS:
                most = _MOST_JOINTS - HELPERS
                raise MotionError(f"the skeleton has {skeleton.joint_count} joints, expected {most} at most for a skin")
            stored = kept_arrays(key, lambda: vars(_build(skeleton, body, build, poses, coarseness)))
            _skins[key] = Skin(**{**stored, "girth": float(stored["girth"])})
            while len(_skins) > _MOST_SKINS:
                del _skins[next(iter(_skins))]
        return _skins[key]


def build_skin_of(database: MotionDatabase, build: Build, coarseness: float = 1.0) -> Skin:
    """Return the skin of the body of a motion database, which learns from its poses how joints bend."""
    rotations = database.rotations
    some = np.asarray(rotations[:: max(1, len(rotations) // _POSES)][:_POSES])
    return build_skin(database.skeleton, database.body, build, some, coarseness)


def _build(skeleton: Skeleton, body: Body, build: Build, poses: Array | None, coarseness: float) -> Skin:
    binding = bind(skeleton, body, poses)
    shapes, names = sculpt(binding, build)
    spacing = _SPACING * binding.size * coarseness
    values, low = sample(shapes, spacing)
    vertices, triangles = largest_piece(*surface_nets(values, low, spacing))
    vertices = relax(shapes, vertices, triangles, 2)
    wanted = wanted_lengths(binding, build, coarseness)
    for _ in range(2):
        vertices, triangles = refine(vertices, triangles, wanted)
        vertices = relax(shapes, vertices, triangles, 1)
    vertices, triangles = thin(vertices, triangles, wanted)
    vertices = relax(shapes, vertices, triangles, 4)
    for side in SIDES:
        _flatten_sole(vertices, binding, f"{side}_foot")
    vertices, triangles, _, raised = dress(vertices, triangles, binding, build)
    limbs = limb_shares(shapes, names, binding, vertices, triangles)
    joints, weights = bind_vertices(skeleton, body, binding, vertices, limbs)
    _, smooth = evaluate(shapes, vertices)
    bare = vertices
    vertices, triangles, parts, origins = raised(vertices, smooth)
    # Normals of the field show more than triangles have, but soles are no part of it.
    normals = vertex_normals(vertices, triangles)
    true = np.setdiff1d(np.arange(len(vertices)), triangles[parts == SKIN_PARTS.index("soles")])
    normals[true] = smooth[origins[true]]
    order = np.argsort(parts, kind="stable")
    triangles, parts = triangles[order], parts[order]
    helpers = bending_joints(body)
    parents = np.asarray(skeleton.parents, np.int64)
    axes, thickens = bone_axes(skeleton, body, binding)
    above = parents[helpers]
    turned = quaternion.multiply(quaternion.conjugate(binding.rotations[above]), binding.rotations[helpers])
    mean = quaternion.rotate(turned, axes[helpers]) + axes[above]
    return Skin(
        vertices=vertices.astype(np.float32),
        normals=normals.astype(np.float32),
        triangles=triangles.astype(np.int32),
        parts=parts.astype(np.uint8),
        joints=np.ascontiguousarray(joints[origins]),
        weights=np.ascontiguousarray(weights[origins]),
        helpers=helpers,
        parents=parents,
        positions=np.concatenate([binding.positions, binding.positions[helpers]]),
        rotations=np.concatenate([binding.rotations, binding.rotations[above]]),
        offsets=np.asarray(skeleton.offsets, float),
        axes=np.concatenate([axes, mean / np.linalg.norm(mean, axis=1, keepdims=True)]),
        thickens=np.append(thickens, thickens[helpers]),
        girth=GIRTHS[build.kind],
        places=texture_places(binding, bare)[origins],
    )


def _flatten_sole(vertices: Array, binding: Binding, name: str) -> None:
    """Put what is under the sole of a foot onto it."""
    segment = binding.segments[name]
    heights = (vertices - segment.start) @ segment.axes[1]
    under = (heights < 0.0) & (np.linalg.norm(vertices - segment.start, axis=1) < 2.5 * segment.length)
    vertices[under] -= heights[under, None] * segment.axes[1]


def _matrices(rotations: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions."""
    w, x, y, z = np.moveaxis(np.asarray(rotations, float), -1, 0)
    return np.stack([
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
    ], axis=-2)  # fmt: skip
