"""Interpretation of BVH files: unit, up axis, roles and body are found, and faults reported."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from crowdsim.bvh.file import FARTHEST
from crowdsim.bvh.io import Bvh, rotate_up, to_clip
from crowdsim.bvh.people import read_people, split_name
from crowdsim.capture import units
from crowdsim.capture.folding import fold_elbows_forward
from crowdsim.core.types import Array, FileName
from crowdsim.errors import MotionError
from crowdsim.motion.analysis import ClipAnalysis, analyse_clip
from crowdsim.motion.body import Body, standing_height
from crowdsim.motion.joint_tree import JointTree
from crowdsim.motion.measuring import (
    MeasuredClip,
    finite_frames,
    human_roles,
    lead_in,
    measure_body,
    rests_like_a_body,
    sample_poses,
)
from crowdsim.motion.resampling import resample
from crowdsim.motion.skeleton import Clip, Skeleton
from crowdsim.motion.strikes import ALL_LIMBS

ANALYSIS_RATE = 60.0
"""Rate at which contacts and strikes of a file are found [1/s]."""

_FLIP = np.deg2rad(100.0)
_FLIP_SPEED = 50.0
"""A joint that rotates further than this in one frame [rad], faster than this [rad/s], has flipped."""
_MOST_FLIPS = 20
_LOOSE = 0.03
"""Share of the body's height by which a joint of a limb may move against its parent, as skin does."""


@dataclass(frozen=True)
class Capture:
    """A BVH file and what was found out about it.

    Attributes:
        bvh: The file as it is.
        clip: Its motion, y up, in metres where the scale is known and in file units where it is not; all frames,
            lead-in included. Elbows that fold backward in the file fold forward in it. Without a frame when the file
            has none.
        finite: Whether every number of the motion is finite.
        body: The human body on its skeleton; None when there is none, or no scale for it.
        roles: Joint of each role; empty when this is no human body.
        unit_scale: Metres in a file unit; None when unknown.
        up_axis: The axis that is up in the file; None when unknown (y is taken).
        lead_in: Frames at the start that are a calibration pose and the jump out of it.
        findings: What is odd, a line each.
        faults: Those of the findings for which the file cannot be trained on.
    """

    bvh: Bvh
    clip: Clip
    finite: bool
    body: Body | None
    roles: dict[str, int]
    unit_scale: float | None
    up_axis: str | None
    lead_in: int
    findings: tuple[str, ...]
    faults: tuple[str, ...]

    @property
    def motion(self) -> Clip:
        """The clip without its lead-in."""
        return self.clip.sliced(self.lead_in, self.clip.frame_count)

    @property
    def start(self) -> float:
        """Time in the file at which the motion begins [s]."""
        return self.lead_in / self.clip.fps

    @cached_property
    def analysis(self) -> ClipAnalysis | None:
        """Contacts and strikes of all limbs in the motion, at ``ANALYSIS_RATE``; None without a body that moves."""
        motion = self.motion
        if self.body is None or motion.frame_count < 2:
            return None
        if not (np.isfinite(motion.root_positions).all() and np.isfinite(motion.rotations).all()):
            return None
        return analyse_clip(resample(motion, ANALYSIS_RATE), self.body, limbs=ALL_LIMBS)


class _Notes:
    """Collects findings and faults of a file."""

    def __init__(self, bvh: Bvh) -> None:
        self.findings = [without_path(finding, bvh.path) for finding in bvh.findings]
        self.faults = [without_path(fault, bvh.path) for fault in bvh.faults]

    def find(self, *what: str) -> None:
        """Note findings."""
        self.findings.extend(what)

    def fault(self, *what: str) -> None:
        """Note findings for which the file cannot be trained on."""
        self.findings.extend(what)
        self.faults.extend(what)


def load_people(path: FileName, unit: str | float | None = None, up_axis: str | None = None) -> list[Capture]:
    """Read a BVH file and find out what each person in it is; trees that are no people are left out where others are.

    Raises:
        BvhError: The file is no BVH.
        MotionError: The given unit or axis is unknown.
    """
    captures = [_interpret(bvh, unit, up_axis) for bvh in read_people(path)]
    return [capture for capture in captures if capture.roles] or captures[:1]


def load_capture(path: FileName, unit: str | float | None = None, up_axis: str | None = None) -> Capture:
    """Read a BVH file and find out what it is; of several people in it, the first.

    Args:
        path: The file, or one person in it: ``capture.bvh#2``.
        unit: Its unit, a name of ``crowdsim.capture.units.UNITS`` or metres; found when None.
        up_axis: Its up axis, 'y' or '-z' say; found when None.

    Raises:
        BvhError: The file is no BVH.
        MotionError: The given unit or axis is unknown.
    """
    return load_people(path, unit, up_axis)[0]


def _interpret(bvh: Bvh, unit: str | float | None, up_axis: str | None) -> Capture:
    """Find out what one tree of joints in a file is."""
    scale = None if unit is None else units.parse_unit(unit)
    axis = None if up_axis is None else units.parse_up_axis(up_axis)
    raw, notes = to_clip(_within_reach(bvh)), _Notes(bvh)
    file, number = split_name(bvh.path)
    raw = replace(raw, name=file.stem if number is None else f"{file.stem}#{number}")
    poses, turned = sample_poses(raw)
    roles = human_roles(raw.skeleton, poses, turned)
    if not roles:
        notes.fault(f"no human body found in {raw.skeleton.joint_count} joints: {_names(raw.skeleton)}")
    if axis is None:
        axis = _find_up_axis(raw.skeleton, roles, poses)
        if axis is None:
            notes.find("up axis unknown, y is taken: the body is neither upright nor keeps to a floor")
    if scale is None:
        scale = _find_scale(raw.skeleton, roles, poses, notes)
    clip = _in_metres(raw, scale or 1.0, axis or "y")
    finite = bool(finite_frames(clip).all())
    if roles and finite:
        clip, wrong = fold_elbows_forward(clip, roles)
        notes.find(*(f"{role.replace('_', ' ')} folds backward, it is corrected to fold forward" for role in wrong))
    if clip.frame_count <= 1:
        notes.fault("no frames, expected motion" if clip.frame_count == 0 else "a single frame, expected motion")
    body = measure_body(clip, roles) if roles and scale is not None else None
    start = 0
    if clip.frame_count > 1 and finite:
        start = lead_in(clip, body) if body is not None else 0
        notes.fault(*_flips(clip, start))
        notes.find(*_moving_joints(clip, body))
    return Capture(
        bvh=bvh,
        clip=clip,
        finite=finite,
        body=body,
        roles=roles,
        unit_scale=scale,
        up_axis=axis,
        lead_in=start,
        findings=tuple(notes.findings),
        faults=tuple(notes.faults),
    )


def usable_clip(capture: Capture, strict: bool = True) -> MeasuredClip:
    """Return a capture's clip with its body and lead-in, if it can be trained on.

    Args:
        capture: The capture.
        strict: Refuse wrong row counts and flips of joints too, not only what has no motion of a body of known size.

    Raises:
        MotionError: It cannot: the file and every reason, a line each.
    """
    usable = capture.finite and capture.clip.frame_count > 1 and not (strict and capture.faults)
    if capture.body is not None and usable:
        return MeasuredClip(capture.clip, capture.body, capture.lead_in)
    source = capture.clip.source
    raise MotionError("\n".join(with_path(fault, source) for fault in capture.faults))


def without_path(finding: str, path: str) -> str:
    """Return a finding of the file, ``PATH:LINE:COLUMN: what``, without its path."""
    if not finding.startswith(path + ":"):
        return finding
    return re.sub(r"^(\d+):(\d+): ", r"line \1, column \2: ", finding[len(path) + 1 :]).lstrip()


def with_path(finding: str, path: FileName) -> str:
    """Return a finding of a capture, ``line LINE, column COLUMN: what``, as ``PATH:LINE:COLUMN: what``.

    What is found out about a file as a whole has no line of its own, and gets the first one.
    """
    found = re.match(r"line (\d+), column (\d+): ", finding)
    return f"{path}:1:1: {finding}" if found is None else f"{path}:{found[1]}:{found[2]}: {finding[found.end() :]}"


def _within_reach(bvh: Bvh) -> Bvh:
    """Return the file with NaN in place of numbers so great that they can be no motion, which are faults of it."""
    if not bvh.motion.size or np.abs(bvh.motion).max() <= FARTHEST:
        return bvh
    return replace(bvh, motion=np.where(np.abs(bvh.motion) <= FARTHEST, bvh.motion, np.nan))


def _names(skeleton: Skeleton) -> str:
    shown = ", ".join(skeleton.names[:6])
    return shown + (" ..." if skeleton.joint_count > 6 else "")


def _find_scale(skeleton: Skeleton, roles: dict[str, int], poses: Array, notes: _Notes) -> float | None:
    """Metres in a file unit by the height of the body; None when it is unknown, which is a fault."""
    if not roles:
        notes.fault("unknown scale: without a human body there is nothing to measure it by")
        return None
    height = standing_height(skeleton, roles, poses[0] if len(poses) else None)
    scale = units.find_scale(height)
    if scale is None:
        notes.fault(units.describe_heights(height))
    return scale


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


def _in_metres(clip: Clip, scale: float, up_axis: str) -> Clip:
    """The clip in metres and y up, as ``to_clip`` with this scale and axis makes it."""
    if scale == 1.0 and up_axis == "y":
        return clip
    rotated = up_axis != "y"

    def move(positions: Array) -> Array:
        return np.asarray(rotate_up(positions * scale, up_axis) if rotated else positions * scale)

    rotations = clip.rotations
    if rotated:
        rotations = np.concatenate([rotations[..., :1], rotate_up(rotations[..., 1:], up_axis)], axis=-1)
    skeleton = replace(clip.skeleton, offsets=move(clip.skeleton.offsets), end_offsets=move(clip.skeleton.end_offsets))
    return replace(
        clip,
        skeleton=skeleton,
        root_positions=move(clip.root_positions),
        rotations=rotations,
        translations=None if clip.translations is None else move(clip.translations),
    )


def _flips(clip: Clip, start: int) -> list[str]:
    """Joints that rotate further in one frame than a body can."""
    least = max(_FLIP, _FLIP_SPEED / clip.fps)
    if least >= np.pi:
        return []
    dots = np.abs(np.einsum("fjc,fjc->fj", clip.rotations[start + 1 :], clip.rotations[start:-1]))
    flips = np.argwhere(dots < np.cos(0.5 * least))
    found = []
    for frame, joint in flips[:_MOST_FLIPS]:
        angle = np.rad2deg(2.0 * np.arccos(dots[frame, joint]))
        found.append(
            f"joint {clip.skeleton.names[joint]!r} flips by {angle:.0f} degrees "
            f"between frames {start + frame} and {start + frame + 1}"
        )
    if len(flips) > _MOST_FLIPS:
        found.append(f"{len(flips) - _MOST_FLIPS} more flips of joints")
    return found


def _moving_joints(clip: Clip, body: Body | None) -> list[str]:
    """Joints of limbs and trunk that move against their parents by more than skin does."""
    if clip.translations is None or body is None:
        return []
    tree = JointTree(clip.skeleton, None)
    bones = {joint for end in body.roles.values() for joint in tree.path(end)}
    bones -= set(tree.path(body.roles["pelvis"]))
    bones -= set(tree.path(body.roles["spine"])[:-1])
    chosen = np.array(sorted(bones))
    span = np.ptp(clip.translations[:, chosen], axis=0).max(axis=-1, initial=0.0)
    moving = np.flatnonzero(span > _LOOSE * body.height)
    if not len(moving):
        return []
    worst = int(moving[np.argmax(span[moving])])
    name = clip.skeleton.names[chosen[worst]]
    return [f"{len(moving)} joints move against their parents, {name!r} by {span[worst]:.3f} m"]
