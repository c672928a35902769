"""The loop of a run: a crowd is simulated, and its control frames go to a sink as they come, with checkpoints.

A take in a run folder is begun there, or continued from a checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Protocol

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.ending import describe_outcome
from crowdsim.crowd.jit_warmup import warm_up
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.statistics import StatisticsCounter
from crowdsim.errors import TakeError
from crowdsim.poses.known_actions import action_counts
from crowdsim.preparation.prepare import take_header
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import Checkpoint, Pace, write_checkpoint
from crowdsim.runs.run import Run
from crowdsim.runs.stage import TAKE
from crowdsim.take.layout import chunk_frames
from crowdsim.take.resume import written_frames, written_strikes
from crowdsim.take.store import TakeWriter, open_take
from crowdsim.take.take import Events, Take

_STEP_AVATAR_FRAMES = 50_000
"""Avatar-frames that are simulated at a stretch, about 50 ms."""


class Sink(Protocol):
    """Where the frames of a run go: memory (``take.memory.TakeCollector``) or a file (``take.store.TakeWriter``)."""

    def append(self, chunk: dict[str, Array], events: Events, targets: Array | None = None) -> None:
        """Add control frames: an array (n, N) for each of ``VARIABLES``, strikes, and positions of targets."""

    def close(self, status: str = "done") -> None:
        """Finish the take; ``status`` is ``done`` or ``interrupted``."""


def record(
    run: Run,
    crowd: Crowd,
    sink: Sink,
    counter: StatisticsCounter | None = None,
    begun: Checkpoint | None = None,
    keep: Callable[[Simulation, Sequence[Array], bool], None] | None = None,
) -> Array | None:
    """Simulate a run, and hand its control frames to a sink and a counter as they come.

    Args:
        run: The run.
        crowd: Its crowd.
        sink: Where the frames go.
        counter: Counts them.
        begun: The checkpoint that the run goes on from.
        keep: Called after each step with the simulation and the time of each stage so far, to write a checkpoint, and
            whether there must be one.

    Returns:
        The time of each stage of control where a profile is wanted. Shape (frames, 6), int64 [ns].

    Raises:
        Interrupted: A signal has come; the sink holds the frames that were done.
    """
    profiled, search = run.scenario.outputs.profile is not None, run.scenario.opponents.search
    avatars, frames = crowd.count, crowd.frames
    size, step = chunk_frames(avatars, run.scenario.outputs.take.chunk), max(1, _STEP_AVATAR_FRAMES // avatars)
    timings: list[Array] = []
    model = warm_up(crowd, search, profiled, run.device, run.advance)
    with Simulation(crowd, run.threads, search, profiled=profiled, model=model, device=run.device) as simulation:
        if begun is not None:
            _restore(simulation, begun, run.work)
            timings += [] if begun.timings is None else [begun.timings]
        run.clock.lap("prepare")
        while not simulation.is_over:
            run.clock.start()
            # No further than to the end of a chunk of the take, where a checkpoint is small.
            chunk = simulation.run(min(step, size - simulation.frame % size))
            run.clock.lap("control")
            sink.append(chunk.variables(), chunk.events, chunk.targets)
            run.clock.lap("take")
            if counter is not None:
                counter.add(chunk)
                run.clock.lap("statistics")
            if chunk.timings is not None:
                timings.append(chunk.timings)
            done, is_last = simulation.frame, simulation.is_over
            is_caught = bool(run.caught) and not is_last
            if is_caught:
                run.stop_waiting()
            if keep is not None:
                keep(simulation, timings, is_caught or is_last)
                run.clock.lap("checkpoints")
            run.advance("control", done, done if is_last else frames)
            if is_caught:
                sink.close("interrupted")
                run.interrupt(f"the {done} of {frames} control frames that were done are kept")
        if arrivals := simulation.arrivals_text():
            run.tell(arrivals)
        if simulation.outcome is not None:
            run.report.outcome = describe_outcome(run.scenario, simulation.outcome)
    sink.close()
    return np.concatenate(timings) if timings else None


def _restore(simulation: Simulation, begun: Checkpoint, folder: Path) -> None:
    """Let a simulation go on from a checkpoint, unless it is of another run, or holds what no run can have."""
    try:
        if int(begun.simulation["frame"]) != begun.frame:
            raise ValueError(f"it is of control frame {begun.frame}, and of {begun.simulation['frame']}")
        simulation.restore(begun.simulation)
    except (KeyError, TypeError, ValueError) as error:
        raise TakeError(f"{folder / CHECKPOINT}: cannot be continued: {error}; remove it to start over") from None


def write_take(run: Run, crowd: Crowd, origin: str, begun: Checkpoint | None) -> tuple[Take, Array | None]:
    """Simulate a run and write its take as it comes, from its first frame or from a checkpoint on.

    Args:
        run: The run.
        crowd: Its crowd.
        origin: Checksum of what it is made from.
        begun: The checkpoint that it goes on from.

    Returns:
        The take, and what control cost where that is wanted.

    Raises:
        OutputError: It cannot be written.
        RunError: The simulation failed.
        Interrupted: A signal has come.
    """
    path = run.work / TAKE
    writer, counter = _begin(run, crowd)
    if begun is not None:
        try:
            writer.reopen(begun.take)
            if writer.done + len(begun.take["frames.action"]) != begun.frame:
                raise TakeError(f"{path}: cannot be continued: its frames are not those up to {begun.frame}")
            counter.add_strikes(*written_strikes(writer))
            for rows in written_frames(writer, path, action_counts(crowd.policies, crowd.cast.policies)):
                counter.add_frames(rows)
            run.report.continued_at = begun.frame
        except (TakeError, ValueError) as error:
            run.tell(f"{error}; starting over")
            begun = None
            writer, counter = _begin(run, crowd)
    if begun is None:
        writer.open(anew=True)
    run.clock.lap("take")
    pace = Pace(begun is not None)

    def keep(simulation: Simulation, timings: Sequence[Array], required: bool) -> None:
        size, since = simulation.nbytes + writer.nbytes, perf_counter()
        if required or pace.is_due(size):
            measured = np.concatenate(timings) if timings else None
            state = simulation.state(), writer.state()
            write_checkpoint(run.work, Checkpoint(simulation.frame, origin, *state, measured), pace.lasts)
            pace.wrote(since, size)

    timings = record(run, crowd, writer, counter, begun, keep)
    run.report.statistics = counter.finish()
    return open_take(path, crowd.cast), timings


def _begin(run: Run, crowd: Crowd) -> tuple[TakeWriter, StatisticsCounter]:
    """Return what writes the take of a run, and what counts its frames."""
    header, chunk = take_header(run.scenario, crowd), run.scenario.outputs.take.chunk
    writer = TakeWriter(run.work / TAKE, header, crowd.frames, chunk)
    cast = crowd.cast
    return writer, StatisticsCounter(crowd.policies, cast.policies, cast.widths, crowd.frames, run.threads)
