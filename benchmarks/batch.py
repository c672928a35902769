"""Many small runs: what does a batch cost beside them, and do two workers take half the time of one?

    python benchmarks/batch.py [--json] [--quick] [--runs N]

A hundred small runs, ``duel`` without outputs for 300 control frames, with a seed each, are done by ``crowdsim batch``
with one worker and with two, and some of them by a shell loop over ``crowdsim run`` on one thread. Kernels are compiled
and the policy is trained before. ``seconds`` is the time from the first run to the last; ``start_seconds`` that of
starting workers, ``after_seconds`` that of small pictures and the report. ``own_milliseconds`` is what a run takes by
its manifest, the median; ``overhead_milliseconds`` what a run takes of a worker's time beside that. ``speedup`` is the
time with one worker over that with two.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

from _quick import command_line, small_policies

from crowdsim.batch.description import load_batch
from crowdsim.batch.results import read_result
from crowdsim.batch.running import plan_batch, run_batch
from crowdsim.batch.workers import BatchOptions

RUNS, QUICK_RUNS = 100, 6
LOOP, QUICK_LOOP = 20, 2
FRAMES, QUICK_FRAMES = 300, 30


def batch(folder: Path, runs: int, frames: int, jobs: int) -> dict[str, float]:
    """Return what a batch takes."""
    file = folder / "batch.yaml"
    axes = [{"seed": f"0:{runs}"}, {"duration": [frames]}]
    description = {"version": 1, "name": "runs", "scenarios": ["duel"], "axes": axes, "outputs": {}}
    file.write_text(json.dumps(description), encoding="utf-8")
    out = folder / f"jobs_{jobs}"
    plan, resolved = plan_batch(out, load_batch(file))
    outcome = run_batch(out, plan, resolved, BatchOptions(jobs=jobs))
    if outcome.failures:
        raise RuntimeError(f"runs failed: {outcome.failures}")
    own = [read_result(out, id)["seconds"]["total"] for id in plan.runs]
    taken = outcome.seconds["runs"]
    return {
        "seconds": taken,
        "start_seconds": outcome.seconds["start"],
        "after_seconds": outcome.seconds["pictures"] + outcome.seconds["report"],
        "own_milliseconds": 1000 * statistics.median(own),
        "overhead_milliseconds": 1000 * (taken * jobs - sum(own)) / runs,
    }


def loop(folder: Path, runs: int, frames: int) -> float:
    """Return what a run takes in a loop over ``crowdsim run`` [s]."""
    program = [sys.executable, "-m", "crowdsim.cli", "run", "duel", "--set", "outputs={}", "--frames", str(frames)]
    paths = [str(Path(__file__).resolve().parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    since = perf_counter()
    for seed in range(runs):
        command = [*program, "--seed", str(seed), "--threads", "1", "--quiet", "--out", str(folder / f"loop_{seed}")]
        subprocess.run(command, check=True, env=environment)
    return (perf_counter() - since) / runs


def measure(runs: int, looped: int, frames: int) -> dict[str, Any]:
    """Return all figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # Compiles and trains what is missing.
        (folder / "first").mkdir()
        batch(folder / "first", 2, frames, 1)
        each = loop(folder, looped, frames)
        found = {jobs: batch(folder, runs, frames, jobs) for jobs in (1, 2)}
    return {
        "runs": runs,
        "workers_1": found[1],
        "workers_2": found[2],
        "speedup": found[1]["seconds"] / found[2]["seconds"],
        "loop_seconds_per_run": each,
        "loop_over_workers_1": each * runs / found[1]["seconds"],
    }


def main() -> None:
    """Measure and print."""
    parser = command_line(__doc__, "few short runs and a small policy: it runs, no more")
    parser.add_argument("--runs", type=int, default=RUNS, help="number of runs")
    options = parser.parse_args()
    with small_policies(wanted=options.quick):
        report = measure(QUICK_RUNS, QUICK_LOOP, QUICK_FRAMES) if options.quick else measure(options.runs, LOOP, FRAMES)
    if options.json:
        print(json.dumps(report, indent=2))
        return
    for key, value in report.items():
        for name, figure in value.items() if isinstance(value, dict) else [("", value)]:
            print(f"{key} {name}".strip().ljust(34), f"{figure:.4g}")


if __name__ == "__main__":
    main()
