"""Small motion databases for tests of the graph: a body of ten joints that waves smoothly."""

import numpy as np

from crowdsim.motion import quaternion as quaternions
from crowdsim.motion.body import Body
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.skeleton import Skeleton

NAMES = (
    "pelvis",
    "chest",
    "head",
    "left_elbow",
    "left_hand",
    "right_elbow",
    "right_hand",
    "left_foot",
    "right_foot",
    "x",
)
PARENTS = (-1, 0, 1, 1, 3, 1, 5, 0, 0, 4)
OFFSETS = (
    (0, 0, 0), (0, 0.3, 0), (0, 0.3, 0), (0.2, 0.1, 0), (0.3, 0, 0),
    (-0.2, 0.1, 0), (-0.3, 0, 0), (0.1, -0.9, 0), (-0.1, -0.9, 0), (0.1, 0, 0),
)  # fmt: skip


def skeleton() -> Skeleton:
    return Skeleton(NAMES, np.array(PARENTS, np.int32), np.array(OFFSETS, float))


def body(height: float = 1.75) -> Body:
    nothing = np.zeros((0, 3))
    return Body(
        roles={name: joint for joint, name in enumerate(NAMES) if name != "x"},
        height=height,
        fist_offsets=np.zeros((2, 3)),
        head_offset=np.zeros(3),
        sole_offsets=np.zeros((2, 2, 3)),
        head_radius=0.11,
        torso_radius=0.15,
        capsule_joints=np.zeros(0, np.int32),
        capsule_starts=nothing,
        capsule_ends=nothing,
        capsule_radii=np.zeros((0, 2)),
        capsule_parts=np.zeros(0, np.uint8),
    )


def database(clips, control_rate: float = 15.0, playback_rate: float = 60.0, height: float = 1.75) -> MotionDatabase:
    """Return a database of clips, each (root positions (P, 3), rotations (P, J, 4), headings (P,), contacts (P, 2))."""
    stride = round(playback_rate / control_rate)
    roots, rotations, headings, contacts = (np.concatenate(parts) for parts in zip(*clips, strict=True))
    frames = len(roots)
    positions, nothing = np.zeros((frames, 3), np.float32), np.zeros(0, np.int32)
    return MotionDatabase(
        skeleton=skeleton(),
        body=body(height),
        control_rate=control_rate,
        playback_rate=playback_rate,
        clip_names=tuple(f"clip_{number}" for number in range(len(clips))),
        clip_starts=np.cumsum([0, *(len(clip[0]) // stride for clip in clips)]).astype(np.int32),
        root_positions=roots.astype(np.float32),
        rotations=rotations.astype(np.float32),
        ground=np.stack([roots[:, 0], roots[:, 2], headings], axis=-1),
        contacts=contacts,
        fists=np.zeros((frames, 2, 3), np.float32),
        heads=positions,
        necks=positions,
        pelvises=positions,
        strike_frames=nothing,
        strike_limbs=nothing.astype(np.uint8),
        strike_peaks=nothing,
        strike_speeds=nothing.astype(np.float32),
        strike_positions=np.zeros((0, 3), np.float32),
    )


def wander(generator: np.random.Generator, control_frames: int, stride: int = 4, period: float = 20.0):
    """Return one clip of smooth random motion that turns, walks about and changes its contacts."""
    frames = control_frames * stride
    time = np.arange(frames) / stride
    joints = len(NAMES)
    rates = generator.integers(1, 4, (3, joints, 3)) / period
    phases = generator.uniform(0, 2 * np.pi, (3, joints, 3))
    vectors = np.sin(2 * np.pi * rates * time[:, None, None, None] + phases).sum(axis=1) * 0.25
    headings = np.cumsum(generator.normal(0, 0.02, frames))
    rotations = quaternions.from_rotation_vector(vectors)
    rotations[:, 0] = quaternions.multiply(quaternions.about_y(headings), rotations[:, 0])
    roots = np.cumsum(generator.normal(0, 0.01, (frames, 3)), axis=0) * [1, 0, 1] + [0, 1, 0]
    contacts = np.sin(2 * np.pi * time[:, None] / period + [0.0, np.pi]) > -0.5
    return roots, rotations, headings, contacts


def walk(periods: int, period: int = 20, stride: int = 4):
    """Return one clip that walks straight ahead and repeats exactly after ``period`` control frames."""
    frames = periods * period * stride
    time = np.arange(frames) / stride
    phase = 2 * np.pi * (np.arange(frames) % (period * stride)) / (period * stride)
    vectors = np.zeros((frames, len(NAMES), 3))
    swing = np.stack([np.sin(phase), 0.3 * np.sin(2 * phase), 0.2 * np.cos(phase)], axis=-1)
    for joint in range(1, len(NAMES)):
        vectors[:, joint] = swing * (0.2 + 0.1 * joint) * (-1) ** joint
    roots = np.zeros((frames, 3))
    roots[:, 1] = 1.0
    roots[:, 2] = time * 0.0625
    contacts = np.stack([np.sin(phase) > -0.3, np.sin(phase) < 0.3], axis=-1)
    return roots, quaternions.from_rotation_vector(vectors), np.zeros(frames), contacts
