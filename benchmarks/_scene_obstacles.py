"""How often bodies are in obstacles, or beyond them, and how often roots slide along them."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Model
from crowdsim.crowd.chunk import Chunk
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.kernels.layout import PELVIS
from crowdsim.crowd.simulation import crowd_model
from crowdsim.places.arrays import are_ways_clear

_FEET = slice(5, 9)
"""Heels and balls among ``Model.outlines``."""
_SLID = 2e-3
"""How far roots slide in a control frame so that it counts [m]."""
_TOUCHING = 1e-6


class OutsideCounter:
    """Counts bodies in and beyond obstacles, chunk by chunk.

    Args:
        crowd: The crowd, which has obstacles.
    """

    def __init__(self, crowd: Crowd) -> None:
        self._crowd, self._model = crowd, crowd_model(crowd)
        self._pelvises = self._feet = self._slid = self._frames = 0

    def add(self, chunk: Chunk) -> None:
        """Count one more chunk."""
        model, policies = self._model, np.asarray(self._crowd.cast.policies)
        actions = np.maximum(chunk.action, 0) + model.policies["actions"][policies]
        shown = model.actions["origin"][actions] + chunk.action_frame * model.policies["stride"][policies]
        points = np.concatenate([model.bodies[:, [PELVIS]], model.outlines[:, _FEET]], axis=1)
        here = chunk.action >= 0
        for frame in range(chunk.frames):
            some = np.flatnonzero(here[frame])
            now, parts = chunk.first + frame, self._crowd.parts
            parts = parts[~((parts["opens"] <= now) & (now < parts["closes"]))]
            x, z = chunk.x[frame, some].astype(float), chunk.z[frame, some].astype(float)
            heading, scale = chunk.heading[frame, some], np.asarray(self._crowd.cast.scales)[some]
            bodies = points[shown[frame, some].astype(np.int64)] * scale[:, None, None]
            cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
            ends = np.stack(
                [
                    x[:, None] + bodies[..., 0] * cos + bodies[..., 2] * sin,
                    z[:, None] - bodies[..., 0] * sin + bodies[..., 2] * cos,
                ],
                axis=-1,
            )
            starts = np.broadcast_to(np.stack([x, z], axis=-1)[:, None], ends.shape)
            out = ~are_ways_clear(parts, starts.reshape(-1, 2), ends.reshape(-1, 2), _TOUCHING).reshape(-1, 5)
            self._pelvises += int(out[:, 0].sum())
            self._feet += int(out[:, [1, 2]].any(axis=1).sum() + out[:, [3, 4]].any(axis=1).sum())
            self._frames += len(some)
        self._slid += int((_slides(model, self._crowd, chunk, shown) > _SLID).sum())

    def finish(self) -> dict[str, float]:
        """Return the shares of pelvises and of feet outside, and of avatar-frames in which a root slides."""
        frames = max(self._frames, 1)
        return {
            "pelvis_outside_share": self._pelvises / frames,
            "feet_outside_share": self._feet / (2 * frames),
            "slide_share": self._slid / frames,
        }


def _slides(model: Model, crowd: Crowd, chunk: Chunk, shown: Array) -> Array:
    """Return how far roots move between control frames of one action beside its motion [m]. Shape (frames - 1, N)."""
    below = shown.astype(np.int64)
    above, share = np.minimum(below + 1, len(model.ground) - 1), shown - below
    x, z, heading = (
        model.ground[axis][below] + share * (model.ground[axis][above] - model.ground[axis][below])
        for axis in ("x", "z", "heading")
    )
    scale = np.asarray(crowd.cast.scales)
    cos, sin = scale * np.cos(chunk.heading - heading), scale * np.sin(chunk.heading - heading)
    base_x, base_z = chunk.x - x * cos - z * sin, chunk.z + x * sin - z * cos
    same = (chunk.action[1:] == chunk.action[:-1]) & (chunk.action_frame[1:] > chunk.action_frame[:-1])
    return np.asarray(np.where(same, np.hypot(np.diff(base_x, axis=0), np.diff(base_z, axis=0)), 0.0))
