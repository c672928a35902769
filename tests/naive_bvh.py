"""A slow, obvious BVH reader for well-formed text, and world positions by matrices."""

import numpy as np
from scipy.spatial.transform import Rotation


def rotation_order(channels):
    """Return the letters of a joint's rotation channels in order, 'ZXY' say, or fewer."""
    return "".join(name[0] for name in channels if name.endswith("rotation"))


def read(text):
    """Return names, parents, offsets, channels and motion of text with one keyword a line."""
    names, parents, offsets, channels, open_joints = [], [], [], [], []
    lines = iter(text.splitlines())
    for line in lines:
        words = line.split()
        if not words:
            continue
        if words[0] in ("ROOT", "JOINT"):
            parents.append(open_joints[-1] if open_joints else -1)
            names.append(words[1])
            open_joints.append(len(names) - 1)
        elif words[0] == "End":
            open_joints.append(None)
        elif words[0] == "OFFSET" and open_joints[-1] is not None:
            offsets.append([float(word) for word in words[1:]])
        elif words[0] == "CHANNELS":
            channels.append(words[2:])
        elif words[0] == "}":
            open_joints.pop()
        elif words[0] == "MOTION":
            break
    rows = [[float(word) for word in line.split()] for line in lines if ":" not in line]
    return names, parents, np.array(offsets), channels, np.array(rows)


def world_positions(parents, offsets, channels, motion):
    """Return positions (F, J, 3) in file units, every joint by a 4 x 4 matrix."""
    positions = np.empty((len(motion), len(parents), 3))
    for frame, row in enumerate(motion):
        worlds, at = [], 0
        for joint, parent in enumerate(parents):
            local = np.eye(4)
            local[:3, 3] = offsets[joint]
            for name in channels[joint]:
                axis = "XYZ".index(name[0])
                if name.endswith("position"):
                    local[axis, 3] = row[at]
                else:
                    turn = np.eye(4)
                    turn[:3, :3] = Rotation.from_euler(name[0].lower(), row[at], degrees=True).as_matrix()
                    local = local @ turn
                at += 1
            worlds.append(local if parent < 0 else worlds[parent] @ local)
            positions[frame, joint] = worlds[joint][:3, 3]
    return positions
