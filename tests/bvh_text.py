"""A small BVH file with some of everything, to be changed by tests."""

import numpy as np

from crowdsim.bvh.io import parse_bvh

PLAIN = """HIERARCHY
ROOT Hips
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Chest
  {
    OFFSET 0 10 0
    CHANNELS 3 Yrotation Xrotation Zrotation
    End Site
    {
      OFFSET 0 5 0
    }
    End Site
    {
      OFFSET 1 5 0
    }
  }
  JOINT Leg
  {
    OFFSET 4 -1 0
    CHANNELS 6 Xrotation Yrotation Zrotation Zposition Xposition Yposition
    End Site
    {
      OFFSET 0 -9 0.5
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.00833333
0 90 1 10 20 30 40 50 60 7 8 9 1 4 -1
1.5 91 -2e1 .5 -5. +3 4e-3 5E+1 60 70 80 90 2 5 -2
"""


def bvh(text, **changes):
    """Read text in which every key of ``changes`` is replaced by its value."""
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return parse_bvh(text.encode(), "walk.bvh")


def same(a, b):
    """Assert that two files hold the same."""
    assert a.names == b.names
    assert a.channels == b.channels
    assert a.end_names == b.end_names
    for name in ("parents", "offsets", "end_parents", "end_offsets", "motion"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert (a.fps, a.declared_frames) == (b.fps, b.declared_frames)
