"""Several people in a file: each tree of a BVH file as a file of its own, named ``capture.bvh#2``."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from crowdsim.bvh.clip import from_clip, to_clip
from crowdsim.bvh.file import Bvh, quoted
from crowdsim.bvh.reader import read_bvh
from crowdsim.core.types import Array, FileName
from crowdsim.errors import BvhError
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import sample_poses
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Skeleton

_LEAST_JOINTS = 10
"""Least number of joints of a human body."""

_NUMBERED = re.compile(r"(.+)#([1-9]\d{0,3})")
_APART = 0.2
"""Share of a body's size by which two bodies that hang on one root lie apart."""


def split_person(path: FileName) -> tuple[Path, int | None]:
    """Return the file that a name means, and the number of the person in it: 2 of ``capture.bvh#2``.

    The number is None without one, and where a file has that name.
    """
    path = Path(path)
    found = _NUMBERED.fullmatch(path.name)
    if found is None or path.is_file():
        return path, None
    return path.with_name(found[1]), int(found[2])


def read_people(path: FileName) -> list[Bvh]:
    """Read a BVH file, each tree of joints in it by itself; paths of several are numbered from 1.

    Bodies that hang on one ROOT, such as those of a scene, are taken off it.

    Args:
        path: The file, or one person in it.

    Raises:
        BvhError: The file is no BVH, or has no person of that number.
    """
    file, number = split_person(path)
    bvh = read_bvh(file)
    roots, scene = np.flatnonzero(bvh.parents < 0), _bodies(bvh)
    count = len(scene) or len(roots)
    if number is not None and number > count:
        raise BvhError(f"{file}: no person {number}; the file has {count}")
    if count == 1 and number is None:
        return [bvh]
    wanted = range(count) if number is None else [number - 1]
    if scene:
        return _taken_off(bvh, [(scene[index], f"{file}#{index + 1}") for index in wanted], count)
    return [_person(bvh, index, f"{file}#{index + 1}") for index in wanted]


def _bodies(bvh: Bvh) -> list[int]:
    """Return the joints that human bodies begin with where several hang on one root; none where there is one body."""
    if np.count_nonzero(bvh.parents < 0) != 1 or bvh.joint_count < 2 * _LEAST_JOINTS:
        return []
    skeleton = Skeleton(bvh.names, bvh.parents, bvh.offsets, bvh.end_parents, bvh.end_offsets)
    at = 0
    while len(skeleton.children(at)) == 1:
        at = skeleton.children(at)[0]
    tops = [joint for joint in skeleton.children(at) if find_roles(_part(skeleton, joint)[0])]
    if len(tops) < 2:
        return []
    # Rigs hold copies of a body, which lie in the same place.
    poses = sample_poses(to_clip(bvh))[0]
    found: list[int] = []
    for top in tops:
        size = float(np.ptp(poses[:, _part(skeleton, top)[1]], axis=1).max(initial=0.0))
        gaps = [float(np.median(np.linalg.norm(poses[:, top] - poses[:, other], axis=-1))) for other in found]
        if min(gaps, default=np.inf) > _APART * size:
            found.append(top)
    return found if len(found) > 1 else []


def _part(skeleton: Skeleton, top: int) -> tuple[Skeleton, Array]:
    """Return the part of a skeleton that begins with a joint, and its joints there."""
    inside = np.zeros(skeleton.joint_count, bool)
    for joint, parent in enumerate(skeleton.parents):
        inside[joint] = joint == top or (parent >= 0 and inside[parent])
    joints = np.flatnonzero(inside)
    place = np.cumsum(inside) - 1
    ends = np.flatnonzero(inside[skeleton.end_parents])
    parents = np.where(joints == top, -1, place[skeleton.parents[joints]]).astype(np.int32)
    part = Skeleton(
        names=tuple(skeleton.names[joint] for joint in joints),
        parents=parents,
        offsets=skeleton.offsets[joints],
        end_parents=place[skeleton.end_parents[ends]].astype(np.int32),
        end_offsets=skeleton.end_offsets[ends],
    )
    return part, joints


def _taken_off(bvh: Bvh, wanted: list[tuple[int, str]], count: int) -> list[Bvh]:
    """Return bodies that hang on one root as files of their own, each with its path."""
    clip = to_clip(bvh)
    positions, rotations = clip_kinematics(clip)
    found = []
    for top, path in wanted:
        part, joints = _part(clip.skeleton, top)
        local = clip.rotations[:, joints].copy()
        local[:, 0] = rotations[:, top]
        moved = None if clip.translations is None else clip.translations[:, joints].copy()
        if moved is not None:
            moved[:, 0] = positions[:, top]
        body = replace(clip, skeleton=part, root_positions=positions[:, top], rotations=local, translations=moved)
        note = f"{path}:1:1: {count} bodies hang on ROOT {quoted(bvh.names[0])}: several people, #1 to #{count}"
        found.append(
            replace(
                from_clip(body, unit_scale=1.0),
                declared_frames=bvh.declared_frames,
                frame_time=bvh.frame_time,
                path=path,
                findings=(*(finding.replace(bvh.path, path, 1) for finding in bvh.findings), note),
                faults=tuple(fault.replace(bvh.path, path, 1) for fault in bvh.faults),
            )
        )
    return found


def _person(bvh: Bvh, index: int, path: str) -> Bvh:
    """Return one tree of a file, with its columns; what was found about the file stays."""
    roots = [*np.flatnonzero(bvh.parents < 0).tolist(), bvh.joint_count]
    first, last = roots[index], roots[index + 1]
    columns = bvh.first_channels()
    ends = np.flatnonzero((bvh.end_parents >= first) & (bvh.end_parents < last))
    parents = bvh.parents[first:last]
    return replace(
        bvh,
        names=bvh.names[first:last],
        parents=np.where(parents < 0, -1, parents - first).astype(np.int32),
        offsets=bvh.offsets[first:last],
        channels=bvh.channels[first:last],
        end_parents=(bvh.end_parents[ends] - first).astype(np.int32),
        end_offsets=bvh.end_offsets[ends],
        end_names=tuple(bvh.end_names[end] for end in ends),
        motion=np.ascontiguousarray(bvh.motion[:, columns[first] : columns[last]]),
        path=path,
        findings=tuple(finding.replace(bvh.path, path, 1) for finding in bvh.findings),
        faults=tuple(fault.replace(bvh.path, path, 1) for fault in bvh.faults),
    )
