"""A take that a run writes, begun or continued, with checkpoints on the way."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.array_checks import ArrayFault
from crowdsim.core.types import Array
from crowdsim.crowd.simulation import Simulation
from crowdsim.errors import OutputError, TakeError
from crowdsim.files import is_folder, remove_tree
from crowdsim.poses.known_actions import action_counts, with_known_actions
from crowdsim.preparation.prepare import take_header
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import Checkpoint, Pace, write_checkpoint
from crowdsim.runs.recording import record
from crowdsim.runs.run import Run
from crowdsim.runs.stage import TAKE
from crowdsim.take.resume import check_writer, written_frames, written_strikes
from crowdsim.take.store import TakeWriter, open_take
from crowdsim.take.take import VARIABLES, Take

if TYPE_CHECKING:
    from crowdsim.crowd.crowd import Crowd
    from crowdsim.crowd.statistics import StatisticsCounter


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
                    _recount(counter, _rows(take, writer.chunk), (take.events.outcome, take.events.down))
                    run.report.continued_at = begun.frame
                    return take, begun.timings
            check_begun(begun, path, crowd.count)
            writer.reopen(begun.take)
            counts = action_counts(crowd.policies, crowd.cast.policies)
            _recount(counter, written_frames(writer, path, counts), written_strikes(writer))
            run.report.continued_at = begun.frame
        except TakeError as error:
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


def _recount(counter: StatisticsCounter, frames: Iterable[dict[str, Array]], strikes: tuple[Array, Array]) -> None:
    """Count what was recorded before."""
    counter.add_strikes(*strikes)
    for rows in frames:
        counter.add_frames(rows)


def _rows(take: Take, size: int) -> Iterator[dict[str, Array]]:
    """Yield what a take holds for each control frame and avatar, some frames at a time."""
    for first in range(0, take.frame_count, size):
        yield {name: getattr(take, name)[first : first + size] for name in VARIABLES}
