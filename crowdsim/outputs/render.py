"""Pictures and video of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from crowdsim.config.files import Fault, Finding
from crowdsim.errors import TakeError
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.cameras import Chosen, Shot, Shots
from crowdsim.scenario.frame_ranges import output_frames
from crowdsim.scenario.looks import MOST_BLUR, Background, Figure, Light, Marks
from crowdsim.scenario.output import Extent, Ranged, Series
from crowdsim.scenario.rates import PictureRate, rate_text

if TYPE_CHECKING:
    from crowdsim.export.posed import FinishedTake

# Bytes of a pixel of a PNG and of a frame of video; seconds that one core takes for a picture: for itself, an avatar
# and a pixel. Measured with the shipped scenarios, rounded up.
_PNG_BYTES, _VIDEO_BYTES = 1.0, 0.1
_PICTURE_SECONDS, _FIGURE_SECONDS, _PIXEL_SECONDS = 0.02, 4e-4, 8e-8


_MOST_FRAMES = 10**12
Pixels = Annotated[int, Field(ge=16, le=8192)]


class RenderOutput(Ranged):
    """Pictures and video."""

    name = "render"
    about = "Pictures and video."
    label = "pictures"
    kernels = "pictures"
    stage = "render"

    fps: PictureRate | None = Field(
        default=None, description="Frames per second, or a fraction; without it the scenario's `fps`."
    )
    size: tuple[Pixels, Pixels] = Field(
        default=(1280, 720), description="Width and height [pixels]; even numbers for video."
    )
    camera: Chosen = Field(
        default="auto",
        description="The name of one of the scenario's `cameras`, a kind of camera such as `orbit` or `follow:red_0`, "
        "two side by side as in `front+side`, or the keys of a camera.",
    )
    shots: Shots = Field(
        default=(), description="Shots of an edited video, one after another, instead of the camera and `frames`."
    )
    mp4: bool = Field(default=True, description="Whether to write video.mp4.")
    png: bool = Field(default=False, description="Whether to write every frame as PNG.")
    contact_sheet: int | None = Field(default=None, ge=1, le=400, description="Number of moments on a contact sheet.")
    marks: Marks = Field(default="all", description="Which strikes have marks: `none`, those that `landed`, or `all`.")
    grid: bool = Field(default=True, description="Whether the floor has squares of a metre.")
    background: Background = Field(
        default="day", description="`day`, `dark`, `studio`, `white`, `black`, `green`, or a colour as '#rrggbb'."
    )
    light: Light = Field(default="day", description="`day`, `soft`, `evening` or `night`.")
    transparent: bool = Field(
        default=False, description="Whether PNG hold the figures alone, and how much of each pixel they cover."
    )
    caption: bool = Field(default=True, description="Whether pictures have a small caption.")
    motion_blur: int = Field(
        default=0,
        ge=0,
        le=MOST_BLUR,
        description="How many moments a picture is the mean of, while a shutter is open for half a frame; 0 for none.",
    )
    figure: Figure = Field(
        default="auto",
        description="What avatars are seen as: `body`, `capsules`, or `auto`: bodies from near, capsules far away.",
    )

    @model_validator(mode="after")
    def _check(self) -> RenderOutput:
        if self.mp4 and (self.size[0] % 2 or self.size[1] % 2):
            raise Fault(f"is {list(self.size)}, expected even numbers for video", "size")
        if not (self.mp4 or self.png or self.contact_sheet):
            raise Fault("writes nothing, expected mp4, png or contact_sheet")
        if self.transparent and self.mp4:
            raise Fault("is true, but video has no transparency, expected mp4: false", "transparent")
        if self.shots and self.frames is not None:
            raise Fault("are given beside shots, which have times of their own, expected one of them", "frames")
        return self

    @classmethod
    def pattern(cls) -> str:
        """Return the regular expression of the names of its files."""
        return r"frames/\d{6,}\.png|video\.mp4|contact_sheet\.png"

    def named(self, members: Callable[[str], Sequence[int] | None], cameras: Mapping[str, Camera]) -> RenderOutput:
        """Return it with the keys of cameras instead of their names."""

        def keys(chosen: Chosen) -> Chosen:
            return cameras.get(chosen, chosen) if isinstance(chosen, str) else chosen

        shots = tuple(shot.model_copy(update={"camera": keys(shot.camera)}) for shot in self.shots)
        return self.model_copy(update={"camera": keys(self.camera), "shots": shots})

    def frames_of(self, extent: Extent) -> tuple[int, int]:
        """Return the first frame and the one after the last of those that a take has, or of an edited video."""
        if not self.shots:
            return super().frames_of(extent)
        return 0, sum(stop - start for start, stop in self._spans(extent))

    def _spans(self, extent: Extent) -> list[tuple[int, int]]:
        """Return the frames of its shots that a take has, which may have ended before them; of some shots none."""
        count = output_frames(extent.control_frames, extent.control_rate, self.rate)
        spans = [shot.span.resolve(_MOST_FRAMES, self.rate) for shot in self.shots]
        return [(min(start, count), min(stop, count)) for start, stop in spans]

    def shots_of(self, extent: Extent) -> tuple[Shot, ...]:
        """Return its shots of frames that a take has, as numbers of frames."""
        spans = zip(self.shots, self._spans(extent), strict=True)
        return tuple(
            shot.model_copy(update={"from": start, "to": stop}) for shot, (start, stop) in spans if start < stop
        )

    def findings_for(self, extent: Extent) -> Iterator[Finding]:
        """Yield a finding for each shot of frames that a take does not have."""
        count = output_frames(extent.control_frames, extent.control_rate, self.rate)
        for i, shot in enumerate(self.shots):
            try:
                shot.span.resolve(count, self.rate)
            except TakeError as error:
                yield Finding(("shots", i), str(error))

    def files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the names of the pictures, the video and the contact sheet."""
        if self.png:
            yield Series("frames", range(*self.frames_of(extent)), "png")
        yield from ["video.mp4"] * self.mp4 + ["contact_sheet.png"] * bool(self.contact_sheet)

    def cost(self, extent: Extent) -> tuple[float, float]:
        """Return about how much room its files take [bytes], and how long one core draws them [s]."""
        moving = self.frame_count(extent) if self.mp4 or self.png else 0
        pixels, still = self.size[0] * self.size[1], self.contact_sheet or 0
        size = pixels * (moving * (_PNG_BYTES * self.png + _VIDEO_BYTES * self.mp4) + _PNG_BYTES * (still > 0))
        each = _PICTURE_SECONDS + _FIGURE_SECONDS * extent.avatars + _PIXEL_SECONDS * pixels
        return size, (moving + still) * each * max(self.motion_blur, 1)

    def prepare(self) -> None:
        """Refuse a video where there is no ffmpeg.

        Raises:
            OutputError: So it is.
        """
        if self.mp4:
            from crowdsim.render.video import ffmpeg

            ffmpeg()

    def write(self, done: FinishedTake) -> list[Path]:
        """Draw the pictures that are missing."""
        from crowdsim.render.batch import picture_files, render
        from crowdsim.render.command import scenario_options
        from crowdsim.render.take_source import TakeSource

        frames = self.frames_of(done.extent)
        if frames[0] == frames[1]:
            return []
        options = replace(scenario_options(self, done.threads), frames=frames, shots=self.shots_of(done.extent))
        files = picture_files(done.folder, frames, self.mp4, self.png, self.contact_sheet or 0)
        there = {path.name for path in files if path.exists()}
        if not all(path.exists() for path in files):
            sheet = 0 if "contact_sheet.png" in there else options.contact_sheet
            options = replace(options, mp4=self.mp4 and "video.mp4" not in there, contact_sheet=sheet)
            source = TakeSource(
                done.take, done.policies, self.rate, threads=done.threads, arena=done.arena, obstacles=done.obstacles
            )
            render(source, done.folder, options, done.progress)
        return files

    def command(self, run: str) -> list[str]:
        """Return the words of the command that draws them from a finished run; none if it cannot name the cameras."""
        if self.shots or not isinstance(self.camera, str):
            return []
        words = [
            "crowdsim",
            "render",
            run,
            "--size",
            f"{self.size[0]}x{self.size[1]}",
            "--fps",
            rate_text(self.rate),
        ]
        words += ["--png"] * self.png + ["--mp4"] * self.mp4
        words += ["--contact-sheet", str(self.contact_sheet)] if self.contact_sheet else []
        words += ["--camera", self.camera]
        for name in ("marks", "background", "light", "figure"):
            words += (
                [f"--{name}", getattr(self, name)]
                if getattr(self, name) != type(self).model_fields[name].default
                else []
            )
        words += ["--motion-blur", str(self.motion_blur)] if self.motion_blur else []
        words += ["--no-grid"] * (not self.grid) + ["--transparent"] * self.transparent
        words += ["--no-caption"] * (not self.caption) + ["--threads", "1"]
        frames = self.asked_frames()
        return words if frames is None else [*words, "--frames", f"{frames[0]}:{frames[1]}"]


OUTPUT = RenderOutput
