"""Which joints carry the skin: at most four each, elbows and knees by halves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from crowdsim.body.binding import SIDES, Binding
from crowdsim.body.field import Shapes, group_distances
from crowdsim.body.meshing import mesh_edges
from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.skeleton import Skeleton

INFLUENCES = 4
_WIDE = 0.014
"""Over which distance skin between trunk and limbs goes from one to the other [m]."""
_SMOOTHING = 4


def bending_joints(body: Body) -> Array:
    """Return the joints that have a helper: both elbows and knees. Shape (4,), int64."""
    return np.array([body.roles[f"{side}_{role}"] for role in ("elbow", "knee") for side in SIDES], np.int64)


def limb_shares(shapes: Shapes, names: list[str], binding: Binding, vertices: Array, triangles: Array) -> Array:
    """Return how much trunk with head, arms and legs (left, then right) carry each vertex. Shape (V, 5)."""
    gaps = group_distances(shapes, vertices, len(names))
    limbs = [("trunk", "head")] + [
        tuple(f"{side}_{name}" for name in chain)
        for chain in (("upper_arm", "forearm", "hand"), ("thigh", "shank", "foot"))
        for side in SIDES
    ]
    near = np.stack([gaps[:, [names.index(name) for name in limb]].min(axis=1) for limb in limbs], axis=1)
    shares = np.exp(-(near - near.min(axis=1, keepdims=True)) / (_WIDE * binding.size))
    middle = vertices[:, 0] - binding.segments["trunk"].start[0]
    for limb in range(1, 5):
        shares[:, limb] *= _ramp(middle * (1.0 if limb % 2 else -1.0), -0.015, 0.015)
    shares /= shares.sum(axis=1, keepdims=True)
    edges = mesh_edges(triangles)
    degree = np.bincount(edges.ravel(), minlength=len(vertices))[:, None]
    for _ in range(_SMOOTHING):
        total = np.zeros_like(shares)
        np.add.at(total, edges[:, 0], shares[edges[:, 1]])
        np.add.at(total, edges[:, 1], shares[edges[:, 0]])
        shares = 0.5 * shares + 0.5 * total / degree
    return shares


def bind_vertices(
    skeleton: Skeleton, body: Body, binding: Binding, vertices: Array, limbs: Array
) -> tuple[Array, Array]:
    """Return joints (V, 4), uint8, and weights (V, 4), float32, of vertices; helper h has the number J + h.

    Args:
        skeleton: The skeleton, J joints.
        body: The body on it.
        binding: Its binding pose.
        vertices: Of the skin [m]. Shape (V, 3).
        limbs: What ``limb_shares`` returned.
    """
    roles, size, count = body.roles, binding.size, skeleton.joint_count
    places, parents = binding.positions, np.asarray(skeleton.parents)
    weights = np.zeros((len(vertices), count + 4))
    _bind_trunk(weights, limbs[:, 0], roles, binding, parents, vertices)
    for index, side in enumerate(SIDES):
        shoulder, elbow, hand = (roles[f"{side}_{role}"] for role in ("shoulder", "elbow", "hand"))
        hip, knee, foot = (roles[f"{side}_{role}"] for role in ("hip", "knee", "foot"))
        segments = binding.segments
        arm, fore = segments[f"{side}_upper_arm"].axes[0], segments[f"{side}_forearm"].axes[0]
        thigh, shank = segments[f"{side}_thigh"].axes[0], segments[f"{side}_shank"].axes[0]
        ahead = segments[f"{side}_foot"].axes[0]

        def along(joint: int, way: Array) -> Array:
            return np.asarray((vertices - places[joint]) @ (way / np.linalg.norm(way)) / size)

        bent = _ramp(along(elbow, arm + fore), -0.042, 0.042)
        held = _ramp(along(hand, fore), -0.095, -0.005)
        share = limbs[:, 1 + index]
        weights[:, shoulder] += share * np.maximum(0.0, 1.0 - 2.0 * bent)
        weights[:, count + index] += share * (1.0 - np.abs(2.0 * bent - 1.0))
        lower = np.maximum(0.0, 2.0 * bent - 1.0)
        weights[:, elbow] += share * lower * (1.0 - held)
        weights[:, hand] += share * lower * held
        bent = _ramp(along(knee, thigh + shank), -0.055, 0.055)
        level = _ramp(along(foot, shank + ahead), -0.035, 0.035)
        share = limbs[:, 3 + index]
        weights[:, hip] += share * np.maximum(0.0, 1.0 - 2.0 * bent)
        weights[:, count + 2 + index] += share * (1.0 - np.abs(2.0 * bent - 1.0))
        lower = np.maximum(0.0, 2.0 * bent - 1.0)
        weights[:, knee] += share * lower * (1.0 - level)
        toe = roles.get(f"{side}_toe")
        rolled = np.zeros(len(vertices)) if toe is None else _ramp(along(toe, ahead), -0.02, 0.02)
        weights[:, foot] += share * lower * level * (1.0 - rolled)
        if toe is not None:
            weights[:, toe] += share * lower * level * rolled
    return strongest(weights)


def strongest(weights: Array) -> tuple[Array, Array]:
    """Return the four greatest weights of each vertex, which then add up to 1, and their joints."""
    order = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    kept = np.take_along_axis(weights, order, axis=1)
    kept[kept < 0.01] = 0.0
    order[kept == 0.0] = 0
    kept = (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32)
    # What single precision loses goes to the greatest.
    kept[:, 0] += np.float32(1.0) - kept.sum(axis=1, dtype=np.float32)
    return order.astype(np.uint8), kept


def _bind_trunk(
    weights: Array, share: Array, roles: Mapping[str, int], binding: Binding, parents: Array, vertices: Array
) -> None:
    places, size = binding.positions, binding.size
    chain = [roles["head"]]
    while chain[-1] != roles["pelvis"]:
        chain.append(int(parents[chain[-1]]))
    chain = chain[::-1]
    heights = places[chain, 1]
    left = np.asarray(share, float)
    for number, joint in enumerate(chain):
        if number + 1 == len(chain):
            weights[:, joint] += left
            break
        above = chain[number + 1]
        if above == roles["head"]:
            # The chin goes with the head, the nape with the neck.
            beyond = _ramp((vertices - places[above]) @ [0.0, 0.8, 0.6] / size, -0.022, 0.022)
        elif above == roles["neck"]:
            beyond = _ramp((vertices[:, 1] - places[above, 1]) / size, -0.02, 0.05)
        else:
            gap = 0.5 * max(min(heights[number + 1] - heights[number], heights[number + 2] - heights[number + 1]), 0.04)
            beyond = _ramp(vertices[:, 1] - heights[number + 1], -gap, gap)
        weights[:, joint] += left * (1.0 - beyond)
        left = left * beyond
    for sign, side in zip((1.0, -1.0), SIDES, strict=True):
        collar, shoulder = int(parents[roles[f"{side}_shoulder"]]), roles[f"{side}_shoulder"]
        if collar in chain:
            continue
        out = (vertices[:, 0] - places[roles["neck"], 0]) * sign / abs(places[shoulder, 0] - places[roles["neck"], 0])
        up = (vertices[:, 1] - places[shoulder, 1]) / size
        moved = _ramp(out, 0.15, 0.85) * _ramp(up, -0.16, -0.02)
        for joint in chain:
            if joint != roles["head"]:
                weights[:, collar] += moved * weights[:, joint]
                weights[:, joint] *= 1.0 - moved


def _ramp(values: Array, low: float, high: float) -> Array:
    """From 0 at ``low`` to 1 at ``high``, level at both ends."""
    x = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


def bone_axes(skeleton: Skeleton, body: Body, binding: Binding) -> tuple[Array, Array]:
    """Return the axis of each joint's bones, in its frame (J, 3), and which joints thicken with girth (J,)."""
    roles = body.roles
    ways = np.tile([0.0, 1.0, 0.0], (skeleton.joint_count, 1))
    thickens = np.ones(skeleton.joint_count, bool)
    for side in SIDES:
        for role, name in (("shoulder", "upper_arm"), ("elbow", "forearm"), ("hip", "thigh"), ("knee", "shank")):
            ways[roles[f"{side}_{role}"]] = binding.segments[f"{side}_{name}"].axes[0]
    stiff = [roles[role] for role in ("head", "left_hand", "right_hand", "left_foot", "right_foot")]
    for joint, parent in enumerate(skeleton.parents):
        thickens[joint] = joint not in stiff and (parent < 0 or thickens[parent])
    return quaternion.rotate(quaternion.conjugate(binding.rotations), ways), thickens
