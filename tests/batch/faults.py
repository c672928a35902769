"""Faults that a worker injects into runs by their seeds; Dask loads this file into every worker of a test.

Seeds from 900 on fail, four kinds by turns: an exception, a crash, too much memory, a task that never ends.
"""

from __future__ import annotations

import ctypes
import time
from typing import Any

KINDS = ("raised", "crashed", "memory", "hung")


def fail(seed: int) -> None:
    """Fail as a seed says."""
    kind = KINDS[seed % 4]
    if kind == "raised":
        raise ValueError(f"seed {seed} is not liked")
    if kind == "crashed":
        ctypes.string_at(0)
    if kind == "memory":
        held = []
        while True:
            held.append(bytearray(50_000_000))
            time.sleep(0.05)
    while True:
        time.sleep(0.05)


def dask_setup(worker: Any) -> None:
    """Let runs of some seeds fail in this worker."""
    from crowdsim.runs import runner

    run_to = runner.run_to

    def run_or_fail(folder: Any, scenario: Any, *values: Any, **named: Any) -> Any:
        if scenario.seed >= 900:
            fail(scenario.seed)
        return run_to(folder, scenario, *values, **named)

    runner.run_to = run_or_fail
