"""Runs every benchmark beside this file, prints a table of the figures, and writes one JSON document.

    python benchmarks/run_all.py [NAME ...] [--quick] [--json] [--out benchmarks/results.json]

Each benchmark's entry states the commit, the date, the kind of machine, the versions of the packages that figures
depend on, and whether it was a quick run. Entries are merged into the document, and written after each benchmark, so
one benchmark can be measured again alone. A benchmark that fails is reported and keeps its previous entry; so does one
that this machine lacks something for, such as a GPU, which is no failure.

With ``--quick`` every benchmark runs for seconds at tiny sizes: the figures only show that it runs. Nothing is written
then unless ``--out`` is given, and a quick entry never replaces a full one. ``docs/make_tables.py`` makes the tables of
the documentation from the document.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import math
import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import psutil

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results.json"
FORMAT, VERSION = "crowdsim-benchmarks", 2
SECONDS = 3600
"""Time that a benchmark may take [s]."""
LACKING = 77
"""Exit code of a benchmark that this machine lacks something for, after a line that says what."""
MEASURED = ("benchmarks", "crowdsim", "policies", "pyproject.toml", "scenarios", ":!benchmarks/results.json")
"""What figures depend on in a checkout."""
PACKAGES = ("numpy", "scipy", "numba", "open3d-cpu", "open3d", "zarr", "upc-pymotion", "pybvh", "bvhio", "polars",
            "quantecon", "scikit-learn", "jupedsim", "orjson", "distributed")  # fmt: skip


def names() -> list[str]:
    """Names of the benchmarks."""
    return sorted(
        path.stem for path in HERE.glob("*.py") if path.stem not in ("run_all",) and not path.stem.startswith("_")
    )


def run(name: str, quick: bool = False) -> dict[str, Any]:
    """Run one benchmark in a process of its own and return its results, or why it failed or cannot be measured here."""
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
        outcome = "not measured" if done.returncode == LACKING else "failed"
        if done.returncode < 0:
            last = lines[-1] if lines else "nothing"
            lines.append(f"ended by {signal.Signals(-done.returncode).name} after {last!r}")
        return {outcome: lines[-1] if lines else f"exit code {done.returncode}"}
    try:
        results = json.loads(done.stdout)
    except ValueError:
        return {"failed": "printed no JSON document"}
    return {"seconds": round(time.perf_counter() - started, 1), "results": portable(results)}


def portable(results: Any) -> Any:
    """Return results with null for what is no finite number, and with file names for absolute paths."""
    if isinstance(results, dict):
        return {key: portable(value) for key, value in results.items()}
    if isinstance(results, list):
        return [portable(value) for value in results]
    if isinstance(results, float) and not math.isfinite(results):
        return None
    if isinstance(results, str) and Path(results).is_absolute():
        return Path(results).name
    return results


def commit() -> str | None:
    """The commit that is measured, with ``-dirty`` where it has changes; None outside of a checkout.

    Changes of the documentation and of the results themselves do not count.
    """
    try:
        head = git("rev-parse", "HEAD")
        changes = git("status", "--porcelain", "--untracked-files=no", "--", *MEASURED)
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{head}-dirty" if changes else head


def git(*words: str) -> str:
    """Return what a git command prints for the checkout that this file is in."""
    command = ["git", "-C", str(HERE.parent), *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def processor() -> str:
    """The processor's model, or its architecture where the system does not say."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def machine() -> str:
    """The kind of machine, such as ``2 cores, Intel(R) Xeon(R) Processor``: nothing that names this one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = round(psutil.virtual_memory().total / 2**30)
    return f"{cores} core{'s' if cores != 1 else ''}, {processor()}, {memory} GiB, {platform.system()}"


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that figures depend on, of those that are installed."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def measure(
    chosen: Sequence[str], quick: bool, done: Callable[[str, dict[str, Any]], None]
) -> dict[str, dict[str, str]]:
    """Run benchmarks one after another, pass on each entry as it comes; return why others have none."""
    known = {
        "commit": commit(),
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": versions(),
        "quick": quick,
    }
    without: dict[str, dict[str, str]] = {"failed": {}, "not measured": {}}
    for name in chosen:
        print(f"{name} ...", file=sys.stderr, flush=True)
        outcome = run(name, quick)
        if "results" in outcome:
            done(name, {**known, **outcome})
        for kind in without.keys() & outcome.keys():
            without[kind][name] = outcome[kind]
            print(f"{name} {kind}: {outcome[kind]}", file=sys.stderr, flush=True)
    return without


def empty() -> dict[str, Any]:
    """Return a document without benchmarks."""
    return {"format": FORMAT, "version": VERSION, "benchmarks": {}}


def read(path: Path) -> dict[str, Any]:
    """Return the document in a file; an empty one where there is none or one of another version."""
    if not path.exists():
        return empty()
    document = json.loads(path.read_text(encoding="utf-8"))
    return document if (document.get("format"), document.get("version")) == (FORMAT, VERSION) else empty()


def merge(document: dict[str, Any], name: str, entry: dict[str, Any]) -> dict[str, Any]:
    """Return a document with one more entry, in the order of names; a quick entry does not replace a full one."""
    kept = document["benchmarks"]
    if entry["quick"] and name in kept and not kept[name]["quick"]:
        return document
    return {**document, "benchmarks": dict(sorted({**kept, name: entry}.items()))}


def write(path: Path, document: dict[str, Any]) -> None:
    """Write a document; a reader never sees half of it."""
    partial = path.with_name(f"{path.name}.partial")
    partial.write_text(f"{json.dumps(document, indent=2, allow_nan=False)}\n", encoding="utf-8")
    partial.replace(path)


def flat(results: Any, prefix: str = "") -> list[tuple[str, Any]]:
    """Leaves of nested results with dotted names."""
    if isinstance(results, dict):
        return [leaf for key, value in results.items() for leaf in flat(value, f"{prefix}.{key}" if prefix else key)]
    return [(prefix, results)]


def table(document: dict[str, Any], without: dict[str, dict[str, str]]) -> str:
    """The figures as a table, and why benchmarks have none."""
    lines = ["| benchmark | figure | value |", "|---|---|---|"]
    for name, entry in document["benchmarks"].items():
        for key, value in flat(entry["results"]):
            if isinstance(value, int | float) and not isinstance(value, bool):
                lines.append(f"| {name} | {key} | {value:.4g} |")
    lines += [f"| {name} | {kind} | {why} |" for kind, reasons in without.items() for name, why in reasons.items()]
    return "\n".join(lines)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(names())}; all by default")
    parser.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
    parser.add_argument("--quick", action="store_true", help="seconds each: tiny sizes, to see that all run")
    parser.add_argument("--out", type=Path, help=f"JSON document to merge into; {RESULTS.name} beside this file")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in names()]
    if unknown:
        parser.error(f"no benchmark {unknown[0]!r}, there are {', '.join(names())}")
    out = options.out or (None if options.quick else RESULTS)
    measured = empty()

    def keep(name: str, entry: dict[str, Any]) -> None:
        measured["benchmarks"][name] = entry
        if out is not None:
            write(out, merge(read(out), name, entry))

    without = measure(options.names or names(), options.quick, keep)
    print(json.dumps({**measured, **without}, indent=2) if options.json else table(measured, without))
    if out is not None and measured["benchmarks"]:
        print(f"{out}: {len(measured['benchmarks'])} benchmarks written", file=sys.stderr)
    for kind, reasons in without.items():
        if reasons:
            print(f"{kind}, previous figures kept: {', '.join(reasons)}", file=sys.stderr)
    if without["failed"]:
        sys.exit(1)


if __name__ == "__main__":
    main()
