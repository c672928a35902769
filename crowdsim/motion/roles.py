"""Which joint plays which part of a human body, from names and, where names fail, from the shape of the tree.

Names alone do not settle it: ``LeftShoulder`` is a collar bone to one exporter and an upper arm to the next, ``hip``
may be the pelvis or the top of a leg. So names only find the ends (head, hands, feet) and give hints about joints
between; the joints between are chosen along the chain from the trunk to the end, by bone length.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import joint_names
from crowdsim.motion.joint_tree import JointTree
from crowdsim.motion.skeleton import Skeleton

_LEAST_JOINTS = 10
_MOST_PAIRS = 12
_UPPER_TO_LOWER = 1.1
"""Length of an upper arm or thigh over that of the lower arm or shank; a collar bone is shorter."""
_SAME_PLACE = 0.02
"""Share of a limb's length within which a left and a right joint lie in one place: both hang on the middle."""
_MISFIT = 0.8
"""How far proportions may lie from a human's; arms and trunk of real and drawn people stay below 0.6."""


def find_roles(skeleton: Skeleton, poses: Array | None = None, rotations: Array | None = None) -> dict[str, int]:
    """Return the joint of each role that was found, by names first and by shape and symmetry where names fail.

    Args:
        skeleton: The skeleton, in any unit and orientation.
        poses: Some poses as joint positions in the same unit, shape (n, J, 3), which distinguish left from right where
            names do not; the rest pose when None.
        rotations: Rotations of the joints in the world in these poses, shape (n, J, 4): joints that carry none only
            connect others.

    Returns:
        A joint for each role of ``crowdsim.motion.body.ROLES`` that the skeleton has. Head, hands and feet, and the
        joints between, are there, or the result is empty: then this is no human body.
    """
    if skeleton.joint_count < _LEAST_JOINTS:
        return {}
    tree = JointTree(skeleton, poses, rotations)
    named = _ends_by_name(tree)
    if named is not None:
        roles = _complete(tree, named)
        if roles and misfit(tree, roles) < _MISFIT:
            return roles
    best: dict[str, int] = {}
    least = _MISFIT
    for ends in _ends_by_shape(tree):
        roles = _complete(tree, ends)
        if roles and misfit(tree, roles) < least - 1e-9:
            best, least = roles, misfit(tree, roles)
    return best


def misfit(tree: JointTree, roles: Mapping[str, int]) -> float:
    """Return how unlike a human's the proportions are: 0 for an average adult, infinite for what has no limbs."""
    sides = ("left", "right")
    legs = [tree.path_length(roles[f"{side}_hip"], roles[f"{side}_foot"]) for side in sides]
    arms = [tree.path_length(roles[f"{side}_shoulder"], roles[f"{side}_hand"]) for side in sides]
    trunk = tree.path_length(roles["pelvis"], roles["head"])
    if min(*legs, *arms, trunk) <= 0.0:
        return float("inf")
    leg, arm = float(np.mean(legs)), float(np.mean(arms))
    uneven = max(abs(legs[0] - legs[1]) / leg, abs(arms[0] - arms[1]) / arm)
    bones = [
        np.log(tree.path_length(roles[f"{side}_{top}"], roles[f"{side}_{middle}"]) / max(rest, 1e-9) / _UPPER_TO_LOWER)
        for side in sides
        for top, middle, end in (("hip", "knee", "foot"), ("shoulder", "elbow", "hand"))
        if (rest := tree.path_length(roles[f"{side}_{middle}"], roles[f"{side}_{end}"])) >= 0.0
    ]
    shares = np.abs([np.log(arm / leg / 0.67), np.log(trunk / leg / 0.72), 0.7 * float(np.max(np.abs(bones)))])
    return float(max(shares.max(), 3.0 * uneven))


def _ends_by_name(tree: JointTree) -> dict[str, int] | None:
    """The five ends by name, the head by its place where it has no name; None when another is missing."""
    ends: dict[str, int] = {}
    helpers = joint_names.AUXILIARY | joint_names.FINGERS
    for side, name in enumerate(("left", "right")):
        # Where both a wrist and a hand are there, the fist rotates at the wrist; so does the foot at the ankle.
        hands = tree.named(joint_names.WRIST, side, helpers) or tree.named(joint_names.HAND, side, helpers)
        feet = tree.named(joint_names.ANKLE, side, helpers) or tree.named(
            joint_names.FOOT, side, helpers | joint_names.TOE
        )
        if not hands or not feet:
            return None
        ends[f"{name}_hand"] = hands[0]
        ends[f"{name}_foot"] = feet[0]
    heads = tree.named(joint_names.HEAD, None, helpers)
    if heads:
        return {"head": heads[0], **ends}
    hub = tree.common([ends["left_hand"], ends["right_hand"]])
    crown = _crown(tree, hub, [tree.path(ends[role]) for role in ends])
    return None if crown is None else {"head": crown, **ends}


def _ends_by_shape(tree: JointTree) -> list[dict[str, int]]:
    """Every way to take two mirrored pairs of limbs as legs and arms that leaves a head between the arms."""
    pairs = tree.mirrored_pairs()[:_MOST_PAIRS]
    found = []
    for legs in pairs:
        for arms in pairs:
            hub_legs, hub_arms = tree.parents[legs[0]], tree.parents[arms[0]]
            if arms is legs or hub_legs == hub_arms:
                continue
            leg_ends, arm_ends = _pair_ends(tree, legs), _pair_ends(tree, arms)
            if not leg_ends or not arm_ends:
                continue
            limbs = [tree.path(end) for end in (*leg_ends, *arm_ends)]
            crown = _crown(tree, hub_arms, limbs)
            if crown is None:
                continue
            left = _left_of(tree, legs, leg_ends, crown)
            same = _on_side(tree, arms, legs, left)
            found.append(
                {
                    "head": crown,
                    "left_foot": leg_ends[left],
                    "right_foot": leg_ends[1 - left],
                    "left_hand": arm_ends[same],
                    "right_hand": arm_ends[1 - same],
                }
            )
    return found


def _pair_ends(tree: JointTree, pair: tuple[int, int]) -> list[int]:
    """The wrists or ankles of a pair of limbs: the joint after the two longest bones in a row; empty without one.

    The limb with the shorter reach decides for both: the other may hold a sword.
    """
    chains = [tree.main_chain(limb) for limb in pair]
    plain = min(pair, key=lambda limb: (float(tree.depth[tree.main_chain(limb)[-1]]), limb))
    limb = tree.limb(plain)
    if len(limb) < 3:
        return []
    lengths = np.diff(tree.depth[[tree.parents[plain], *limb]])
    end = limb[1 + int(np.argmax(np.minimum(lengths[1:], lengths[:-1])))]
    place = chains[pair.index(plain)].index(end)
    return [chain[place] for chain in chains] if 2 <= place < min(map(len, chains)) else []


def _crown(tree: JointTree, hub: int, limbs: list[list[int]]) -> int | None:
    """The head: on the longest chain from the arms' hub on which no limb hangs; not eyes, jaw or a mark at its end."""
    on_limbs = {joint for limb in limbs for joint in limb}
    others = [joint for joint in tree.children[hub] if joint not in on_limbs]
    if not others:
        return None
    at = max(others, key=lambda joint: tree.depth[tree.main_chain(joint)[-1]])
    while len(tree.children[at]) == 1 and not tree.is_nub(tree.children[at][0]):
        at = tree.children[at][0]
    return at


def _left_of(tree: JointTree, legs: tuple[int, int], feet: list[int], crown: int) -> int:
    """Which of two legs is the left one: by name, else from where the toes and the bent knees point."""
    sides = [
        tree.names[foot][0] if tree.names[foot][0] is not None else tree.names[leg][0]
        for leg, foot in zip(legs, feet, strict=True)
    ]
    if None not in sides and sides[0] != sides[1]:
        return sides.index(0)
    votes = 0.0
    for pose in tree.poses:
        up = pose[crown] - pose[tree.parents[legs[0]]]
        across = pose[legs[0]] - pose[legs[1]]
        ahead = np.zeros(3)
        for leg, foot in zip(legs, feet, strict=True):
            chain = tree.main_chain(leg)
            at = chain.index(foot)
            ankle = pose[foot]
            ahead += pose[chain[1:at]].mean(axis=0) - 0.5 * (pose[leg] + ankle)
            if chain[at + 1 :]:
                ahead += pose[chain[-1]] - ankle
            else:
                ends = tree.skeleton.end_offsets[tree.skeleton.end_parents == foot]
                # Without poses' rotations an end site's position is known in the rest pose only.
                if len(tree.poses) == 1 and len(ends):
                    ahead += ends[0]
        # Facing +z with y up, left is +x = y cross z.
        votes += float(np.dot(np.cross(up, ahead), across)) / max(float(np.linalg.norm(across)), 1e-9)
    return 0 if votes >= 0 else 1


def _on_side(tree: JointTree, arms: tuple[int, int], legs: tuple[int, int], left_leg: int) -> int:
    """Index of the arm on the left leg's side."""
    sides = [tree.names[arm][0] for arm in arms]
    if None not in sides and sides[0] != sides[1]:
        return sides.index(0)
    poses = tree.poses
    across_legs = poses[:, legs[left_leg]] - poses[:, legs[1 - left_leg]]
    across_arms = poses[:, arms[0]] - poses[:, arms[1]]
    if np.abs(across_arms).max(initial=0.0) < 1e-9:
        across_arms = poses[:, tree.limb(arms[0])[1]] - poses[:, tree.limb(arms[1])[1]]
    return 0 if float(np.sum(across_legs * across_arms)) >= 0.0 else 1


def _complete(tree: JointTree, ends: dict[str, int]) -> dict[str, int]:
    """Fill in the joints between the ends; an empty dictionary when they do not hang together as a body does."""
    if len(set(ends.values())) < len(ends):
        return {}
    pelvis = tree.common([ends["left_foot"], ends["right_foot"]])
    chest = tree.common([ends["left_hand"], ends["right_hand"], ends["head"]])
    roles = {"pelvis": _pelvis(tree, pelvis)}
    for end, upper, middle, hub, words in (
        ("foot", "hip", "knee", pelvis, (joint_names.HIP, joint_names.KNEE)),
        ("hand", "shoulder", "elbow", chest, (joint_names.SHOULDER, joint_names.ELBOW)),
    ):
        chains = [tree.path(ends[f"{side}_{end}"]) for side in ("left", "right")]
        chains = [chain[chain.index(hub) + 1 :] for chain in chains]
        if min(map(len, chains)) < 3:
            return {}
        connectors = _connectors(tree, *chains)
        for side, chain in zip(("left", "right"), chains, strict=True):
            top, mid = _two_bones(tree, chain, connectors, *words)
            roles[f"{side}_{upper}"], roles[f"{side}_{middle}"] = top, mid
            roles[f"{side}_{end}"] = chain[-1]
    for side in ("left", "right"):
        toe = _toe(tree, roles[f"{side}_foot"])
        if toe is not None:
            roles[f"{side}_toe"] = toe
    return _trunk(tree, roles, ends["head"], chest)


def _pelvis(tree: JointTree, hub: int) -> int:
    """The legs' hub, or the joint before it where that is called a pelvis and the hub a spine."""
    parent = tree.parents[hub]
    if parent >= 0 and tree.words(hub) & joint_names.SPINE and tree.words(parent) & joint_names.PELVIS:
        return parent
    return hub


def _trunk(tree: JointTree, roles: dict[str, int], head: int, chest: int) -> dict[str, int]:
    """Add spine, chest, neck and head."""
    trunk = tree.path(head)
    start = tree.common([roles["pelvis"], head])
    above = trunk[trunk.index(start) + 1 :]
    if not above or head == roles["pelvis"]:
        return {}
    if chest in above[1:] and tree.words(chest) & joint_names.NECK and not tree.words(chest) & joint_names.SPINE:
        # 3ds Max hangs collar bones on the neck.
        chest = above[above.index(chest) - 1]
    roles["head"] = head
    roles["chest"] = chest if chest in above and chest != head else above[0]
    lower = above[: above.index(roles["chest"]) + 1]
    named = [joint for joint in lower if "spine" in tree.words(joint) and "to" not in tree.words(joint)]
    roles["spine"] = (named or lower)[0]
    upper = above[above.index(roles["chest"]) + 1 :]
    necks = [joint for joint in upper if tree.words(joint) & joint_names.NECK and joint != head]
    roles["neck"] = (necks or upper or [head])[0]
    return roles


def _connectors(tree: JointTree, left: list[int], right: list[int]) -> set[int]:
    """Joints of a pair of limbs that only connect others: they carry no rotation, or both lie in one place.

    A limb of which less than two joints rotate was not captured, and shows nothing.
    """
    shown = [chain for chain in (left, right) if np.count_nonzero(~tree.fixed[chain[:-1]]) > 1]
    found = {joint for chain in shown for joint in chain if tree.fixed[joint]}
    reach = float(tree.depth[left[-1]] - tree.depth[tree.parents[left[0]]])
    for pair in zip(left, right, strict=False):
        if np.linalg.norm(tree.poses[:, pair[0]] - tree.poses[:, pair[1]], axis=-1).max() > _SAME_PLACE * reach:
            break
        found.update(pair)
    return found


def _two_bones(
    tree: JointTree,
    chain: list[int],
    connectors: set[int],
    upper_words: frozenset[str],
    middle_words: frozenset[str],
) -> tuple[int, int]:
    """Top and middle joint of a limb whose chain ends at the wrist or ankle, by name if that fits, else by length."""

    def preferred(joints: list[int], words: frozenset[str] | None = None) -> list[int]:
        own = [joint for joint in joints if not tree.words(joint) & joint_names.AUXILIARY]
        own = own if words is None else [joint for joint in own if tree.words(joint) & words]
        return [joint for joint in own if joint not in connectors] or own

    middles = preferred(chain[1:-1], middle_words)[:1]
    if middles:
        before = chain[: chain.index(middles[0])]
        tops = preferred(before, upper_words)[:1] or preferred(before)
    else:
        middles = preferred(chain[1:-1]) or chain[1:-1]
        tops = preferred(chain[:-2], upper_words)[:1] or preferred(chain[:-2])
    tops = [joint for joint in tops if not tree.words(joint) & joint_names.COLLAR] or tops or chain[:-2]
    end = tree.depth[chain[-1]]

    def unlike(pair: tuple[int, int]) -> tuple[float, float]:
        upper, lower = max(tree.depth[pair[1]] - tree.depth[pair[0]], 1e-9), max(end - tree.depth[pair[1]], 1e-9)
        # Of joints in one place the last one carries the bone.
        return round(abs(float(np.log(upper / lower / _UPPER_TO_LOWER))), 6), -chain.index(pair[0])

    pairs = [(top, middle) for top in tops for middle in middles if chain.index(top) < chain.index(middle)]
    return min(pairs or [(chain[0], middles[0])], key=unlike)


def _toe(tree: JointTree, foot: int) -> int | None:
    """The ball of the foot: a joint below the ankle, by name, else the chain that goes on."""
    below = tree.below(foot)[1:]
    words = joint_names.TOE | joint_names.FOOT
    named = [joint for joint in below if tree.words(joint) & words and not tree.words(joint) & joint_names.AUXILIARY]
    if named:
        return named[0]
    ahead = tree.main_chain(foot)[1:]
    return next((joint for joint in ahead if tree.lengths[joint] > 0.1 * tree.lengths[foot]), None)
