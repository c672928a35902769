"""Runs every benchmark beside this file, prints a table of the figures, and writes one JSON document.

    python benchmarks/run_all.py [NAME ...] [--quick] [--json] [--out benchmarks/results.json]

The document says of what commit the figures are, when and on what kind of machine they were measured, and with which
versions of the packages that they depend on. With ``--quick`` every benchmark runs for seconds at tiny sizes: then the
figures only tell that it runs, and nothing is written unless ``--out`` is given.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import psutil

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results.json"
FORMAT, VERSION = "crowdsim-benchmarks", 1
SECONDS = 1800
PACKAGES = ("numpy", "scipy", "numba", "open3d-cpu", "open3d", "zarr", "upc-pymotion", "pybvh", "bvhio", "polars",
            "quantecon", "scikit-learn", "jupedsim", "orjson")  # fmt: skip


def names() -> list[str]:
    """Names of the benchmarks."""
    return sorted(
        path.stem for path in HERE.glob("*.py") if path.stem not in ("run_all",) and not path.stem.startswith("_")
    )


def run(name: str, quick: bool = False) -> dict[str, Any]:
    """Run one benchmark in a process of its own and return its results, or why it failed."""
    started = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, str(HERE / f"{name}.py"), "--json", *(["--quick"] if quick else [])],
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {"failed": f"not done in {SECONDS} s"}
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        return {"failed": lines[-1] if lines else f"exit {done.returncode}"}
    return {"seconds": round(time.perf_counter() - started, 1), "results": json.loads(done.stdout)}


def commit() -> str | None:
    """The commit that is measured, with ``-dirty`` where the checkout has changes; None outside of a checkout."""
    try:
        done = subprocess.run(
            ["git", "-C", str(HERE), "describe", "--always", "--abbrev=40", "--dirty", "--exclude=*"],
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError:
        return None
    return done.stdout.strip() or None


def processor() -> str:
    """The processor's model, or its architecture where the system does not say."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def machine() -> dict[str, Any]:
    """The kind of machine: nothing that names this one."""
    return {
        "processor": processor(),
        "architecture": platform.machine(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
        "system": platform.system(),
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that figures depend on, of those that are installed."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def measure(chosen: Sequence[str], quick: bool) -> dict[str, Any]:
    """Run benchmarks one after another and return the document."""
    document: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "commit": commit(),
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": versions(),
        "quick": quick,
        "benchmarks": {},
    }
    for name in chosen:
        print(f"{name} ...", file=sys.stderr, flush=True)
        document["benchmarks"][name] = run(name, quick)
    return document


def flat(results: Any, prefix: str = "") -> list[tuple[str, Any]]:
    """Leaves of nested results with dotted names."""
    if isinstance(results, dict):
        return [leaf for key, value in results.items() for leaf in flat(value, f"{prefix}.{key}" if prefix else key)]
    return [(prefix, results)]


def table(document: dict[str, Any]) -> str:
    """The figures as a table."""
    lines = ["| benchmark | figure | value |", "|---|---|---|"]
    for name, outcome in document["benchmarks"].items():
        if "failed" in outcome:
            lines.append(f"| {name} | failed | {outcome['failed']} |")
            continue
        for key, value in flat(outcome["results"]):
            if isinstance(value, int | float) and not isinstance(value, bool):
                lines.append(f"| {name} | {key} | {value:.4g} |")
    return "\n".join(lines)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(names())}; all by default")
    parser.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
    parser.add_argument("--quick", action="store_true", help="seconds each: tiny sizes, to see that all run")
    parser.add_argument("--out", type=Path, help=f"file of the JSON document; {RESULTS.name} beside this file")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in names()]
    if unknown:
        parser.error(f"no benchmark {unknown[0]!r}, there are {', '.join(names())}")
    document = measure(options.names or names(), options.quick)
    text = json.dumps(document, indent=2)
    whole = not options.names and not options.quick
    out = options.out or (RESULTS if whole else None)
    if out is not None:
        out.write_text(f"{text}\n", encoding="utf-8")
        print(f"{out} written", file=sys.stderr)
    print(text if options.json else table(document))
    if any("failed" in outcome for outcome in document["benchmarks"].values()):
        sys.exit(1)


if __name__ == "__main__":
    main()
