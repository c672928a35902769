"""What joint names say: the side, and words of body parts that many exporters use."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

_SIDES = {"left": 0, "l": 0, "lft": 0, "lf": 0, "right": 1, "r": 1, "rgt": 1, "rt": 1}
_NOISE = frozenset("bip mixamorig character def bn jt joint jnt bone j b m c bind cc base".split())

HEAD = frozenset({"head", "skull"})
NECK = frozenset({"neck", "lowerneck"})
HAND = frozenset({"hand", "palm"})
WRIST = frozenset({"wrist"})
FOOT = frozenset({"foot"})
ANKLE = frozenset({"ankle"})
TOE = frozenset({"toe", "toes", "toebase", "ball"})
KNEE = frozenset({"knee", "shin", "calf", "tibia", "lowerleg", "lowleg", "loleg", "leglower"})
HIP = frozenset({"thigh", "upleg", "upperleg", "femur", "legupper"})
ELBOW = frozenset({"elbow", "forearm", "lowerarm", "radius", "farm", "armlower", "lowarm", "loarm"})
SHOULDER = frozenset({"upperarm", "uparm", "humerus", "shldr", "uarm", "armupper"})
COLLAR = frozenset({"collar", "clavicle", "scapula"})
PELVIS = frozenset({"pelvis", "hip", "hips"})
SPINE = frozenset({"spine", "abdomen", "chest"})
FINGERS = frozenset("thumb index middle mid ring pinky finger fingers little carpal metacarpal tip handtip".split())
AUXILIARY = frozenset("prop twist roll ik effector goal target pole nub end site tip top".split())
"""Words of joints that help a rig along and play no role themselves."""

_GLUED = (
    HEAD | NECK | HAND | WRIST | FOOT | ANKLE | TOE | KNEE | HIP | ELBOW | SHOULDER | COLLAR | FINGERS
    | frozenset("leg arm shoulder hip hipjoint buttock ulna eye ear clav".split())
)  # fmt: skip
"""Words to which exporters glue an l or an r."""


def plain_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return joint names without what all begin with up to a mark, as in ``Alex:Hips`` and ``Alex:Spine``."""
    first, last = min(names), max(names)
    same = next((at for at, pair in enumerate(zip(first, last, strict=False)) if len(set(pair)) > 1), len(first))
    length = max(first[:same].rfind(mark) for mark in ":_|. ") + 1
    return tuple(name[length:] for name in names) if len(names) > 1 else tuple(names)


def split_name(name: str) -> tuple[int | None, frozenset[str]]:
    """Return a joint name's side (0 left, 1 right, None) and its words in lower case, neighbours also joined.

    Namespaces before ':' and exporters' prefixes are left out: ``mixamorig:LeftUpLeg`` gives 0, 'up', 'leg', 'upleg'.
    """
    plain = re.split(r"[:|]", name)[-1]
    plain = plain.replace("左", " left ").replace("右", " right ")
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
    if word in _GLUED:
        return None, word
    for mark in ("left", "right", "l", "r"):
        if word.startswith(mark) and (word[len(mark) :] in _GLUED or len(mark) > 1):
            return _SIDES[mark], word[len(mark) :]
    for mark in ("left", "right", "l", "r"):
        if word.endswith(mark) and (word[: -len(mark)] in _GLUED or len(mark) > 1):
            return _SIDES[mark], word[: -len(mark)]
    return None, word
