"""Runs of a batch while Dask does them: sent, watched, and noted when they end."""

from __future__ import annotations

import queue
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim.batch.attempts import log_path, read_attempts
from crowdsim.batch.engine import BatchOptions
from crowdsim.batch.failures import describe_failure
from crowdsim.batch.plan import LOGS, Plan, PlannedRun
from crowdsim.batch.progress import Progress
from crowdsim.batch.report import pick_thumbnails, thumbnail_path
from crowdsim.batch.results import write_result
from crowdsim.batch.tasks import Job, draw, export, finish, has_outputs, posed_outputs, simulate, thumbnail, topic
from crowdsim.errors import RunError
from crowdsim.files import entries
from crowdsim.scenario.output import Extent

if TYPE_CHECKING:
    from distributed import Client, Future

    from crowdsim.outputs.render import RenderOutput

Show = Callable[[Progress], None]
"""Is called several times a second with how far a batch is."""
_LOOK = 0.25
"""How often that is [s]."""
_THUMBNAILS = 60.0
"""How long small pictures are waited for once all runs have ended [s]."""


@dataclass
class Outcome:
    """What came of a batch.

    Attributes:
        folder: Its folder.
        plan: Its plan.
        kept: Runs that were finished before.
        done: Runs that have been finished now.
        failures: Runs that have failed, by id, with the cause.
        left: Runs that have not been begun, after a failure that ended the batch.
        seconds: Time of each stage [s].
    """

    folder: Path
    plan: Plan
    kept: int = 0
    done: int = 0
    failures: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    left: int = 0
    seconds: dict[str, float] = field(default_factory=dict)


class Session:
    """The runs of a batch while Dask does them."""

    def __init__(
        self, client: Client, plan: Plan, options: BatchOptions, progress: Progress, outcome: Outcome,
        show: Show | None, notify: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._folder, self._client, self._plan, self._options = outcome.folder, client, plan, options
        self._progress, self._outcome, self._show, self._notify = progress, outcome, show, notify
        self._name = uuid.uuid4().hex[:12]
        self._ended: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._out_of_memory: set[tuple[str, int]] = set()
        self._submitted: dict[str, list[Future]] = {}

    def run(self) -> None:
        """Send all runs that are not finished to the scheduler, and wait until each has ended.

        Raises:
            RunError: The scheduler was lost.
        """
        client, progress = self._client, self._progress
        client.subscribe_topic(topic(self._name), self._hear)
        client.subscribe_topic("worker-restart-memory", self._hear_of_memory)
        client.subscribe_topic("all", self._hear_of_workers)
        progress.begin()
        progress.write(now=True)
        waiting = [run for id, run in self._plan.runs.items() if id not in progress.done]
        for run in waiting:
            self._submitted[run.id] = self._submit(self._job(run))
            self._watch(run.id)
        self._wait({run.id for run in waiting})
        # A scheduler complains of clients that leave while they listen to what becomes of clients.
        client.unsubscribe_topic("all")

    def _wait(self, open_runs: set[str]) -> None:
        """Wait until each run has ended, or the first has failed where that ends the batch."""
        while open_runs:
            with suppress(queue.Empty):
                id = self._ended.get(timeout=_LOOK)
                if id in open_runs and self._settle(id):
                    open_runs.discard(id)
                    if self._options.fail_fast and self._outcome.failures:
                        self._client.cancel([future for id in open_runs for future in self._submitted[id]])
                        self._outcome.left = len(open_runs)
                        break
                    continue
            self._look()
        self._look()

    def _job(self, run: PlannedRun) -> Job:
        """Return what the tasks of a run need to know."""
        options, environment = self._options, self._plan.environment
        return Job(self._folder, run, self._name, environment, options.retries, options.timeout, options.command)

    def _submit(self, job: Job) -> list[Future]:
        """Send the tasks of a run: simulation, exports and ranges of pictures at once, and last what joins them."""

        def send(task: Callable[..., None], name: str, *values: Any) -> Future:
            key = f"{name}-{job.session}-{job.run.id}"
            return self._client.submit(task, job, *values, key=key, retries=job.retries, pure=False)

        first, outputs = send(simulate, "simulate"), job.run.outputs
        if not has_outputs(outputs):
            return [first]
        parts = [send(export, f"export_{one.name}", one.name, first) for one in posed_outputs(outputs)]
        if outputs.render is not None:
            for low, stop in frame_ranges(outputs.render, job.run, self._plan.batch.frames_per_task):
                parts.append(send(draw, f"draw_{low:08d}", low, stop, first))
        return [first, *parts, send(finish, "finish", *(parts or [first]))]

    def _watch(self, id: str) -> None:
        self._submitted[id][-1].add_done_callback(lambda _: self._ended.put(id))

    def draw_thumbnails(self) -> None:
        """Draw small pictures that are missing, unless a failure has ended the batch; one that fails is left out."""
        if self._outcome.left:
            return
        futures = []
        for id in pick_thumbnails(self._plan):
            path = thumbnail_path(self._folder, id)
            if id in self._progress.done and not path.is_file():
                job, key = self._job(self._plan.runs[id]), f"thumbnail-{self._name}-{id}"
                futures.append(self._client.submit(thumbnail, job, path, key=key, pure=False))
        until = time.monotonic() + _THUMBNAILS
        for future in futures:
            with suppress(Exception):
                future.exception(timeout=max(0.1, until - time.monotonic()))

    def _hear(self, event: tuple[float, Mapping[str, Any]]) -> None:
        message = event[1]
        if "refused" in message:
            difference = "; ".join(message["difference"])
            self._notify(f"worker {message['refused']}: is not used, since it differs: {difference}")
        else:
            self._progress.hear(message)

    def _hear_of_memory(self, event: tuple[float, Mapping[str, Any]]) -> None:
        self._out_of_memory.add((event[1]["worker"], event[1]["pid"]))

    def _hear_of_workers(self, event: tuple[float, Mapping[str, Any]]) -> None:
        if event[1].get("action") == "remove-worker" and not event[1]["expected"]:
            self._notify(f"worker {event[1]['worker']}: was lost; other workers, or new ones, go on with its tasks")

    def _look(self) -> None:
        """Report how far it is.

        Raises:
            RunError: The scheduler was lost.
        """
        if self._client.status != "running":
            what = "its workers end, and the same command goes on from what is finished"
            raise RunError(f"the scheduler at {self._options.scheduler or 'this machine'} was lost; {what}")
        self._progress.write()
        if self._show is not None:
            self._show(self._progress)

    def _settle(self, id: str) -> bool:
        """Note how a run has ended; whether it has."""
        from distributed import KilledWorker

        last, run = self._submitted[id][-1], self._plan.runs[id]
        if last.status == "finished":
            self._progress.settle(id, True)
            self._outcome.done += 1
            return True
        if last.status != "error":
            # The scheduler is gone, which is found when it is looked at next.
            return False
        error = last.exception()
        if isinstance(error, KilledWorker) and self._is_innocent(id):
            self._client.retry([last])
            self._watch(id)
            return False
        result = describe_failure(self._folder, run, error, self._name, self._out_of_memory)
        write_result(self._folder, id, result)
        self._outcome.failures[id] = result
        self._progress.settle(id, False)
        return True

    def _is_innocent(self, id: str) -> bool:
        """Whether a scheduler has given up a run because workers died that had not begun it often enough."""
        tasks = [Path(name).stem for name in entries(self._folder, f"{LOGS}/{id}") if name.endswith(".log")]
        died = [
            sum(not one.ended for one in read_attempts(log_path(self._folder, id, task), self._name)) for task in tasks
        ]
        return max(died, default=0) <= self._options.retries


def frame_ranges(render: RenderOutput, run: PlannedRun, size: int) -> Iterator[tuple[int, int]]:
    """Yield the ranges of pictures that tasks draw, divided at multiples of a size: first picture, one past the last.

    None are drawn for a contact sheet alone.
    """
    if not (render.mp4 or render.png):
        return
    first, stop = render.frames_of(Extent(run.avatars, run.control_frames, run.control_rate))
    for low in range(first - first % size, stop, size):
        yield max(low, first), min(low + size, stop)
