"""The command ``batch``."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdsim.commands.batch_text import BatchBars, plan_lines, print_outcome
from crowdsim.commands.common import Json, Mocap, Threads, complete_scenario, detail, print_json, say, talk
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError

if TYPE_CHECKING:
    from crowdsim.batch.description import Batch
    from crowdsim.batch.plan import Plan

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
    mocap: Mocap = None,
    as_json: Json = False,
) -> None:
    """Run many scenarios: sweeps over seeds and other keys, on this machine or on a Dask cluster."""
    from crowdsim.batch.description import with_overrides
    from crowdsim.batch.engine import BatchOptions
    from crowdsim.batch.running import plan_batch, run_batch

    wanted = with_overrides(_read_batch(files, seeds, sweep or []), override or ())
    limit, most = _parse_time(timeout), None if memory is None else _parse_size(memory)
    if scheduler is not None and (jobs is not None or memory is not None):
        raise CrowdsimError("batch --scheduler: has workers of its own, expected neither --jobs nor --memory")
    if scheduler is not None and dashboard:
        raise CrowdsimError("batch --scheduler: has a dashboard of its own, expected no --dashboard")
    if scheduler is None and (insecure or {ca_file, certificate, key} != {None}):
        raise CrowdsimError("batch: --insecure and certificates are for another scheduler, expected --scheduler")
    folder = out or Path("output") / wanted.name
    with Bars() as bars:
        plan, runs = plan_batch(folder, wanted, bars)
    if dry_run:
        _print_plan(folder, plan, as_json)
        return
    workers = jobs or _fitting_workers(plan)
    command = shlex.join(["crowdsim", *sys.argv[1:]])
    options = BatchOptions(
        workers, scheduler, insecure, ca_file, certificate, key, dashboard, fail_fast, retries, limit, most, mocap,
        threads, command,
    )  # fmt: skip
    detail(f"{plan.batch.name}: {len(plan.runs):,} runs into {folder}")
    with Bars() as bars, BatchBars(plan) as shown:
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
        print_outcome(outcome)
    if outcome.failures:
        for id, failure in outcome.failures.items():
            print(f"{plan.runs[id].folder}: {failure['task']}: {failure['message']}", file=sys.stderr)
        print(f"{len(outcome.failures)} of {len(plan.runs)} runs failed", file=sys.stderr)
        sys.exit(1)


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
        for line in plan_lines(plan, done):
            say(line)
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
