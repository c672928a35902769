"""Animals and other things that are no human bodies, some with human names, moving a little."""

from __future__ import annotations

import numpy as np
from turns import about

from crowdsim.bvh.io import Bvh, from_clip
from crowdsim.motion import quaternion
from crowdsim.motion.skeleton import Clip, Skeleton

Joint = tuple[str, str, tuple[float, float, float]]


def _both(rows: list[Joint], sides: tuple[str, str] = ("Left", "Right")) -> list[Joint]:
    out = []
    for side, sign in zip(sides, (1.0, -1.0), strict=True):
        for name, parent, (x, y, z) in rows:
            out.append((name.replace("~", side), parent.replace("~", side), (x * sign, y, z)))
    return out


DOG: list[Joint] = [
    ("Hips", "", (0.0, 0.5, 0.0)),
    ("Spine", "Hips", (0.0, 0.03, 0.2)),
    ("Spine1", "Spine", (0.0, 0.0, 0.23)),
    ("Neck", "Spine1", (0.0, 0.1, 0.15)),
    ("Head", "Neck", (0.0, 0.12, 0.14)),
    *_both(
        [
            ("~Shoulder", "Spine1", (0.07, 0.0, 0.07)),
            ("~Arm", "~Shoulder", (0.01, -0.14, 0.06)),
            ("~ForeArm", "~Arm", (0.0, -0.15, -0.05)),
            ("~Hand", "~ForeArm", (0.0, -0.16, 0.0)),
            ("~UpLeg", "Hips", (0.07, -0.02, -0.03)),
            ("~Leg", "~UpLeg", (0.0, -0.18, 0.04)),
            ("~Foot", "~Leg", (0.0, -0.18, -0.08)),
            ("~Toe", "~Foot", (0.0, -0.1, 0.04)),
        ]
    ),
    ("Tail", "Hips", (0.0, 0.02, -0.1)),
    ("Tail1", "Tail", (0.0, 0.05, -0.15)),
]
HORSE: list[Joint] = [
    ("horse_root", "", (0.0, 1.3, 0.0)),
    ("horse_spine_01", "horse_root", (0.0, 0.05, 0.35)),
    ("horse_spine_02", "horse_spine_01", (0.0, 0.0, 0.35)),
    ("horse_spine_03", "horse_spine_02", (0.0, 0.0, 0.3)),
    ("horse_neck_01", "horse_spine_03", (0.0, 0.25, 0.25)),
    ("horse_neck_02", "horse_neck_01", (0.0, 0.3, 0.25)),
    ("horse_head", "horse_neck_02", (0.0, 0.2, 0.15)),
    ("horse_jaw", "horse_head", (0.0, -0.15, 0.25)),
    *_both(
        [
            ("front_leg_01_~", "horse_spine_03", (0.15, -0.1, 0.1)),
            ("front_leg_02_~", "front_leg_01_~", (0.0, -0.35, 0.05)),
            ("front_leg_03_~", "front_leg_02_~", (0.0, -0.4, -0.05)),
            ("front_leg_04_~", "front_leg_03_~", (0.0, -0.3, 0.0)),
            ("front_hoof_~", "front_leg_04_~", (0.0, -0.12, 0.05)),
            ("back_leg_01_~", "horse_root", (0.15, -0.1, -0.1)),
            ("back_leg_02_~", "back_leg_01_~", (0.0, -0.35, 0.1)),
            ("back_leg_03_~", "back_leg_02_~", (0.0, -0.4, -0.15)),
            ("back_leg_04_~", "back_leg_03_~", (0.0, -0.3, 0.05)),
            ("back_hoof_~", "back_leg_04_~", (0.0, -0.1, 0.05)),
        ],
        ("l", "r"),
    ),
    ("tail_01", "horse_root", (0.0, 0.0, -0.25)),
    ("tail_02", "tail_01", (0.0, -0.2, -0.1)),
    ("tail_03", "tail_02", (0.0, -0.3, 0.0)),
]
BIRD: list[Joint] = [
    ("Root", "", (0.0, 0.3, 0.0)),
    ("Body", "Root", (0.0, 0.04, 0.08)),
    ("Neck1", "Body", (0.0, 0.08, 0.05)),
    ("Neck2", "Neck1", (0.0, 0.08, 0.03)),
    ("Head", "Neck2", (0.0, 0.05, 0.04)),
    ("Beak", "Head", (0.0, 0.0, 0.06)),
    *_both(
        [
            ("Wing_~_1", "Body", (0.06, 0.03, 0.0)),
            ("Wing_~_2", "Wing_~_1", (0.25, 0.02, 0.0)),
            ("Wing_~_3", "Wing_~_2", (0.3, 0.0, -0.05)),
            ("Wing_~_4", "Wing_~_3", (0.3, 0.0, -0.1)),
            ("Thigh_~", "Root", (0.04, -0.02, 0.0)),
            ("Shank_~", "Thigh_~", (0.0, -0.1, 0.05)),
            ("Tarsus_~", "Shank_~", (0.0, -0.1, -0.06)),
            ("Claw_~", "Tarsus_~", (0.0, -0.07, 0.05)),
        ],
        ("L", "R"),
    ),
    ("Tail", "Root", (0.0, 0.0, -0.12)),
]
SPIDER: list[Joint] = [
    ("thorax", "", (0.0, 0.3, 0.0)),
    ("abdomen", "thorax", (0.0, 0.05, -0.3)),
    ("head", "thorax", (0.0, 0.0, 0.15)),
    *_both(
        [
            row
            for leg in range(4)
            for row in (
                (f"leg{leg}~0", "thorax", (0.1, 0.0, 0.1 - 0.07 * leg)),
                (f"leg{leg}~1", f"leg{leg}~0", (0.15, 0.1, 0.15 - 0.1 * leg)),
                (f"leg{leg}~2", f"leg{leg}~1", (0.2, 0.0, 0.15 - 0.1 * leg)),
                (f"leg{leg}~3", f"leg{leg}~2", (0.1, -0.35, 0.0)),
            )
        ],
        ("L", "R"),
    ),
]
SNAKE: list[Joint] = [("Snake00", "", (0.0, 0.05, 0.0))] + [
    (f"Snake{index:02d}", f"Snake{index - 1:02d}", (0.0, 0.0, 0.1)) for index in range(1, 24)
]
HAND: list[Joint] = [
    ("Wrist", "", (0.0, 0.0, 0.0)),
    *[
        row
        for finger, x in zip(
            ("Thumb", "Index", "Middle", "Ring", "Pinky"), (-0.03, -0.02, 0.0, 0.02, 0.03), strict=True
        )
        for row in (
            (f"{finger}1", "Wrist", (x, 0.0, 0.08)),
            (f"{finger}2", f"{finger}1", (0.0, 0.0, 0.04)),
            (f"{finger}3", f"{finger}2", (0.0, 0.0, 0.03)),
        )
    ],
]
HEXAPOD: list[Joint] = [
    ("body", "", (0.0, 0.4, 0.0)),
    ("front", "body", (0.0, 0.0, 0.3)),
    ("head", "front", (0.0, 0.1, 0.2)),
    *_both(
        [
            row
            for leg, parent in enumerate(("front", "body", "body"))
            for row in (
                (f"leg{leg}~0", parent, (0.15, 0.0, -0.15 * leg)),
                (f"leg{leg}~1", f"leg{leg}~0", (0.15, -0.05, 0.0)),
                (f"leg{leg}~2", f"leg{leg}~1", (0.05, -0.2, 0.0)),
                (f"leg{leg}~3", f"leg{leg}~2", (0.0, -0.15, 0.0)),
            )
        ]
    ),
]


def _depth_first(rows: list[Joint]) -> list[Joint]:
    def branch(parent: str) -> list[Joint]:
        return [deeper for row in rows if row[1] == parent for deeper in (row, *branch(row[0]))]

    return branch("")


ANIMALS = {
    "dog": DOG,
    "horse": HORSE,
    "bird": BIRD,
    "spider": SPIDER,
    "snake": SNAKE,
    "hand": HAND,
    "hexapod": HEXAPOD,
}


def export_animal(
    rows: list[Joint],
    frames: int = 90,
    scale: float = 0.01,
    up: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0),
    along_x: bool = False,
) -> Bvh:
    """Write an animal as it walks on the spot; ``along_x`` lays the bones of its rest pose along x."""
    rows = _depth_first(rows)
    names = [name for name, _, _ in rows]
    parents = np.array([names.index(parent) if parent else -1 for _, parent, _ in rows], np.int32)
    offsets = np.array([offset for _, _, offset in rows], float)
    times = np.arange(frames) / 30.0
    local = np.zeros((frames, len(rows), 4))
    local[..., 0] = 1.0
    for joint in range(1, len(rows)):
        swing = 0.15 * np.sin(2.0 * np.pi * times + joint)
        local[:, joint] = about(np.array([1.0, 0.0, 0.0]), swing)
    turns = np.zeros((len(rows), 4))
    turns[:, 0] = 1.0
    if along_x:
        for joint in range(len(rows)):
            below = [child for child in range(len(rows)) if parents[child] == joint]
            way = offsets[below[0]] if below else offsets[joint]
            turns[joint] = quaternion.between([1.0, 0.0, 0.0], way)
    rotations = np.empty_like(local)
    moved = offsets.copy()
    for joint, parent in enumerate(parents):
        before = quaternion.conjugate(turns[parent]) if parent >= 0 else np.array([1.0, 0.0, 0.0, 0.0])
        rotations[:, joint] = quaternion.multiply(before, quaternion.multiply(local[:, joint], turns[joint]))
        if parent >= 0:
            moved[joint] = quaternion.rotate(before, offsets[joint])
    roots = np.repeat(offsets[:1], frames, axis=0) + np.stack(
        [0 * times, 0.01 * np.sin(9 * times), 0.3 * times], axis=1
    )
    rotations[:, 0] = quaternion.multiply(np.array(up), rotations[:, 0])
    roots = quaternion.rotate(np.array(up), roots)
    leaves = [joint for joint in range(len(rows)) if joint not in parents]
    skeleton = Skeleton(tuple(names), parents, moved, np.array(leaves, np.int32), moved[leaves] * 0.5)
    return from_clip(Clip("animal", skeleton, 30.0, roots, quaternion.continuous(rotations)), "ZYX", scale)
