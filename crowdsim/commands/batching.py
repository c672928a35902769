"""The command ``batch``."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdsim.commands.common import (
    Device,
    Json,
    Mocap,
    Threads,
    complete_scenario,
    detail,
    print_json,
    say,
    size_text,
    talk,
)
from crowdsim.commands.process import escaped, terminal
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError

if TYPE_CHECKING:
    from crowdsim.batch.description import Batch
    from crowdsim.batch.plan import Plan
    from crowdsim.batch.results import Progress
    from crowdsim.batch.running import Outcome
    from crowdsim.scenario.scenario import Scenario

_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0}
_SIZES = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}


def batch(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="BATCH.yaml|SCENARIO", help="A batch file, or scenarios.", autocompletion=complete_scenario
        ),
    ],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of the batch; output/NAME else.")] = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="A:B", help="Seeds of scenarios, half-open, or numbers with commas between.")
    ] = None,
    sweep: Annotated[
        list[str] | None, typer.Option(metavar="KEY=V,V", help="Values of a key, groups[0].count=5,15,30 say.")
    ] = None,
    override: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Another value, groups[0].count=12 say.")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=1024, help="Workers of this machine; as many as fit else."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler with workers, tls://HOST:8786 say.")
    ] = None,
    ca_file: Annotated[
        Path | None, typer.Option("--tls-ca-file", metavar="FILE", help="Certificate that signed the scheduler's.")
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option("--tls-cert", metavar="FILE", help="Certificate to show to the scheduler.")
    ] = None,
    key: Annotated[Path | None, typer.Option("--tls-key", metavar="FILE", help="Key of this certificate.")] = None,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Use a scheduler without TLS; all who reach it run programs as you do.")
    ] = False,
    dashboard: Annotated[
        bool, typer.Option("--dashboard", help="Serve Dask's dashboard, which all users of this machine can read.")
    ] = False,
    fail_fast: Annotated[
        bool, typer.Option("--fail-fast/--keep-going", help="End at the first run that fails, or do all others.")
    ] = False,
    retries: Annotated[
        int, typer.Option(metavar="N", min=0, max=100, help="How often a task that failed is tried again.")
    ] = 1,
    timeout: Annotated[str, typer.Option(metavar="TIME", help="How long a task of a run may take, 30m say.")] = "30m",
    memory: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Memory of a worker, 4G say; its share by default.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List the runs and what they take; run nothing.")] = False,
    threads: Threads = CORES,
    device: Device = "cpu",
    mocap: Mocap = None,
    as_json: Json = False,
) -> None:
    """Run many scenarios: sweeps over seeds and other keys, on this machine or on a Dask cluster."""
    from crowdsim.batch.description import with_overrides
    from crowdsim.batch.running import plan_batch, run_batch
    from crowdsim.batch.workers import BatchOptions
    from crowdsim.crowd.cuda.device import check_device, choose_device, gpu_count

    wanted = with_overrides(_read_batch(files, seeds, sweep or []), override or ())
    limit, most = _parse_time(timeout), None if memory is None else _parse_size(memory)
    if scheduler is not None and (jobs is not None or memory is not None):
        raise CrowdsimError("batch --scheduler: has workers of its own, expected neither --jobs nor --memory")
    if scheduler is not None and dashboard:
        raise CrowdsimError("batch --scheduler: has a dashboard of its own, expected no --dashboard")
    check_device(device)
    if scheduler is None and (insecure or {ca_file, certificate, key} != {None}):
        raise CrowdsimError("batch: --insecure and certificates are for another scheduler, expected --scheduler")
    folder = out or Path("output") / wanted.name
    with Bars() as bars:
        plan, runs = plan_batch(folder, wanted, bars)
    if dry_run:
        _print_plan(folder, plan, as_json)
        return
    workers = jobs or _fitting_workers(plan)
    if scheduler is None and "cuda" in [choose_device(device, *_size_of(run.scenario)) for run in runs.values()]:
        workers = min(workers, gpu_count())
    command = shlex.join(["crowdsim", *sys.argv[1:]])
    options = BatchOptions(
        workers, scheduler, insecure, ca_file, certificate, key, dashboard, fail_fast, retries, limit, most, mocap,
        threads, command, device,
    )  # fmt: skip
    detail(f"{plan.batch.name}: {len(plan.runs):,} runs into {folder}")
    with Bars() as bars, _BatchBars(plan) as shown:
        outcome = run_batch(folder, plan, runs, options, shown, shown.note, bars)
    if as_json:
        print_json(
            {
                "batch": plan.batch.name, "folder": str(folder), "runs": len(plan.runs), "kept": outcome.kept,
                "done": outcome.done, "failed": len(outcome.failures), "left": outcome.left,
                "seconds": outcome.seconds, "failures": outcome.failures,
            }
        )  # fmt: skip
    elif not talk.quiet:
        _print_outcome(outcome)
    if outcome.failures:
        for id, failure in outcome.failures.items():
            print(f"{plan.runs[id].folder}: {failure['task']}: {failure['message']}", file=sys.stderr)
        print(f"{len(outcome.failures)} of {len(plan.runs)} runs failed", file=sys.stderr)
        sys.exit(1)


def _size_of(scenario: Scenario) -> tuple[int, str]:
    """Return what decides about the device of a run: how many avatars it has, and how they find opponents."""
    return scenario.avatar_count, scenario.opponents.search


def _read_batch(files: list[str], seeds: str | None, sweeps: list[str]) -> Batch:
    """Return the batch that a file describes, or scenarios with options."""
    from crowdsim.batch.description import batch_of_options, is_batch_file, load_batch

    described = [name for name in files if is_batch_file(name)]
    if not described:
        return batch_of_options(files, seeds, sweeps)
    if len(files) > 1:
        raise CrowdsimError(f"{described[0]}: is a batch file, expected it alone")
    if seeds is not None or sweeps:
        raise CrowdsimError(f"{described[0]}: has axes of its own, expected neither --seeds nor --sweep")
    return load_batch(described[0])


def _fitting_workers(plan: Plan) -> int:
    """Return how many workers the machine has cores, memory and runs for."""
    from crowdsim.machine import available_memory

    most = max(run.estimate.memory for run in plan.runs.values())
    available = available_memory()
    fitting = CORES if available is None else int(available // most)
    return max(1, min(CORES, len(plan.runs), fitting))


def _print_plan(folder: Path, plan: Plan, as_json: bool) -> None:
    from crowdsim.batch.results import is_done

    done = {id for id, run in plan.runs.items() if is_done(folder, run)}
    if not as_json:
        _print_runs(plan, done)
        return
    values = {id: {"scenario": one.scenario, **one.values} for one, id in reversed(plan.combinations)}
    runs: list[dict[str, Any]] = [
        {
            "run": id, "folder": str(folder / run.folder), "done": id in done, "values": values[id], "seed": run.seed,
            "avatars": run.avatars, "control_frames": run.control_frames, "bytes": round(run.estimate.bytes),
            "memory_bytes": round(run.estimate.memory), "minutes": round(run.estimate.seconds / 60, 4),
        }
        for id, run in plan.runs.items()
    ]  # fmt: skip
    print_json({"batch": plan.batch.name, "folder": str(folder), "runs": runs})


def _parse_time(text: str) -> float:
    """Return the seconds that ``30m``, ``90s`` or ``2h`` are."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([smh]?)\s*", text)
    if match is None or not 0 < float(match[1]) * _UNITS.get(match[2], 1.0) <= 1e7:
        raise CrowdsimError(f"timeout {text!r}: expected a time above 0, such as 90s, 30m or 2h")
    return float(match[1]) * _UNITS.get(match[2], 1.0)


def _parse_size(text: str) -> int:
    """Return the bytes that ``500M`` or ``4G`` are."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([kmgt]?)i?b?\s*", text.lower())
    if match is None or float(match[1]) * _SIZES[match[2]] < 1e6:
        raise CrowdsimError(f"memory {text!r}: expected a size of at least 1M, such as 500M or 4G")
    return int(float(match[1]) * _SIZES[match[2]])


def _print_runs(plan: Plan, done: set[str]) -> None:
    """Print the runs of a plan with what they take, and all together."""
    labels = {id: str(one) for one, id in reversed(plan.combinations)}
    width = max(map(len, labels.values()))
    heads = "".join(f"  {name:>9}" for name in ("avatars", "frames", "disk", "memory"))
    say(f"{'run':<{width}}  {'id':<16}  {'seed':>6}{heads}  minutes")
    for id, run in plan.runs.items():
        disk, memory = size_text(run.estimate.bytes), size_text(run.estimate.memory)
        size = f"{run.avatars:>9,}  {run.control_frames:>9,}  {disk:>9}  {memory:>9}  {run.estimate.seconds / 60:7.2f}"
        say(f"{labels[id]:<{width}}  {id}  {run.seed:>6}  {size}{'  done' if id in done else ''}")
    left = [run.estimate for id, run in plan.runs.items() if id not in done]
    total, most = size_text(sum(one.bytes for one in left)), max((one.memory for one in left), default=0.0)
    say(
        f"{len(left):,} of {len(plan.runs):,} runs to do: {total} on disk, {size_text(most)} of memory a worker, "
        f"{sum(one.seconds for one in left) / 60:.1f} minutes of one core"
    )
    same = len(plan.combinations) - len(plan.runs)
    if same:
        say(f"{same:,} combinations give the same scenario as another one, and are not run again")


def time_text(seconds: float) -> str:
    """Return a time in the units that suit it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class _BatchBars:
    """How far a batch is, on standard error; called with its progress.

    On a terminal there is a bar for all runs and one for each that a worker is at. Elsewhere each run that ends has a
    line of plain text. With ``--quiet`` there is neither.
    """

    def __init__(self, plan: Plan) -> None:
        self._labels = {id: str(one) for one, id in reversed(plan.combinations)}
        self._order = list(plan.runs)
        self._ended: set[str] | None = None
        self._all: Any = None
        self._each: dict[str, Any] = {}

    def __call__(self, progress: Progress) -> None:
        """Show it."""
        ended, total, live = progress.done | progress.failed, len(self._order), sys.stderr.isatty()
        if talk.quiet:
            return
        if self._ended is None:
            self._ended = set(progress.done)
            if progress.done:
                self.note(f"{len(progress.done):,} of {total:,} runs are finished already")
        seconds = None if len(ended) == total else progress.seconds_left()
        remaining = "" if seconds is None else f", about {time_text(seconds)} left"
        if live:
            self._show_bars(progress, len(ended), remaining.removeprefix(", "))
        for number, id in enumerate(sorted(ended - self._ended, key=self._order.index), len(self._ended) + 1):
            what = "failed" if id in progress.failed else "done"
            if not live or what == "failed":
                self.note(f"{number:,} of {total:,}: {self._labels[id]}: {what}{remaining}")
        self._ended |= ended

    def note(self, text: str) -> None:
        """Print a line of its own, above the bars where there are some."""
        if talk.quiet:
            return
        if self._all is not None:
            self._all.write(escaped(text), file=terminal())
        else:
            print(text, file=sys.stderr, flush=True)

    def _show_bars(self, progress: Progress, ended: int, remaining: str) -> None:
        from tqdm import tqdm

        # Some terminals say that they have no columns and no rows.
        columns, rows = shutil.get_terminal_size((80, 24))
        size: dict[str, Any] = {"file": terminal(), "ncols": columns, "nrows": rows}
        if self._all is None:
            form = "{desc}: {n_fmt} of {total_fmt} |{bar}| {elapsed}{postfix}"
            self._all = tqdm(total=len(self._order), desc="runs", bar_format=form, position=0, **size)
        self._all.n = ended
        self._all.set_postfix_str(remaining, refresh=False)
        self._all.refresh()
        for id in [id for id in self._each if id not in progress.active]:
            self._each.pop(id).close()
        for id, (stage, done, total) in list(progress.active.items())[:8]:
            if id not in self._each:
                form = "  {desc} |{bar:20}| {n_fmt} of {total_fmt}"
                self._each[id] = tqdm(bar_format=form, leave=False, **size)
            bar = self._each[id]
            bar.set_description_str(f"{self._labels[id]}, {stage}", refresh=False)
            bar.total, bar.n = total, done
            bar.refresh()

    def __enter__(self) -> _BatchBars:
        return self

    def __exit__(self, *_: object) -> None:
        for bar in self._each.values():
            bar.close()
        with suppress(AttributeError):
            self._all.close()


def _print_outcome(outcome: Outcome) -> None:
    """Print what came of a batch, on one screen."""
    from crowdsim.batch.attempts import KINDS
    from crowdsim.batch.plan import REPORT
    from crowdsim.batch.report import INDEX, SUMMARY

    seconds = outcome.seconds
    print(outcome.folder)
    kept = f", {outcome.kept:,} before" if outcome.kept else ""
    print(f"  runs      {len(outcome.plan.runs):,}: {outcome.done:,} done{kept}, {len(outcome.failures):,} failed")
    if outcome.left:
        print(f"  left      {outcome.left:,}, after the first failure")
    causes = Counter(failure["cause"] for failure in outcome.failures.values())
    for cause, count in causes.most_common():
        print(f"  failed    {count:,}: {KINDS.get(cause, cause)}")
    for failure in list(outcome.failures.values())[:10]:
        print(f"  to repeat {failure['command'] or 'the same batch'}")
    print(f"  report    {outcome.folder / REPORT / INDEX}, {SUMMARY}")
    print(f"  seconds   {', '.join(f'{stage} {value:.1f}' for stage, value in seconds.items())}")
