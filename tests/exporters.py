"""Writes a motion as other programs export it: their joint names, trees, rest poses, units, axes and channels.

A convention is an indented text, one joint a line: its name, the role it turns with, and where it lies. A line without
a place is the joint that plays that role. ``~`` in a name marks a left limb, which is repeated for the right.

Places: ``role``, ``role>other:t`` (on the line from one role to the other, t may leave 0..1), each with an optional
``+x,y,z`` in shares of the body's height; x points to the figure's left.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from turns import about

from crowdsim.bvh.io import Bvh, from_clip, write_bvh
from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import clip_kinematics, forward_kinematics
from crowdsim.motion.skeleton import Clip, Skeleton


@dataclass(frozen=True)
class Node:
    """One joint of a convention; ``place`` is empty where it plays ``role``."""

    name: str
    parent: int
    role: str
    place: str


@dataclass(frozen=True)
class Convention:
    """How one exporter names and hangs its joints."""

    name: str
    nodes: tuple[Node, ...]

    @property
    def roles(self) -> dict[str, str]:
        """The joint that truly plays each role."""
        return {node.role: node.name for node in self.nodes if not node.place and node.role != "world"}


def convention(name: str, sides: tuple[str, str], text: str) -> Convention:
    """Read a convention; ``sides`` replace the ``~`` in names."""
    nodes: list[Node] = []
    lines = [line for line in text.splitlines() if line.strip()]
    stack: list[tuple[int, int]] = []
    index = 0
    while index < len(lines):
        indent = _indent(lines[index])
        if "~" in lines[index]:
            stop = index + 1
            while stop < len(lines) and _indent(lines[stop]) > indent:
                stop += 1
            while stack and stack[-1][0] >= indent:
                stack.pop()
            for side in (0, 1):
                branch = list(stack)
                for line in lines[index:stop]:
                    _append(nodes, branch, line, sides[side], side)
            index = stop
        else:
            _append(nodes, stack, lines[index], "", 0)
            index += 1
    return Convention(name, tuple(nodes))


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _append(nodes: list[Node], stack: list[tuple[int, int]], line: str, side: str, right: int) -> None:
    indent = _indent(line)
    words = line.split("|") if "|" in line else line.split()
    name, role, place = (*[word.strip() for word in words], "")[:3]
    if right:
        role = role.replace("left_", "right_")
        place = place.replace("left_", "RIGHT_").replace("+", "+-").replace("--", "")
        place = place.replace("RIGHT_", "right_")
    while stack and stack[-1][0] >= indent:
        stack.pop()
    nodes.append(Node(name.replace("~", side), stack[-1][1] if stack else -1, role, place))
    stack.append((indent, len(nodes) - 1))


@dataclass(frozen=True)
class Export:
    """How a motion is written.

    Attributes:
        scale: Metres in a file unit.
        up: Turn of the whole world, a quaternion that takes y up to the file's up.
        turn_rest: Whether that turn is in the offsets too, or only in the root's rotation.
        heading: Turn of the rest pose and the motion about the vertical [rad].
        rest: "T", "A", "I" (arms hanging) or "bones" (every joint's own frame lies along its bone).
        order: Rotation order of all joints, or "mixed".
        six: Six channels at every joint.
        fps: Frames a second, of frames picked out of the source's.
    """

    scale: float = 0.01
    up: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    turn_rest: bool = True
    heading: float = 0.0
    rest: str = "T"
    order: str = "ZXY"
    six: bool = False
    every: int = 1
    size: float = 1.0
    frames: slice = field(default_factory=lambda: slice(None))


_HALF = float(np.sqrt(0.5))
UPS = {
    "y": (1.0, 0.0, 0.0, 0.0),
    "z": (_HALF, _HALF, 0.0, 0.0),
    "-z": (_HALF, -_HALF, 0.0, 0.0),
    "-y": (0.0, 1.0, 0.0, 0.0),
    "x": (_HALF, 0.0, 0.0, -_HALF),
    "-x": (_HALF, 0.0, 0.0, _HALF),
}
"""Turns that take +y to the axis."""


def export_motion(clip: Clip, roles: dict[str, int], how: Convention, export: Export = Export()) -> Bvh:
    """Return a clip (y up, rest pose a T-pose that faces +z) as an exporter would write it."""
    skeleton = clip.skeleton
    rest = skeleton.rest_positions() * export.size
    height = float(rest[roles["head"], 1] - rest[[roles["left_foot"], roles["right_foot"]], 1].min()) * 1.15
    places = {role: rest[joint] for role, joint in roles.items()}
    for side in ("left", "right"):
        if f"{side}_toe" not in places:
            places[f"{side}_toe"] = places[f"{side}_foot"] + height * np.array([0.0, -0.035, 0.075])
    world_at, world_turn = clip_kinematics(clip)
    world_at = world_at * export.size
    pose_turn = _rest_turns(skeleton, roles, export.rest)
    facing = quaternion.about_y(export.heading)
    up = np.array(export.up)
    frames = len(world_at)

    at = np.empty((len(how.nodes), 3))
    own = np.empty((frames, len(how.nodes), 4))
    frame_turn = np.empty((len(how.nodes), 4))
    root_path = np.zeros((frames, 3))
    pelvis = places["pelvis"]
    for index, node in enumerate(how.nodes):
        at[index] = _place(node, places, height, pelvis)
        anchor = roles.get(node.role)
        if anchor is None and node.role.endswith("_toe"):
            anchor = roles[node.role.replace("toe", "foot")]
        if anchor is None:
            own[:, index], frame_turn[index] = [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
        else:
            own[:, index] = world_turn[:, anchor]
            frame_turn[index] = quaternion.conjugate(pose_turn[anchor])
        if node.parent < 0:
            if anchor is None:
                root_path[:] = at[index]
            else:
                root_path[:] = world_at[:, anchor] + quaternion.rotate(own[:, index], at[index] - rest[anchor])
    if export.rest == "bones":
        frame_turn = _bone_frames(how, at)
    # A joint's frame in the file is the source's frame turned by ``frame_turn``.
    turned = quaternion.multiply(own, frame_turn)
    turned = quaternion.multiply(facing, turned)
    root_path = quaternion.rotate(facing, root_path)
    turned = quaternion.multiply(up, turned)
    root_path = quaternion.rotate(up, root_path)
    if export.rest != "bones":
        # The rest pose is turned with the world, so that rotations stay small, unless only the root's is to be.
        whole = quaternion.multiply(up, facing) if export.turn_rest else facing
        turned = quaternion.multiply(turned, quaternion.conjugate(whole))
        frame_turn = quaternion.multiply(frame_turn, quaternion.conjugate(whole))
    parents = np.array([node.parent for node in how.nodes], np.int32)
    local = turned.copy()
    offsets = np.zeros((len(how.nodes), 3))
    moving = np.zeros((frames, len(how.nodes), 3))
    moving[:, 0] = root_path
    for index, parent in enumerate(parents):
        if parent >= 0:
            local[:, index] = quaternion.multiply(quaternion.conjugate(turned[:, parent]), turned[:, index])
            offsets[index] = quaternion.rotate(quaternion.conjugate(frame_turn[parent]), at[index] - at[parent])
            moving[:, index] = offsets[index]
    static = [
        index for index, node in enumerate(how.nodes) if node.parent >= 0 and how.nodes[node.parent].role == "world"
    ]
    for index in static:
        anchor = roles.get(how.nodes[index].role)
        if anchor is not None:
            path = world_at[:, anchor] + quaternion.rotate(own[:, index], at[index] - rest[anchor])
            path = quaternion.rotate(quaternion.multiply(up, facing), path)
            parent = int(parents[index])
            moving[:, index] = quaternion.rotate(quaternion.conjugate(turned[:, parent]), path - root_path)
    leaves = [index for index in range(len(parents)) if index not in parents]
    ends = []
    for leaf in leaves:
        way = offsets[leaf] * 0.4
        role = how.nodes[leaf].role
        if role.endswith("_foot") and not how.nodes[leaf].place:
            way = quaternion.rotate(
                quaternion.conjugate(frame_turn[leaf]), (places[role.replace("foot", "toe")] - at[leaf]) * 1.4
            )
        ends.append(way)
    exported = Clip(
        name=how.name,
        skeleton=Skeleton(
            tuple(node.name for node in how.nodes), parents, offsets, np.array(leaves, np.int32), np.array(ends)
        ),
        fps=clip.fps / export.every,
        root_positions=root_path,
        rotations=quaternion.continuous(local),
        translations=moving if export.six or static else None,
    ).sliced(0, frames)
    picked = np.arange(frames)[export.frames][:: export.every]
    exported = replace(
        exported,
        root_positions=exported.root_positions[picked],
        rotations=exported.rotations[picked],
        translations=None if exported.translations is None else exported.translations[picked],
    )
    count = len(how.nodes)
    orders = ["ZXY", "XYZ", "YXZ", "ZYX", "XZY", "YZX"]
    order = [orders[i % 6] for i in range(count)] if export.order == "mixed" else export.order
    return from_clip(exported, order, export.scale)


def _rest_turns(skeleton: Skeleton, roles: dict[str, int], rest: str) -> np.ndarray:
    """World turns of all joints in the wanted rest pose."""
    local = np.zeros((1, skeleton.joint_count, 4))
    local[..., 0] = 1.0
    if rest in ("A", "I"):
        angle = np.deg2rad(45.0 if rest == "A" else 88.0)
        local[0, roles["left_shoulder"]] = about([0.0, 0.0, 1.0], -angle)
        local[0, roles["right_shoulder"]] = about([0.0, 0.0, 1.0], angle)
    return np.asarray(forward_kinematics(skeleton, np.zeros((1, 3)), local)[1][0])


def _bone_frames(how: Convention, at: np.ndarray) -> np.ndarray:
    """For each joint the rotation that takes +y to the direction of its first child, as some programs define bones."""
    turns = np.zeros((len(at), 4))
    turns[:, 0] = 1.0
    for index, node in enumerate(how.nodes):
        children = [i for i, other in enumerate(how.nodes) if other.parent == index]
        way = at[children[0]] - at[index] if children else at[index] - at[node.parent]
        if np.linalg.norm(way) > 1e-6:
            turns[index] = quaternion.between([0.0, 1.0, 0.0], way)
    return turns


def _place(node: Node, places: dict[str, np.ndarray], height: float, pelvis: np.ndarray) -> np.ndarray:
    text = node.place or node.role
    text, _, shift = text.partition("+")
    if text == "world":
        at = np.array([pelvis[0], 0.0, pelvis[2]])
    else:
        start, _, rest = text.partition(">")
        at = places[start]
        if rest:
            end, _, share = rest.partition(":")
            at = at + (places[end] - at) * float(share)
    if shift:
        at = at + height * np.array([float(value) for value in shift.split(",")])
    return np.asarray(at, dtype=float)


def write_export(path: Path, bvh: Bvh) -> Path:
    """Write an export and return its path."""
    write_bvh(path, bvh)
    return path
