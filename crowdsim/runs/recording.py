"""The loop of a run: a crowd is simulated, and its control frames go to a sink as they come, with checkpoints.

A take in a run folder is begun there, or continued from a checkpoint.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Protocol

import numpy as np

from crowdsim.array_checks import ArrayFault
from crowdsim.core.types import Array
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.ending import describe_outcome
from crowdsim.crowd.jit_warmup import warm_up
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.state import read_outcome
from crowdsim.errors import OutputError, RunError, TakeError
from crowdsim.files import is_folder, remove_tree
from crowdsim.poses.known_actions import action_counts, with_known_actions
from crowdsim.preparation.prepare import take_header
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import Checkpoint, Pace, write_checkpoint
from crowdsim.runs.run import Run
from crowdsim.runs.stage import TAKE
from crowdsim.take.layout import chunk_frames
from crowdsim.take.resume import check_writer, written_frames, written_strikes
from crowdsim.take.store import TakeWriter, open_take
from crowdsim.take.take import VARIABLES, Events, Take

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


class CheckpointKeeper:
    """Keeps checkpoints of a run in its folder.

    Args:
        folder: The run folder.
        origin: Checksum of what the run is made from.
        writer: Writer of its take.
        begun: The checkpoint that it goes on from.
    """

    def __init__(self, folder: Path, origin: str, writer: TakeWriter, begun: Checkpoint | None) -> None:
        self.begun = begun
        self._folder, self._origin, self._writer = folder, origin, writer
        self._pace = Pace(begun is not None)

    def keep(self, simulation: Simulation, timings: Sequence[Array], required: bool) -> None:
        """Write a checkpoint where it is time for one, or it is required.

        Raises:
            OutputError: It cannot be written.
        """
        size = simulation.nbytes + self._writer.nbytes
        if not (required or self._pace.is_due(size)):
            return
        since = perf_counter()
        measured = np.concatenate(timings) if timings else None
        state = simulation.state(), self._writer.state()
        written = Checkpoint(simulation.frame, self._origin, *state, measured)
        write_checkpoint(self._folder, written, self._pace.lasts)
        self._pace.wrote(since, size)


def record(
    run: Run,
    crowd: Crowd,
    sink: Sink,
    counter: StatisticsCounter | None = None,
    keeper: CheckpointKeeper | None = None,
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
    avatars, frames = crowd.count, crowd.frames
    size, step = chunk_frames(avatars, run.scenario.outputs.take.chunk), max(1, _STEP_AVATAR_FRAMES // avatars)
    timings: list[Array] = []
    try:
        model = warm_up(crowd, search, profiled)
        with Simulation(crowd, run.threads, search, run.order, profiled, model) as simulation:
            if keeper is not None and keeper.begun is not None:
                _restore(simulation, keeper.begun, run.work)
                timings += [] if keeper.begun.timings is None else [keeper.begun.timings]
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
                if keeper is not None:
                    keeper.keep(simulation, timings, is_caught or is_last)
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
    except RunError:
        # It would fail again.
        sink.abandon()
        raise
    return np.concatenate(timings) if timings else None


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


def write_take(
    run: Run, crowd: Crowd, origin: str, begun: Checkpoint | None, counter: StatisticsCounter
) -> tuple[Take, Array | None]:
    """Simulate a run and write its take as it comes, from its first frame or from a checkpoint on.

    Args:
        run: The run.
        crowd: Its crowd.
        origin: Checksum of what it is made from.
        begun: The checkpoint that it goes on from.
        counter: Counts its frames, those of before too.

    Returns:
        The take, and what control cost where that is wanted.

    Raises:
        OutputError: It cannot be written; the checkpoint and what it needs stay.
        RunError: The simulation failed; nothing stays of the take.
        Interrupted: A signal has come.
    """
    path = run.work / TAKE
    chunk = run.scenario.outputs.take.chunk
    header = take_header(run.scenario, crowd)
    writer = TakeWriter(path, header, crowd.frames, chunk)
    if begun is not None:
        try:
            if path.exists():
                take = with_known_actions(open_take(path), crowd.policies)
                if take.status == "done" and take.frame_count == begun.frame:
                    counter.add_strikes(take.events.outcome, take.events.down)
                    for first in range(0, take.frame_count, writer.chunk):
                        counter.add_frames(
                            {name: getattr(take, name)[first : first + writer.chunk] for name in VARIABLES}
                        )
                    ended = read_outcome(begun.simulation, crowd)
                    run.report.outcome = None if ended is None else describe_outcome(run.scenario, ended)
                    run.report.continued_at = begun.frame
                    return take, begun.timings
            check_begun(begun, path, crowd.count)
            writer.reopen(begun.take)
            counts = action_counts(crowd.policies, crowd.cast.policies)
            counter.add_strikes(*written_strikes(writer))
            for rows in written_frames(writer, path, counts):
                counter.add_frames(rows)
            run.report.continued_at = begun.frame
        except (TakeError, ValueError) as error:
            run.tell(f"{error}; starting over")
            begun = None
            writer = TakeWriter(path, header, crowd.frames, chunk)
            writer.abandon()
            if is_folder(run.work, TAKE):
                remove_tree(run.work, TAKE)
    try:
        if begun is None:
            writer.open()
        run.clock.lap("take")
        timings = record(run, crowd, writer, counter, CheckpointKeeper(run.work, origin, writer, begun))
    except OutputError:
        if not (run.work / CHECKPOINT).exists():
            # Nothing could go on from what is there.
            writer.abandon()
        raise
    return open_take(path), timings


def check_begun(begun: Checkpoint, path: Path, avatars: int) -> None:
    """Hold what the take's writer held at a checkpoint against what it must be.

    Raises:
        TakeError: It is something else.
    """
    try:
        check_writer(begun.take)
        waiting = begun.take["frames.action"]
        if int(begun.take["frames"]) + len(waiting) != begun.frame or (len(waiting) and waiting.shape[1] != avatars):
            raise ArrayFault("frames.action", f"is {waiting.shape}, expected the frames up to {begun.frame}")
    except ArrayFault as fault:
        raise TakeError(f"{path}: cannot be continued: {fault}") from None
