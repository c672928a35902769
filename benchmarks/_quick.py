"""The options that all benchmarks have, and what they run on with ``--quick``: policies learned in seconds."""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
COUNTS = {"distance": 8, "bearing": 8, "height": 2}
"""Grid points of each axis, at the most."""


def command_line(about: str | None, quick: str) -> argparse.ArgumentParser:
    """Return a parser of the options ``--json`` and ``--quick``; ``about`` is a docstring, or a sentence."""
    parser = argparse.ArgumentParser(description=(about or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
    parser.add_argument("--quick", action="store_true", help=quick)
    return parser


def best_seconds(work: Callable[[], object], repeats: int) -> float:
    """Return the shortest time of several runs [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def smaller(recipe: dict[str, Any], seconds: float, falls: bool = False) -> dict[str, Any]:
    """Return a recipe of the same behaviours that is learned in seconds; what learns from capture performs instead.

    Where the recipe's motion has falls, the small one's has falls and rests if ``falls`` are asked for.
    """
    performed = {"seconds": seconds, "seed": 2}
    if "stick" in recipe["motion"].get("performer", {}):
        performed["stick"] = recipe["motion"]["performer"]["stick"]
    if falls and recipe["motion"].get("performer", {}).get("falls"):
        performed |= {"falls": 1, "rests": 1}
    behaviours = {}
    for name, spec in recipe["behaviours"].items():
        axes = {
            key: axis if axis is None else {**axis, "count": min(axis["count"], COUNTS[key])}
            for key, axis in spec["axes"].items()
        }
        solver = {**spec.get("solver", {"kind": "value_iteration"}), "tolerance": 0.05, "max_sweeps": 20}
        behaviours[name] = {**spec, "axes": axes, "solver": solver, "finer": 1}
    return {
        **recipe,
        **({"defend": {"rounds": 2, "seconds": 10, "pairs": 8}} if "defend" in recipe else {}),
        "motion": {"performer": performed, "mirror": recipe["motion"].get("mirror", True)},
        "graph": {"threshold": 0.3, "spacing": 0.3, "branching": 6},
        "behaviours": behaviours,
    }


def with_policy(name: str, shipped: str = "boxer") -> list[str]:
    """Return what lets the boxers of a shipped scenario, who have the policy ``shipped``, fight by another one.

    That may have learned other behaviours: its recipe weighs them.
    """
    return [] if name == shipped else [f"types.boxer.policy={name}", "types.boxer.behaviours={}"]


@contextmanager
def small_policies(seconds: float = 24.0, falls: bool = False, wanted: bool = True) -> Iterator[None]:
    """Work in a folder where the shipped policies are small; they are trained there on first use.

    The working folder is where policies are looked for first. It is removed at the end.

    Args:
        seconds: Length of the performance that they learn from [s].
        falls: Whether those have falls whose recipes ask for them.
        wanted: Otherwise the shipped policies are used.
    """
    if not wanted:
        yield
        return
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        (folder / "policies").mkdir()
        for path in sorted((ROOT / "policies").glob("*.yaml")):
            outcome = smaller(yaml.safe_load(path.read_text(encoding="utf-8")), seconds, falls)
            outcome.pop("prune", None)
            (folder / "policies" / path.name).write_text(yaml.safe_dump(outcome, sort_keys=False), encoding="utf-8")
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)
