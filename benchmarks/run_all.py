"""Runs every benchmark beside this file and prints the table of claims that the README shows.

``python benchmarks/run_all.py [NAME ...]``; with ``--json`` all results as one document.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
SECONDS = 1800


def names() -> list[str]:
    """Names of the benchmarks."""
    return sorted(
        path.stem for path in HERE.glob("*.py") if path.stem not in ("run_all",) and not path.stem.startswith("_")
    )


def run(name: str) -> dict[str, Any]:
    """Run one benchmark in a process of its own and return what it told, or why it failed."""
    started = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, str(HERE / f"{name}.py"), "--json"],
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


def flat(told: Any, prefix: str = "") -> list[tuple[str, Any]]:
    """Leaves of nested results with dotted names."""
    if isinstance(told, dict):
        return [leaf for key, value in told.items() for leaf in flat(value, f"{prefix}.{key}" if prefix else str(key))]
    return [(prefix, told)]


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(names())}; all by default")
    parser.add_argument("--json", action="store_true", help="one JSON document and nothing else")
    chosen = parser.parse_args()
    unknown = [name for name in chosen.names if name not in names()]
    if unknown:
        parser.error(f"no benchmark {unknown[0]!r}, there are {', '.join(names())}")
    told = {}
    for name in chosen.names or names():
        print(f"{name} ...", file=sys.stderr, flush=True)
        told[name] = run(name)
    if chosen.json:
        print(json.dumps(told, indent=2))
        return
    print("| benchmark | figure | value |\n|---|---|---|")
    for name, outcome in told.items():
        if "failed" in outcome:
            print(f"| {name} | failed | {outcome['failed']} |")
            continue
        for key, value in flat(outcome["results"]):
            if isinstance(value, int | float) and not isinstance(value, bool):
                print(f"| {name} | {key} | {value:.4g} |")
    if any("failed" in outcome for outcome in told.values()):
        sys.exit(1)


if __name__ == "__main__":
    main()
