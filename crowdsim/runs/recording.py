"""The loop of a run: a crowd is simulated, and its control frames go to a sink as they come."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.warming import warm_up
from crowdsim.runs.preparation import Prepared
from crowdsim.runs.run import Run
from crowdsim.take.take import Events

if TYPE_CHECKING:
    from crowdsim.crowd.statistics import StatisticsCounter

_TAKE_CHUNK_AVATAR_FRAMES = 4_000_000
_STEP_AVATAR_FRAMES = 200_000


class Sink(Protocol):
    """Where the frames of a run go: memory (``take.memory.TakeCollector``) or a file (``take.store.TakeWriter``)."""

    def append(self, chunk: dict[str, Array], events: Events, targets: Array | None = None) -> None:
        """Add control frames: an array (n, N) for each of ``VARIABLES``, strikes, and positions of targets."""

    def close(self, status: str = "done") -> None:
        """Finish the take; ``status`` is ``done`` or ``interrupted``."""

    def abandon(self) -> None:
        """Remove what has been written."""


def take_chunk(run: Run, prepared: Prepared) -> int:
    """Return how many control frames are a chunk of the take."""
    return max(1, min(run.scenario.outputs.take.chunk, _TAKE_CHUNK_AVATAR_FRAMES // len(prepared.cast.names)))


def record(run: Run, prepared: Prepared, sink: Sink, counter: StatisticsCounter | None = None) -> Array | None:
    """Simulate a run, and hand its control frames to a sink and a counter as they come.

    Returns:
        The time of each stage of control where a profile is wanted. Shape (frames, 6), int64 [ns].

    Raises:
        Interrupted: A signal has come; the sink holds the frames that were done.
    """
    frames, clock = prepared.frames, run.clock
    step = max(1, min(take_chunk(run, prepared), _STEP_AVATAR_FRAMES // len(prepared.cast.names)))
    crowd, policies, script = prepared.crowd, prepared.policies, prepared.script
    profiled, search = run.scenario.outputs.profile is not None, run.scenario.opponents.search
    timings: list[Array] = []
    try:
        model = warm_up(crowd, policies, script, search, profiled)
        simulation = Simulation(crowd, policies, script, run.threads, search, run.order, profiled, model)
        try:
            clock.lap("prepare")
            while simulation.frame < frames:
                chunk = simulation.run(min(step, frames - simulation.frame))
                clock.lap("control")
                sink.append(chunk.variables(), chunk.events, chunk.targets)
                clock.lap("take")
                if counter is not None:
                    counter.add(chunk)
                    clock.lap("statistics")
                if chunk.timings is not None:
                    timings.append(chunk.timings)
                done = simulation.frame
                run.advance("control", done, frames)
                if run.caught and done < frames:
                    sink.close("interrupted")
                    run.interrupt(f"the {done} of {frames} control frames that were done are kept")
                clock.start()
        finally:
            simulation.close()
        sink.close()
    except BaseException:
        sink.abandon()
        raise
    return np.concatenate(timings) if timings else None
