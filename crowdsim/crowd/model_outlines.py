"""Points of bodies that obstacles confine: heads, trunks, fists and soles in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.layout import LEFT_FIST, LIMB_ROOM, RIGHT_FIST, TRUNK_ROOM
from crowdsim.crowd.model_arms import arm_rows
from crowdsim.crowd.model_falls import soles_of

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


def outline_rows(policies: Sequence[Policy]) -> dict[str, Array]:
    """Return ``Model.outlines`` and ``Model.extents`` of policies."""
    points = []
    for policy in policies:
        database = policy.database
        trunk = np.stack([database.heads, database.necks, database.pelvises], axis=1)
        fists = arm_rows(database)[:, LEFT_FIST : RIGHT_FIST + 1]
        points.append(np.concatenate([trunk, fists, soles_of(policy).reshape(-1, 4, 3)], axis=1))
    outlines = np.concatenate(points).astype(np.float32)
    rooms = np.array([TRUNK_ROOM] * 3 + [LIMB_ROOM] * 6)
    extents = (np.hypot(outlines[..., 0], outlines[..., 2]) + rooms).max(axis=1)
    return {"outlines": outlines, "extents": extents.astype(np.float32)}


def no_outlines() -> dict[str, Array]:
    """Return those of a crowd without obstacles: none."""
    return {"outlines": np.zeros((0, 9, 3), np.float32), "extents": np.zeros(0, np.float32)}
