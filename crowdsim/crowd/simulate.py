"""A crowd is run from its first frame to its last, chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator

from crowdsim.core.types import Array
from crowdsim.crowd.chunk import Chunk
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.simulation import Simulation

_CHUNK_AVATAR_FRAMES = 1_000_000


def simulate(
    crowd: Crowd,
    frames: int,
    threads: int = 1,
    search: str = "auto",
    order: Array | None = None,
    profiled: bool = False,
    chunk: int | None = None,
) -> Iterator[Chunk]:
    """Run a crowd and yield its frames in chunks; it runs only as far as chunks are read.

    Args:
        crowd: The crowd; see ``draw.draw_crowd`` for a scenario's.
        frames: Control frames.
        threads: Threads for large crowds.
        search: How nearest opponents are found, one of ``scenario.groups.SEARCHES``.
        order: Number of the avatar in each slot at the start; it changes no result. Shape (N,).
        profiled: Take the time of every stage.
        chunk: Control frames in a chunk; by default a million avatar-frames, at most 256.

    Raises:
        RunError: An avatar's position or values are not finite; the message names avatar and frame.
    """
    size = chunk or min(max(_CHUNK_AVATAR_FRAMES // max(crowd.count, 1), 1), 256)
    simulation = Simulation(crowd, threads, search, order, profiled)
    try:
        while simulation.frame < frames and not simulation.is_over:
            yield simulation.run(min(size, frames - simulation.frame))
    finally:
        simulation.close()
