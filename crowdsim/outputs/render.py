"""Pictures and video of a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from crowdsim.config.files import Fault, Finding, StrictModel
from crowdsim.config.findings import show
from crowdsim.scenario.output import Extent, Ranged, Series
from crowdsim.scenario.parts import MAXIMUM_SECONDS, Metres
from crowdsim.scenario.rates import PictureRate

if TYPE_CHECKING:
    from crowdsim.export.posed import FinishedTake

# Bytes of a pixel of a PNG and of a frame of video; seconds that one core takes for a picture: for itself, an avatar
# and a pixel. Measured with the shipped scenarios, rounded up.
_PNG_BYTES, _VIDEO_BYTES = 1.0, 0.1
_PICTURE_SECONDS, _FIGURE_SECONDS, _PIXEL_SECONDS = 0.02, 4e-4, 8e-8


class FollowCamera(StrictModel):
    """A camera that follows an avatar."""

    kind: Literal["follow"] = Field(description="Follows an avatar.")
    avatar: int = Field(default=0, ge=0, description="Number of the avatar, from 0.")


class CameraKey(StrictModel):
    """Where the camera is at a time."""

    seconds: float = Field(ge=0, le=MAXIMUM_SECONDS, description="Time from the start of the run [s].")
    position: tuple[Metres, Metres, Metres] = Field(description="Position of the camera, x, y and z [m].")
    look_at: tuple[Metres, Metres, Metres] = Field(description="Point in the middle of the picture, x, y and z [m].")


class KeyedCamera(StrictModel):
    """A camera that moves smoothly through keys."""

    kind: Literal["keys"] = Field(description="Moves smoothly through keys.")
    keys: tuple[CameraKey, ...] = Field(min_length=1, description="Where it is at which time, in order of time.")

    @model_validator(mode="after")
    def _check(self) -> KeyedCamera:
        for i in range(1, len(self.keys)):
            if self.keys[i].seconds <= self.keys[i - 1].seconds:
                before = self.keys[i - 1].seconds
                raise Fault(f"is {self.keys[i].seconds}, expected more than {before} before it", "keys", i, "seconds")
        return self


Camera = Literal["auto", "orbit", "top", "side"] | Annotated[FollowCamera | KeyedCamera, Field(discriminator="kind")]
Pixels = Annotated[int, Field(ge=16, le=8192)]


class RenderOutput(Ranged):
    """Pictures and video."""

    name = "render"
    about = "Pictures and video."
    label = "pictures"
    kernels = "pictures"
    stage = "render"

    fps: PictureRate = Field(default=30.0, description="Frames per second, or a fraction.")
    size: tuple[Pixels, Pixels] = Field(
        default=(1280, 720), description="Width and height [pixels]; even numbers for video."
    )
    camera: Camera = Field(
        default="auto", description="`auto`, `orbit`, `top`, `side`, one that follows, or one with keys."
    )
    mp4: bool = Field(default=True, description="Whether to write video.mp4.")
    png: bool = Field(default=False, description="Whether to write every frame as PNG.")
    contact_sheet: int | None = Field(default=None, ge=1, le=400, description="Number of moments on a contact sheet.")
    caption: bool = Field(default=True, description="Whether pictures have a small caption.")

    @model_validator(mode="after")
    def _check(self) -> RenderOutput:
        if self.mp4 and (self.size[0] % 2 or self.size[1] % 2):
            raise Fault(f"is {list(self.size)}, expected even numbers for video", "size")
        if not (self.mp4 or self.png or self.contact_sheet):
            raise Fault("writes nothing, expected mp4, png or contact_sheet")
        return self

    @classmethod
    def pattern(cls) -> str:
        """Return the regular expression of the names of its files."""
        return r"frames/\d{6,}\.png|video\.mp4|contact_sheet\.png"

    def findings(self, avatars: int) -> Iterator[Finding]:
        """Yield a finding where the camera follows an avatar that there is not."""
        if isinstance(self.camera, FollowCamera) and self.camera.avatar >= avatars:
            what = f"{show(self.camera.avatar)}, expected an avatar from 0 to {avatars - 1}"
            yield Finding(("camera", "avatar"), what)

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
        return size, (moving + still) * each

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
        options = replace(scenario_options(self, done.threads), frames=frames)
        files = picture_files(done.folder, frames, self.mp4, self.png, self.contact_sheet or 0)
        there = {path.name for path in files if path.exists()}
        if not all(path.exists() for path in files):
            sheet = 0 if "contact_sheet.png" in there else options.contact_sheet
            options = replace(options, mp4=self.mp4 and "video.mp4" not in there, contact_sheet=sheet)
            source = TakeSource(done.take, done.policies, self.rate, threads=done.threads, arena=done.arena)
            render(source, done.folder, options, done.progress)
        return files

    def command(self, run: str) -> list[str]:
        """Return the words of the command that draws them from a finished run."""
        words = [
            "crowdsim",
            "render",
            run,
            "--size",
            f"{self.size[0]}x{self.size[1]}",
            "--fps",
            str(self.fps).removesuffix(".0"),
        ]
        words += ["--png"] * self.png + ["--mp4"] * self.mp4
        words += ["--contact-sheet", str(self.contact_sheet)] if self.contact_sheet else []
        words += ["--camera", self.camera] if isinstance(self.camera, str) else []
        words += ["--no-caption"] * (not self.caption) + ["--threads", "1"]
        frames = self.asked_frames()
        return words if frames is None else [*words, "--frames", f"{frames[0]}:{frames[1]}"]


OUTPUT = RenderOutput
