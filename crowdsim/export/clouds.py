"""Outputs of labelled point clouds, one file for each frame."""

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

MAXIMUM_POINTS = 500_000_000
# Bytes of a point, and seconds that one core takes for it. Measured with the shipped scenarios, rounded up.
_POINT_BYTES, _POINT_SECONDS = 50.0, 1e-7


class CloudOutput(PosedOutput):
    """Point clouds, one file per frame."""

    kernels = "clouds"

    every: int = Field(default=1, ge=1, le=1_000_000, description="Write every n-th output frame.")
    points: int = Field(default=500, ge=1, le=100_000, description="Points per avatar.")
    surface: Literal["capsules", "body"] = Field(
        default="capsules", description="What points lie on: `capsules`, or the skin of the `body`."
    )
    obstacles: float = Field(
        default=50.0,
        ge=0.0,
        le=100_000.0,
        description="Points a square metre on walls, doors and other obstacles; 0 leaves them out.",
    )

    @classmethod
    def posed_pattern(cls) -> str:
        """Return the regular expression of the names of its clouds."""
        return rf"{cls.name}/\d{{6,}}\.{cls.name}"

    def findings(self, avatars: int) -> Iterator[Finding]:
        """Yield a finding for each avatar that there is not, and where there are too many points."""
        yield from super().findings(avatars)
        points = self.points * len(self.chosen(avatars))
        if points > MAXIMUM_POINTS:
            what = f"asks for {points:,} points a frame, expected at most {MAXIMUM_POINTS:,}"
            yield Finding(("points",), what)

    def findings_for(self, extent: Extent) -> Iterator[Finding]:
        """Yield a finding where there are too many points on obstacles."""
        points = self.obstacles * extent.obstacle_area
        if points > MAXIMUM_POINTS:
            what = f"asks for {points:,.0f} points a frame on {extent.obstacle_area:,.0f} m2 of obstacles, "
            yield Finding(("obstacles",), f"{what}expected at most {MAXIMUM_POINTS:,}")

    def posed_files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the names of the clouds, which are numbered by output frame."""
        yield Series(self.name, range(*self.frames_of(extent), self.every), self.name)

    def cost(self, extent: Extent) -> tuple[float, float]:
        """Return about how much room its files take [bytes], and how long one core writes them [s]."""
        frames = self.frame_count(extent) / self.every
        bodies = len(self.chosen(extent.avatars)) * frames
        points = self.points * bodies + self.obstacles * extent.obstacle_area * frames
        return _POINT_BYTES * points, _POINT_SECONDS * points + POSE_SECONDS * bodies

    def sink(self, sampler: PoseSampler, folder: Path, missing: Collection[str] | None = None) -> Sink:
        """Return what writes clouds, from the first that is missing on."""
        from crowdsim.export.pointcloud import CloudSink

        first, stop = self.frames_of(extent_of(sampler.take))
        if missing:
            first = min(int(Path(name).stem) for name in missing)
        return CloudSink(
            sampler,
            folder,
            self.name,
            self.rate,
            self.points,
            (first, stop),
            self.every,
            self.numbers,
            self.surface,
            self.obstacles,
        )
