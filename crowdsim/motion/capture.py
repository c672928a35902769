"""A BVH file understood: unit, up axis, roles and body found, and everything that is odd about it told."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.errors import MotionError
from crowdsim.motion import units
from crowdsim.motion.body import Body, build_body, standing_height
from crowdsim.motion.bvh import Bvh, read_bvh, to_clip
from crowdsim.motion.cleaning import lead_in
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Clip, Skeleton

Array = NDArray[Any]

_SAMPLES = 64
"""Poses looked at to find roles and axes."""
_FLIP = np.deg2rad(100.0)
_FLIP_SPEED = 50.0
"""A joint that turns further than this in one frame [rad], faster than this [rad/s], has flipped."""
_MOST_FLIPS = 20


@dataclass(frozen=True)
class Capture:
    """A BVH file and what was found out about it.

    Attributes:
        bvh: The file as it stands.
        clip: Its motion, y up, in metres where the scale is known and in file units where it is not; all frames, lead-in
            included. Without a frame when the file has none.
        body: The human body on its skeleton; None when there is none, or no scale for it.
        roles: Joint of each role; empty when this is no human body.
        unit_scale: Metres in a file unit; None when unknown.
        up_axis: The axis that is up in the file; None when unknown (y is taken).
        lead_in: Frames at the start that are a calibration pose and the jump out of it.
        findings: What is odd, a line each.
    """

    bvh: Bvh
    clip: Clip
    body: Body | None
    roles: dict[str, int]
    unit_scale: float | None
    up_axis: str | None
    lead_in: int
    findings: tuple[str, ...]

    @property
    def motion(self) -> Clip:
        """The clip without its lead-in."""
        return self.clip.sliced(self.lead_in, self.clip.frame_count)


def load_capture(path: str | os.PathLike[str], unit: str | float | None = None, up_axis: str | None = None) -> Capture:
    """Read a BVH file and find out what it is.

    Args:
        path: The file.
        unit: Its unit, a name of ``crowdsim.motion.units.UNITS`` or metres; found when None.
        up_axis: Its up axis, 'y' or '-z' say; found when None.

    Raises:
        BvhError: The file is no BVH.
        MotionError: The given unit or axis is unknown.
    """
    scale = None if unit is None else units.parse_unit(unit)
    axis = None if up_axis is None else units.parse_up_axis(up_axis)
    bvh = read_bvh(path)
    findings = [_without_path(finding, str(path)) for finding in bvh.findings]
    raw = to_clip(bvh)
    finite = np.isfinite(raw.root_positions).all(axis=1) & np.isfinite(raw.rotations).all(axis=(1, 2))
    poses = _sample_poses(raw, finite)
    roles = find_roles(raw.skeleton, poses if len(poses) else None)
    rest = raw.skeleton.rest_positions()
    if roles and not _is_human(raw.skeleton, roles, poses if len(poses) else rest[None]):
        roles = {}
    if not roles:
        findings.append(f"no human body found in {raw.skeleton.joint_count} joints: {_names(raw.skeleton)}")
    if axis is None:
        heads, feet = _ends(raw.skeleton, roles)
        axis = units.find_up_axis(rest, poses if len(poses) else rest[None], heads, feet)
        if axis is None:
            findings.append("up axis unknown, y is taken: the body neither stands nor keeps to a floor")
    if scale is None and roles:
        height = standing_height(raw.skeleton, roles)
        scale = units.find_scale(height)
        if scale is None:
            sizes = ", ".join(f"{height * metres:.2f} m in {name}" for name, metres in units.UNITS.items())
            findings.append(f"unknown scale: the body would stand {sizes}; expected 1 m to 2.4 m")
    elif scale is None:
        findings.append("unknown scale: without a human body there is nothing to measure it by")
    clip = to_clip(bvh, scale or 1.0, axis or "y")
    if clip.frame_count <= 1:
        findings.append("no frames, expected motion" if clip.frame_count == 0 else "a single frame, expected motion")
    body = build_body(clip.skeleton, roles) if roles and scale is not None else None
    usable = clip.frame_count > 1 and bool(finite.all())
    start = lead_in(clip, body) if body is not None and usable else 0
    if usable:
        findings.extend(_flips(clip, start))
        findings.extend(_moving_joints(clip, body))
    return Capture(bvh, clip, body, roles, scale, axis, start, tuple(findings))


def usable_clip(capture: Capture) -> Clip:
    """Return a capture's clip if it can be trained on.

    Raises:
        MotionError: It cannot: the file and every reason, a line each.
    """
    if capture.body is not None and capture.clip.frame_count > 1 and not capture.findings:
        return capture.clip
    raise MotionError("\n".join(f"{capture.clip.source}: {finding}" for finding in capture.findings))


def _without_path(finding: str, path: str) -> str:
    return finding[len(path) + 1 :] if finding.startswith(path + ":") else finding


def _names(skeleton: Skeleton) -> str:
    shown = ", ".join(skeleton.names[:6])
    return shown + (" ..." if skeleton.joint_count > 6 else "")


def _sample_poses(clip: Clip, finite: Array) -> Array:
    """Joint positions of a few frames spread over the clip. Shape (n, J, 3)."""
    frames = np.flatnonzero(finite)
    if len(frames) > _SAMPLES:
        frames = frames[np.linspace(0, len(frames) - 1, _SAMPLES).astype(int)]
    moved = None if clip.translations is None else clip.translations[frames]
    return forward_kinematics(clip.skeleton, clip.root_positions[frames], clip.rotations[frames], moved)[0]


def _ends(skeleton: Skeleton, roles: dict[str, int]) -> tuple[list[int], list[int]]:
    """Joints at the top and at the bottom of a body; of a body that is no human's, its root and its leaves."""
    if roles:
        return [roles["head"]], [roles["left_foot"], roles["right_foot"]]
    leaves = [joint for joint in range(skeleton.joint_count) if not skeleton.children(joint)]
    return [0], leaves or [0]


def _is_human(skeleton: Skeleton, roles: dict[str, int], poses: Array) -> bool:
    """Whether proportions are a human's: two long legs and arms, not four legs or a pair of wings."""
    lengths = np.linalg.norm(skeleton.offsets, axis=1)

    def along(start: str, end: str) -> float:
        total, joint = 0.0, roles[end]
        while joint != roles[start] and joint >= 0:
            total += float(lengths[joint])
            joint = int(skeleton.parents[joint])
        return total

    legs = [along(f"{side}_hip", f"{side}_foot") for side in ("left", "right")]
    arms = [along(f"{side}_shoulder", f"{side}_hand") for side in ("left", "right")]
    trunk = along("pelvis", "head")
    if min(*legs, *arms, trunk) <= 0.0:
        return False
    leg, arm = float(np.mean(legs)), float(np.mean(arms))
    proportionate = 0.4 < arm / leg < 1.35 and 0.35 < trunk / leg < 1.5
    symmetric = abs(legs[0] - legs[1]) < 0.2 * leg and abs(arms[0] - arms[1]) < 0.2 * arm
    return proportionate and symmetric and _is_upright(skeleton, roles, poses)


def _is_upright(skeleton: Skeleton, roles: dict[str, int], poses: Array) -> bool:
    """Whether the trunk goes on where the legs end, as in anyone who stands, and does not lie across them."""
    rest = skeleton.rest_positions()
    aligned = []
    for group in (rest[None], poses):
        hips = 0.5 * (group[:, roles["left_hip"]] + group[:, roles["right_hip"]])
        feet = 0.5 * (group[:, roles["left_foot"]] + group[:, roles["right_foot"]])
        shoulders = 0.5 * (group[:, roles["left_shoulder"]] + group[:, roles["right_shoulder"]])
        legs, trunk = hips - feet, shoulders - hips
        scale = np.linalg.norm(legs, axis=-1) * np.linalg.norm(trunk, axis=-1)
        aligned.append(float(np.median(np.sum(legs * trunk, axis=-1) / np.maximum(scale, 1e-12))))
    return max(aligned) > 0.6


def _flips(clip: Clip, start: int) -> list[str]:
    """Joints that turn further in one frame than a body can."""
    dots = np.abs(np.sum(clip.rotations[start + 1 :] * clip.rotations[start:-1], axis=-1))
    angles = 2.0 * np.arccos(np.clip(dots, 0.0, 1.0))
    places = np.argwhere((angles > _FLIP) & (angles * clip.fps > _FLIP_SPEED))
    found = [
        f"joint {clip.skeleton.names[joint]!r} flips by {np.rad2deg(angles[frame, joint]):.0f} degrees "
        f"between frames {start + frame} and {start + frame + 1}"
        for frame, joint in places[:_MOST_FLIPS]
    ]
    if len(places) > _MOST_FLIPS:
        found.append(f"{len(places) - _MOST_FLIPS} more flips of joints")
    return found


def _moving_joints(clip: Clip, body: Body | None) -> list[str]:
    """Joints that move against their parents by more than skin does."""
    if clip.translations is None or body is None:
        return []
    span = np.ptp(clip.translations[:, 1:], axis=0).max(axis=-1, initial=0.0)
    moving = np.flatnonzero(span > 0.03 * body.height) + 1
    if not len(moving):
        return []
    worst = int(moving[np.argmax(span[moving - 1])])
    return [
        f"{len(moving)} joints move against their parents, {clip.skeleton.names[worst]!r} by {span[worst - 1]:.3f} m"
    ]
