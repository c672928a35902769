"""A batch from its description to its report: planned, prepared once, done by Dask, watched, and noted run by run."""

from __future__ import annotations

import queue
import time
import uuid
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from crowdsim.batch.attempts import describe_failure, read_deaths
from crowdsim.batch.description import Batch
from crowdsim.batch.plan import (
    FOLDERS,
    NAME,
    POLICIES,
    SCENARIOS,
    Plan,
    PlannedRun,
    Resolved,
    check_disk,
    is_batch,
    make_plan,
    read_plan,
    resolve,
    write_frozen,
    write_plan,
)
from crowdsim.batch.report import pick_thumbnails, thumbnail_path, write_report
from crowdsim.batch.results import Progress, is_done, write_result
from crowdsim.batch.tasks import Job, draw, export, finish, has_outputs, posed_outputs, simulate, thumbnail, topic
from crowdsim.batch.workers import (
    BatchOptions,
    check_workers,
    compile_kernels,
    compile_on_hosts,
    connect,
    dashboard_address,
    find_certificates,
    require_dask,
)
from crowdsim.core import types
from crowdsim.errors import BatchError, OutputError, RunError
from crowdsim.files import copy_plain, exists_plain, is_folder, make_folder, move_plain, remove_tree, walk
from crowdsim.preparation.prepare import kernel_uses, load_policies, policy_names, training_notice, untrained_policies
from crowdsim.runs.lock import hold_folder
from crowdsim.runs.provenance import document_difference
from crowdsim.scenario.output import Extent

if TYPE_CHECKING:
    from distributed import Client, Future

    from crowdsim.outputs.render import RenderOutput

Show = Callable[[Progress], None]
"""Is called several times a second with how far a batch is."""
Notify = Callable[[str], None]
"""Is called with what a user should know."""
_LOOK = 0.25
"""How often the state of a batch is shown [s]."""
_THUMBNAILS = 60.0
"""How long small pictures are waited for once all runs have ended [s]."""
_OWN = (".crowdsim-", f".{NAME}")
"""How names begin of what a process leaves in a folder that was killed before it wrote the plan."""


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


def plan_batch(folder: Path, batch: Batch, progress: types.Progress | None = None) -> tuple[Plan, dict[str, Resolved]]:
    """Return the plan of a batch, and its runs; nothing is written, and nothing trained.

    Raises:
        BatchError: The batch is invalid, the folder holds something else, or the disk has no room for it.
        ScenarioError: A scenario is invalid.
        RecipeError: The recipe of a policy is invalid.
        PolicyError: A bundle is damaged.
    """
    if folder.exists() and not folder.is_dir():
        raise BatchError(f"{folder}: is a file, expected a folder for the batch")
    for name in (NAME, *FOLDERS):
        if (folder / name).is_symlink():
            raise BatchError(f"{folder / name}: is a symbolic link, expected none in the folder of a batch")
    if folder.is_dir() and not is_batch(folder):
        held = sorted(path.name for path in folder.iterdir() if not path.name.startswith(_OWN))
        if held:
            raise BatchError(f"{folder}: holds {held[0]!r}, which is no batch's; expected an empty folder, see --out")
    runs, combinations = resolve(batch, progress)
    plan = make_plan(batch, runs, combinations)
    check_disk(folder, [run.estimate for run in plan.runs.values() if not is_done(folder, run)])
    return plan, runs


def run_batch(
    folder: Path,
    plan: Plan,
    runs: Mapping[str, Resolved],
    options: BatchOptions,
    show: Show = lambda progress: None,
    notify: Notify = lambda text: None,
    train: types.Progress | None = None,
) -> Outcome:
    """Do the runs of a batch that are not finished, and write its report.

    Args:
        folder: Folder of the batch, made when missing; workers must see it under the same name.
        plan: The plan.
        runs: Its runs.
        options: How they are done.
        show: Is called several times a second with how far it is.
        notify: Is called with what a user should know.
        train: Is called with stage, done and total of a training.

    Raises:
        PolicyError: Capture for a policy is missing.
        BatchError: The batch has begun with something else, the scheduler does not answer, or a worker cannot be used.
        OutputError: The folder cannot be used, or is in use.
        RunError: The scheduler was lost.
    """
    require_dask(options)
    security = find_certificates(options)
    folder = Path(folder).absolute()
    outcome, times = Outcome(folder, plan), [perf_counter()]
    plan = _with_policies(folder, plan, _train(runs.values(), options, notify, train))
    uses = _used_kernels(runs.values())
    compile_kernels(uses, options.threads, notify)
    with connect(options, security) as client, ExitStack() as stack:
        progress = Progress(folder, plan.runs, dashboard_address(client))
        if progress.dashboard:
            notify(f"dashboard: {progress.dashboard}")
        stack.enter_context(_held(folder, options.command))
        if not client.scheduler_info(n_workers=-1)["workers"]:
            notify("waiting for workers of the scheduler")
            client.wait_for_workers(1)
        plan = replace(plan, environment=check_workers(client, folder))
        if is_batch(folder):
            _refuse_changes(folder, read_plan(folder).environment, plan.environment)
        if options.scheduler is not None:
            compile_on_hosts(client, uses)
        write_plan(folder, plan)
        for resolved in runs.values():
            write_frozen(folder / SCENARIOS, resolved)
        _freeze_policies(folder / POLICIES, plan.policies)
        done = {id for id, run in plan.runs.items() if is_done(folder, run)}
        outcome.kept = len(done)
        times.append(perf_counter())
        session = _Session(client, plan, options, progress, outcome, show, notify)
        session.run(done)
        times.append(perf_counter())
        session.draw_thumbnails()
        times.append(perf_counter())
        write_report(folder, plan)
        times.append(perf_counter())
        progress.write(now=True)
    stages = ("start", "runs", "pictures", "report")
    outcome.seconds = {name: times[i + 1] - times[i] for i, name in enumerate(stages)}
    return outcome


def _train(
    runs: Iterable[Resolved], options: BatchOptions, notify: Notify, train: types.Progress | None
) -> dict[str, str]:
    """Return the fingerprints of the policies that runs use, by name; trained when missing or stale."""
    found: dict[str, str] = {}
    for one in runs:
        if not set(policy_names(one.scenario)) <= found.keys():
            for name in untrained_policies(one.scenario, options.mocap):
                notify(training_notice(name, options.threads))
            policies = load_policies(one.scenario, options.mocap, options.threads, train)
            found.update({policy.name: policy.fingerprint for policy in policies})
    return found


def _with_policies(folder: Path, plan: Plan, now: Mapping[str, str]) -> Plan:
    """Return a plan with the fingerprints of its policies, and of those that the batch had before."""
    before = read_plan(folder).policies if is_batch(folder) else {}
    again = {name: fingerprint for name, fingerprint in now.items() if name in before}
    _refuse_changes(folder, {"policies": before}, {"policies": {**before, **again}})
    return replace(plan, policies={**before, **now})


def _refuse_changes(folder: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    difference = document_difference(before, now)
    if difference:
        what = f"{folder}: holds a batch that cannot be continued, since something has changed; --out names another"
        raise BatchError("\n".join([what, *difference]))


def _used_kernels(runs: Iterable[Resolved]) -> list[str]:
    """Return what runs need kernels for; a picture is made of each."""
    wholes = [one.scenario.model_copy(update={"outputs": one.outputs}) for one in runs]
    return list(dict.fromkeys(["pictures", *(use for whole in wholes for use in kernel_uses(whole))]))


def _freeze_policies(folder: Path, names: Collection[str]) -> None:
    """Keep policies in a folder, from which all workers map them into memory; those that are there stay."""
    from crowdsim.training.train import find_bundle

    make_folder(folder)
    for name in names:
        partial, bundle = f".{name}.part", find_bundle(name)
        if exists_plain(folder, f"{name}/policy.json"):
            continue
        try:
            if is_folder(folder, partial):
                remove_tree(folder, partial)
            for file in walk(bundle):
                # It is never changed once it is written.
                copy_plain(bundle / file, folder, f"{partial}/{file}", link=True)
            move_plain(folder, partial, folder, name)
        except OSError as error:
            raise OutputError(f"{folder / name}: cannot be written: {error.strerror or error}") from None


@contextmanager
def _held(folder: Path, command: str) -> Iterator[None]:
    """Hold the folder of a batch; where nothing came of it, it goes again."""
    try:
        with hold_folder(folder, command):
            yield
    except BaseException:
        if not is_batch(folder):
            with suppress(OSError):
                folder.rmdir()
        raise


class _Session:
    """The runs of a batch while Dask does them: sent, watched, and noted when they end."""

    def __init__(
        self, client: Client, plan: Plan, options: BatchOptions, progress: Progress, outcome: Outcome, show: Show,
        notify: Notify,
    ) -> None:  # fmt: skip
        self._folder, self._client, self._plan, self._options = outcome.folder, client, plan, options
        self._progress, self._outcome, self._show, self._notify = progress, outcome, show, notify
        self._name = uuid.uuid4().hex[:12]
        self._ended: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._out_of_memory: set[tuple[str, int]] = set()
        self._submitted: dict[str, list[Future]] = {}

    def run(self, done: set[str]) -> None:
        """Send all runs that are not finished to the scheduler, and wait until each has ended.

        Raises:
            RunError: The scheduler was lost.
        """
        client = self._client
        client.subscribe_topic(topic(self._name), self._hear)
        client.subscribe_topic("worker-restart-memory", self._hear_of_memory)
        client.subscribe_topic("all", self._hear_of_workers)
        self._progress.begin(done)
        self._progress.write(now=True)
        for id, run in self._plan.runs.items():
            if id not in done:
                self._submitted[id] = self._submit(self._job(run))
                self._watch(id)
        open_runs = set(self._submitted)
        # Until each has ended, or the first has failed where that ends the batch.
        while open_runs and not self._outcome.left:
            with suppress(queue.Empty):
                id = self._ended.get(timeout=_LOOK)
                if id in open_runs and self._settle(id):
                    open_runs.discard(id)
                    if self._options.fail_fast and self._outcome.failures:
                        client.cancel([future for id in open_runs for future in self._submitted[id]])
                        self._outcome.left = len(open_runs)
                    continue
            self._look()
        self._look()
        # A scheduler complains of clients that leave while they listen to what becomes of clients.
        client.unsubscribe_topic("all")

    def _job(self, run: PlannedRun) -> Job:
        """Return what the tasks of a run need to know."""
        options, environment = self._options, self._plan.environment
        how = options.retries, options.timeout, options.command, options.device
        return Job(self._folder, run, self._name, environment, *how)

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
        """Report how far it is, while the scheduler is there."""
        if self._client.status != "running":
            what = "its workers end, and the same command goes on from what is finished"
            raise RunError(f"the scheduler at {self._options.scheduler or 'this machine'} was lost; {what}")
        self._progress.write()
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
        if isinstance(error, KilledWorker):
            deaths = map(len, read_deaths(self._folder, id, self._name).values())
            if max(deaths, default=0) <= self._options.retries:
                # The scheduler has given it up because workers died that had not begun it often enough.
                self._client.retry([last])
                self._watch(id)
                return False
        result = describe_failure(self._folder, run, error, self._name, self._out_of_memory)
        write_result(self._folder, id, result)
        self._outcome.failures[id] = result
        self._progress.settle(id, False)
        return True

    def draw_thumbnails(self) -> None:
        """Draw small pictures that are missing, unless a failure has ended the batch; one that fails is left out."""
        futures = []
        for id in pick_thumbnails(self._plan) if not self._outcome.left else ():
            path = thumbnail_path(self._folder, id)
            if id in self._progress.done and not path.is_file():
                job, key = self._job(self._plan.runs[id]), f"thumbnail-{self._name}-{id}"
                futures.append(self._client.submit(thumbnail, job, path, key=key, pure=False))
        until = time.monotonic() + _THUMBNAILS
        for future in futures:
            with suppress(Exception):
                future.exception(timeout=max(0.1, until - time.monotonic()))


def frame_ranges(render: RenderOutput, run: PlannedRun, size: int) -> Iterator[tuple[int, int]]:
    """Yield the ranges of pictures that tasks draw, divided at multiples of a size: first picture, one past the last.

    None are drawn for a contact sheet alone.
    """
    if not (render.mp4 or render.png):
        return
    first, stop = render.frames_of(Extent(run.avatars, run.control_frames, run.control_rate))
    for low in range(first - first % size, stop, size):
        yield max(low, first), min(low + size, stop)
