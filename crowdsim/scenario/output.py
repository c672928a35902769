"""What the outputs of a scenario have in common; each one is a class in a file of ``crowdsim.outputs``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

from pydantic import BeforeValidator, Field, model_validator

from crowdsim.config.files import Fault, Finding, StrictModel
from crowdsim.config.schema import Expected
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.frame_ranges import first_frame_at, output_frames
from crowdsim.scenario.parts import MAXIMUM_SECONDS, Name
from crowdsim.scenario.rates import Rate

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

FPS = 60.0
"""Frames a second of an output where neither it nor its scenario names a rate."""
_MOST_FRAMES = 10**12
Avatars = tuple[Annotated[int, Field(ge=0)] | Name, ...]
Frames = tuple[Annotated[int, Field(ge=0, le=_MOST_FRAMES)], Annotated[int, Field(ge=1, le=_MOST_FRAMES)]]
_FRAMES = (
    "Output frames to write, the first and the one after the last; or as a mapping in `seconds`, or as text such as "
    "`0:120` or `2s:5s`; without it all."
)
_RANGE = re.compile(r"\s*(\d+)\s*(?::|\.\.)\s*(\d+)\s*|\s*(\d+(?:\.\d+)?)\s*s\s*(?::|\.\.)\s*(\d+(?:\.\d+)?)\s*s\s*")


class Extent(NamedTuple):
    """How much there is of a take.

    Attributes:
        avatars: Number of avatars.
        control_frames: Number of control frames.
        control_rate: Control frames a second.
        obstacle_area: Surface of the obstacles of its scenario [m2].
    """

    avatars: int
    control_frames: int
    control_rate: float
    obstacle_area: float = 0.0


class Series(NamedTuple):
    """Files whose names are numbers of six digits or more: ``ply/000060.ply``.

    Attributes:
        folder: Their folder.
        numbers: Their numbers.
        suffix: What their names end with.
    """

    folder: str
    numbers: range
    suffix: str

    def names(self) -> list[str]:
        """Return the names."""
        return [f"{self.folder}/{number:06d}.{self.suffix}" for number in self.numbers]


class Output(StrictModel):
    """Something that a run can write; its fields are the keys that a scenario has for it.

    Attributes:
        name: Its key in ``outputs``.
        about: What it is, in a sentence.
        label: What summaries and lists of files call its files; the name unless a class says otherwise.
        kernels: What it needs kernels for (``jit.signatures``).
        stage: What its time counts as.
        always: Whether every run writes it.
        from_take: Whether a command of its own, ``export`` or ``render``, writes it from a take that is finished; all
            others are written with the run.
        reads_policies: Whether ``findings_with`` looks at policies.
    """

    name: ClassVar[str]
    about: ClassVar[str]
    label: ClassVar[str] = ""
    kernels: ClassVar[str] = ""
    stage: ClassVar[str] = "export"
    always: ClassVar[bool] = False
    from_take: ClassVar[bool] = True
    reads_policies: ClassVar[bool] = False

    @classmethod
    def pattern(cls) -> str:
        """Return the regular expression of the names of its files."""
        return ""

    def findings(self, avatars: int) -> Iterator[Finding]:
        """Yield what is wrong with it for a number of avatars, at its own keys."""
        yield from ()

    def findings_with(self, policies: Sequence[Policy]) -> Iterator[Finding]:
        """Yield what is wrong with it for the policies of its avatars."""
        yield from ()

    def findings_for(self, extent: Extent) -> Iterator[Finding]:
        """Yield what is wrong with it for a take of a length, at its own keys."""
        yield from ()

    def place(self, finding: Finding) -> Finding:
        """Return a finding at one of its keys as one of the scenario's."""
        return replace(finding, loc=("outputs", self.name, *finding.loc))

    def resolved(self, fps: float) -> Output:
        """Return it with all that it leaves to its scenario, which has ``fps`` frames a second."""
        return self

    def named(self, members: Callable[[str], Sequence[int] | None], cameras: Mapping[str, Camera]) -> Output:
        """Return it with what names in it stand for.

        Args:
            members: Returns the numbers of the avatars that the name of an avatar, a group or a team means; None for
                other names.
            cameras: Cameras by name.
        """
        return self

    def files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the names of its files in a run folder, in their order; ``names`` are those of all avatars."""
        yield from ()

    def cost(self, extent: Extent) -> tuple[float, float]:
        """Return about how much room its files take [bytes], and how long one core writes them [s]."""
        return 0.0, 0.0

    def prepare(self) -> None:
        """Begin what it needs later, and refuse what cannot be written here at all."""

    def write(self, done: Any) -> list[Any]:
        """Write what is missing of its files, and return all of them; ``done`` is a ``FinishedTake``."""
        return []

    def command(self, run: str) -> list[str]:
        """Return the words of the command that writes it from a finished run; none where there is no such command."""
        return []


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


class Ranged(Output):
    """An output that has frames, and can be cut to some of them."""

    frames: Annotated[
        Annotated[Frames, Expected("a list of two whole numbers")] | SecondsRange | None,
        BeforeValidator(_read_range),
    ] = Field(default=None, description=_FRAMES, json_schema_extra=_allow_range_text)
    fps: Rate | None = Field(
        default=None,
        description="Frames per second, or a fraction such as `24000/1001`; without it the scenario's `fps`.",
    )

    @model_validator(mode="after")
    def _check_frames(self) -> Ranged:
        frames = self.frames.seconds if isinstance(self.frames, SecondsRange) else self.frames
        if frames is not None and frames[0] >= frames[1]:
            raise Fault(f"is {list(frames)}, expected the first frame before the last", "frames")
        return self

    @property
    def rate(self) -> float:
        """Frames a second."""
        return self.fps or FPS

    def resolved(self, fps: float) -> Ranged:
        """Return it with its rate, and its frames as numbers."""
        given = self.model_copy(update={"fps": self.fps or fps})
        return given.model_copy(update={"frames": given.asked_frames()})

    def asked_frames(self) -> tuple[int, int] | None:
        """Return the first frame and the one after the last that are asked for; None for all."""
        if not isinstance(self.frames, SecondsRange):
            return self.frames
        start, stop = (first_frame_at(second, self.rate) for second in self.frames.seconds)
        return start, max(stop, start + 1)

    def frames_of(self, extent: Extent) -> tuple[int, int]:
        """Return the first frame and the one after the last of those that a take has; the same twice for none."""
        count = output_frames(extent.control_frames, extent.control_rate, self.rate)
        first, stop = self.asked_frames() or (0, count)
        return min(first, count), min(stop, count)

    def frame_count(self, extent: Extent) -> int:
        """Return the number of these frames."""
        first, stop = self.frames_of(extent)
        return stop - first
