"""A report of a run as one page, with its player."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field, model_validator

from crowdsim.config.files import Fault, Finding
from crowdsim.config.findings import show
from crowdsim.files import write_plain
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.output import Avatars, Extent, Ranged, Series

if TYPE_CHECKING:
    from crowdsim.export.posed import FinishedTake
    from crowdsim.render.take_source import TakeSource
    from crowdsim.view.recording import Recording

_FILE = "report.html"
_POSE_BYTES, _PAGE_BYTES = 60.0, 400_000.0
_POSE_SECONDS, _FIGURE_SECONDS = 60e-6, 2.4e-3
"""Bytes and seconds of an avatar in a frame, bytes of the rest, and seconds of an avatar in all thumbnails; measured
with the shipped scenarios."""
_AVATARS = (
    "Numbers of the avatars that the player shows, from 0, or names of avatars, groups and teams; without it all."
)


class ReportOutput(Ranged):
    """A report as one HTML page: what happened, how well it looks, pictures, the player, and how to repeat it."""

    name = "report"
    about = "A report as one HTML page: summary, statistics with verdicts, pictures, the player, the scenario."
    kernels = "pictures"
    stage = "report"

    player: bool = Field(default=True, description="Whether the page has the player; `frames` and `fps` are its own.")
    avatars: Avatars | None = Field(default=None, description=_AVATARS)

    @model_validator(mode="after")
    def _check(self) -> ReportOutput:
        for key in ("avatars", "frames"):
            if not self.player and getattr(self, key) is not None:
                raise Fault("is of the player, which player: false leaves out", key)
        return self

    @classmethod
    def pattern(cls) -> str:
        """Return the regular expression of the name of its file."""
        return _FILE.replace(".", r"\.")

    def files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the name of the page."""
        if extent.control_frames:
            yield _FILE

    def named(self, members: Callable[[str], Sequence[int] | None], cameras: Mapping[str, Camera]) -> ReportOutput:
        """Return it with the numbers of its avatars."""
        if self.avatars is None:
            return self
        numbers = [[avatar] if isinstance(avatar, int) else members(avatar) or () for avatar in self.avatars]
        return self.model_copy(update={"avatars": tuple(sorted({one for found in numbers for one in found}))})

    def findings(self, avatars: int) -> Iterator[Finding]:
        """Yield a finding for each avatar that there is not."""
        for i, avatar in enumerate(self.avatars or ()):
            if isinstance(avatar, int) and avatar >= avatars:
                yield Finding(("avatars", i), f"{show(avatar)}, expected an avatar from 0 to {avatars - 1}")

    def findings_for(self, extent: Extent) -> Iterator[Finding]:
        """Yield a finding where browsers could not load the page."""
        from crowdsim.view.page import LARGEST

        size = self.cost(extent)[0]
        if size > LARGEST:
            what = f"would have about {size / 1e9:.1f} GB, expected {LARGEST / 1e9:.1f} at most; "
            yield Finding((), what + "fewer avatars or frames, a lower rate, or player: false")

    def cost(self, extent: Extent) -> tuple[float, float]:
        """Return about how much room the page takes [bytes], and how long one core writes it [s]."""
        shown = extent.avatars if self.avatars is None else len(self.avatars)
        poses = shown * self.frame_count(extent) if self.player else 0
        seconds = 2.0 + _FIGURE_SECONDS * extent.avatars + _POSE_SECONDS * poses
        return _PAGE_BYTES + _POSE_BYTES * poses, seconds

    def write(self, done: FinishedTake) -> list[Path]:
        """Write the page where it is missing.

        Raises:
            OutputError: It cannot be written.
            CrowdsimError: It would be too large.
        """
        from crowdsim.view.report import report_parts

        path = done.folder / _FILE
        if not path.exists():
            done = replace(done, take=replace(done.take, policies=tuple(done.policies)))
            recording = self._recording(done) if self.player else None
            pictures, how = self._pictures(done), (done.threads, done.progress)
            parts = report_parts(done.take, recording, done.scenario, *how, done.health, done.heals, pictures)
            write_plain(done.folder, _FILE, parts)
        return [path]

    def _pictures(self, done: FinishedTake) -> TakeSource | None:
        from crowdsim.render.take_source import TakeSource, thumbnail_rate

        take = done.take
        if not take.frame_count:
            return None
        return TakeSource(
            take, done.policies, thumbnail_rate(take), threads=done.threads, arena=done.arena, obstacles=done.obstacles
        )

    def _recording(self, done: FinishedTake) -> Recording | None:
        from crowdsim.view.take_motion import record_take

        start, stop = self.frames_of(done.extent)
        if start == stop:  # a run that ended before
            return None
        numbers = None if self.avatars is None else [int(avatar) for avatar in self.avatars]
        frames = f"{start}:{stop}"
        return record_take(
            done.take, self.rate, numbers, frames, done.threads, done.arena, done.cameras, done.health, done.obstacles,
            done.heals,
        )  # fmt: skip

    def command(self, run: str) -> list[str]:
        """Return the words of the command that writes it from a finished run."""
        words = ["crowdsim", "report", run, "--fps", f"{self.rate:g}", "--threads", "1"]
        words += [] if self.player else ["--no-player"]
        if self.avatars is not None:
            words += ["--avatars", ",".join(map(str, self.avatars))]
        frames = self.asked_frames()
        return words if frames is None else [*words, "--frames", f"{frames[0]}:{frames[1]}"]


OUTPUT = ReportOutput
