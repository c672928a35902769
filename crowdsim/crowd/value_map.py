"""Value maps: what an avatar's next action is worth, by where its opponent stands."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, Model, World
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.kernels.layout import DROPS, HEAD
from crowdsim.crowd.kernels.value_maps import best_values
from crowdsim.policy.kernels.axes import Corners

REACH = 3.0
"""Up to which distance cells are shown, for a body of scale 1 [m]."""
_BEARINGS, _DISTANCES = 36, 24
"""About how many bearings and distances are shown of a finer grid."""


@dataclass(frozen=True)
class ValueMap:
    """What the best next action of an avatar is worth, by where its opponent stands.

    It is for the decision at the end of the action in progress: seen from where, and facing as, the avatar is then.

    Attributes:
        avatar: Number of the avatar.
        x: Where its action ends [m].
        z: Likewise.
        heading: Which way it faces then [rad].
        distances: Distances of the opponent that faces it [m]. Shape (d,).
        bearings: Bearings of the opponent, to the left is positive [rad]. Shape (b,).
        values: Sum of the behaviours' values, each over its scale and times its weight. Shape (d, b).
    """

    avatar: int
    x: float
    z: float
    heading: float
    distances: Array
    bearings: Array
    values: Array


def map_values(crowd: Crowd, model: Model, avatars: Avatars, world: World, number: int) -> ValueMap | None:
    """Return the value map of an avatar; None where none of its behaviours counts, or it is down.

    Args:
        crowd: The crowd.
        model: Its policies.
        avatars: Its avatars.
        world: What they share.
        number: Number of the avatar, which is there.
    """
    if len(avatars.conditions) and avatars.conditions["standing"][number] >= DROPS:
        return None
    slot = int(avatars.slot_of[number])
    index = int(avatars.policy[slot])
    policy, cohort = crowd.policies[index], int(avatars.playback["cohort"][slot])
    weights = np.array(world.weights[cohort, : len(policy.behaviours)], float)
    if not (weights > 0.0).any():
        return None
    grid = policy.behaviours[int(np.argmax(weights))].grid
    axes = {axis.name: axis.points for axis in grid.ground_axes}
    distances = axes.get("distance", np.linspace(0.0, REACH, _DISTANCES))
    distances = distances[(distances > 0.0) & (distances <= REACH)]
    distances = distances[:: max(1, round(len(distances) / _DISTANCES))]
    bearings = axes.get("bearing", np.linspace(-math.pi, math.pi, _BEARINGS, endpoint=False))
    bearings = bearings[:: max(1, round(len(bearings) / _BEARINGS))]

    action, scale = int(avatars.motion["action"][slot]), float(avatars.playback["scale"][slot])
    state = int(model.actions["next"][action]) - int(model.policies["states"][index])
    far, aside = (part.ravel() for part in np.meshgrid(distances, bearings, indexing="ij"))
    height = _height_of(avatars, model, world, slot) / scale
    points = np.column_stack([far * np.sin(aside), np.full(len(far), height), far * np.cos(aside)])
    tables, out = policy.lookup_tables(), np.empty(len(far))
    most = int(np.diff(policy.actions.offsets).max())
    corners = Corners(np.empty(64, np.int64), np.empty(64))
    facing = np.arctan2(-points[:, 0], -points[:, 2])
    best_values(tables, weights, state, points, facing, corners, np.empty(most), out)
    frames = int(model.actions["length"][action]) * int(model.policies["stride"][index])
    end = model.ground[int(model.actions["origin"][action]) + frames]
    return ValueMap(
        avatar=number,
        x=float(avatars.motion["end_x"][slot]),
        z=float(avatars.motion["end_z"][slot]),
        heading=float(avatars.playback["base_turn"][slot] + end["heading"]),
        distances=distances * scale,
        bearings=bearings,
        values=out.reshape(len(distances), len(bearings)),
    )


def _height_of(avatars: Avatars, model: Model, world: World, slot: int) -> float:
    """Return how high an avatar's opponent is, its head or a scripted target; its own head where it has none [m]."""
    opponent = int(avatars.opponent[slot])
    if opponent <= -2:
        return float(world.targets[-1, -2 - opponent, 1])
    other = slot if opponent < 0 else int(avatars.slot_of[opponent])
    frame = int(model.actions["origin"][avatars.motion["action"][other]])
    return float(model.bodies[frame, HEAD, 1] * avatars.playback["scale"][other])
