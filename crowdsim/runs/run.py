"""A run in progress: what is asked for, what it costs, and its report."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from crowdsim.core.types import FileName, Progress
from crowdsim.runs.manifest import RUN as STAGE
from crowdsim.scenario.scenario import Scenario

if TYPE_CHECKING:
    from crowdsim.compilation import Compilation
    from crowdsim.crowd.statistics import CrowdStatistics

PATIENCE = 1.0
"""How long a run may go on after a signal to come to the end of a frame [s]."""
CHOICES = "the same command goes on from there"
"""What can be done about a run that was interrupted."""


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
        notes: What a user should know; of a run that was not done before, ``Run.notify`` has been called with it.
        done_before: Whether the run was finished already and has not been done again.
        continued_at: Control frames that were done before, where a run goes on that was interrupted.
        compiled: Kernels that had to be compiled; their time is the stage ``compile``, with that of loading others.
        statistics: The run in numbers.
        outcome: How it ended, where its scenario has an end and that came (``ending.describe_outcome``).
        outputs: Files of each kind, and their size together [bytes].
    """

    folder: Path
    seconds: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    done_before: bool = False
    continued_at: int = 0
    compiled: int = 0
    statistics: CrowdStatistics | None = None
    outcome: dict[str, Any] | None = None
    outputs: dict[str, tuple[Path, int, int]] = field(default_factory=dict)


class Clock:
    """Adds the time since the last lap to stages; what kernels took to compile or to load is a stage of its own.

    Args:
        seconds: Where the time of each stage is added [s].
    """

    def __init__(self, seconds: dict[str, float]) -> None:
        self._seconds, self._begun, self._since = seconds, perf_counter(), perf_counter()
        self._compilation: Compilation | None = None
        self._compiled = 0.0

    def watch(self, compilation: Compilation) -> None:
        """Count from now on what is compiled as a stage of its own."""
        self._compilation, self._compiled = compilation, compilation.seconds

    def start(self) -> None:
        """Begin a lap now."""
        self._since = perf_counter()
        self._compiled = 0.0 if self._compilation is None else self._compilation.seconds

    def lap(self, stage: str) -> None:
        """Add the time since the last lap to a stage."""
        since, before = self._since, self._compiled
        self.start()
        compiling = min(self._compiled - before, self._since - since)
        times = {stage: self._since - since - compiling}
        for name, seconds in (times if self._compilation is None else {**times, "compile": compiling}).items():
            self._seconds[name] = self._seconds.get(name, 0.0) + seconds

    def total(self) -> float:
        """Return the time since the clock was made [s]."""
        return perf_counter() - self._begun


@dataclass
class Run:
    """One run: what is asked for, what it costs, and what has come of it.

    Attributes:
        scenario: The scenario, resolved.
        threads: Threads; results do not depend on them.
        mocap: Folder of capture for policies that are trained from it.
        progress: Called with stage, done and total.
        notify: Called with what a user should know beforehand.
        folder: The run folder; a run in memory has none.
        force: Whether what an earlier run has left in the folder may be removed.
        command: The command, for the manifest.
        more: What a finished run is extended by, see ``runner.run_to``.
        device: Where control runs, ``cpu`` or ``cuda``.
        policy_folders: Where its policies were found, by name.
        caught: The signal that asks the run to stop, once it has come.
        report: What has been done.
        clock: Measures the stages of the report.
    """

    scenario: Scenario
    threads: int = 1
    mocap: FileName | None = None
    progress: Progress | None = None
    notify: Callable[[str], None] | None = None
    folder: Path = Path()
    force: bool = False
    command: str = ""
    more: tuple[float, bool] | None = None
    device: str = "cpu"
    policy_folders: dict[str, str] = field(default_factory=dict)
    caught: list[int] = field(default_factory=list)
    report: Report = field(init=False)
    clock: Clock = field(init=False)

    def __post_init__(self) -> None:
        """Start the clock."""
        self.report = Report(self.folder)
        self.clock = Clock(self.report.seconds)

    @property
    def work(self) -> Path:
        """Folder in the run's in which everything is written until it is whole."""
        return self.folder / STAGE

    def tell(self, text: str) -> None:
        """Report what a user should know, now and in the report."""
        self.report.notes.append(text)
        if self.notify is not None:
            self.notify(text)

    def advance(self, stage: str, done: int, total: int) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(stage, done, total)

    def advance_outputs(self, stage: str, done: int, total: int) -> None:
        """Report progress of what is written once the take is finished.

        Raises:
            Interrupted: A signal has come.
        """
        if self.caught:
            self.interrupt("the take is finished, outputs are missing")
        self.advance(stage, done, total)

    @contextmanager
    def catch_signals(self) -> Iterator[None]:
        """Note the first SIGINT or SIGTERM, so that the run stops at the next frame; after a second stop it anyway."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def note(number: int, _: Any) -> None:
            if self.caught:
                raise KeyboardInterrupt
            self.caught.append(number)
            if hasattr(signal, "setitimer"):
                signal.setitimer(signal.ITIMER_REAL, PATIENCE)

        def stop(number: int, _: Any) -> None:
            self.interrupt("what was finished is kept")

        handlers = {signal.SIGINT: note, signal.SIGTERM: note}
        if hasattr(signal, "SIGALRM"):
            handlers[signal.SIGALRM] = stop
        before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
        try:
            yield
        finally:
            self.stop_waiting()
            for number, handler in before.items():
                signal.signal(number, handler)

    def stop_waiting(self) -> None:
        """Let what goes on now come to its end after a signal, since it is the end."""
        if hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread():
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def interrupt(self, kept: str) -> None:
        """Stop the run because of a signal that has come; ``kept`` says what is kept.

        Raises:
            Interrupted: Always.
        """
        raise Interrupted(self.caught[0], self.folder, f"{kept}; {CHOICES}")
