"""Bodies in BVH files as points and capsules in the world, from which exported figures and their source are measured.

It shares no code with the package: BVH files are read and posed by ``plain_bvh``. Sizes of bodies (radii, capsules,
positions of fists and soles on hands and feet) and where actions begin in the source are numbers of the policy's
bundle.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from _exported.plain_bvh import Array, pose, read_plain

JOINTS = (
    "pelvis", "chest", "neck", "head",
    "left_shoulder", "left_elbow", "left_hand", "left_hip", "left_knee", "left_foot",
    "right_shoulder", "right_elbow", "right_hand", "right_hip", "right_knee", "right_foot",
)  # fmt: skip
OTHER_SIDE = [
    JOINTS.index({"l": "right", "r": "left"}[name[0]] + name[name.index("_") :]) if "_" in name else at
    for at, name in enumerate(JOINTS)
]
HINGES = ("left_knee", "right_knee", "left_elbow", "right_elbow")
PARTS = (
    "torso", "head", "left_leg", "right_leg", "left_upper_arm", "right_upper_arm",
    "left_forearm", "right_forearm", "left_fist", "right_fist",
)  # fmt: skip
"""Parts of a body that capsules belong to."""


@dataclass(frozen=True)
class Sizes:
    """Numbers of a policy's bundle.

    Attributes:
        names: Names of the joints.
        parents: Parent of each joint. Shape (J,).
        roles: Joint of each role.
        offsets: Position of each joint in its parent's frame, unscaled [m]. Shape (J, 3).
        fists: Middle of each fist in the frame of its hand [m]. Shape (2, 3).
        head: Middle of the head in the frame of its joint [m]. Shape (3,).
        soles: Heel and ball in the frame of each foot [m]. Shape (2, 2, 3).
        head_radius: Radius of the head [m].
        torso_radius: Radius of the capsule from pelvis to neck [m].
        height: Of the body [m].
        stride: Playback frames in a control frame.
        rate: Playback frames a second.
        clip_names: Clips of the database.
        clip_starts: First control frame of each, and the end. Shape (clips + 1,).
        roots: Positions of the root over the database's playback frames [m]. Shape (P, 3).
        first: Playback frame at which each action begins. Shape (A,).
        lengths: Length of each action [control frames]. Shape (A,).
        capsule_joints: Joint that each capsule rides on. Shape (K,).
        capsule_ends: Both ends of each in the frame of that joint, unscaled [m]. Shape (K, 2, 3).
        capsule_radii: Radius at both ends, unscaled [m]. Shape (K, 2).
    """

    names: tuple[str, ...]
    parents: Array
    roles: dict[str, int]
    offsets: Array
    fists: Array
    head: Array
    soles: Array
    head_radius: float
    torso_radius: float
    height: float
    stride: int
    rate: float
    clip_names: tuple[str, ...]
    clip_starts: Array
    roots: Array
    first: Array
    lengths: Array
    capsule_joints: Array
    capsule_ends: Array
    capsule_radii: Array

    def rest(self) -> Array:
        """Positions of the joints in the rest pose [m]. Shape (J, 3)."""
        positions = np.zeros_like(self.offsets)
        for joint in range(1, len(positions)):
            positions[joint] = positions[self.parents[joint]] + self.offsets[joint]
        return positions

    def forward(self) -> Array:
        """Where the rest pose looks: level, and square to its hips. Shape (3,)."""
        rest = self.rest()
        ahead = np.cross(rest[self.roles["left_hip"]] - rest[self.roles["right_hip"]], [0.0, 1.0, 0.0])
        return np.asarray(ahead / np.linalg.norm(ahead))

    def capsule_parts(self) -> Array:
        """Index into ``PARTS`` of each capsule. Shape (K,)."""
        starts = {self.roles["neck"]: "head", self.roles["head"]: "head"}
        for side in ("left", "right"):
            limbs = (("hip", "leg"), ("shoulder", "upper_arm"), ("elbow", "forearm"), ("hand", "fist"))
            starts |= {self.roles[f"{side}_{role}"]: f"{side}_{part}" for role, part in limbs}
        parts: list[str] = []
        for joint, parent in enumerate(self.parents):
            parts.append(starts.get(joint, parts[parent] if parent >= 0 else "torso"))
        return np.array([PARTS.index(parts[joint]) for joint in self.capsule_joints])


def read_sizes(bundle: Path) -> Sizes:
    """Read the numbers of a bundle."""
    outcome = json.loads((bundle / "policy.json").read_text())

    def numbers(name: str) -> Array:
        return np.load(bundle / f"{name}.npy")

    stride = round(outcome["database"]["playback_rate"] / outcome["database"]["control_rate"])
    return Sizes(
        names=tuple(outcome["skeleton"]["names"]),
        parents=numbers("skeleton_parents"),
        roles=outcome["body"]["roles"],
        offsets=numbers("skeleton_offsets"),
        fists=numbers("body_fist_offsets"),
        head=numbers("body_head_offset"),
        soles=numbers("body_sole_offsets"),
        head_radius=outcome["body"]["head_radius"],
        torso_radius=outcome["body"]["torso_radius"],
        height=outcome["body"]["height"],
        stride=stride,
        rate=outcome["database"]["playback_rate"],
        clip_names=tuple(outcome["database"]["clip_names"]),
        clip_starts=numbers("database_clip_starts").astype(int),
        roots=numbers("database_root_positions"),
        first=(numbers("graph_action_first").astype(int) - 1) * stride,
        lengths=numbers("graph_action_lengths").astype(int),
        capsule_joints=numbers("body_capsule_joints").astype(int),
        capsule_ends=np.stack([numbers("body_capsule_starts"), numbers("body_capsule_ends")], axis=1),
        capsule_radii=numbers("body_capsule_radii"),
    )


@dataclass(frozen=True)
class Figure:
    """A body over F frames, in the world [m].

    Attributes:
        joints: Positions of ``JOINTS``. Shape (F, 16, 3).
        fists: Middles of the fists, left and right. Shape (F, 2, 3).
        head: Middle of the head. Shape (F, 3).
        soles: Heel and ball of each foot. Shape (F, 2, 2, 3).
        crosses: Cross product of the unit vectors along the bones before and after each of ``HINGES``, in the frame of
            the bone before. Shape (F, 4, 3).
        dots: Their dot products. Shape (F, 4).
        turns: Rotation matrices of ``JOINTS`` in the world. Shape (F, 16, 3, 3).
        pelvises: Unit vector to which the pelvis faces, level. Shape (F, 3).
        faces: Unit vector to which the head faces. Shape (F, 3).
    """

    joints: Array
    fists: Array
    head: Array
    soles: Array
    crosses: Array
    dots: Array
    turns: Array
    pelvises: Array
    faces: Array

    def part(self, frames: Any) -> Figure:
        """Return some frames."""
        return Figure(*(getattr(self, field.name)[frames] for field in fields(self)))


def join(figures: list[Figure]) -> Figure:
    """Return figures one after another."""
    return Figure(*(np.concatenate([getattr(one, field.name) for one in figures]) for field in fields(Figure)))


@dataclass(frozen=True)
class Posed:
    """What a BVH file shows.

    Attributes:
        figure: The body.
        capsules: Ends of its capsules in the world [m]. Shape (F, K, 2, 3), float32.
        scale: Its size over that of the bundle's body.
        fps: Frames a second.
    """

    figure: Figure
    capsules: Array
    scale: float
    fps: float


def pose_file(path: Path, sizes: Sizes, turned: tuple[str, ...] = ()) -> Posed:
    """Read a BVH file as a body.

    Elbows of ``turned`` fold opposite to the file.

    Raises:
        ValueError: The file has other joints than the policy's body.
    """
    bvh = read_plain(path)
    if bvh.names != sizes.names:
        raise ValueError(f"{path}: has other joints than the policy's body")
    bones = np.linalg.norm(bvh.offsets[1:], axis=1)
    scale = float(bones.sum() / np.linalg.norm(sizes.offsets[1:], axis=1).sum())
    rest = sizes.rest()
    uppers = {sizes.roles[name]: sizes.roles[name.replace("elbow", "shoulder")] for name in turned}
    positions, turns = pose(bvh, {joint: rest[joint] - rest[upper] for joint, upper in uppers.items()})
    capsules = np.empty((len(positions), *sizes.capsule_ends.shape), np.float32)
    for k, joint in enumerate(sizes.capsule_joints):
        offsets = np.einsum("fij,ej->fei", turns[:, joint], sizes.capsule_ends[k] * scale)
        capsules[:, k] = positions[:, joint, None] + offsets
    return Posed(_figure(positions, turns, sizes, scale), capsules, scale, bvh.fps)


def _figure(positions: Array, turns: Array, sizes: Sizes, scale: float) -> Figure:
    """Points and directions of a body from positions (F, J, 3) and turns (F, J, 3, 3) of its joints."""
    roles, sides = sizes.roles, ("left", "right")

    def at(role: str, offset: Array) -> Array:
        return positions[:, roles[role]] + turns[:, roles[role]] @ (offset * scale)

    crosses, dots = np.empty((len(positions), 4, 3)), np.empty((len(positions), 4))
    for k, middle in enumerate(HINGES):
        side = middle.split("_")[0]
        upper, lower = ("hip", "foot") if "knee" in middle else ("shoulder", "hand")
        a, b, c = (roles[role] for role in (f"{side}_{upper}", middle, f"{side}_{lower}"))
        one, two = unit(positions[:, b] - positions[:, a]), unit(positions[:, c] - positions[:, b])
        crosses[:, k] = np.einsum("fji,fj->fi", turns[:, a], np.cross(one, two))
        dots[:, k] = np.sum(one * two, axis=1)
    shown = [roles[role] for role in JOINTS]
    across = positions[:, roles["left_hip"]] - positions[:, roles["right_hip"]]
    soles = [np.stack([at(f"{side}_foot", sole) for sole in sizes.soles[k]], axis=1) for k, side in enumerate(sides)]
    return Figure(
        joints=positions[:, shown],
        fists=np.stack([at(f"{side}_hand", sizes.fists[k]) for k, side in enumerate(sides)], axis=1),
        head=at("head", sizes.head),
        soles=np.stack(soles, axis=1),
        crosses=crosses,
        dots=dots,
        turns=turns[:, shown],
        pelvises=unit(np.cross(across, [0.0, 1.0, 0.0])),
        faces=turns[:, roles["head"]] @ sizes.forward(),
    )


def unit(vectors: Array) -> Array:
    """Return vectors of length 1."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def hinge_axes(figure: Figure) -> Array:
    """Return the axis about which knees and elbows bend: the mean of those of clearly bent ones. Shape (4, 3)."""
    bent = np.linalg.norm(figure.crosses, axis=-1) > np.sin(np.radians(20.0))
    return unit(np.sum(figure.crosses * bent[..., None], axis=0))


def flexions(figure: Figure, axes: Array) -> Array:
    """Return how far knees and elbows are bent, below 0 where past straight [deg]. Shape (F, 4)."""
    size = np.linalg.norm(figure.crosses, axis=-1)
    side = np.where(np.sum(figure.crosses * axes, axis=-1) < 0.0, -1.0, 1.0)
    return np.degrees(np.arctan2(side * size, figure.dots))
