"""Retargeting: the motion of one skeleton on another, with other names, joints and bone lengths.

Every joint of the target rotates away from a T-pose as the source's joint of the same role does, so that trunk, head
and bones point where the source's point. Positions follow from proportions: the path of the hips is scaled by the
length of the legs, soles are where the source's are on that scale, fists where the source's are beside the shoulders
on the scale of the arms. What is planted in the source stays planted.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.joint_tree import JointTree
from crowdsim.motion.kinematics import clip_kinematics, forward_kinematics
from crowdsim.motion.measuring import MeasuredClip, rests_like_a_body, sample_poses
from crowdsim.motion.skeleton import Clip

SIDES = ("left", "right")
BONES = {
    "thigh": ("hip", "knee"),
    "shank": ("knee", "foot"),
    "upper arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "hand"),
    "trunk": ("hip", "shoulder"),
}
"""Roles between which lengths are compared; those of the trunk between the middles of both sides."""
MOST_UNLIKE = 1.5
"""Greatest ratio of bones, on the scale of the bodies, up to which two skeletons are two people."""
_STRETCH = 0.9995
"""Share of its length to which a limb is stretched at the most."""
_RAISED = 0.2
"""A foot this much higher than the other, as a share of the height, does not lower the pelvis."""
_STRAIGHT = 0.2
"""How far the middle of a limb is from the line between its ends, as a share of the upper bone, from which on the pose
alone decides where it bends."""
_LEVEL = 0.012
"""Height of a ball over its heel, as a share of the height, at which a foot begins to be on its heel."""
_SMOOTH = 0.1
"""Time over which the pelvis is lowered [s]."""
_OPEN, _LEAST_BEND = 0.06, 0.01
"""How far a limb bends in its usual direction before its pose decides, and on the average for that direction to be
known from the motion, as shares of its upper bone."""
_LEFT, _UP, _AHEAD = np.eye(3)


@dataclass(frozen=True)
class Retargeted:
    """A clip brought to another skeleton, and what was changed.

    Attributes:
        measured: The clip on the target's skeleton, with its body.
        scale: Length of the target's legs over that of the source's, by which paths are scaled.
        bones: How much longer each of ``BONES`` is than the source's on that scale, mean of both sides [m].
        soles: Furthest distance of a sole from where the source's is on that scale, in the median frame [m].
        fists: Likewise of a fist, beside the shoulders on the scale of the arms.
        lowered: Furthest that the pelvis was lowered for feet to reach the floor [m].
    """

    measured: MeasuredClip
    scale: float
    bones: Mapping[str, float]
    soles: float
    fists: float
    lowered: float

    def describe(self) -> str:
        """Return in words what was changed, lengths in centimetres."""
        bones = ", ".join(f"{name} {100.0 * gap:+.1f}" for name, gap in self.bones.items() if abs(gap) >= 5e-4)
        parts = [f"{self.scale:.3f} times as large" if abs(self.scale - 1.0) >= 5e-4 else "as large"]
        parts += [f"bones {bones} cm"] if bones else []
        parts += [f"soles within {100.0 * self.soles:.1f} cm", f"fists within {100.0 * self.fists:.1f} cm"]
        parts += [f"pelvis lowered by up to {100.0 * self.lowered:.1f} cm"] if self.lowered >= 5e-4 else []
        return ", ".join(parts)


def retarget(source: MeasuredClip, target: MeasuredClip) -> Retargeted:
    """Bring a clip to the skeleton of another one.

    Args:
        source: The clip, with its body.
        target: A clip on the wanted skeleton, with its body; its motion is looked at only where its rest pose is no
            pose of a body.

    Raises:
        MotionError: Proportions are too unlike to be those of two people: which bones, with their lengths.
    """
    ours, theirs = _Rig(source), _Rig(target)
    unlike = _unlike_bones(ours, theirs, source.body.height, target.body.height)
    if unlike:
        raise MotionError(f"{source.clip.name!r} is unlike {target.clip.name!r}: {'; '.join(unlike)}")
    positions, rotations = clip_kinematics(source.clip)
    swings = _swings(ours, theirs, rotations)
    world = quaternion.multiply(swings, theirs.reference)
    scale = theirs.leg / ours.leg
    posing = _Posing(theirs, world, 0.5 * scale * (positions[:, ours.hips[0]] + positions[:, ours.hips[1]]))
    soles = _soles(source.body, ours, positions, rotations)
    wanted = [scale * sole for sole, _ in soles]
    shares = [share for _, share in soles]
    lowered = posing.plant(wanted, shares, target.body, source.clip.fps)
    reached = posing.reach(_fists(source.body, ours, positions, rotations, theirs.arm / ours.arm), target.body)
    clip = Clip(
        name=source.clip.name,
        skeleton=target.clip.skeleton,
        fps=source.clip.fps,
        root_positions=posing.root_positions(),
        rotations=quaternion.continuous(posing.local()),
        source=source.clip.source,
    )
    at, turned = clip_kinematics(clip)
    gaps = [
        np.linalg.norm(_sole(target.body, theirs, side, at, turned, shares[side]) - wanted[side], axis=-1)
        for side in range(2)
    ]
    return Retargeted(
        measured=MeasuredClip(clip, target.body, source.lead_in),
        scale=scale,
        bones={name: theirs.bones[name] - scale * ours.bones[name] for name in BONES},
        soles=float(np.median(np.max(gaps, axis=0))) if clip.frame_count else 0.0,
        fists=float(np.median(reached)) if clip.frame_count else 0.0,
        lowered=lowered,
    )


def _unlike_bones(ours: _Rig, theirs: _Rig, own_height: float, height: float) -> list[str]:
    """Return in words which bones are too unlike to be those of two people, with their joints and lengths."""
    size = own_height / height
    found = []
    for name, (start, end) in BONES.items():
        ratio = ours.bones[name] / size / max(theirs.bones[name], 1e-9)
        if not 1.0 / MOST_UNLIKE < ratio < MOST_UNLIKE:
            joints = " to ".join(ours.named(role) for role in (start, end))
            found.append(
                f"{name} ({joints}) of {100.0 * ours.bones[name]:.1f} cm at a height of {own_height:.2f} m, "
                f"expected about {100.0 * size * theirs.bones[name]:.1f} cm"
            )
    return found


def target_of(clips: Sequence[MeasuredClip]) -> int:
    """Return which clip others are brought to the skeleton of: the first of the skeleton with the longest motion."""
    firsts: list[int] = []
    seconds: list[float] = []
    for index, one in enumerate(clips):
        same = [at for at, first in enumerate(firsts) if not clips[first].clip.skeleton.difference(one.clip.skeleton)]
        if same:
            seconds[same[0]] += one.clip.seconds
        else:
            firsts.append(index)
            seconds.append(one.clip.seconds)
    return firsts[int(np.argmax(seconds))]


def to_one_skeleton(clips: Sequence[MeasuredClip]) -> tuple[list[MeasuredClip], dict[str, Retargeted]]:
    """Bring clips of several skeletons to the one with the longest motion.

    Returns:
        The clips, and for those that were brought to it what was changed, by name.

    Raises:
        MotionError: A skeleton is unlike that one.
    """
    if not clips:
        return [], {}
    target = clips[target_of(clips)]
    brought = {
        index: retarget(one, target)
        for index, one in enumerate(clips)
        if target.clip.skeleton.difference(one.clip.skeleton)
    }
    result = [brought[index].measured if index in brought else one for index, one in enumerate(clips)]
    return result, {clips[index].clip.name: change for index, change in brought.items()}


class _Rig:
    """What is needed of a skeleton to carry motion over: its T-pose, chains and lengths.

    Attributes:
        skeleton: The skeleton.
        roles: Its joints by role.
        reference: Rotation of each joint in the world in a T-pose that faces +z. Shape (J, 4).
        bones: Lengths of ``BONES``, mean of both sides [m].
        leg: Length of a leg from the hip to the ankle [m].
        arm: Length from the middle between the shoulders to a fist of a stretched arm [m].
        hips: The two hip joints.
        shoulders: The two shoulder joints.
    """

    def __init__(self, measured: MeasuredClip) -> None:
        self.skeleton, self.roles = measured.clip.skeleton, measured.body.roles
        self.tree = JointTree(self.skeleton, None)
        self.hips = [self.roles[f"{side}_hip"] for side in SIDES]
        self.shoulders = [self.roles[f"{side}_shoulder"] for side in SIDES]
        self.reference = _reference(measured, self.tree)
        at = np.zeros((self.skeleton.joint_count, 3))
        for joint, parent in enumerate(self.tree.parents):
            if parent >= 0:
                at[joint] = at[parent] + quaternion.rotate(self.reference[parent], self.skeleton.offsets[joint])
        places = {role: at[joint] for role, joint in self.roles.items()}
        self.bones = {}
        for name, (start, end) in BONES.items():
            ways = np.stack([places[f"{side}_{end}"] - places[f"{side}_{start}"] for side in SIDES])
            mean = np.linalg.norm(ways.mean(axis=0)) if name == "trunk" else np.linalg.norm(ways, axis=1).mean()
            self.bones[name] = float(mean)
        self.leg = self.bones["thigh"] + self.bones["shank"]
        wide = 0.5 * float(np.linalg.norm(places["left_shoulder"] - places["right_shoulder"]))
        fist = float(np.linalg.norm(measured.body.fist_offsets, axis=1).mean())
        self.arm = wide + self.bones["upper arm"] + self.bones["forearm"] + fist

    def named(self, role: str) -> str:
        """The name of the left joint of a role."""
        return self.skeleton.names[self.roles[f"left_{role}"]]

    def between(self, above: int, below: int) -> list[int]:
        """Joints from one, included, to one that hangs on it, left out."""
        path = self.tree.path(below)
        return path[path.index(above) : -1] if above in path else []


def _reference(measured: MeasuredClip, tree: JointTree) -> Array:
    """Return the rotations of the joints in the world in a T-pose that faces +z. Shape (J, 4).

    The rest pose if that is one of a body, else the pose with the straightest arms, is turned to face +z, and limbs are
    rotated to a T by the smallest rotations.
    """
    skeleton, roles = measured.clip.skeleton, measured.body.roles
    rests = rests_like_a_body(skeleton, roles)
    if rests:
        at, turned = skeleton.rest_positions(), np.tile([1.0, 0.0, 0.0, 0.0], (skeleton.joint_count, 1))
    else:
        at, turned = _straightest(measured)
    hips = [at[roles[f"{side}_hip"]] for side in SIDES]
    trunk = _unit(at[roles["neck"]] - 0.5 * (hips[0] + hips[1]))
    across = hips[0] - hips[1] + at[roles["left_shoulder"]] - at[roles["right_shoulder"]]
    whole = _aligned(trunk if rests else _UP, across)
    at, turned = quaternion.rotate(whole, at), quaternion.multiply(whole, turned)
    if not rests:
        # A pose of the motion leans; the head is taken to look ahead in it.
        upright = quaternion.between(quaternion.rotate(whole, trunk), _UP)
        for joint in set(range(skeleton.joint_count)) - {j for role in _LIMBS for j in tree.below(roles[role])}:
            turned[joint] = quaternion.multiply(upright, turned[joint])
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        for chain, way in (
            (("shoulder", "elbow", "hand"), sign * _LEFT),
            (("hip", "knee", "foot"), -_UP),
        ):
            joints = [roles[f"{side}_{role}"] for role in chain]
            for start, end in itertools.pairwise(joints):
                turn = quaternion.between(at[end] - at[start], way)
                moved = set(tree.below(start)) - set(tree.below(end))
                if chain[-1] == "hand" and end == joints[-1]:
                    moved |= set(tree.below(end))
                for joint in moved:
                    turned[joint] = quaternion.multiply(turn, turned[joint])
        if not rests:
            index = SIDES.index(side)
            sole = measured.body.sole_offsets[index]
            up = quaternion.rotate(turned[roles[f"{side}_foot"]], _upward(sole))
            ahead = quaternion.rotate(turned[roles[f"{side}_foot"]], sole[1] - sole[0])
            flat = _aligned(up, np.cross(up, ahead))
            for joint in tree.below(roles[f"{side}_foot"]):
                turned[joint] = quaternion.multiply(flat, turned[joint])
    return turned


_LIMBS = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


def _straightest(measured: MeasuredClip) -> tuple[Array, Array]:
    """Return positions (J, 3) and rotations (J, 4) of the pose whose arms are straightest, upright ones first."""
    roles = measured.body.roles
    positions, rotations = sample_poses(measured.clip)
    stretch = np.zeros(len(positions))
    for side in SIDES:
        shoulder, elbow, hand = (positions[:, roles[f"{side}_{role}"]] for role in ("shoulder", "elbow", "hand"))
        lengths = np.linalg.norm(elbow - shoulder, axis=-1) + np.linalg.norm(hand - elbow, axis=-1)
        stretch += np.linalg.norm(hand - shoulder, axis=-1) / np.maximum(lengths, 1e-9)
    feet = 0.5 * (positions[:, roles["left_foot"], 1] + positions[:, roles["right_foot"], 1])
    stretch += 4.0 * (positions[:, roles["head"], 1] - feet) / measured.body.height
    best = int(np.argmax(stretch))
    return positions[best], rotations[best].copy()


def _aligned(up: Array, across: Array) -> Array:
    """Return the rotation after which ``up`` is +y and ``across``, made square to it, +x. Shape (4,)."""
    first = quaternion.between(up, _UP)
    across = quaternion.rotate(first, across)
    return quaternion.multiply(quaternion.about_y(float(np.arctan2(across[2], across[0]))), first)


def _swings(ours: _Rig, theirs: _Rig, rotations: Array) -> Array:
    """Return how each joint of the target rotates away from its T-pose: as the source's does. Shape (F, J, 4)."""
    away = quaternion.multiply(rotations, quaternion.conjugate(ours.reference))
    result = np.empty((len(rotations), theirs.skeleton.joint_count, 4))
    taken = np.full(theirs.skeleton.joint_count, -1)

    def follow(targets: list[int], sources: list[int]) -> None:
        """Let joints of a chain follow those of another one, by their shares of its length."""
        if not targets or not sources:
            return
        places, shares = (_shares(rig.tree, chain) for rig, chain in ((ours, sources), (theirs, targets)))
        for joint, share in zip(targets, shares, strict=True):
            at = float(np.interp(share, places, np.arange(len(sources))))
            low = min(int(at), len(sources) - 1)
            high = min(low + 1, len(sources) - 1)
            result[:, joint] = quaternion.slerp(away[:, sources[low]], away[:, sources[high]], at - low)
            taken[joint] = sources[low]

    for joint in theirs.tree.path(theirs.roles["pelvis"]):
        follow([joint], [ours.roles["pelvis"]])
    trunk = ("pelvis", "spine", "chest", "neck", "head")
    for start, end in itertools.pairwise(trunk):
        chains = [rig.between(rig.roles[start], rig.roles[end]) for rig in (theirs, ours)]
        follow(chains[0], chains[1] or [ours.roles[start]])
    follow([theirs.roles["head"]], [ours.roles["head"]])
    for side in SIDES:
        for hub, chain in (("pelvis", ("hip", "knee", "foot", "toe")), ("chest", ("shoulder", "elbow", "hand"))):
            top = [rig.roles[f"{side}_{chain[0]}"] for rig in (theirs, ours)]
            hubs = [rig.tree.common([rig.roles[hub], joint]) for rig, joint in zip((theirs, ours), top, strict=True)]
            links = [
                rig.between(*ends)[1:] for rig, ends in zip((theirs, ours), zip(hubs, top, strict=True), strict=True)
            ]
            follow(links[0], links[1] or [hubs[1]])
            for start, end in zip(chain, (*chain[1:], ""), strict=True):
                role, after = f"{side}_{start}", f"{side}_{end}"
                if role not in theirs.roles:
                    continue
                own = ours.roles.get(role, ours.roles[f"{side}_foot"])
                bone = theirs.between(theirs.roles[role], theirs.roles[after]) if after in theirs.roles else []
                follow(bone or [theirs.roles[role]], [own])
    # Fingers, eyes and the like follow those of the same name, else what they hang on. Names are known without numbers:
    # the second joint of a name follows the second one.
    alike: dict[Any, list[int]] = {}
    for joint, name in enumerate(ours.tree.names):
        alike.setdefault(name, []).append(joint)
    seen: Counter[Any] = Counter()
    for joint, name in enumerate(theirs.tree.names):
        same, place = alike.get(name, []) if name[1] else [], seen[name]
        seen[name] += 1
        if taken[joint] < 0:
            source = same[min(place, len(same) - 1)] if same else None
            parent = theirs.tree.parents[joint]
            result[:, joint] = away[:, source] if source is not None else result[:, parent]
            taken[joint] = taken[parent] if source is None else source
    return result


def _shares(tree: JointTree, chain: list[int]) -> Array:
    """Return where the joints of a chain are along it: 0 to 1, the last one before its end."""
    depth = np.array([tree.depth[joint] for joint in chain]) - tree.depth[chain[0]]
    if depth[-1] < 1e-9:
        return np.zeros(len(chain)) if len(chain) == 1 else np.arange(len(chain)) / (len(chain) - 1)
    return depth / depth[-1] + 1e-12 * np.arange(len(chain))


def _upward(sole: Array) -> Array:
    """The direction from a sole, heel and ball (2, 3), to the foot joint over it."""
    ahead = _unit(sole[1] - sole[0])
    return _unit(ahead * np.dot(sole[0], ahead) - sole[0])


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-12))


def _soles(body: Body, rig: _Rig, positions: Array, rotations: Array) -> list[tuple[Array, Array]]:
    """Return where the sole of each foot is lowest (F, 3), and how far from the heel to the ball that is (F,)."""
    found = []
    for index, side in enumerate(SIDES):
        foot = rig.roles[f"{side}_foot"]
        heel, ball = (quaternion.rotate(rotations[:, foot], offset) for offset in body.sole_offsets[index])
        # A foot that is flat is planted by its ball, and by its heel only while the ball is raised.
        share = 1.0 / (1.0 + np.exp(-np.clip((heel - ball)[:, 1] / (_LEVEL * body.height) + 3.0, -30.0, 30.0)))
        found.append((_sole(body, rig, index, positions, rotations, share), share))
    return found


def _sole(body: Body, rig: _Rig, side: int, positions: Array, rotations: Array, share: Array) -> Array:
    """Return a point of a sole, at a share of the way from the heel to the ball. Shape (F, 3)."""
    foot = rig.roles[f"{SIDES[side]}_foot"]
    heel, ball = body.sole_offsets[side]
    offset = heel + share[:, None] * (ball - heel)
    return np.asarray(positions[:, foot] + quaternion.rotate(rotations[:, foot], offset))


def _fists(body: Body, rig: _Rig, positions: Array, rotations: Array, scale: float) -> list[Array]:
    """Return where the fists are from the middle between the shoulders, scaled. Two of shape (F, 3)."""
    middle = 0.5 * (positions[:, rig.shoulders[0]] + positions[:, rig.shoulders[1]])
    hands = [rig.roles[f"{side}_hand"] for side in SIDES]
    return [
        scale * (positions[:, hand] + quaternion.rotate(rotations[:, hand], offset) - middle)
        for hand, offset in zip(hands, body.fist_offsets, strict=True)
    ]


class _Posing:
    """Poses of the target that are corrected: rotations in the world, and where the hips are."""

    def __init__(self, rig: _Rig, world: Array, hips: Array) -> None:
        self.rig, self.world, self.hips = rig, world, hips

    def local(self) -> Array:
        """Rotations against the parents. Shape (F, J, 4)."""
        local = self.world.copy()
        for joint, parent in enumerate(self.rig.tree.parents):
            if parent >= 0:
                local[:, joint] = quaternion.multiply(quaternion.conjugate(self.world[:, parent]), self.world[:, joint])
        return np.asarray(quaternion.normalise(local))

    def root_positions(self) -> Array:
        """Positions of the root at which the middle between the hips is where it is to be. Shape (F, 3)."""
        at, _ = forward_kinematics(self.rig.skeleton, np.zeros_like(self.hips), self.local())
        return np.asarray(self.hips - 0.5 * (at[:, self.rig.hips[0]] + at[:, self.rig.hips[1]]))

    def positions(self) -> Array:
        """Positions of all joints. Shape (F, J, 3)."""
        return forward_kinematics(self.rig.skeleton, self.root_positions(), self.local())[0]

    def plant(self, soles: list[Array], shares: list[Array], body: Body, fps: float) -> float:
        """Put soles where they are to be, the pelvis lowered where legs are too short; return by how much [m]."""
        from scipy.ndimage import gaussian_filter1d, maximum_filter1d

        feet = [self.rig.roles[f"{side}_foot"] for side in SIDES]
        ankles = []
        for side, foot in enumerate(feet):
            heel, ball = body.sole_offsets[side]
            offset = heel + shares[side][:, None] * (ball - heel)
            ankles.append(soles[side] - quaternion.rotate(self.world[:, foot], offset))
        positions = self.positions()
        length = _STRETCH * (self.rig.bones["thigh"] + self.rig.bones["shank"])
        lower = np.zeros(len(self.hips))
        for side in range(2):
            way = ankles[side] - positions[:, self.rig.hips[side]]
            level = way[:, 0] ** 2 + way[:, 2] ** 2
            short = -way[:, 1] - np.sqrt(np.maximum(length**2 - level, 0.0))
            down = ankles[side][:, 1] - ankles[1 - side][:, 1] < _RAISED * body.height
            lower = np.maximum(lower, np.where(down & (level < length**2), short, 0.0))
        if len(lower) and lower.max() > 0.0:
            width = max(1, round(_SMOOTH * fps))
            lower = gaussian_filter1d(maximum_filter1d(lower, 4 * width + 1), width)
            self.hips = self.hips - lower[:, None] * _UP
        for side, name in enumerate(SIDES):
            self._reach([self.rig.roles[f"{name}_{role}"] for role in ("hip", "knee", "foot")], ankles[side])
        return float(lower.max(initial=0.0))

    def reach(self, fists: list[Array], body: Body) -> Array:
        """Put fists where they are to be from the middle between the shoulders; return the gaps [m]. Shape (F,)."""
        positions = self.positions()
        middle = 0.5 * (positions[:, self.rig.shoulders[0]] + positions[:, self.rig.shoulders[1]])
        gaps = []
        for side, name in enumerate(SIDES):
            joints = [self.rig.roles[f"{name}_{role}"] for role in ("shoulder", "elbow", "hand")]
            wrist = middle + fists[side] - quaternion.rotate(self.world[:, joints[2]], body.fist_offsets[side])
            gaps.append(self._reach(joints, wrist))
        return np.max(gaps, axis=0) if len(self.hips) else np.zeros(0)

    def _reach(self, joints: list[int], goals: Array) -> Array:
        """Bend a limb in its plane so that its end comes to goals (F, 3); return the gaps [m]. Shape (F,)."""
        top, middle, end = joints
        positions = self.positions()
        start, elbow, tip = (positions[:, joint] for joint in joints)
        upper, lower = np.linalg.norm(elbow - start, axis=-1), np.linalg.norm(tip - elbow, axis=-1)
        way = goals - start
        far = np.linalg.norm(way, axis=-1)
        reach = np.clip(far, np.abs(upper - lower) * 1.001 + 1e-6, _STRETCH * (upper + lower))
        along = _unit(way)
        # Knees bend ahead and elbows back in a T-pose, and as they do on the average where limbs are straight.
        swing = quaternion.multiply(self.world[:, top], quaternion.conjugate(self.rig.reference[top]))
        bend = elbow - start - np.sum((elbow - start) * _unit(tip - start), axis=-1, keepdims=True) * _unit(tip - start)
        usual = quaternion.rotate(quaternion.conjugate(swing), bend).sum(axis=0)
        usual = _unit(usual + _LEAST_BEND * upper.sum() * (_AHEAD if top in self.rig.hips else -_AHEAD))
        pole = quaternion.rotate(swing, usual)
        # A nearly straight limb does not bend the other way, as noise of captured joints has it.
        straight = np.clip(1.0 - np.linalg.norm(bend, axis=-1) / (_STRAIGHT * upper), 0.0, 1.0)
        against = straight * np.minimum(np.sum(bend * pole, axis=-1), 0.0)
        side = bend + (_OPEN * upper - against)[:, None] * pole
        side = _unit(side - np.sum(side * along, axis=-1, keepdims=True) * along)
        cosine = np.clip((upper**2 + reach**2 - lower**2) / (2.0 * upper * reach), -1.0, 1.0)
        sine = np.sqrt(1.0 - cosine**2)
        bent = start + upper[:, None] * (cosine[:, None] * along + sine[:, None] * side)
        moved = start + reach[:, None] * along
        for first, last, before, after in (
            (top, middle, elbow - start, bent - start),
            (middle, end, tip - elbow, moved - bent),
        ):
            turn = quaternion.between(before, after)
            kept = set(self.rig.tree.below(first)) - set(self.rig.tree.below(last))
            for joint in kept:
                self.world[:, joint] = quaternion.multiply(turn, self.world[:, joint])
        return np.asarray(np.abs(far - reach))
