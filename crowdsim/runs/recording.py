"""A simulation written into a take as it goes, with a clock on every stage and an ear for signals."""

from __future__ import annotations

import shutil
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.runs.folder import TAKE
from crowdsim.runs.manifest import available_memory
from crowdsim.runs.preparation import Prepared
from crowdsim.scenario.scenario import Scenario
from crowdsim.take.take import Take

if TYPE_CHECKING:
    from crowdsim.compilation import Compilation
    from crowdsim.crowd.statistics import CrowdStatistics


_TAKE_CHUNK_AVATAR_FRAMES = 4_000_000
_STEP_AVATAR_FRAMES = 200_000

CHOICES = "run --force starts over, --out names another folder"
"""What can be done about a run that was interrupted."""

LARGE = 20_000
"""Crowds of so many avatars are told beforehand what they need."""

_BASE_BYTES, _AVATAR_BYTES, _FRAME_BYTES, _DISK_BYTES = 400e6, 1200.0, 6.0, 20.0
"""Memory of a run: of the program and a policy, an avatar, an avatar-frame's strikes; and what a take holds of it on
disk at most. Measured with the shipped crowds, rounded up."""


class Interrupted(Exception):
    """A run was asked to stop; what it had done is kept and marked.

    Attributes:
        number: Number of the signal.
        folder: The run folder.
    """

    def __init__(self, number: int, folder: Path, kept: str) -> None:
        super().__init__(f"{folder}: interrupted; {kept}")
        self.number, self.folder = number, folder


@dataclass
class Report:
    """What a run did, for its summary and manifest.

    Attributes:
        folder: The run folder.
        seconds: Time of each stage [s].
        notes: What a user should know.
        done_before: Whether the run was finished already and has not been done again.
        compiled: Kernels that had to be compiled; their time is the stage ``compile``, with that of loading others.
        statistics: The run in numbers.
        outputs: Files of each kind, and their size together [bytes].
    """

    folder: Path
    seconds: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    done_before: bool = False
    compiled: int = 0
    statistics: CrowdStatistics | None = None
    outputs: dict[str, tuple[Path, int, int]] = field(default_factory=dict)


class Clock:
    """Adds the time since the last lap to stages; what kernels took to compile or to load is a stage of its own.

    Args:
        seconds: Where the time of each stage is added [s].
        compilation: What is compiled meanwhile.
    """

    def __init__(self, seconds: dict[str, float], compilation: Compilation | None = None) -> None:
        self._seconds = seconds
        self._compilation = compilation
        self._begun = perf_counter()
        self.start()

    def start(self) -> None:
        """Begin a lap now."""
        self._since = perf_counter()
        self._compiled = 0.0 if self._compilation is None else self._compilation.seconds

    def lap(self, stage: str) -> None:
        """Add the time since the last lap to a stage."""
        since, before = self._since, self._compiled
        self.start()
        compiling = min(self._compiled - before, self._since - since)
        self._add(stage, self._since - since - compiling)
        if self._compilation is not None:
            self._add("compile", compiling)

    def watch(self, compilation: Compilation) -> None:
        """Tell from now on what is compiled from what is done."""
        self._compilation = compilation
        self._compiled = compilation.seconds

    def _add(self, stage: str, seconds: float) -> None:
        self._seconds[stage] = self._seconds.get(stage, 0.0) + seconds

    def total(self) -> float:
        """Return the time since the clock was made [s]."""
        return perf_counter() - self._begun


def needs(avatars: int, frames: int, folder: Path) -> str:
    """Return a sentence on the memory and room on disk that a run takes, and whether there is as much."""
    memory = _BASE_BYTES + avatars * (_AVATAR_BYTES + frames * _FRAME_BYTES)
    room = avatars * frames * _DISK_BYTES
    told = f"{avatars:,} avatars x {frames:,} control frames take up to {memory / 1e9:.1f} GB of memory and "
    told += f"{room / 1e9:.1f} GB on disk, without outputs"
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free
    available = available_memory()
    if available is not None and memory > available:
        told += f"; only {available / 1e9:.1f} GB of memory are free"
    if room > free:
        told += f"; only {free / 1e9:.1f} GB are free in {existing}"
    return told


@contextmanager
def stop_signals() -> Iterator[list[int]]:
    """Collect the first SIGINT or SIGTERM instead of dying of it; a second one interrupts at once."""
    caught: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield caught
        return

    def note(number: int, _: Any) -> None:
        if caught:
            raise KeyboardInterrupt
        caught.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def record(
    folder: Path,
    scenario: Scenario,
    prepared: Prepared,
    threads: int,
    report: Report,
    clock: Clock,
    caught: list[int],
    progress: Progress | None,
) -> tuple[Take, Array | None]:
    """Simulate and write the take as it comes; return it, and what control cost where that is wanted."""
    from crowdsim.crowd.simulation import Simulation
    from crowdsim.crowd.statistics import StatisticsCounter
    from crowdsim.crowd.warming import warm_up
    from crowdsim.take.store import TakeWriter, open_take

    policies, cast, frames = prepared.policies, prepared.cast, prepared.frames
    profiled = scenario.outputs.profile is not None
    search = scenario.opponents.search
    model = warm_up(prepared.crowd, policies, prepared.script, search, profiled)
    clock.lap("prepare")
    count = len(cast.names)
    rows = max(1, min(scenario.outputs.take.chunk, _TAKE_CHUNK_AVATAR_FRAMES // count))
    counter = StatisticsCounter(policies, cast.policies, cast.scales, frames)
    timings: list[Array] = []
    writer = TakeWriter(
        folder / TAKE, cast, frames, prepared.rate, scenario.name, scenario.seed,
        tuple(policy.fingerprint for policy in policies), tuple(scenario.targets), rows,
        scenario.reactions,
    )  # fmt: skip
    clock.lap("take")
    simulation = Simulation(prepared.crowd, policies, prepared.script, threads, search, profiled=profiled, model=model)
    clock.lap("prepare")
    try:
        step = max(1, min(rows, _STEP_AVATAR_FRAMES // count))
        while simulation.frame < frames:
            chunk = simulation.run(min(step, frames - simulation.frame))
            clock.lap("control")
            writer.append(chunk.variables(), chunk.events, chunk.targets)
            clock.lap("take")
            counter.add(chunk)
            if chunk.timings is not None:
                timings.append(chunk.timings)
            clock.lap("statistics")
            done = chunk.first + chunk.frames
            if progress is not None:
                progress("control", done, frames)
            if caught and done < frames:
                writer.close("interrupted")
                kept = f"the {done} of {frames} control frames that were done are kept, {CHOICES}"
                raise Interrupted(caught[0], folder, kept)
            clock.start()
        writer.close()
    except BaseException:
        writer.abandon()
        raise
    finally:
        simulation.close()
    take = open_take(folder / TAKE)
    size = sum(path.stat().st_size for path in (folder / TAKE).rglob("*") if path.is_file())
    report.outputs["take"] = (folder / TAKE, 1, size)
    report.statistics = counter.finish()
    clock.lap("take")
    return take, np.concatenate(timings) if timings else None
