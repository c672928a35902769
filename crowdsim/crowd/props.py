"""What avatars carry, as takes record it."""

from __future__ import annotations

import numpy as np

PROP = np.dtype(
    [
        ("type", np.int16),
        ("joint", np.int32),
        ("start", np.float32, 3),
        ("end", np.float32, 3),
        ("radius", np.float32),
        ("colour", np.float32, 3),
        ("blocks", np.bool_),
    ]
)
"""A capsule that avatars of a type carry at a joint.

Both ends in the joint's frame [m], its radius [m], its colour, and whether it is of a shield, which blocks strikes.
"""

FACE = np.dtype(
    [
        ("type", np.int16),
        ("joint", np.int32),
        ("corners", np.float32, (3, 3)),
        ("colour", np.float32, 3),
        ("blocks", np.bool_),
    ]
)
"""A triangle of a mesh that avatars of a type carry at a joint.

Its corners in the joint's frame [m], its colour, and whether it is of a shield.
"""
