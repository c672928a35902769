"""Forward kinematics joint by joint with scipy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation


def forward(parents, offsets, root_positions, rotations, translations=None):
    """Return world positions (F, J, 3) and rotation matrices (F, J, 3, 3)."""
    frames, joints = rotations.shape[:2]
    positions, turns = np.empty((frames, joints, 3)), np.empty((frames, joints, 3, 3))
    for frame in range(frames):
        for joint in range(joints):
            local = Rotation.from_quat(np.roll(rotations[frame, joint], -1)).as_matrix()
            parent = parents[joint]
            if parent < 0:
                positions[frame, joint], turns[frame, joint] = root_positions[frame], local
                continue
            arm = offsets[joint] if translations is None else translations[frame, joint]
            positions[frame, joint] = positions[frame, parent] + turns[frame, parent] @ arm
            turns[frame, joint] = turns[frame, parent] @ local
    return positions, turns
