"""A bank of clips, and a track for each avatar, for engines that play thousands of avatars."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from crowdsim.export.posed import PosedOutput, extent_of
from crowdsim.export.stream import Sink
from crowdsim.scenario.output import Extent, Series

if TYPE_CHECKING:
    from crowdsim.poses.sampler import PoseSampler

_ROW_BYTES, _AVATAR_BYTES, _BANK_BYTES = 60.0, 4_000.0, 20e6
"""Bytes of an avatar at a time and of its segments, and of a bank at the most, measured with the shipped scenarios."""
_ROW_SECONDS = 5e-6


class ClipsOutput(PosedOutput):
    """A bank of clips as glTF, and which of them each avatar plays, when and where, as JSON and Parquet."""

    name = "clips"
    about = "A bank of clips as glTF and a track for each avatar as JSON and Parquet, for game engines."
    kernels = "bodies"

    rotations: Literal["float32", "int16"] = Field(
        default="float32",
        description="How rotations are stored: `float32`, 16 bits where they move no other joint; or all as `int16`, "
        "which takes three fifths of the room.",
    )

    @classmethod
    def posed_pattern(cls) -> str:
        """Return the regular expression of the names of its files."""
        return r"clips/(?:bank\.glb|tracks\.json|tracks\.parquet)"

    def posed_files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the names of the bank and the tracks."""
        from crowdsim.export.clips import clip_files

        yield from (f"{self.name}/{file}" for file in clip_files())

    def file_of(self, avatar: str) -> str:
        """Return the file that holds the tracks of all avatars."""
        return "tracks.json"

    def cost(self, extent: Extent) -> tuple[float, float]:
        """Return about how much room its files take [bytes], and how long one core writes them [s]."""
        avatars = len(self.chosen(extent.avatars))
        rows = avatars * self.frame_count(extent)
        return _ROW_BYTES * rows + _AVATAR_BYTES * avatars + _BANK_BYTES, _ROW_SECONDS * rows

    def sink(self, sampler: PoseSampler, folder: Path, missing: Collection[str] | None = None) -> Sink:
        """Return what writes the files."""
        from crowdsim.export.clips import ClipSink

        frames = self.frames_of(extent_of(sampler.take))
        return ClipSink(sampler, folder, self.rate, frames, self.numbers, self.rotations)


OUTPUT = ClipsOutput
