"""How a batch is done, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crowdsim.batch.plan import Plan
from crowdsim.core.types import FileName


@dataclass(frozen=True)
class BatchOptions:
    """How a batch is done.

    Attributes:
        jobs: Workers of this machine.
        scheduler: Address of a scheduler with workers of its own.
        fail_fast: Whether the first failure ends the batch.
        retries: How often a task that failed is tried again.
        timeout: How long a task may take [s].
        memory: Memory that a worker of this machine may take [bytes].
        mocap: Folder of capture for policies that are trained from it.
        threads: Threads that train and compile beforehand.
        command: The command, for manifests.
    """

    jobs: int = 1
    scheduler: str | None = None
    fail_fast: bool = False
    retries: int = 1
    timeout: float = 1800.0
    memory: int | None = None
    mocap: FileName | None = None
    threads: int = 1
    command: str = ""


@dataclass
class Outcome:
    """What came of a batch.

    Attributes:
        folder: Its folder.
        plan: Its plan.
        kept: Runs that were finished before.
        done: Runs that have been finished now.
        failures: Runs that have failed, by id, with the cause.
        left: Runs that have not been begun, after a failure that ended the batch.
        seconds: Time of each stage [s].
    """

    folder: Path
    plan: Plan
    kept: int = 0
    done: int = 0
    failures: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    left: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
