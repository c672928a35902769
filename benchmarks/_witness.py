"""Bodies in BVH files as points in the world: what exported figures and the capture behind them are judged by.

It shares no code with the package: BVH files are read and posed by ``_plain_bvh``. Sizes of bodies (radii of head and
torso, positions of fists and soles on hands and feet) and where actions begin in the capture are numbers of the
policy's bundle.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from _plain_bvh import Array, pose, read_plain

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
MIRROR = "~mirror"


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

    def rest(self) -> Array:
        """Positions of the joints in the rest pose [m]. Shape (J, 3)."""
        positions = np.zeros_like(self.offsets)
        for joint in range(1, len(positions)):
            positions[joint] = positions[self.parents[joint]] + self.offsets[joint]
        return positions


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
    """

    joints: Array
    fists: Array
    head: Array
    soles: Array
    crosses: Array
    dots: Array

    def part(self, frames: Any) -> Figure:
        """Return some frames."""
        return Figure(*(getattr(self, field.name)[frames] for field in fields(self)))


def join(figures: list[Figure]) -> Figure:
    """Return figures one after another."""
    return Figure(*(np.concatenate([getattr(one, field.name) for one in figures]) for field in fields(Figure)))


def mirror(figure: Figure) -> Figure:
    """Return a figure's mirror image in x = 0."""
    flip = np.array([-1.0, 1.0, 1.0])
    swapped = [1, 0, 3, 2]
    return Figure(
        joints=figure.joints[:, OTHER_SIDE] * flip,
        fists=figure.fists[:, ::-1] * flip,
        head=figure.head * flip,
        soles=figure.soles[:, ::-1] * flip,
        # Frames of joints are mirrored too; a cross product keeps its part along the mirror's normal.
        crosses=figure.crosses[:, swapped] * -flip,
        dots=figure.dots[:, swapped],
    )


def read_figure(path: Path, sizes: Sizes, turned: tuple[str, ...] = ()) -> tuple[Figure, float, float]:
    """Read a BVH file as a body; return it, its size over the bundle's body, and its frames a second.

    Elbows of ``turned`` fold opposite to the file.
    """
    bvh = read_plain(path)
    if bvh.names != sizes.names:
        raise ValueError(f"{path}: has other joints than the policy's body")
    bones = np.linalg.norm(bvh.offsets[1:], axis=1)
    scale = float(bones.sum() / np.linalg.norm(sizes.offsets[1:], axis=1).sum())
    rest = sizes.rest()
    uppers = {sizes.roles[name]: sizes.roles[name.replace("elbow", "shoulder")] for name in turned}
    positions, turns = pose(bvh, {joint: rest[joint] - rest[upper] for joint, upper in uppers.items()})

    def at(role: str, offset: Array) -> Array:
        joint = sizes.roles[role]
        return positions[:, joint] + turns[:, joint] @ (offset * scale)

    crosses, dots = np.empty((len(positions), 4, 3)), np.empty((len(positions), 4))
    for k, middle in enumerate(HINGES):
        side = middle.split("_")[0]
        upper, lower = ("hip", "foot") if "knee" in middle else ("shoulder", "hand")
        a, b, c = (sizes.roles[role] for role in (f"{side}_{upper}", middle, f"{side}_{lower}"))
        one, two = _unit(positions[:, b] - positions[:, a]), _unit(positions[:, c] - positions[:, b])
        crosses[:, k] = np.einsum("fji,fj->fi", turns[:, a], np.cross(one, two))
        dots[:, k] = np.sum(one * two, axis=1)
    sides = ("left", "right")
    figure = Figure(
        joints=positions[:, [sizes.roles[role] for role in JOINTS]],
        fists=np.stack([at(f"{side}_hand", sizes.fists[k]) for k, side in enumerate(sides)], axis=1),
        head=at("head", sizes.head),
        soles=np.stack(
            [np.stack([at(f"{side}_foot", sole) for sole in sizes.soles[k]], axis=1) for k, side in enumerate(sides)],
            axis=1,
        ),
        crosses=crosses,
        dots=dots,
    )
    return figure, scale, bvh.fps


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def hinge_axes(figure: Figure) -> Array:
    """Return the axis about which knees and elbows bend: the mean of those of clearly bent ones. Shape (4, 3)."""
    bent = np.linalg.norm(figure.crosses, axis=-1) > np.sin(np.radians(20.0))
    return _unit(np.sum(figure.crosses * bent[..., None], axis=0))


def flexions(figure: Figure, axes: Array) -> Array:
    """Return how far knees and elbows are bent, below 0 where past straight [deg]. Shape (F, 4)."""
    size = np.linalg.norm(figure.crosses, axis=-1)
    side = np.where(np.sum(figure.crosses * axes, axis=-1) < 0.0, -1.0, 1.0)
    return np.degrees(np.arctan2(side * size, figure.dots))


def folds(figure: Figure, sizes: Sizes) -> Array:
    """Return how far knees fold backward and elbows forward, 1 wholly and -1 the other way, in the rest pose's frame.

    Shape (4,). In the rest pose joints are not turned, so that forward is what is square to the hips and up.
    """
    rest = sizes.rest()
    across = rest[sizes.roles["left_hip"]] - rest[sizes.roles["right_hip"]]
    forward = np.cross(across, [0.0, 1.0, 0.0])
    outcome = []
    for hinge, axis in zip(HINGES, hinge_axes(figure), strict=True):
        side, what = hinge.split("_")
        upper = rest[sizes.roles[f"{side}_{'hip' if what == 'knee' else 'shoulder'}"]]
        way = np.cross(axis, rest[sizes.roles[hinge]] - upper)
        outcome.append((-1.0 if what == "knee" else 1.0) * float(np.dot(way, forward)) / np.linalg.norm(way))
    return np.array(outcome) / np.linalg.norm(forward)


def ground(figure: Figure, fps: float) -> float:
    """Return the height of the floor under a figure: the median of its lowest sole over its stiller half."""
    soles = figure.soles.reshape(len(figure.soles), 4, 3)
    speeds = np.linalg.norm(np.diff(soles, axis=0), axis=-1).min(axis=1) * fps
    still = np.flatnonzero(speeds <= np.median(speeds))
    return float(np.median(soles[still, :, 1].min(axis=1)))


@dataclass(frozen=True)
class Source:
    """The capture that a policy plays, by the database's playback frames.

    Attributes:
        figure: What the capture shows there, its floor at 0.
        clips: Clip of each frame; a clip and its mirror image have one number. Shape (P,).
        starts: First playback frame of each clip, mirror images counted apart, and the end.
        apart: How far roots of the bundle's database lie from those of the capture at the most, over the floor [m].
        floors: How far the two disagree on each clip's floor [m]. Shape (clips,).
        backward: Clips whose knees fold forward or elbows backward in the file, seen from the rest pose, and which.
            Such elbows are turned here.
    """

    figure: Figure
    clips: Array
    starts: Array
    apart: float
    floors: Array
    backward: list[tuple[str, str]]


def read_source(paths: list[Path], sizes: Sizes) -> Source:
    """Read the clips of a policy from their files, frames in the order of its database."""
    found = {path.stem: path for path in paths}
    parts: list[Figure] = []
    numbers: list[int] = []
    clips: list[Array] = []
    floors: list[float] = []
    backward: list[tuple[str, str]] = []
    apart = 0.0
    starts = sizes.clip_starts * sizes.stride
    seen: dict[str, tuple[int, Figure]] = {}
    for clip, name in enumerate(sizes.clip_names):
        low, high = starts[clip], starts[clip + 1]
        plain = name.removesuffix(MIRROR)
        if name.endswith(MIRROR):
            number, shown = seen[plain]
            parts.append(mirror(shown))
        else:
            figure, _, fps = read_figure(found[plain], sizes)
            wrong = [HINGES[k] for k in np.flatnonzero(folds(figure, sizes) < 0.0)]
            backward += [(plain, hinge) for hinge in wrong]
            if wrong:
                figure, _, fps = read_figure(found[plain], sizes, tuple(name for name in wrong if "elbow" in name))
            step, roots = round(fps / sizes.rate), sizes.roots[low:high]
            # Where the database begins in the file, which may open with a calibration pose.
            last = len(figure.joints) - step * (high - low - 1)
            own = figure.joints[:, 0]
            level = [0, 2]
            gaps = [np.abs(own[k::step][: high - low, level] - roots[:, level]).max() for k in range(last)]
            begin = int(np.argmin(gaps))
            apart = max(apart, float(gaps[begin]))
            shown = figure.part(slice(begin, begin + step * (high - low), step))
            floor = ground(figure.part(slice(begin, None)), fps)
            floors.append(float(np.median(shown.joints[:, 0, 1] - roots[:, 1])) - floor)
            shown = _lowered(shown, floor)
            number = len(seen)
            seen[plain] = number, shown
            parts.append(shown)
        numbers.append(number)
        clips.append(np.full(high - low, number))
    return Source(join(parts), np.concatenate(clips), starts, apart, np.array(floors), backward)


def _lowered(figure: Figure, floor: float) -> Figure:
    down = np.array([0.0, floor, 0.0])
    return replace(
        figure,
        joints=figure.joints - down,
        fists=figure.fists - down,
        head=figure.head - down,
        soles=figure.soles - down,
    )
