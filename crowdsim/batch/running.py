"""A batch from its description to its report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from crowdsim.batch.description import Batch
from crowdsim.batch.engine import (
    BatchOptions,
    check_workers,
    compile_on_hosts,
    connect,
    dashboard_address,
    find_certificates,
    require_dask,
)
from crowdsim.batch.estimates import check_disk
from crowdsim.batch.plan import (
    LOGS,
    NAME,
    OWN,
    POLICIES,
    REPORT,
    RESULTS,
    RUNS,
    SCENARIOS,
    WORK,
    Plan,
    is_batch,
    make_plan,
    read_plan,
    write_plan,
)
from crowdsim.batch.preparing import compile_kernels, freeze_policies, train_policies, used_kernels
from crowdsim.batch.progress import Progress
from crowdsim.batch.report import write_report
from crowdsim.batch.resolving import Resolved, resolve, write_frozen
from crowdsim.batch.results import is_done
from crowdsim.batch.session import Outcome, Session, Show
from crowdsim.errors import BatchError
from crowdsim.runs.lock import hold_folder
from crowdsim.runs.provenance import document_difference

if TYPE_CHECKING:
    from distributed import Client


def plan_batch(
    folder: Path, batch: Batch, progress: Callable[[str, int, int], None] | None = None
) -> tuple[Plan, dict[str, Resolved]]:
    """Return the plan of a batch, and its runs; nothing is written, and nothing trained.

    Raises:
        BatchError: The batch is invalid, the folder holds something else, or the disk has no room for it.
        ScenarioError: A scenario is invalid.
        RecipeError: The recipe of a policy is invalid.
        PolicyError: A bundle is damaged.
    """
    _check_folder(folder)
    runs, combinations = resolve(batch, progress)
    plan = make_plan(batch, runs, combinations)
    check_disk(folder, [run.estimate for run in plan.runs.values() if not is_done(folder, run)])
    return plan, runs


def run_batch(
    folder: Path,
    plan: Plan,
    runs: Mapping[str, Resolved],
    options: BatchOptions,
    show: Show | None = None,
    notify: Callable[[str], None] | None = None,
    train: Callable[[str, int, int], None] | None = None,
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
    notify = notify or (lambda text: None)
    outcome = Outcome(folder, plan)
    since = perf_counter()
    policies = train_policies(runs.values(), options.mocap, options.threads, train, notify)
    plan = _with_policies(folder, plan, {name: policy.fingerprint for name, policy in policies.items()})
    uses = used_kernels(runs.values())
    compile_kernels(uses, options.threads, notify)
    with ExitStack() as stack:
        client = stack.enter_context(connect(options, security))
        progress = Progress(folder, plan.runs, dashboard_address(client))
        if progress.dashboard:
            notify(f"dashboard: {progress.dashboard}")
        stack.enter_context(_held(folder, options.command))
        plan = _begin(folder, client, plan, notify)
        if options.scheduler is not None:
            compile_on_hosts(client, uses)
        _freeze(folder, plan, runs)
        progress.done = {id for id, run in plan.runs.items() if is_done(folder, run)}
        outcome.kept = len(progress.done)
        times = [since, perf_counter()]
        session = Session(client, plan, options, progress, outcome, show, notify)
        session.run()
        times.append(perf_counter())
        session.draw_thumbnails()
        times.append(perf_counter())
        write_report(folder, plan)
        times.append(perf_counter())
        progress.write(now=True)
    stages = ("start", "runs", "pictures", "report")
    outcome.seconds = {name: times[i + 1] - times[i] for i, name in enumerate(stages)}
    return outcome


def _with_policies(folder: Path, plan: Plan, now: Mapping[str, str]) -> Plan:
    """Return a plan with the fingerprints of its policies, and of those that the batch had before."""
    before = read_plan(folder).policies if is_batch(folder) else {}
    again = {name: fingerprint for name, fingerprint in now.items() if name in before}
    _refuse_changes(folder, {"policies": before}, {"policies": {**before, **again}})
    return replace(plan, policies={**before, **now})


def _freeze(folder: Path, plan: Plan, runs: Mapping[str, Resolved]) -> None:
    """Write all that workers read into the folder of a batch."""
    write_plan(folder, plan)
    for resolved in runs.values():
        write_frozen(folder / SCENARIOS, resolved)
    freeze_policies(folder / POLICIES, plan.policies)


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


def _begin(folder: Path, client: Client, plan: Plan, notify: Callable[[str], None]) -> Plan:
    """Return the plan with the environment of the workers, once there are some and all have been checked."""
    if not client.scheduler_info(n_workers=-1)["workers"]:
        notify("waiting for workers of the scheduler")
        client.wait_for_workers(1)
    environment = check_workers(client, folder)
    if is_batch(folder):
        _refuse_changes(folder, read_plan(folder).environment, environment)
    return replace(plan, environment=environment)


def _check_folder(folder: Path) -> None:
    """Refuse a folder that holds something else than a batch, or a link to where the batch would write.

    Raises:
        BatchError: It does.
    """
    if folder.exists() and not folder.is_dir():
        raise BatchError(f"{folder}: is a file, expected a folder for the batch")
    for name in (NAME, RUNS, SCENARIOS, POLICIES, WORK, LOGS, RESULTS, REPORT):
        if (folder / name).is_symlink():
            raise BatchError(f"{folder / name}: is a symbolic link, expected none in the folder of a batch")
    if folder.is_dir() and not is_batch(folder):
        held = sorted(path.name for path in folder.iterdir() if not path.name.startswith(OWN))
        if held:
            raise BatchError(f"{folder}: holds {held[0]!r}, which is no batch's; expected an empty folder, see --out")


def _refuse_changes(folder: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    difference = document_difference(before, now)
    if difference:
        what = f"{folder}: holds a batch that cannot be continued, since something has changed; --out names another"
        raise BatchError("\n".join([what, *difference]))
