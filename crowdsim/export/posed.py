"""Outputs that are written from poses: what they have in common, and how those of a take are written together."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from crowdsim.config.files import Finding
from crowdsim.config.findings import show
from crowdsim.core.types import Array, Progress
from crowdsim.errors import OutputError
from crowdsim.export.stream import Sink, stream_poses
from crowdsim.files import exists_plain, make_inside, write_plain
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.heals import Heal
from crowdsim.scenario.output import Avatars, Extent, Output, Ranged, Series
from crowdsim.scenario.rates import rate_text

if TYPE_CHECKING:
    from crowdsim.crowd.record import TakeData
    from crowdsim.policy.policy import Policy
    from crowdsim.poses.sampler import PoseSampler
    from crowdsim.take.take import Take

AVATARS = "avatars.csv"
"""Name of the list of avatars."""
POSE_SECONDS = 25e-6
"""About how long one core takes to pose an avatar at a time and to write that [s]."""


@dataclass(frozen=True)
class FinishedTake:
    """A take that is finished, and where its outputs go.

    Attributes:
        take: The take.
        policies: Its policies.
        folder: The folder of its outputs.
        threads: Threads.
        progress: Called with stage, done and total.
        arena: The arena of its scenario (``crowd.cast.pack_arena``). Shape (5,).
        timings: What control cost where that was measured. Shape (frames, 6), int64 [ns].
        obstacles: Parts of its scenario's obstacles, whose doors open by seconds. Shape (n,), ``PART``.
        cameras: Cameras of its scenario by name.
        health: Health at the start of avatars that can be hurt, by the names of their types [points].
        heals: When its scenario restores health.
        scenario: The resolved scenario, as text.
    """

    take: Take
    policies: Sequence[Policy]
    folder: Path
    threads: int = 1
    progress: Progress | None = None
    arena: Array | None = None
    timings: Array | None = None
    obstacles: Array | None = None
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    health: Mapping[str, float] = field(default_factory=dict)
    heals: Sequence[Heal] = ()
    scenario: str = ""

    @property
    def extent(self) -> Extent:
        """How much there is of the take."""
        return extent_of(self.take)


def extent_of(take: TakeData) -> Extent:
    """Return how much there is of a take."""
    return Extent(take.avatar_count, take.frame_count, take.control_rate)


class PosedOutput(Ranged):
    """An output that is written from poses; its files lie in a folder of its name, and ``export`` has an option for it.

    A subclass names its ``posed_files`` and gives the ``sink`` that writes those that are missing. Beside them lies a
    list of its avatars, ``NAME/avatars.csv`` (``avatar_list``).
    """

    avatars: Avatars | None = Field(
        default=None,
        description="Numbers of the avatars to write, from 0, or names of avatars, groups and teams; without it all.",
    )

    @classmethod
    @abstractmethod
    def posed_pattern(cls) -> str:
        """Return the regular expression of the names of its files that are written from poses."""

    @abstractmethod
    def posed_files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the names of its files that are written from poses, as ``files`` does; there is at least one frame."""

    @abstractmethod
    def sink(self, sampler: PoseSampler, folder: Path, missing: Collection[str] | None = None) -> Sink:
        """Return what writes files from the poses of a take into the folder of its name.

        Args:
            sampler: The poses.
            folder: The folder.
            missing: Names of the files, as ``posed_files`` gives them; all when None.
        """

    def file_of(self, avatar: str) -> str:
        """Return the file in its folder that holds an avatar of a name; nothing where each file holds all avatars."""
        return ""

    @classmethod
    def pattern(cls) -> str:
        """Return the regular expression of the names of its files."""
        return rf"{cls.name}/avatars\.csv|{cls.posed_pattern()}"

    def files(self, extent: Extent, names: Sequence[str]) -> Iterator[str | Series]:
        """Yield the names of its files, the list of its avatars last."""
        if self.frame_count(extent):
            yield from self.posed_files(extent, names)
            yield f"{self.name}/{AVATARS}"

    def chosen(self, count: int) -> Sequence[int]:
        """Return the numbers of its avatars, ascending, of ``count`` that there are."""
        return range(count) if self.avatars is None else self.numbers or ()

    @property
    def numbers(self) -> list[int] | None:
        """Numbers of its avatars, ascending, once names among them are numbers; None for all."""
        return None if self.avatars is None else sorted({int(avatar) for avatar in self.avatars})

    def named(self, members: Callable[[str], Sequence[int] | None], cameras: Mapping[str, Camera]) -> PosedOutput:
        """Return it with the numbers of its avatars."""
        if self.avatars is None or all(isinstance(avatar, int) for avatar in self.avatars):
            return self
        numbers = [[avatar] if isinstance(avatar, int) else members(avatar) or () for avatar in self.avatars]
        return self.model_copy(update={"avatars": tuple(sorted({one for found in numbers for one in found}))})

    def of_take(self, names: Sequence[str], cameras: Mapping[str, Camera]) -> PosedOutput:
        """Return it with the keys of its camera, for a finished take.

        Args:
            names: Names of the avatars.
            cameras: Cameras of the scenario by name.

        Raises:
            CrowdsimError: There is no such camera or avatar.
        """
        return self.named(lambda name: None, cameras)

    def findings(self, avatars: int) -> Iterator[Finding]:
        """Yield a finding for each avatar that there is not."""
        for i, avatar in enumerate(self.avatars or ()):
            if isinstance(avatar, int) and avatar >= avatars:
                yield Finding(("avatars", i), f"{show(avatar)}, expected an avatar from 0 to {avatars - 1}")

    def within(self, extent: Extent) -> PosedOutput:
        """Return it with the frames that a take has of those that it asks for."""
        return self.model_copy(update={"frames": self.frames_of(extent)})

    def command(self, run: str) -> list[str]:
        """Return the words of the command that writes it from a finished run."""
        words = ["crowdsim", "export", run, f"--{self.name}", "--threads", "1"]
        for key, value in self:
            if isinstance(value, bool):
                words += [f"--{'' if value else 'no-'}{key.replace('_', '-')}"]
            elif value is not None:
                words += [f"--{key.replace('_', '-')}", _option_text(key, value)]
        return words


def _option_text(key: str, value: Any) -> str:
    if isinstance(value, tuple):
        return (":" if key == "frames" else ",").join(map(str, value))
    return rate_text(value) if isinstance(value, float) else str(value)


def file_names(output: Output, extent: Extent, names: Sequence[str]) -> list[str]:
    """Return the names of all files of an output, each by itself, in their order."""
    found: list[str] = []
    for one in output.files(extent, names):
        found += one.names() if isinstance(one, Series) else [one]
    return found


def write_posed(
    sampler: PoseSampler,
    folder: Path,
    outputs: Iterable[PosedOutput],
    threads: int = 1,
    progress: Progress | None = None,
) -> dict[str, list[Path]]:
    """Write what is missing of outputs into a folder; return all files of each. Those at one rate share poses.

    Args:
        sampler: Poses of the take.
        folder: The folder, in which each output has a folder of its name.
        outputs: The outputs.
        threads: Threads that write.
        progress: Called with what is written, how many files are done and how many there are.

    Raises:
        OutputError: A file cannot be written.
        RunError: A library that an output needs cannot be loaded.
    """
    from crowdsim.export.avatar_list import avatar_list

    extent, names = extent_of(sampler.take), sampler.take.cast.names.tolist()
    planned: dict[str, list[str]] = {}
    rates: dict[float, list[Sink]] = {}
    lists: dict[str, PosedOutput] = {}
    for output in outputs:
        place = make_inside(folder, output.name)
        planned[output.name] = file_names(output, extent, names)
        missing = {name for name in planned[output.name] if not exists_plain(folder, name)}
        listed = f"{output.name}/{AVATARS}"
        if planned[output.name].count(listed) > 1:
            raise OutputError(f"{folder / listed}: is the list of avatars, and an avatar has a file of this name")
        if listed in missing:
            missing.remove(listed)
            lists[listed] = output
        if missing:
            rates.setdefault(output.rate, []).append(output.sink(sampler, place, missing))
    for fps, sinks in rates.items():
        stream_poses(sampler, fps, sinks, threads, progress)
    for listed, output in lists.items():
        avatars, frames = output.chosen(len(names)), output.frames_of(extent)
        write_plain(folder, listed, avatar_list(sampler, avatars, frames, output.rate, output.file_of))
    # Avatars that never came have no file.
    return {kind: [folder / name for name in found if exists_plain(folder, name)] for kind, found in planned.items()}
