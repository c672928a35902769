"""What control cost, as a table and as a picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from crowdsim.scenario.output import Extent, Output, Series

if TYPE_CHECKING:
    from crowdsim.export.posed import FinishedTake


class ProfileOutput(Output):
    """What control cost."""

    name = "profile"
    about = "What control cost, frame by frame."
    stage = "profile"
    from_take = False

    csv: bool = Field(default=True, description="Whether to write profile.csv, one row per control frame.")
    plots: bool = Field(default=False, description="Whether to draw profile.png.")

    @classmethod
    def pattern(cls) -> str:
        """Return the regular expression of the names of its files."""
        return r"profile\.(?:csv|png)"

    def files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the names of the table and the picture."""
        yield from ["profile.csv"] * self.csv + ["profile.png"] * self.plots

    def write(self, done: FinishedTake) -> list[Path]:
        """Write both; nothing where nothing was measured."""
        from crowdsim.crowd.profile_files import draw_profile, write_csv

        if done.timings is None:
            return []
        files = [done.folder / str(name) for name in self.files(done.extent, ())]
        for path in files:
            (write_csv if path.suffix == ".csv" else draw_profile)(path, done.timings, done.extent.avatars)
        return files


OUTPUT = ProfileOutput
