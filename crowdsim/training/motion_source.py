"""The part of a recipe on motion: where it comes from and how it is prepared."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from crowdsim.capture.units import UNITS, parse_unit
from crowdsim.config.files import Fault, StrictModel
from crowdsim.errors import MotionError

MAXIMUM_SEED = 2**63 - 1


def _inside(name: str) -> str:
    inner = PurePosixPath(name.replace("\\", "/"))
    if inner.is_absolute() or ".." in inner.parts or "\0" in name:
        raise ValueError("expected a file or a pattern below the folder of capture")
    return name


def _known(unit: str | float) -> str | float:
    try:
        parse_unit(unit)
    except MotionError:
        raise ValueError(f"expected {', '.join(UNITS)} or metres as a positive number") from None
    return unit


Unit = Annotated[str | float, AfterValidator(_known)]
Choice = Literal["repair", "keep", "refuse"] | float
ClipName = Annotated[str, AfterValidator(_inside)]


class PerformerSource(StrictModel):
    """The embedded boxer performs."""

    seconds: float = Field(default=420.0, ge=5.0, le=36000.0, description="Length of the session [s].")
    seed: int = Field(default=1, ge=0, le=MAXIMUM_SEED, description="Seed of the session.")
    stance: Literal["orthodox", "southpaw"] = Field(default="orthodox", description="Which side leads.")
    falls: int = Field(
        default=0,
        ge=0,
        le=1000,
        description="How often each kind of fall, stagger and celebration is performed besides; 0: not at all, and "
        "an avatar that would be knocked down leaves the scene.",
    )
    rests: int = Field(
        default=0,
        ge=0,
        le=1000,
        description="How often each way of standing at ease, and of walking off, is performed besides; 0: not at all.",
    )
    stick: Literal["one_hand", "two_hands"] | None = Field(
        default=None,
        description="How the performer holds a stick, with which it strikes instead of boxing; null: it has none. "
        "`strikes.props` says where that is: in the right hand of an orthodox one, with the point [-0.39, 0, 0.45].",
    )


class CaptureSource(StrictModel):
    """Motion capture in BVH files."""

    clips: list[ClipName] = Field(
        min_length=1,
        max_length=10_000,
        description="Files, or patterns with * for several, below the folder of capture; FILE.bvh#2 is the second of "
        "several people in a file.",
    )
    folder: str | None = Field(
        default=None,
        description="Folder of capture, seen from the recipe's; --mocap takes precedence. Null: that of --mocap or "
        "CROWDSIM_MOCAP.",
    )
    unit: Unit | None = Field(default=None, description="Unit of the files, by name or in metres; found when null.")
    up_axis: Literal["x", "y", "z", "-x", "-y", "-z"] | None = Field(
        default=None, description="Up axis of the files, such as y or -z; found when null."
    )
    strict: bool = Field(default=True, description="Refuse files with wrong row counts or joints that flip.")
    faults: dict[str, Choice] = Field(
        default_factory=dict,
        description="What is done about kinds of faults that `crowdsim inspect` finds, instead of what is usual: "
        "`repair`, sure or not; `keep` the motion as it is; or `refuse` files. `time_base` may be frames per second.",
    )

    @field_validator("faults")
    @classmethod
    def _known_faults(cls, faults: dict[str, Choice]) -> dict[str, Choice]:
        from crowdsim.capture.loading import check_choices

        try:
            check_choices(faults)
        except MotionError as error:
            raise ValueError(str(error)) from None
        return faults


class Motion(StrictModel):
    """Where motion comes from and how it is prepared."""

    performer: PerformerSource | None = Field(default=None, description="Motion of the embedded boxer.")
    capture: CaptureSource | None = Field(default=None, description="Motion of BVH files.")
    mirror: bool = Field(default=True, description="Add the mirror image of every clip; training learns both from one.")
    trim: bool = Field(default=True, description="Cut off calibration poses at the start of a clip.")

    @model_validator(mode="after")
    def _one_source(self) -> Motion:
        if (self.performer is None) == (self.capture is None):
            raise Fault(
                "names both performer and capture, expected one"
                if self.performer
                else "names no motion, expected performer or capture"
            )
        return self
