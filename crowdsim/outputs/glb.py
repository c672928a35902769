"""Avatars of a take as skinned bodies with their motion: one binary glTF 2.0 file."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from crowdsim.config.files import Finding
from crowdsim.export.posed import POSE_SECONDS, PosedOutput, extent_of
from crowdsim.export.stream import Sink
from crowdsim.scenario.output import Extent, Series

if TYPE_CHECKING:
    from crowdsim.poses.sampler import PoseSampler

_FILE = "glb/take.glb"
_LARGEST = 2**32
_POSE_BYTES = {"float32": 400.0, "int16": 210.0}
"""Bytes of an avatar at a time, measured with the shipped scenarios."""
_SKIN_BYTES, _AVATAR_BYTES = 300_000.0, 8_000.0
"""Bytes of a skin, which avatars of one build share, and of the description of an avatar."""


class GlbOutput(PosedOutput):
    """Skinned bodies and their motion as binary glTF 2.0, one file for all avatars, one animation, metres, y up."""

    name = "glb"
    about = "Skinned bodies and their motion as binary glTF 2.0, one file for all avatars."
    kernels = "bodies"

    rotations: Literal["float32", "int16"] = Field(
        default="float32", description="How rotations are stored: `float32`, or `int16`, which takes half the room."
    )

    @classmethod
    def posed_pattern(cls) -> str:
        """Return the regular expression of the name of its file."""
        return _FILE.replace(".", r"\.")

    def posed_files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the name of the file."""
        yield _FILE

    def file_of(self, avatar: str) -> str:
        """Return the name of the file, which holds all avatars that are there at some time."""
        return Path(_FILE).name

    def findings_for(self, extent: Extent) -> Iterator[Finding]:
        """Yield a finding where the file would be larger than glTF files can be."""
        size = self.cost(extent)[0]
        if size >= _LARGEST:
            what = f"would have about {size / 1e9:.1f} GB, glTF files have at most {_LARGEST / 1e9:.1f}; "
            yield Finding((), what + "expected fewer avatars or frames, a lower rate, or rotations: int16")

    def cost(self, extent: Extent) -> tuple[float, float]:
        """Return about how much room the file takes [bytes], and how long one core writes it [s]."""
        avatars = len(self.chosen(extent.avatars))
        poses = avatars * self.frame_count(extent)
        return _POSE_BYTES[self.rotations] * poses + _SKIN_BYTES + _AVATAR_BYTES * avatars, POSE_SECONDS * poses

    def sink(self, sampler: PoseSampler, folder: Path, missing: Collection[str] | None = None) -> Sink:
        """Return what writes the file."""
        from crowdsim.export.gltf import GltfSink

        frames = self.frames_of(extent_of(sampler.take))
        return GltfSink(sampler, folder / Path(_FILE).name, self.rate, frames, self.numbers, self.rotations)


OUTPUT = GlbOutput
