"""Outputs of a scenario: what a run writes beside its take."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from crowdsim.config.files import Fault, StrictModel
from crowdsim.config.schema import Expected
from crowdsim.scenario.frame_ranges import first_frame_at
from crowdsim.scenario.parts import MAXIMUM_SECONDS, Metres

Fps = Annotated[float, Field(ge=1, le=1000)]
Avatars = tuple[Annotated[int, Field(ge=0)], ...]
_MOST_FRAMES = 10**12
Frames = tuple[Annotated[int, Field(ge=0, le=_MOST_FRAMES)], Annotated[int, Field(ge=1, le=_MOST_FRAMES)]]
_FPS = "Frames per second; without it the scenario's `fps`."
_AVATARS = "Numbers of the avatars to write, from 0; without it all."
_FRAMES = (
    "Output frames to write, the first and the one after the last; or as a mapping in `seconds`, or as text such as "
    "`0:120` or `2s:5s`; without it all."
)
_CHUNK = (
    "Control frames in a chunk of the take, at most as many as are 4 million avatar-frames; without it as many as are "
    "about 1 MiB of each variable."
)
_RANGE = re.compile(r"\s*(\d+)\s*:\s*(\d+)\s*|\s*(\d+(?:\.\d+)?)\s*s\s*:\s*(\d+(?:\.\d+)?)\s*s\s*")


class SecondsRange(StrictModel):
    """A stretch of time."""

    seconds: Annotated[
        tuple[Annotated[float, Field(ge=0, le=MAXIMUM_SECONDS)], Annotated[float, Field(gt=0, le=MAXIMUM_SECONDS)]],
        Expected("a list of two numbers [s]"),
    ] = Field(description="Begin and end [s].")


def _read_range(value: Any) -> Any:
    """Return text such as ``0:120`` or ``2s:5s`` as plain data; anything else as it is, but lists as tuples."""
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(end, str) for end in value):
        value = ":".join(value)
    match = _RANGE.fullmatch(value) if isinstance(value, str) else None
    if match is not None and match[1] is not None:
        return int(match[1]), int(match[2])
    if match is not None:
        return {"seconds": (float(match[3]), float(match[4]))}
    if isinstance(value, dict):
        return {key: tuple(inner) if isinstance(inner, list) else inner for key, inner in value.items()}
    return tuple(value) if isinstance(value, list) else value


def _allow_range_text(schema: dict[str, Any]) -> None:
    text = {"type": "string", "pattern": f"^({_RANGE.pattern})$", "examples": ["0:120", "2s:5s"]}
    schema["anyOf"].insert(2, text)


class _Ranged(StrictModel):
    """An output that can be cut to some frames."""

    frames: Annotated[
        Annotated[Frames, Expected("a list of two whole numbers")] | SecondsRange | None,
        BeforeValidator(_read_range),
    ] = Field(default=None, description=_FRAMES, json_schema_extra=_allow_range_text)

    @model_validator(mode="after")
    def _check_frames(self) -> _Ranged:
        frames = self.frames.seconds if isinstance(self.frames, SecondsRange) else self.frames
        if frames is not None and frames[0] >= frames[1]:
            raise Fault(f"is {list(frames)}, expected the first frame before the last", "frames")
        return self

    def frames_at(self, fps: float) -> tuple[int, int] | None:
        """Return the first frame and the one after the last at a rate, given in frames or seconds."""
        if not isinstance(self.frames, SecondsRange):
            return self.frames
        start, stop = (first_frame_at(second, fps) for second in self.frames.seconds)
        return start, max(stop, start + 1)


class TakeOutput(StrictModel):
    """The take, which every run writes."""

    chunk: int | None = Field(default=None, ge=1, le=65536, description=_CHUNK)


class BvhOutput(_Ranged):
    """One BVH file per avatar."""

    fps: Fps | None = Field(default=None, description=_FPS)
    avatars: Avatars | None = Field(default=None, description=_AVATARS)


class CloudOutput(_Ranged):
    """Point clouds, one file per frame."""

    fps: Fps | None = Field(default=None, description=_FPS)
    every: int = Field(default=1, ge=1, le=1_000_000, description="Write every n-th output frame.")
    points: int = Field(default=500, ge=1, le=100_000, description="Points per avatar.")
    avatars: Avatars | None = Field(default=None, description=_AVATARS)


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


class RenderOutput(_Ranged):
    """Pictures and video."""

    fps: Annotated[float, Field(ge=1, le=240)] = Field(default=30.0, description="Frames per second.")
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


class ProfileOutput(StrictModel):
    """What control cost."""

    csv: bool = Field(default=True, description="Whether to write profile.csv, one row per control frame.")
    plots: bool = Field(default=False, description="Whether to draw profile.png.")


class Outputs(StrictModel):
    """What a run writes; an output that is not named is not written, but the take always is."""

    take: TakeOutput = Field(default_factory=TakeOutput, description="The take, which every run writes.")
    bvh: BvhOutput | None = Field(default=None, description="Motion as BVH, one file per avatar.")
    ply: CloudOutput | None = Field(default=None, description="Point clouds as PLY, one file per frame.")
    pcd: CloudOutput | None = Field(default=None, description="Point clouds as PCD, one file per frame.")
    render: RenderOutput | None = Field(default=None, description="Pictures and video.")
    profile: ProfileOutput | None = Field(default=None, description="What control cost, frame by frame.")
