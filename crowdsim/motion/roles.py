"""Which joint plays which part of a human body, from names and, where names fail, from the shape of the tree.

Names alone do not settle it: ``LeftShoulder`` is a collar bone to one exporter and an upper arm to the next, ``hip``
may be the pelvis or the top of a leg. So names only find the ends (head, hands, feet) and give hints on the way; the
joints between are chosen along the chain from the pelvis to the end, by bone length.
"""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion.skeleton import Skeleton

Array = NDArray[Any]

_SIDES = {"left": 0, "l": 0, "lft": 0, "lf": 0, "right": 1, "r": 1, "rgt": 1, "rt": 1}
_NOISE = frozenset("bip mixamorig character def bn jt joint jnt bone j b bind".split())
_WORDS = frozenset(
    "toebase toes toe ball foot ankle leg upleg upperleg lowerleg lowleg thigh calf shin knee femur tibia hip hipjoint "
    "buttock hand wrist palm forearm lowerarm elbow radius ulna arm uparm upperarm shldr shoulder humerus collar "
    "clavicle thumb index middle ring pinky eye uarm farm finger fingers".split()
)

_HEAD = {"head", "skull"}
_NECK = {"neck"}
_HAND = {"hand", "wrist", "palm"}
_FOOT = {"ankle", "foot"}
_TOE = {"toe", "toes", "toebase", "ball"}
_KNEE = {"knee", "shin", "calf", "tibia", "lowerleg", "lowleg", "legs", "leglower"}
_HIP = {"thigh", "upleg", "upperleg", "femur", "legupper", "hipjoint"}
_ELBOW = {"elbow", "forearm", "lowerarm", "radius", "ulna", "farm", "armlower", "lowarm"}
_SHOULDER = {"upperarm", "uparm", "humerus", "shldr", "uarm", "armupper"}
_COLLAR = {"collar", "clavicle"}
_FINGERS = {"thumb", "index", "middle", "mid", "ring", "pinky", "finger", "fingers", "little"}

LIMB_ROLES = ("head", "left_hand", "right_hand", "left_foot", "right_foot")


def split_name(name: str) -> tuple[int | None, frozenset[str]]:
    """Return a joint name's side (0 left, 1 right, None) and its words in lower case, neighbours also joined.

    Namespaces before ':' and exporters' prefixes are left out: ``mixamorig:LeftUpLeg`` gives 0, 'up', 'leg', 'upleg'.
    """
    plain = re.split(r"[:|]", name)[-1]
    plain = re.sub(r"^([LR])(?=[A-Z])", r"\1 ", plain)
    plain = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", plain)
    plain = re.sub(r"([A-Z])([A-Z][a-z])", r"\1 \2", plain)
    words = [word.lower() for word in re.findall(r"[A-Za-z]+", plain)]
    side: int | None = None
    kept: list[str] = []
    for word in words:
        found, rest = _strip_side(word)
        if found is not None and side is None:
            side = found
            if rest:
                kept.append(rest)
        elif word not in _NOISE:
            kept.append(word)
    joined = {a + b for a, b in itertools.pairwise(kept)}
    return side, frozenset(kept) | joined


def _strip_side(word: str) -> tuple[int | None, str]:
    if word in _SIDES:
        return _SIDES[word], ""
    for prefix in ("left", "right", "l", "r"):
        if word.startswith(prefix) and word[len(prefix) :] in _WORDS and word not in _WORDS:
            return _SIDES[prefix], word[len(prefix) :]
    for suffix in ("left", "right", "l", "r"):
        if word.endswith(suffix) and word[: -len(suffix)] in _WORDS and word not in _WORDS:
            return _SIDES[suffix], word[: -len(suffix)]
    return None, word


def find_roles(skeleton: Skeleton, poses: Array | None = None) -> dict[str, int]:
    """Return the joint of each role that was found, by names first and by shape and symmetry where names fail.

    Args:
        skeleton: The skeleton, in any unit and orientation.
        poses: A few poses as joint positions in the same unit, shape (n, J, 3), which tell left from right where names
            do not; the rest pose when None.

    Returns:
        A joint for each role of ``crowdsim.motion.body.ROLES`` that the skeleton has. All five of ``LIMB_ROLES`` and
        the joints on the way to them are there, or the result is empty: then this is no human body.
    """
    if skeleton.joint_count < 10:
        return {}
    tree = _Tree(skeleton)
    for ends in (_ends_by_name(tree), _ends_by_shape(tree, poses)):
        if ends is not None:
            roles = _complete(tree, ends)
            if roles:
                return roles
    return {}


class _Tree:
    """A skeleton with what the search asks for again and again."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        self.parents = [int(parent) for parent in skeleton.parents]
        self.lengths = np.linalg.norm(skeleton.offsets, axis=1)
        self.lengths[0] = 0.0
        self.children: list[list[int]] = [[] for _ in self.parents]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.children[parent].append(joint)
        self.words = [split_name(name) for name in skeleton.names]
        self.depth = np.zeros(len(self.parents))
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.depth[joint] = self.depth[parent] + self.lengths[joint]

    def path(self, joint: int) -> list[int]:
        """Joints from the root to ``joint``, both included."""
        chain = [joint]
        while self.parents[chain[-1]] >= 0:
            chain.append(self.parents[chain[-1]])
        return chain[::-1]

    def below(self, joint: int) -> list[int]:
        """All joints that hang on ``joint``, itself first."""
        found = [joint]
        for at in found:
            found.extend(self.children[at])
        return found


def _named(tree: _Tree, words: set[str], side: int | None, unless: set[str] = frozenset()) -> list[int]:  # type: ignore[assignment]
    return [
        joint
        for joint, (its_side, its_words) in enumerate(tree.words)
        if its_side == side and its_words & words and not its_words & unless
    ]


def _ends_by_name(tree: _Tree) -> dict[str, int] | None:
    """The five ends by name, or None when one is missing."""
    heads = _named(tree, _HEAD, None, _FINGERS)
    if not heads:
        return None
    ends = {"head": heads[0]}
    for side, name in enumerate(("left", "right")):
        hands = _named(tree, _HAND, side, _FINGERS | {"prop", "twist", "roll", "ik"})
        feet = _named(tree, {"ankle"}, side, _TOE) or _named(tree, _FOOT, side, _TOE | {"ik"})
        if not hands or not feet:
            return None
        # Where both a wrist and a hand are there, the wrist is where the fist turns; the first on the chain is it.
        ends[f"{name}_hand"] = hands[0]
        ends[f"{name}_foot"] = feet[0]
    return ends


def _ends_by_shape(tree: _Tree, poses: Array | None) -> dict[str, int] | None:
    """The five ends from mirrored pairs of limbs: the legs nearer the root, a head between the arms."""
    pairs = _mirrored_pairs(tree)
    if len(pairs) < 2:
        return None
    best: dict[str, int] | None = None
    for legs in pairs:
        for arms in pairs:
            hub_legs, hub_arms = tree.parents[legs[0]], tree.parents[arms[0]]
            if arms is legs or hub_legs == hub_arms or hub_legs not in tree.path(hub_arms):
                continue
            leg_ends = [_limb_end(tree, limb) for limb in legs]
            arm_ends = [_limb_end(tree, limb) for limb in arms]
            crown = _crown(tree, hub_arms, arms)
            if crown is None or None in leg_ends or None in arm_ends:
                continue
            if poses is None:
                poses = tree.skeleton.rest_positions()[None]
            left, right = _left_and_right(tree, poses, legs, crown)
            swap = _same_side(poses, arms, legs, left)
            best = {
                "head": crown,
                "left_foot": leg_ends[left],  # type: ignore[dict-item]
                "right_foot": leg_ends[right],  # type: ignore[dict-item]
                "left_hand": arm_ends[swap],  # type: ignore[dict-item]
                "right_hand": arm_ends[1 - swap],  # type: ignore[dict-item]
            }
            return best
    return best


def _mirrored_pairs(tree: _Tree) -> list[tuple[int, int]]:
    """Pairs of brothers whose chains of main bones have the same lengths, longest chains first."""
    pairs = []
    for brothers in tree.children:
        chains = [(joint, _main_chain(tree, joint)) for joint in brothers]
        for index, (a, chain_a) in enumerate(chains):
            for b, chain_b in chains[index + 1 :]:
                lengths_a, lengths_b = tree.lengths[chain_a], tree.lengths[chain_b]
                if len(chain_a) >= 3 and len(chain_a) == len(chain_b):
                    scale = max(lengths_a.max(), 1e-9)
                    if np.abs(lengths_a - lengths_b).max() < 0.1 * scale:
                        pairs.append((float(lengths_a.sum()), a, b))
    pairs.sort(key=lambda pair: -pair[0])
    return [(a, b) for _, a, b in pairs]


def _main_chain(tree: _Tree, joint: int) -> list[int]:
    """The chain from ``joint`` to the leaf that lies furthest along the bones."""
    below = tree.below(joint)
    last = max(below, key=lambda at: (tree.depth[at], -at))
    path = tree.path(last)
    return path[path.index(joint) :]


def _limb_end(tree: _Tree, limb: int) -> int | None:
    """The wrist or ankle of a limb: the joint after its two longest bones in a row."""
    chain = _main_chain(tree, limb)
    if len(chain) < 3:
        return None
    lengths = tree.lengths[chain]
    sums = [min(lengths[i], lengths[i - 1]) for i in range(1, len(chain))]
    return chain[1 + int(np.argmax(sums))]


def _crown(tree: _Tree, hub: int, arms: tuple[int, int]) -> int | None:
    """The head: the chain at the arms' hub that is no arm; its last joint but eyes, jaw and the like."""
    others = [joint for joint in tree.children[hub] if joint not in arms]
    if not others:
        return None
    at = max(others, key=lambda joint: tree.depth[_main_chain(tree, joint)[-1]])
    for _ in range(3):
        if len(tree.children[at]) != 1:
            break
        at = tree.children[at][0]
    return at


def _left_and_right(tree: _Tree, poses: Array, limbs: tuple[int, int], crown: int) -> tuple[int, int]:
    """Which of two legs is left, from where the toes or the bent knees point; (0, 1) or (1, 0)."""
    votes = 0.0
    chains = [_main_chain(tree, limb) for limb in limbs]
    for pose in poses:
        up = pose[crown] - pose[0]
        across = pose[limbs[0]] - pose[limbs[1]]
        ahead = np.zeros(3)
        for chain in chains:
            at = chain.index(_limb_end(tree, chain[0]))  # type: ignore[arg-type]
            hip, knee, ankle = pose[chain[max(at - 2, 0)]], pose[chain[at - 1]], pose[chain[at]]
            ahead += knee - 0.5 * (hip + ankle)
            if chain[at + 1 :]:
                ahead += pose[chain[-1]] - ankle
        # Facing +z with y up, left is +x = y cross z.
        votes += float(np.sign(np.dot(np.cross(up, ahead), across)))
    return (0, 1) if votes >= 0 else (1, 0)


def _same_side(poses: Array, arms: tuple[int, int], legs: tuple[int, int], left_leg: int) -> int:
    """Index of the arm on the left leg's side."""
    across_legs = poses[:, legs[left_leg]] - poses[:, legs[1 - left_leg]]
    across_arms = poses[:, arms[0]] - poses[:, arms[1]]
    return 0 if float(np.sum(across_legs * across_arms)) >= 0.0 else 1


def _complete(tree: _Tree, ends: dict[str, int]) -> dict[str, int]:
    """Fill in the joints between the ends; an empty dictionary when they do not hang together as a body does."""
    paths = {role: tree.path(joint) for role, joint in ends.items()}
    pelvis = _last_common([paths["left_foot"], paths["right_foot"]])
    chest = _last_common([paths["left_hand"], paths["right_hand"]])
    if chest not in paths["head"]:
        return {}
    roles = {"pelvis": pelvis}
    for side in ("left", "right"):
        for end, upper, middle, hub, words in (
            ("foot", "hip", "knee", pelvis, (_HIP, _KNEE)),
            ("hand", "shoulder", "elbow", chest, (_SHOULDER, _ELBOW)),
        ):
            chain = paths[f"{side}_{end}"]
            chain = chain[chain.index(hub) + 1 :]
            if len(chain) < 3:
                return {}
            top, mid = _two_bones(tree, chain, *words)
            roles[f"{side}_{upper}"], roles[f"{side}_{middle}"] = top, mid
            roles[f"{side}_{end}"] = chain[-1]
    for side_index, side in enumerate(("left", "right")):
        toe = _toe(tree, roles[f"{side}_foot"], side_index)
        if toe is not None:
            roles[f"{side}_toe"] = toe
    trunk = paths["head"]
    spine = trunk[trunk.index(chest) :] if roles["pelvis"] not in trunk else trunk[trunk.index(roles["pelvis"]) + 1 :]
    if not spine:
        return {}
    roles["head"] = ends["head"]
    roles["chest"] = chest if chest != roles["pelvis"] else spine[0]
    roles["spine"] = spine[0] if spine[0] != roles["head"] else roles["chest"]
    necks = [joint for joint in spine if tree.words[joint][1] & _NECK]
    above = trunk[trunk.index(chest) + 1 :]
    roles["neck"] = necks[0] if necks else above[0] if above else roles["head"]
    return roles


def _last_common(paths: list[list[int]]) -> int:
    """The last joint that all paths share."""
    shared = [joints[0] for joints in zip(*paths, strict=False) if len(set(joints)) == 1]
    return shared[-1]


def _two_bones(tree: _Tree, chain: list[int], upper_words: set[str], middle_words: set[str]) -> tuple[int, int]:
    """Top and middle joint of a limb whose chain ends at the wrist or ankle, by name if that fits, else by length."""
    depth = np.concatenate([[0.0], np.cumsum(tree.lengths[chain[1:]])])
    total = max(float(depth[-1]), 1e-9)
    fits = [i for i in range(1, len(chain) - 1) if tree.words[chain[i]][1] & middle_words]
    if fits:
        middle = fits[0]
    else:
        # The two bones of a limb are about as long as one another, so the middle joint parts what is left best.
        middle = 1
        best = -1.0
        for i in range(1, len(chain) - 1):
            before, after = max(depth[i] - depth[j] for j in range(i)), total - depth[i]
            straight = min(before, after)
            if straight > best + 1e-9 * total:
                best, middle = straight, i
    named = [i for i in range(middle) if tree.words[chain[i]][1] & upper_words]
    if named:
        return chain[named[0]], chain[middle]
    lower = total - depth[middle]
    # Collars and buttocks are short: the top joint is the last one with an upper bone of at least half the lower.
    tops = [
        i for i in range(middle) if depth[middle] - depth[i] > 0.5 * lower and not tree.words[chain[i]][1] & _COLLAR
    ]
    return chain[tops[-1] if tops else 0], chain[middle]


def _toe(tree: _Tree, foot: int, side: int) -> int | None:
    """The ball of the foot: a joint below the ankle, by name, else the only chain that goes on."""
    below = tree.below(foot)[1:]
    named = [joint for joint in below if tree.words[joint][1] & (_TOE | _FOOT)]
    if named:
        return named[0]
    return below[0] if below and tree.lengths[below[0]] > 0.1 * tree.lengths[foot] else None
