"""How a BVH file is read: its numbers, and what is taken for its unit, its up axis, its roles and its body.

A reading is never changed. Repairs of faults (``crowdsim.capture.faults``) return another one, and everything below the
file follows from that anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from crowdsim.bvh.clip import in_metres, rotate_up, to_clip
from crowdsim.bvh.file import FARTHEST, Bvh
from crowdsim.bvh.people import split_person
from crowdsim.capture import units
from crowdsim.capture.columns import path_of, with_path
from crowdsim.capture.evidence import Evidence, gather_evidence, picked
from crowdsim.capture.folding import fold_forward
from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body, standing_height
from crowdsim.motion.joint_tree import JointTree
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import (
    finite_frames,
    human_roles,
    lead_in,
    measure_body,
    rests_like_a_body,
    sample_poses,
)
from crowdsim.motion.skeleton import Clip, Skeleton


@dataclass(frozen=True)
class Reading:
    """A BVH file with what is taken for granted about it.

    Attributes:
        bvh: The file, repaired where its numbers needed that.
        unit: Metres in a file unit; found by the body's height when None.
        axis: The axis that is up in the file; found when None.
        tilt: Rotation of the world, after its up axis is y, that puts it upright; None where it is.
        folded: Roles of elbows that fold backward in the file and are corrected.
        lost: Frames whose poses are not those of the body. Shape (F,), bool; None where there are none.
        cuts: Frames that do not go on from the one before, so that a clip ends there and another begins.
    """

    bvh: Bvh
    unit: float | None = None
    axis: str | None = None
    tilt: Array | None = None
    folded: tuple[str, ...] = ()
    lost: Array | None = None
    cuts: tuple[int, ...] = ()

    @cached_property
    def raw(self) -> Clip:
        """The motion in file units with the file's axes."""
        bvh = self.bvh
        if bvh.motion.size and not np.abs(bvh.motion).max() <= FARTHEST:
            bvh = replace(bvh, motion=np.where(np.abs(bvh.motion) <= FARTHEST, bvh.motion, np.nan))
        file, number = split_person(bvh.path)
        return replace(to_clip(bvh), name=file.stem if number is None else f"{file.stem}#{number}")

    @cached_property
    def samples(self) -> tuple[Array, Array]:
        """Joints of a few frames that are not lost, in file units with the file's axes: (n, J, 3) and (n, J, 4)."""
        return sample_poses(self.raw if self.lost is None else picked(self.raw, ~self.lost))

    @property
    def poses(self) -> Array:
        """Their positions."""
        return self.samples[0]

    @cached_property
    def roles(self) -> dict[str, int]:
        """Joint of each role; empty when this is no human body."""
        return human_roles(self.raw.skeleton, *self.samples)

    @cached_property
    def up_axis(self) -> str | None:
        """The axis that is up in the file; None when nothing shows it."""
        return _find_up_axis(self.raw.skeleton, self.roles, self.poses) if self.axis is None else self.axis

    @cached_property
    def carrier(self) -> int:
        """The joint whose positions carry the body: the root, or one below a root that stays at the origin."""
        if not self.roles:
            return 0
        chain = [self.roles["pelvis"]]
        while self.raw.skeleton.parents[chain[-1]] >= 0:
            chain.append(int(self.raw.skeleton.parents[chain[-1]]))
        lengths = [float(np.abs(np.diff(path_of(self.bvh, joint), axis=0)).sum()) for joint in chain[::-1]]
        return chain[::-1][int(np.argmax(lengths))]

    @property
    def path(self) -> Array:
        """Positions of the carrier in the file. Shape (F, 3)."""
        return path_of(self.bvh, self.carrier)

    def with_path(self, path: Array) -> Reading:
        """Return the reading with other positions of the carrier."""
        return replace(self, bvh=with_path(self.bvh, self.carrier, path))

    @cached_property
    def to_world(self) -> Array:
        """Matrix that takes vectors of the file, as the carrier's positions are, to those with y up. Shape (3, 3)."""
        axes = np.eye(3)
        parent = int(self.raw.skeleton.parents[self.carrier])
        if parent >= 0:
            axes = quaternion.rotate(clip_kinematics(self.raw.sliced(0, 1))[1][0, parent], axes)
        return rotate_up(axes, self.up_axis or "y").T

    @cached_property
    def height(self) -> float | None:
        """Standing height of the body in file units; None without a body."""
        if not self.roles:
            return None
        return standing_height(self.raw.skeleton, self.roles, self.poses[0] if len(self.poses) else None)

    @cached_property
    def scale(self) -> float | None:
        """Metres in a file unit; None when unknown."""
        if self.unit is not None or self.height is None:
            return self.unit
        return units.find_scale(self.height)

    @cached_property
    def clip(self) -> Clip:
        """The motion, y up, in metres where the scale is known and in file units where it is not."""
        clip = in_metres(self.raw, self.scale or 1.0, self.up_axis or "y")
        if self.tilt is not None:
            clip = _rotated(clip, self.tilt)
        if self.folded:
            clip = fold_forward(clip, self.roles, self.folded)
        return clip if self.lost is None else _bridged(clip, self.lost)

    @cached_property
    def finite(self) -> bool:
        """Whether every number of the motion is finite."""
        return bool(finite_frames(self.raw).all())

    @cached_property
    def body(self) -> Body | None:
        """The human body on the skeleton; None when there is none, or no scale for it."""
        if not self.roles or self.scale is None:
            return None
        return measure_body(self.clip if self.lost is None else picked(self.clip, ~self.lost), self.roles)

    @cached_property
    def evidence(self) -> Evidence | None:
        """How the body moves; None without one, or where numbers are missing."""
        if self.body is None or not self.finite or self.clip.frame_count < 2:
            return None
        return gather_evidence(self.clip, self.body, self.lost)

    def in_motion(self, frames: Array) -> Array:
        """Return those of frames (n,) that are behind a pose held at first, and neither in nor behind lost ones."""
        if self.body is None or not len(frames):
            return frames
        frames = frames[frames > lead_in(self.clip, self.body)]
        return frames if self.lost is None else frames[~(self.lost[frames] | self.lost[frames - 1])]


def _find_up_axis(skeleton: Skeleton, roles: dict[str, int], poses: Array) -> str | None:
    """The axis that is up in a file; None when nothing shows it."""
    rest = skeleton.rest_positions()
    group = poses if len(poses) else rest[None]
    if roles:
        feet = [roles["left_foot"], roles["right_foot"]]
        return units.find_up_axis(rest if rests_like_a_body(skeleton, roles) else None, group, [roles["head"]], feet)
    # Of a body that is no human's, legs hang down from where they begin; arms and wings even out.
    tree = JointTree(skeleton, group)
    limbs = [limb for pair in tree.mirrored_pairs() for limb in pair]
    tops, tips = [tree.parents[limb] for limb in limbs], [tree.main_chain(limb)[-1] for limb in limbs]
    axis = units.find_up_axis(None, group, tops, tips)
    # Files of other than humans have y or z up; limbs that point elsewhere are no legs.
    return axis if axis in (None, "y", "z") else units.find_up_axis(None, group, [], [])


def _bridged(clip: Clip, lost: Array) -> Clip:
    """The clip with poses between those around them in frames that are lost, so that nothing jumps there."""
    known = np.flatnonzero(~lost)
    if not len(known) or len(known) == len(lost):
        return clip
    after = np.minimum(np.searchsorted(known, np.arange(len(lost))), len(known) - 1)
    first, last = known[np.maximum(after - 1, 0)], known[after]
    share = np.where(lost, (np.arange(len(lost)) - first) / np.maximum(last - first, 1), 1.0)
    share = np.clip(share, 0.0, 1.0)[:, None]
    moved = clip.translations
    return replace(
        clip,
        root_positions=clip.root_positions[first] * (1.0 - share) + clip.root_positions[last] * share,
        rotations=np.where(
            lost[:, None, None],
            quaternion.slerp(
                clip.rotations[first], clip.rotations[last], np.broadcast_to(share, clip.rotations.shape[:2])
            ),
            clip.rotations,
        ),
        translations=None
        if moved is None
        else moved[first] * (1.0 - share[..., None]) + moved[last] * share[..., None],
    )


def _rotated(clip: Clip, turn: Array) -> Clip:
    """The clip in a world that is rotated about its origin; the rest pose stays."""
    roots = quaternion.rotate(turn, clip.root_positions)
    rotations = clip.rotations.copy()
    rotations[:, 0] = quaternion.multiply(turn, rotations[:, 0])
    moved = clip.translations
    if moved is not None:
        moved = moved.copy()
        moved[:, 0] = roots
    return replace(clip, root_positions=roots, rotations=rotations, translations=moved)
