"""Runs as Dask's tasks: simulation, then exports and frame ranges of pictures in parallel, then what joins them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from crowdsim.batch.plan import PlannedRun
from crowdsim.batch.tasks import KINDS, Job, draw, export, finish, has_outputs, simulate
from crowdsim.scenario.frame_ranges import output_frames
from crowdsim.scenario.outputs import RenderOutput

if TYPE_CHECKING:
    from distributed import Client, Future


@dataclass(frozen=True)
class Submitted:
    """The tasks of a run.

    Attributes:
        last: The one with which it is finished.
        futures: All of them.
    """

    last: Future
    futures: tuple[Future, ...]


def submit(client: Client, job: Job, run: PlannedRun, frames_per_task: int, retries: int) -> Submitted:
    """Send the tasks of a run to the scheduler.

    Args:
        client: Client of the scheduler.
        job: What the tasks need to know.
        run: The run.
        frames_per_task: Pictures that one task draws.
        retries: How often a task is tried again that raised.
    """

    def send(task: Any, name: str, *values: Any) -> Future:
        key = f"{name}-{job.session}-{job.id}"
        return client.submit(task, job, *values, key=key, retries=retries, pure=False)

    first = send(simulate, "simulate")
    if not has_outputs(job.outputs):
        return Submitted(first, (first,))
    parts = [send(export, f"export_{kind}", kind, first) for kind in KINDS if getattr(job.outputs, kind) is not None]
    if job.outputs.render is not None:
        for low, stop in frame_ranges(job.outputs.render, run, frames_per_task):
            parts.append(send(draw, f"draw_{low:08d}", low, stop, first))
    last = send(finish, "finish", *parts, *([] if parts else [first]))
    return Submitted(last, (first, *parts, last))


def frame_ranges(render: RenderOutput, run: PlannedRun, size: int) -> Iterator[tuple[int, int]]:
    """Yield the ranges of pictures that tasks draw, divided at multiples of a size: first picture, one past the last.

    None are drawn for a contact sheet alone.
    """
    if not (render.mp4 or render.png):
        return
    count = output_frames(run.control_frames, run.control_rate, render.fps)
    first, stop = render.frames_at(render.fps) or (0, count)
    stop = min(stop, count)
    for low in range(first - first % size, stop, size):
        yield max(low, first), min(low + size, stop)
