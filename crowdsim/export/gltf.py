"""Avatars of a take as one binary glTF 2.0 file: skinned bodies, one animation, metres, y up.

Every size is known before the first pose, so that the description is written first and blocks of poses are put at
their places; memory does not grow with the take. Each avatar has a tree of joints and a skinned mesh at the root of the
scene; avatars of one build share vertices, and the matrices of each skin hold what is its own: size, girth, length of
legs and arms. Helper joints ``...Half`` turn half as far as elbows and knees.
"""

from __future__ import annotations

import json
import os
import struct
import uuid
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.body.anatomy import Build
from crowdsim.body.looks import colours, linear, roughness, usual_build
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.body.skin import Skin, build_skin
from crowdsim.core.types import Array, Progress
from crowdsim.crowd.events import OUTCOMES
from crowdsim.errors import OutputError
from crowdsim.export.gltf_kernels import pack_rotations
from crowdsim.export.stream import Block, run_all, stream_poses
from crowdsim.motion.strikes import LIMBS
from crowdsim.take.builds import build_skeleton
from crowdsim.take.poses import Poses, PoseSampler

ROTATIONS = {"float32": ("<f4", 1.0), "int16": ("<i2", 32767.0)}
"""How rotations are stored, and what a one becomes."""
_HELPERS = {"float32": ("<i2", 32767.0), "int16": ("i1", 127.0)}
"""Helpers only move a fold of skin, for which fewer digits are enough."""
_COMPONENTS = {"|i1": 5120, "|u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_VERTICES, _INDICES = 34962, 34963
_LARGEST = 2**32 - 1
"""Bytes of a binary glTF file at the most, whose header counts them in 32 bits."""
_POSES = 200
"""Poses from which a skin learns how its joints bend."""


class GltfSink:
    """Writes one ``.glb`` of avatars of a take; a ``Sink``.

    Args:
        sampler: Poses of the take.
        path: The file.
        fps: Output frames a second; times are exact for fractions such as 24000/1001.
        frames: First output frame and one past the last; all when None.
        avatars: Numbers of the avatars; all when None.
        rotations: ``float32``, or ``int16``, which takes half the place.
        builds: Build of each avatar of the take; by its girth when None.

    Raises:
        OutputError: The file would be larger than glTF files can be.
    """

    kind = "glb"
    margin = 0

    def __init__(
        self,
        sampler: PoseSampler,
        path: Path,
        fps: float | Fraction,
        frames: tuple[int, int] | None = None,
        avatars: Sequence[int] | Array | None = None,
        rotations: str = "float32",
        builds: Sequence[Build] | None = None,
    ) -> None:
        take = sampler.take
        self.start, self.stop = frames or (0, take.output_frames(float(fps)))
        numbers: Array = np.arange(take.avatar_count) if avatars is None else np.unique(np.asarray(avatars))
        self._sampler, self._path, self._fps, self._rotations = sampler, path, Fraction(fps), rotations
        there = {int(number): _presence(sampler, int(number), self.start, self.stop, float(fps)) for number in numbers}
        self.avatars: Array = np.array([number for number in there if there[number].any()], np.int64)
        girths = np.asarray(take.cast.girths, float)
        self._builds = [usual_build(girth) for girth in girths] if builds is None else list(builds)
        self._file = _Layout()
        self._describe(there)
        self._total, self._written, self._partial = 1, 0, None
        self._last: dict[int, tuple[Array, Array, Array]] = {}

    @property
    def total(self) -> int:
        """Number of frames, which progress counts."""
        return self.stop - self.start

    @property
    def done(self) -> int:
        """Number of frames written so far."""
        return self._written

    def split(self, most: int) -> list[GltfSink]:
        """Return itself: one file holds all avatars."""
        return [self]
