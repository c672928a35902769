"""Skins of avatars in pictures: shaped once for each avatar, and posed for each picture."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.body.kernels import carry_skin, nearest_capsules, skin_vertices
from crowdsim.body.palette import skin_paints
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.body.skin import Skin
from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.render.figure import Figure
from crowdsim.render.raycast import PosedSkins
from crowdsim.render.scene import Cast

BODY_SCALE, LEAST_SCALE = 36.0, 8.0
"""Pixels a metre from which avatars are drawn as bodies by ``auto``, and by ``body``."""
_FINE_SCALE, _COARSENESS = 160.0, 1.7
"""Pixels a metre from which bodies have their whole skin, and how many times as long its edges are below."""
_KEPT_SETS, _KEPT_TRIANGLES, _KEPT_SHAPES = 4, 4_000_000, 512
"""Sets of avatars that are kept, as far as they have no more triangles in all, and shapes of avatars."""


@dataclass(frozen=True)
class _Shape:
    """The skin of an avatar, what takes it into the frames of its joints, and the capsule of each triangle."""

    skin: Skin
    bindings: Array
    straights: Array
    homes: Array


@dataclass(frozen=True)
class _Set:
    """Avatars that are posed together: their shapes, where the vertices of each begin, and what never changes."""

    shapes: tuple[_Shape, ...]
    starts: Array
    triangles: Array
    owners: Array
    looks: Array
    homes: Array
    paints: Array


class SkinCast:
    """The skins of a cast; any number of threads may pose them.

    Args:
        cast: The avatars.
        skin: Returns the skin of an avatar whose edges are so many times as long as usual.
        kinds: Number of each avatar's type, which its shorts follow. Shape (N,).
    """

    def __init__(self, cast: Cast, skin: Callable[[int, float], Skin], kinds: Array) -> None:
        self._cast, self._skin, self._kinds = cast, skin, kinds
        count = len(cast.scales)
        self._columns, self._figures = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._rows, row = np.zeros(count, np.int64), 0
        for figure, (members, form) in enumerate(zip(cast.members, cast.figures, strict=True)):
            each = len(form.capsule_joints)
            self._figures[members], self._columns[members] = figure, np.arange(len(members))
            self._rows[members] = row + each * np.arange(len(members))
            row += each * len(members)
        self._shapes: dict[tuple[int, bool], _Shape] = {}
        self._sets: dict[bytes, _Set] = {}
        self._lock = threading.Lock()

    def pose(self, poses: Sequence[tuple[Array, Array]], scales: Array, least: float) -> PosedSkins | None:
        """Return the skins of avatars that are seen from near; None where there is none.

        Args:
            poses: World positions (n, J, 3) and rotations (n, J, 4) of the members of each figure.
            scales: At how many pixels a metre each avatar shows, 0 where nothing of it is seen. Shape (N,).
            least: From how many on a skin is seen.
        """
        avatars = np.flatnonzero(scales >= least)
        if not len(avatars):
            return None
        some = self._set(avatars, scales[avatars] >= _FINE_SCALE)
        vertices, normals = (np.empty((int(some.starts[-1]), 3), np.float32) for _ in range(2))
        for index, (avatar, shape) in enumerate(zip(avatars, some.shapes, strict=True)):
            positions, rotations = (part[self._columns[avatar]] for part in poses[self._figures[avatar]])
            skin, rows = shape.skin, slice(some.starts[index], some.starts[index + 1])
            matrices = np.empty((1, *shape.bindings.shape), np.float32)
            carry_skin(np.asarray(positions, float), np.asarray(rotations, float), float(self._cast.scales[avatar]),
                       shape.bindings, skin.parents, skin.helpers, shape.straights, matrices[0])  # fmt: skip
            skin_vertices(0, 1, matrices, skin.joints, skin.weights, skin.vertices[None], skin.normals[None],
                          vertices[None, rows], normals[None, rows])  # fmt: skip
        return PosedSkins(avatars, vertices, normals, some.triangles, some.owners, some.looks, some.homes, some.paints)

    def _set(self, avatars: Array, fine: Array) -> _Set:
        """Return what never changes of some avatars."""
        key = avatars.tobytes() + fine.tobytes()
        with self._lock:
            if key not in self._sets:
                self._sets[key] = self._join(avatars, fine)
                while len(self._sets) > 1 and (
                    len(self._sets) > _KEPT_SETS
                    or sum(len(one.triangles) for one in self._sets.values()) > _KEPT_TRIANGLES
                ):
                    del self._sets[next(iter(self._sets))]
            return self._sets[key]

    def _join(self, avatars: Array, fine: Array) -> _Set:
        shapes = tuple(self._shape(*each) for each in zip(avatars.tolist(), fine.tolist(), strict=True))
        starts = np.cumsum([0, *(len(shape.skin.vertices) for shape in shapes)])
        counts = [len(shape.skin.triangles) for shape in shapes]
        parts = len(SKIN_PARTS)
        return _Set(
            shapes,
            starts,
            np.concatenate([
                shape.skin.triangles + np.int32(start) for shape, start in zip(shapes, starts[:-1], strict=True)
            ]),
            np.repeat(avatars, counts).astype(np.int32),
            np.concatenate([shape.skin.parts.astype(np.int32) + parts * row for row, shape in enumerate(shapes)]),
            np.concatenate([
                shape.homes + np.int32(self._rows[avatar]) for shape, avatar in zip(shapes, avatars, strict=True)
            ]),
            np.concatenate([
                skin_paints(int(avatar), self._cast.dresses[avatar], int(self._kinds[avatar])) for avatar in avatars
            ]),
        )  # fmt: skip

    def _shape(self, avatar: int, fine: bool) -> _Shape:
        key = avatar, fine
        if key not in self._shapes:
            skin = self._skin(avatar, 1.0 if fine else _COARSENESS)
            self._shapes[key] = _Shape(
                skin,
                skin.inverse_bindings(),
                skin.straights(),
                _home_capsules(skin, self._cast.figures[self._figures[avatar]]),
            )
            while len(self._shapes) > _KEPT_SHAPES:
                del self._shapes[next(iter(self._shapes))]
        return self._shapes[key]


def _home_capsules(skin: Skin, figure: Figure) -> Array:
    """Return the capsule on which each triangle of a skin lies. Shape (T,), int32."""
    joints = figure.capsule_joints
    starts, ends = (
        skin.positions[joints] + quaternion.rotate(skin.rotations[joints], np.asarray(offsets, float))
        for offsets in (figure.capsule_starts, figure.capsule_ends)
    )
    homes = np.empty(len(skin.vertices), np.int32)
    nearest_capsules(skin.vertices.astype(float), starts, ends, np.asarray(figure.capsule_radii, float), homes)
    return np.asarray(homes[skin.triangles[:, 0]])
