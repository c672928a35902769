"""Converts BVH files to clips in metres, y up, and clips to BVH: the only border where units and axes change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.bvh.channel_kernels import channels_to_quaternions, quaternions_to_channels
from crowdsim.bvh.file import AXIS, Bvh
from crowdsim.core.types import Array
from crowdsim.errors import BvhError, nearest
from crowdsim.motion.skeleton import Clip, Skeleton

UP_AXES: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "y": ((0, 1, 2), (1, 1, 1)),
    "-y": ((0, 1, 2), (1, -1, -1)),
    "z": ((0, 2, 1), (1, 1, -1)),
    "-z": ((0, 2, 1), (1, -1, 1)),
    "x": ((1, 0, 2), (-1, 1, 1)),
    "-x": ((1, 0, 2), (1, -1, 1)),
}
"""For each up axis of a file, the file's axes and their signs that become our x, y and z: rotations by 90 and 180
degrees."""

_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
_POSITIONS = ("Xposition", "Yposition", "Zposition")
_STILL = 1e-5
_MOST_POSES, _FEW_POSES = 1 << 26, 1 << 22
_MOST_JOINTS_A_NUMBER = 4


def rotate_up(vectors: ArrayLike, up_axis: str) -> Array:
    """Rotate vectors (..., 3) of a file with the given up axis so that y is up, exactly."""
    order, signs = UP_AXES[up_axis]
    return np.asarray(vectors)[..., order] * np.array(signs, dtype=float)


def to_clip(bvh: Bvh, unit_scale: float = 1.0, up_axis: str = "y") -> Clip:
    """Return the motion of a file's first root in metres, y up.

    The whole file is rotated, rest pose and motion alike: with U the rotation, an offset o becomes U o and a local
    rotation R becomes U R U^-1, so that the rest pose is upright too and all rotations are the identity in it.

    A joint's position channels replace its offset, the root's too; an axis without a channel keeps the offset's part.
    Where a joint's positions do not change over the clip they become its offset; ``translations`` is None when that is
    so for every joint. Scale channels are not used. Rotations are continuous over frames. Values that are not finite
    stay so.

    Args:
        bvh: The file.
        unit_scale: Metres in one file unit, 0.01 for centimetres.
        up_axis: Axis that is up in the file: 'y', 'z', 'x', '-y', '-z' or '-x'.

    Raises:
        BvhError: The up axis is unknown, the scale is no positive number, or frames times joints are too many.
    """
    if up_axis not in UP_AXES:
        raise BvhError(
            f"up axis {up_axis!r} is unknown, expected one of {', '.join(UP_AXES)}{nearest(up_axis, UP_AXES)}"
        )
    if not (np.isfinite(unit_scale) and unit_scale > 0.0):
        raise BvhError(f"unit scale {unit_scale!r} is no number of metres above 0")
    roots = np.flatnonzero(bvh.parents < 0)
    joints = int(roots[1]) if len(roots) > 1 else bvh.joint_count
    frames = bvh.frame_count
    # Joints without channels cost a file nothing, and memory as much as others do.
    if frames * joints > min(_MOST_POSES, max(_FEW_POSES, _MOST_JOINTS_A_NUMBER * bvh.motion.size)):
        raise BvhError(
            f"{bvh.path}:1:1: {frames} frames of {joints} joints are more than fit in memory, expected at most "
            f"{_MOST_POSES:,} poses of joints, and no more than {_MOST_JOINTS_A_NUMBER} for each number of a file that "
            "is long"
        )

    offsets = np.array(bvh.offsets[:joints], float)
    rotations = np.empty((frames, joints, 4))
    columns, axes, first = _rotation_channels(bvh, joints)
    channels_to_quaternions(np.ascontiguousarray(bvh.motion, float), first, columns, axes, rotations)
    moves = _read_positions(bvh, joints)
    roots_at = moves.pop(0, np.repeat(offsets[:1], frames, axis=0))
    _settle(moves, offsets)
    translations = None
    if moves and frames:
        translations = np.repeat(offsets[None], frames, axis=0)
        translations[:, 0] = roots_at
        for joint, positions in moves.items():
            translations[:, joint] = positions
    ends = bvh.end_parents < joints
    skeleton = Skeleton(
        names=bvh.names[:joints],
        parents=np.ascontiguousarray(bvh.parents[:joints], np.int32),
        offsets=offsets,
        end_parents=np.ascontiguousarray(bvh.end_parents[ends], np.int32),
        end_offsets=np.array(bvh.end_offsets[ends], float),
    )
    clip = Clip(Path(bvh.path).stem, skeleton, bvh.fps, roots_at, rotations, translations, source=bvh.path)
    return in_metres(clip, unit_scale, up_axis)


def in_metres(clip: Clip, unit_scale: float, up_axis: str) -> Clip:
    """Return a clip in file units with the file's axes in metres, y up."""
    if unit_scale == 1.0 and up_axis == "y":
        return clip

    def move(positions: Array) -> Array:
        return rotate_up(positions * unit_scale, up_axis) if up_axis != "y" else positions * unit_scale

    rotations, skeleton = clip.rotations, clip.skeleton
    if up_axis != "y":
        rotations = np.concatenate([rotations[..., :1], rotate_up(rotations[..., 1:], up_axis)], axis=-1)
    return replace(
        clip,
        skeleton=replace(skeleton, offsets=move(skeleton.offsets), end_offsets=move(skeleton.end_offsets)),
        root_positions=move(clip.root_positions),
        rotations=rotations,
        translations=None if clip.translations is None else move(clip.translations),
    )


def _rotation_channels(bvh: Bvh, joints: int) -> tuple[Array, Array, Array]:
    """Return columns and axes of rotation channels, and where each joint's begin. All int64."""
    starts = bvh.first_channels()
    columns, axes, first = [], [], [0]
    for joint in range(joints):
        for place, name in enumerate(bvh.channels[joint]):
            if name.endswith("rotation"):
                columns.append(int(starts[joint]) + place)
                axes.append(AXIS[name[0]])
        first.append(len(columns))
    return np.array(columns, np.int64), np.array(axes, np.int64), np.array(first, np.int64)


def _read_positions(bvh: Bvh, joints: int) -> dict[int, Array]:
    """Return positions (F, 3) of the joints that have position channels, in file units."""
    starts = bvh.first_channels()
    moves = {}
    for joint in range(joints):
        own = [(place, AXIS[name[0]]) for place, name in enumerate(bvh.channels[joint]) if name.endswith("position")]
        if own:
            moves[joint] = np.repeat(bvh.offsets[joint : joint + 1], bvh.frame_count, axis=0)
            for place, axis in own:
                moves[joint][:, axis] = bvh.motion[:, int(starts[joint]) + place]
    return moves


def _settle(moves: dict[int, Array], offsets: Array) -> None:
    """Make the positions of joints that do not move their offsets (J, 3), and leave the others in ``moves``."""
    for joint in list(moves):
        positions = moves[joint]
        if len(positions) and np.isfinite(positions).all():
            low, high = positions.min(axis=0), positions.max(axis=0)
            if (high - low).max() <= _STILL * np.abs(positions).max():
                offsets[joint] = positions[0] if (high == low).all() else np.median(positions, axis=0)
                del moves[joint]


def check_orders(orders: str | Sequence[str], joints: int) -> tuple[str, ...]:
    """Return one rotation order a joint.

    Raises:
        BvhError: An order is none of the six, or their number is not that of the joints.
    """
    every = (orders,) * joints if isinstance(orders, str) else tuple(orders)
    if len(every) != joints:
        raise BvhError(f"{len(every)} rotation orders for {joints} joints, expected one for each or one for all")
    for order in every:
        if order not in _ORDERS:
            raise BvhError(f"rotation order {order!r} is unknown, expected one of {', '.join(_ORDERS)}")
    return every


def clip_channels(joints: int, orders: str | Sequence[str], moving: bool) -> tuple[tuple[str, ...], ...]:
    """Return the channel names that a clip is written with.

    Args:
        joints: Number of joints J.
        orders: Rotation order of all joints, 'ZXY' say, or one for each.
        moving: Whether joints other than the root have positions too, as a clip with translations needs.
    """
    every = check_orders(orders, joints)
    angles = [tuple(f"{letter}rotation" for letter in order) for order in every]
    return tuple(_POSITIONS + own if moving or not joint else own for joint, own in enumerate(angles))


def channel_motion(
    channels: Sequence[Sequence[str]],
    root_positions: Array,
    rotations: Array,
    translations: Array | None = None,
    unit_scale: float = 0.01,
    previous: Array | None = None,
) -> Array:
    """Return the rows of a file with channels as ``clip_channels`` gives them; Euler angles do not jump.

    Each triple of angles is the one nearest to the frame before among all that mean the same rotation.

    Args:
        channels: Channel names of each joint.
        root_positions: Position of the root [m]. Shape (F, 3).
        rotations: Local rotations. Shape (F, J, 4), wxyz.
        translations: Positions of the joints in their parents' frames [m], where they have position channels. Shape
            (F, J, 3).
        unit_scale: Metres in one file unit.
        previous: The angles of the frame before [deg], so that chunks join: shape (J, 3), changed in place to those of
            the last frame; a first chunk passes NaN.

    Returns:
        Positions in file units and angles in degrees. Shape (F, C).
    """
    frames, joints = rotations.shape[:2]
    starts = np.concatenate([[0], np.cumsum([len(own) for own in channels])]).astype(np.int64)
    orders, columns = np.empty((joints, 3), np.int64), np.empty(joints, np.int64)
    motion = np.empty((frames, int(starts[-1])))
    for joint, own in enumerate(channels):
        if len(own) == 6:
            positions = root_positions if joint == 0 or translations is None else translations[:, joint]
            motion[:, starts[joint] : starts[joint] + 3] = positions / unit_scale
        columns[joint] = starts[joint + 1] - 3
        orders[joint] = [AXIS[name[0]] for name in own[-3:]]
    if previous is None:
        previous = np.full((joints, 3), np.nan)
    local = np.ascontiguousarray(rotations, float)
    quaternions_to_channels(local, orders, columns, previous, bool(np.isfinite(previous).all()), motion)
    return motion


def file_order(parents: Array) -> Array:
    """Return the joints in the order in which a file holds them: each with all that hangs on it before the next."""
    children: list[list[int]] = [[] for _ in parents]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(joint)
    found, todo = [], [int(root) for root in np.flatnonzero(np.asarray(parents) < 0)[::-1]]
    while todo:
        joint = todo.pop()
        found.append(joint)
        todo.extend(reversed(children[joint]))
    return np.array(found, dtype=np.int64)


def depth_first(clip: Clip, order: str | Sequence[str]) -> tuple[Clip, str | Sequence[str]]:
    """Return a clip, and its joints' rotation orders, with the joints as a file holds them."""
    skeleton = clip.skeleton
    joints = file_order(skeleton.parents)
    if np.array_equal(joints, np.arange(len(joints))):
        return clip, order
    place = np.argsort(joints)
    parents = np.where(skeleton.parents >= 0, place[skeleton.parents], -1)[joints].astype(np.int32)
    ends = np.argsort(place[skeleton.end_parents], kind="stable")
    moved = Skeleton(
        names=tuple(skeleton.names[joint] for joint in joints),
        parents=parents,
        offsets=skeleton.offsets[joints],
        end_parents=place[skeleton.end_parents][ends].astype(np.int32),
        end_offsets=skeleton.end_offsets[ends],
    )
    result = order if isinstance(order, str) or len(order) != len(joints) else [order[joint] for joint in joints]
    translations = None if clip.translations is None else clip.translations[:, joints]
    return replace(clip, skeleton=moved, rotations=clip.rotations[:, joints], translations=translations), result


def from_clip(clip: Clip, order: str | Sequence[str] = "ZXY", unit_scale: float = 0.01) -> Bvh:
    """Return a clip as BVH, y up: six channels at the root, three at every other joint, six where joints move.

    Args:
        clip: The clip.
        order: Rotation order of all joints, or one for each joint.
        unit_scale: Metres in one file unit; centimetres by default.

    Raises:
        BvhError: An order is unknown or the scale is no positive number.
    """
    if not (np.isfinite(unit_scale) and unit_scale > 0.0):
        raise BvhError(f"unit scale {unit_scale!r} is no number of metres above 0")
    clip, orders = depth_first(clip, order)
    skeleton = clip.skeleton
    channels = clip_channels(skeleton.joint_count, orders, clip.translations is not None)
    return Bvh(
        names=skeleton.names,
        parents=skeleton.parents,
        offsets=skeleton.offsets / unit_scale,
        channels=channels,
        end_parents=skeleton.end_parents,
        end_offsets=skeleton.end_offsets / unit_scale,
        end_names=("Site",) * len(skeleton.end_parents),
        motion=channel_motion(channels, clip.root_positions, clip.rotations, clip.translations, unit_scale),
        declared_frames=clip.frame_count,
        frame_time=1.0 / clip.fps,
        fps=clip.fps,
        path=clip.source,
    )
