"""Paths of the points of a body that analysis needs: fists, feet, head, trunk, soles, and the ground frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT, Body
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strikers import HANDS_AND_FEET

_FEET = 8.0
"""How much more than hips and shoulders the feet say where a stance looks; those two where feet are close together."""

_RAISED = (0.15, 0.7)
"""Heights of a foot over the other, for a body of ``HEIGHT`` [m], between which a stance passes from the feet to the
pelvis: a foot that kicks says nothing about where the body stands. In a walk no foot is raised as high."""


@dataclass(frozen=True)
class Tracks:
    """Paths of a body's points in the world, over F frames.

    Attributes:
        ground: Ground transform: under the pelvis, facing as hips and shoulders do. Shape (F, 3), headings continuous.
        stances: Ground transform that is constant while both feet are planted: between the toes, or the balls where
            there are none, and looking nearly at right angles to the line between them; ``ground`` while a foot is
            raised high. Shape (F, 3), headings continuous.
        fists: Left and right fist [m]. Shape (F, 2, 3).
        feet: What left and right foot kick with (``Body.foot_offsets``) [m]. Shape (F, 2, 3).
        shoulders: Left and right shoulder joint [m]. Shape (F, 2, 3).
        heads: Centre of the head [m]. Shape (F, 3).
        necks: Upper end of the torso [m]. Shape (F, 3).
        pelvises: Lower end of the torso [m]. Shape (F, 3).
        heels: Left and right heel on the sole [m]. Shape (F, 2, 3).
        balls: Ball of the left and right foot on the sole [m]. Shape (F, 2, 3).
        others: What else strikes, in the order of ``strikers.LIMBS`` after hands and feet [m]; NaN for props that are
            not there. Shape (F, 7, 3).
    """

    ground: Array
    stances: Array
    fists: Array
    feet: Array
    shoulders: Array
    heads: Array
    necks: Array
    pelvises: Array
    heels: Array
    balls: Array
    others: Array

    @property
    def strikers(self) -> Array:
        """Points that strike, in the order of ``strikers.LIMBS`` [m]. Shape (F, 11, 3)."""
        return np.concatenate([self.fists, self.feet, self.others], axis=1)


def build_tracks(body: Body, positions: Array, rotations: Array) -> Tracks:
    """Follow a body's points through posed frames.

    Args:
        body: The body.
        positions: Joint positions in the world [m]. Shape (F, J, 3).
        rotations: Joint rotations in the world. Shape (F, J, 4).
    """
    role = body.roles
    hands = [role["left_hand"], role["right_hand"]]
    feet = [role["left_foot"], role["right_foot"]]
    shoulders = positions[:, [role["left_shoulder"], role["right_shoulder"]]]
    across = shoulders[:, 0] - shoulders[:, 1] + positions[:, role["left_hip"]] - positions[:, role["right_hip"]]
    pelvis = positions[:, role["pelvis"]]
    balls = positions[:, feet] + quaternion.rotate(rotations[:, feet], body.sole_offsets[:, 1])
    # A planted foot rotates about its toes.
    toes = [role[name] for name in ("left_toe", "right_toe") if name in role]
    soles = positions[:, toes] if len(toes) == 2 else balls
    raised = _raised(soles, body.height)[:, None]
    middles, apart = soles.mean(axis=1), soles[:, 0] - soles[:, 1]
    return Tracks(
        ground=_ground(pelvis, across),
        stances=_ground(middles + raised * (pelvis - middles), across + _FEET * (1.0 - raised) * apart),
        fists=positions[:, hands] + quaternion.rotate(rotations[:, hands], body.fist_offsets),
        feet=positions[:, feet] + quaternion.rotate(rotations[:, feet], body.foot_offsets),
        shoulders=shoulders,
        heads=positions[:, role["head"]] + quaternion.rotate(rotations[:, role["head"]], body.head_offset),
        necks=positions[:, role["neck"]],
        pelvises=pelvis,
        heels=positions[:, feet] + quaternion.rotate(rotations[:, feet], body.sole_offsets[:, 0]),
        balls=balls,
        others=_others(body, positions, rotations),
    )


def _others(body: Body, positions: Array, rotations: Array) -> Array:
    """Return the points of all strikers but hands and feet. Shape (F, 7, 3)."""
    rows = body.strikers[len(HANDS_AND_FEET) :]
    joints = rows["joint"]
    points = positions[:, joints] + quaternion.rotate(rotations[:, joints], rows["offset"])
    points[:, joints < 0] = np.nan
    return np.asarray(points)


def clip_tracks(clip: Clip, body: Body) -> Tracks:
    """Follow a body's points through a clip."""
    return build_tracks(body, *clip_kinematics(clip))


def _raised(soles: Array, height: float) -> Array:
    """Return 0 where feet (F, 2, 3) are about as high as each other, 1 where one is raised to kick. Shape (F,)."""
    low, high = (limit * height / HEIGHT for limit in _RAISED)
    share = np.clip((np.abs(soles[:, 0, 1] - soles[:, 1, 1]) - low) / (high - low), 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share))


def _ground(middles: Array, across: Array) -> Array:
    """Return ground transforms under positions (F, 3), with what is across (F, 3) from the right to the left."""
    # Facing is left cross up.
    heading = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
    return np.stack([middles[:, 0], middles[:, 2], heading], axis=1).astype(float)


def speeds(path: Array, fps: float) -> Array:
    """Return the speed along paths (F, ..., 3) by central differences [m/s]. Shape (F, ...)."""
    if len(path) < 2:
        return np.zeros(path.shape[:-1])
    return np.asarray(np.linalg.norm(np.gradient(path, axis=0), axis=-1) * fps)
