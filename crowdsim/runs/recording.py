"""The loop of a run: a crowd is simulated, and its control frames go to a sink as they come."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.chunk import Chunk
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.ending import describe_outcome
from crowdsim.crowd.jit_warmup import warm_up
from crowdsim.crowd.simulation import Simulation
from crowdsim.errors import RunError, TakeError
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import Checkpoint
from crowdsim.runs.run import Run
from crowdsim.take.layout import chunk_frames
from crowdsim.take.take import Events

if TYPE_CHECKING:
    from crowdsim.crowd.statistics import StatisticsCounter

_STEP_AVATAR_FRAMES = 50_000
"""Avatar-frames that are simulated at a stretch, about 50 ms."""


class Sink(Protocol):
    """Where the frames of a run go: memory (``take.memory.TakeCollector``) or a file (``take.store.TakeWriter``)."""

    def append(self, chunk: dict[str, Array], events: Events, targets: Array | None = None) -> None:
        """Add control frames: an array (n, N) for each of ``VARIABLES``, strikes, and positions of targets."""

    def close(self, status: str = "done") -> None:
        """Finish the take; ``status`` is ``done`` or ``interrupted``."""

    def abandon(self) -> None:
        """Remove what has been written."""


class Keeper(Protocol):
    """Keeps checkpoints of a run (``resuming.CheckpointKeeper``)."""

    begun: Checkpoint | None
    """Where the run begins; None for its first frame."""

    def keep(self, simulation: Simulation, timings: Sequence[Array], required: bool) -> None:
        """Write a checkpoint where it is time for one, or it is required."""


def record(
    run: Run,
    crowd: Crowd,
    sink: Sink,
    counter: StatisticsCounter | None = None,
    keeper: Keeper | None = None,
) -> Array | None:
    """Simulate a run, and hand its control frames to a sink and a counter as they come.

    Args:
        run: The run.
        crowd: Its crowd.
        sink: Where the frames go.
        counter: Counts them.
        keeper: Keeps checkpoints, and knows the one that the run goes on from.

    Returns:
        The time of each stage of control where a profile is wanted. Shape (frames, 6), int64 [ns].

    Raises:
        Interrupted: A signal has come; the sink holds the frames that were done.
    """
    profiled, search = run.scenario.outputs.profile is not None, run.scenario.opponents.search
    timings: list[Array] = []
    try:
        model = warm_up(crowd, search, profiled)
        with Simulation(crowd, run.threads, search, run.order, profiled, model) as simulation:
            if keeper is not None and keeper.begun is not None:
                _restore(simulation, keeper.begun, run.work)
                timings += [] if keeper.begun.timings is None else [keeper.begun.timings]
            run.clock.lap("prepare")
            _record_chunks(run, simulation, timings, sink, counter, keeper)
            if arrivals := simulation.arrivals_text():
                run.tell(arrivals)
            if simulation.outcome is not None:
                run.report.outcome = describe_outcome(run.scenario, simulation.outcome)
        sink.close()
    except RunError:
        # It would fail again.
        sink.abandon()
        raise
    return np.concatenate(timings) if timings else None


def _record_chunks(
    run: Run,
    simulation: Simulation,
    timings: list[Array],
    sink: Sink,
    counter: StatisticsCounter | None,
    keeper: Keeper | None,
) -> None:
    """Simulate a run to its end; what control costs is added to ``timings``.

    Raises:
        Interrupted: A signal has come.
    """
    frames = simulation.crowd.frames
    for chunk in _chunks(run, simulation):
        sink.append(chunk.variables(), chunk.events, chunk.targets)
        run.clock.lap("take")
        if counter is not None:
            counter.add(chunk)
            run.clock.lap("statistics")
        if chunk.timings is not None:
            timings.append(chunk.timings)
        done = simulation.frame
        is_last = simulation.is_over
        is_caught = bool(run.caught) and not is_last
        if is_caught:
            run.stop_waiting()
        if keeper is not None:
            keeper.keep(simulation, timings, is_caught or is_last)
            run.clock.lap("checkpoints")
        run.advance("control", done, done if is_last else frames)
        if is_caught:
            sink.close("interrupted")
            run.interrupt(f"the {done} of {frames} control frames that were done are kept")


def _restore(simulation: Simulation, begun: Checkpoint, folder: Path) -> None:
    """Let a simulation go on from a checkpoint.

    Raises:
        TakeError: The checkpoint is of another run, or holds what no run can have.
    """
    try:
        if int(begun.simulation["frame"]) != begun.frame:
            raise ValueError(f"it is of control frame {begun.frame}, and of {begun.simulation['frame']}")
        simulation.restore(begun.simulation)
    except (KeyError, TypeError, ValueError) as error:
        raise TakeError(f"{folder / CHECKPOINT}: cannot be continued: {error}; remove it to start over") from None


def _chunks(run: Run, simulation: Simulation) -> Iterator[Chunk]:
    """Yield the control frames of a run as they come."""
    avatars = simulation.crowd.count
    size, step = chunk_frames(avatars, run.scenario.outputs.take.chunk), max(1, _STEP_AVATAR_FRAMES // avatars)
    while not simulation.is_over:
        run.clock.start()
        # No further than to the end of a chunk of the take, where a checkpoint is small.
        until = size - simulation.frame % size
        chunk = simulation.run(min(step, until))
        run.clock.lap("control")
        yield chunk
