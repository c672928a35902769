"""A slow, obvious two-bone solver: search the flexion, then turn by scipy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation


def end_place(upper, middle, end, target, axis, least, most, steps=20001):
    """Return the point that a limb bent about ``axis`` (square to its upper bone) comes nearest to the target with.

    The flexion is found by trying many; then the limb lies on the line to the target.
    """
    bone = middle - upper
    length, other = np.linalg.norm(bone), np.linalg.norm(end - middle)
    flexions = np.linspace(least, most, steps)[:, None]
    ends = bone + Rotation.from_rotvec(axis * flexions).apply(bone / length) * other
    gaps = np.abs(np.linalg.norm(ends, axis=1) - np.linalg.norm(target - upper))
    towards = (target - upper) / np.linalg.norm(target - upper)
    return upper + towards * np.linalg.norm(ends[np.argmin(gaps)])
