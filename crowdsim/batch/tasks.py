"""What workers do: simulate a run, export it, draw some of its pictures, and put everything together.

A task is a function of a job that gives the same files however often it is begun; files that are there already are not
written again. So a task whose worker has died is done by another one, from the last checkpoint or whole file on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim.batch.attempts import attempt, log_path
from crowdsim.batch.plan import POLICIES, SCENARIOS, WORK, PlannedRun
from crowdsim.batch.results import collect, write_result
from crowdsim.batch.workers import describe_environment
from crowdsim.files import Writing, entries, make_folder, remove_tree
from crowdsim.runs.folder import RESOLVED
from crowdsim.runs.lock import find_owner, hold_folder
from crowdsim.runs.opening import recorded
from crowdsim.runs.provenance import document_difference
from crowdsim.runs.stage import complete_alone, record_pictures
from crowdsim.scenario.outputs import Outputs
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.store import open_take

if TYPE_CHECKING:
    from crowdsim.export.posed import PosedOutput
    from crowdsim.policy.policy import Policy
    from crowdsim.render.options import RenderOptions
    from crowdsim.render.take_source import TakeSource
    from crowdsim.runs.recorded import RecordedRun

_PAUSE = 0.2
"""How often a folder is looked at that another process holds [s]."""
_NEWS = 0.5
"""How often progress is reported [s]."""


@dataclass(frozen=True)
class Job:
    """What the tasks of a run need to know; plain data, which is sent to workers (see ``BatchOptions``).

    Attributes:
        batch: Folder of the batch.
        run: The run.
        session: This session of the batch.
        environment: What a worker must be.
    """

    batch: Path
    run: PlannedRun
    session: str
    environment: Mapping[str, Any]
    retries: int
    timeout: float
    command: str
    device: str

    @property
    def folder(self) -> Path:
        """Run folder."""
        return self.batch / self.run.folder

    @property
    def work(self) -> Path:
        """Folder of what is not in its place yet."""
        return self.batch / WORK / self.run.id


def simulate(job: Job) -> None:
    """Simulate a run into its folder; where it has no outputs it is finished then."""
    from crowdsim.crowd.cuda.device import choose_device, take_gpu
    from crowdsim.runs.runner import run_to

    with _attempt(job, "simulate") as progress:
        policies = _policies(job)
        scenario = load_scenario(job.batch / SCENARIOS / job.run.id / RESOLVED, policies=job.run.policies)
        _wait_for(job.folder)
        if choose_device(job.device, scenario.avatar_count, scenario.opponents.search) == "cuda":
            take_gpu(_worker_number())
        run_to(
            job.folder, scenario, 1, command=job.command, progress=progress, policies=policies, device=job.device
        )  # fmt: skip
        if not has_outputs(job.run.outputs):
            write_result(job.batch, job.run.id, collect(job.folder, _run(job), job.run.mark))


def _worker_number() -> int:
    """Return the number of the worker that does this task; 0 of one that has a name."""
    from distributed import get_worker

    name = get_worker().name
    return name if isinstance(name, int) else 0


def export(job: Job, kind: str, *_: None) -> None:
    """Export a finished take as one kind of file, into a folder beside the run's."""
    from crowdsim.export.posed import extent_of

    with _attempt(job, f"export-{kind}") as progress:
        run = _run(job)
        output = getattr(job.run.outputs, kind).within(extent_of(run))
        out = job.work / f"export-{kind}"
        _wait_for(out)
        run.write([output], out, 1, progress)


def draw(job: Job, first: int, stop: int, *_: None) -> None:
    """Draw some pictures of a finished take, into a folder beside the run's."""
    from crowdsim.render.batch import draw_apart

    with _attempt(job, f"pictures-{first:08d}") as progress:
        source, options = _source(job)
        out = job.work / f"pictures-{first:08d}"
        _wait_for(out)
        with hold_folder(out):
            draw_apart(source, out, replace(options, frames=(first, stop), contact_sheet=0), progress)


def finish(job: Job, *_: None) -> None:
    """Put exports and pictures in their places in the run folder, join the video, and write the report."""
    from crowdsim.export.posed import extent_of
    from crowdsim.runs.exports import adopt_export

    with _attempt(job, "finish") as progress:
        run = _run(job)
        _wait_for(job.folder)
        for output in posed_outputs(job.run.outputs):
            adopt_export(job.folder, job.work / f"export-{output.name}", output.within(extent_of(run)))
        if job.run.outputs.render is not None:
            _join(job, progress)
        if job.run.outputs.report is not None:
            run.write([job.run.outputs.report], job.folder, progress=progress)
        write_result(job.batch, job.run.id, collect(job.folder, run, job.run.mark))
        with suppress(OSError):
            remove_tree(job.batch, f"{WORK}/{job.run.id}")


def thumbnail(job: Job, path: Path, *_: None) -> None:
    """Draw a small picture of a finished take, at half its time."""
    from crowdsim.render.look import Look
    from crowdsim.render.options import RenderOptions
    from crowdsim.render.take_source import thumbnail_rate
    from crowdsim.render.video import write_png

    with _attempt(job, "thumbnail"):
        run = _run(job)
        source = run.source(thumbnail_rate(run), 1)
        stage = RenderOptions(size=(256, 144), look=Look(caption=False), threads=1).stage(source)
        make_folder(path.parent)
        write_png(path, stage.picture(source.frame_count // 2), stage.mark)


def has_outputs(outputs: Outputs) -> bool:
    """Whether anything is written once a take is finished."""
    return any(output.from_take for output in outputs.wanted())


def posed_outputs(outputs: Outputs) -> list[PosedOutput]:
    """Return the outputs that are exported, each by a task of its own."""
    from crowdsim.export.posed import PosedOutput

    return [output for output in outputs.wanted() if isinstance(output, PosedOutput)]


def _join(job: Job, progress: Callable[[str, int, int], None]) -> None:
    """Join the pictures that tasks have drawn, as ``crowdsim render`` draws them all."""
    from crowdsim.render.batch import adopt_frames, render

    source, options = _source(job)

    @contextmanager
    def record(folder: Path, *more: Any) -> Iterator[Writing]:
        with record_pictures(folder, *more, run=folder) as writing:
            if not writing.done:
                apart = [name for name in entries(job.batch, f"{WORK}/{job.run.id}") if name.startswith("pictures-")]
                adopt_frames(writing.folder, [job.work / name for name in apart])
            yield writing

    render(source, job.folder, options, progress, record)


def _source(job: Job) -> tuple[TakeSource, RenderOptions]:
    """Return the source of a run's pictures, and how they are drawn."""
    from crowdsim.export.posed import extent_of
    from crowdsim.render.command import scenario_options

    wanted = job.run.outputs.render
    assert wanted is not None
    options, source = scenario_options(wanted, 1), _run(job).source(wanted.rate, 1)
    extent = extent_of(source.take)
    return source, replace(options, frames=wanted.frames_of(extent), shots=wanted.shots_of(extent))


def _run(job: Job) -> RecordedRun:
    complete_alone(job.folder)
    return recorded(job.folder, replace(open_take(job.folder), policies=tuple(_policies(job))))


def _policies(job: Job) -> list[Policy]:
    return [_load_policy(job.batch / POLICIES / name) for name in job.run.policies]


@lru_cache(maxsize=4)
def _load_policy(folder: Path) -> Policy:
    """Return a policy, mapped into memory: the processes of a machine share one copy."""
    from crowdsim.policy.bundle import load_policy

    return replace(load_policy(folder), name=folder.name)


def _wait_for(folder: Path) -> None:
    """Wait until no process holds a folder: one that Dask has given up may still be at work in it."""
    while find_owner(folder) is not None:
        time.sleep(_PAUSE)


@contextmanager
def _attempt(job: Job, task: str) -> Iterator[Callable[[str, int, int], None]]:
    """Hold an attempt at a task, and give what reports its progress to the process that sent it."""
    from distributed import Reschedule, get_worker

    worker = get_worker()
    difference = document_difference(job.environment, describe_environment())
    if difference:
        # Other workers do the tasks, and this one closes.
        worker.log_event(topic(job.session), {"refused": worker.address, "difference": difference})
        worker.loop.add_callback(worker.close)
        raise Reschedule
    reported = 0.0

    def report(stage: str, done: int, total: int) -> None:
        nonlocal reported
        if time.monotonic() - reported > _NEWS:
            reported = time.monotonic()
            worker.log_event(topic(job.session), {"run": job.run.id, "stage": stage, "done": done, "total": total})

    worker.log_event(topic(job.session), {"run": job.run.id, "stage": task, "done": 0, "total": 1})
    with attempt(log_path(job.batch, job.run.id, task), job.session, job.retries, job.timeout, worker.address):
        yield report


def topic(session: str) -> str:
    """Return the name under which workers report what they do for a session of a batch."""
    return f"crowdsim-batch-{session}"
