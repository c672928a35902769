"""What the first result costs: ``crowdsim run brawl_30`` with nothing compiled and nothing trained, and once more.

    python benchmarks/first_run.py [--threads N] [--json] [--quick]

* first: kernels are compiled, the embedded boxer is trained, the brawl is simulated and its outputs are written.
* again: the same with ``--force``; kernels and policy are there.

Both give the seconds of each stage as ``crowdsim run --json`` reports them, and ``wall_seconds`` of the whole command.
``outputs`` holds files and megabytes of each output. With ``--quick`` kernels that are compiled already are used.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from _quick import small_policies

POLICIES = Path(__file__).resolve().parent.parent / "policies"
QUICK = ("--frames", "60", "--fraction", "0.2")


@contextmanager
def untrained() -> Iterator[None]:
    """Work in a folder with the shipped recipes, none of them trained, and with no compiled kernels."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        (folder / "policies").mkdir()
        for path in POLICIES.glob("*.yaml"):
            shutil.copy(path, folder / "policies")
        os.chdir(folder)
        cache = os.environ.get("NUMBA_CACHE_DIR")
        os.environ["NUMBA_CACHE_DIR"] = str(folder / "kernels")
        try:
            yield
        finally:
            os.environ.pop("NUMBA_CACHE_DIR")
            if cache is not None:
                os.environ["NUMBA_CACHE_DIR"] = cache
            os.chdir(before)


def timed(*words: str) -> dict[str, Any]:
    """Run the brawl in the working folder; return what the command reports, and how long it took [s]."""
    program = "from crowdsim.cli import main; main()"
    command = [sys.executable, "-c", program, "run", "brawl_30", "--out", "brawl_30", "--json", *words]
    started = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr.strip() or "crowdsim run brawl_30 failed")
    return {**json.loads(done.stdout)["runs"][0], "wall_seconds": time.perf_counter() - started}


def measure(threads: int, quick: bool) -> dict[str, Any]:
    """Return all figures."""
    words = ("--threads", str(threads), *(QUICK if quick else ()))
    with small_policies() if quick else untrained():
        first, again = timed(*words), timed(*words, "--force")
    return {
        "threads": threads,
        "avatars": again["avatars"],
        "control_frames": again["control_frames"],
        "first": {**first["seconds"], "wall_seconds": first["wall_seconds"]},
        "again": {**again["seconds"], "wall_seconds": again["wall_seconds"]},
        "outputs": {
            name: {"files": one["files"], "megabytes": one["bytes"] / 1e6} for name, one in again["outputs"].items()
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="What the first result costs.")
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
    parser.add_argument("--quick", action="store_true", help="seconds: six avatars, 4 s, a small policy")
    options = parser.parse_args()
    outcome = measure(options.threads, options.quick)
    if options.json:
        print(json.dumps(outcome, indent=2))
        return
    print(f"brawl_30, {outcome['avatars']} avatars, {outcome['control_frames']} control frames [s]")
    print(f"{'':<16}{'first':>9}{'again':>9}")
    for stage, seconds in outcome["first"].items():
        print(f"{stage:<16}{seconds:9.2f}{outcome['again'].get(stage, 0.0):9.2f}")
    for name, one in outcome["outputs"].items():
        print(f"{name}: {one['files']} files, {one['megabytes']:.1f} MB")


if __name__ == "__main__":
    main()
