"""Figures of capsules on skeletons, positioned by poses and coloured by team and avatar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.body.palette import avatar_paints, capsule_paints
from crowdsim.core.types import Array
from crowdsim.poses.capsules import swelling_capsules
from crowdsim.render.figure import Figure, dress, figure_segments
from crowdsim.render.kernels.capsules import place_capsules
from crowdsim.render.kernels.records import CAPSULE, as_records
from crowdsim.render.raycast import Capsules

_BALL, _BALL_PAINT = 0.13, (0.85, 0.50, 0.03, 0.3)
"""Radius [m] and paint of a marker."""


@dataclass(frozen=True)
class Cast:
    """Everything about the avatars that does not change from frame to frame.

    Attributes:
        figures: Figures, one a kind of body.
        members: Avatars of each figure, ascending. Length of ``figures``, each (n,), int32.
        scales: Size of each avatar. Shape (N,).
        girths: How thick its trunk and limbs are for their length. Shape (N,).
        stretches: How long the bones of its trunk, legs and arms are for its size. Shape (N, 3).
        segments: Which of these bones each capsule of each figure lies on. Length of ``figures``, each (k,), int64.
        paints: Paint of every capsule, in the order of ``place``. Shape (K, 4), float32.
        owners: Avatar of every capsule. Shape (K,), int32.
        dresses: Paint of each part of every avatar, see ``avatar_paints``. Shape (N, 7, 4), float32.
    """

    figures: tuple[Figure, ...]
    members: tuple[Array, ...]
    scales: Array
    girths: Array
    stretches: Array
    segments: tuple[Array, ...]
    paints: Array
    owners: Array
    dresses: Array

    def place(self, poses: Sequence[tuple[Array, Array]], markers: Array | None = None) -> Capsules:
        """Return the capsules of one frame.

        Args:
            poses: World positions (n, J, 3) and rotations (n, J, 4) of the members of each figure.
            markers: Positions of things that are no avatars, which show as balls [m]. Shape (G, 3).
        """
        balls = 0 if markers is None else len(markers)
        shapes = np.empty((len(self.owners) + balls, 8), np.float32)
        row = 0
        kinds = zip(self.figures, self.segments, self.members, poses, strict=True)
        for figure, segments, avatars, (positions, rotations) in kinds:
            rows = len(avatars) * len(figure.capsule_joints)
            place_capsules(
                np.ascontiguousarray(positions),
                np.ascontiguousarray(rotations),
                self.scales[avatars, None] * self.stretches[avatars],
                self.girths[avatars],
                figure.capsule_joints,
                segments,
                np.stack([figure.capsule_starts, figure.capsule_ends]),
                figure.capsule_radii,
                swelling_capsules(figure.capsule_parts).astype(float),
                as_records(shapes[row : row + rows], CAPSULE),
            )
            row += rows
        if markers is None or not balls:
            return Capsules(shapes, self.paints, self.owners)
        shapes[row:] = np.concatenate([markers, markers, np.full((balls, 2), _BALL)], axis=1)
        paints = np.concatenate([self.paints, np.tile(np.array(_BALL_PAINT, np.float32), (balls, 1))])
        owners = np.concatenate([self.owners, len(self.scales) + np.arange(balls, dtype=np.int32)])
        return Capsules(shapes, paints, owners)


def build_cast(
    figures: Sequence[Figure],
    avatar_figures: Array,
    teams: Sequence[int] | Array,
    scales: Array | None = None,
    colours: Array | None = None,
    girths: Array | None = None,
    stretches: Array | None = None,
    bare: Array | None = None,
) -> Cast:
    """Dress avatars: which figure each has, and which colours.

    Args:
        figures: Kinds of bodies.
        avatar_figures: Index of each avatar's figure. Shape (N,).
        teams: Team of each avatar. Shape (N,).
        scales: Size of each avatar, 1 by default. Shape (N,).
        colours: Colour that an avatar has instead of its team's, NaN for none: red, green, blue in 0..1. Shape (N, 3).
        girths: How thick its trunk and limbs are for their length, 1 by default. Shape (N,).
        stretches: How long the bones of its trunk, legs and arms are for its size, 1 by default. Shape (N, 3).
        bare: Which have bare hands, none by default. Shape (N,), bool.
    """
    segments = tuple(figure_segments(figure) for figure in figures)
    figures = [dress(figure) for figure in figures]
    avatar_figures = np.asarray(avatar_figures)
    by_part = avatar_paints(teams, colours)
    worn = by_part if bare is None else capsule_paints(by_part, bare)
    members, paints, owners = [], [], []
    for index, figure in enumerate(figures):
        avatars = np.flatnonzero(avatar_figures == index).astype(np.int32)
        members.append(avatars)
        paints.append(worn[avatars][:, figure.capsule_parts].reshape(-1, 4))
        owners.append(np.repeat(avatars, len(figure.capsule_joints)))
    return Cast(
        figures=tuple(figures),
        members=tuple(members),
        scales=np.ones(len(avatar_figures)) if scales is None else np.asarray(scales, float),
        girths=np.ones(len(avatar_figures)) if girths is None else np.asarray(girths, float),
        stretches=np.ones((len(avatar_figures), 3)) if stretches is None else np.asarray(stretches, float),
        segments=segments,
        paints=np.ascontiguousarray(np.concatenate(paints), dtype=np.float32),
        owners=np.concatenate(owners).astype(np.int32),
        dresses=by_part,
    )
