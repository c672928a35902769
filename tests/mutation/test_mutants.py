"""Bundles, takes, runs and archives of strangers: each mutant is refused with an error, or runs without a crash.

Mutants are changed arrays and documents, and checksums fit: whoever writes a hostile file signs it too. Most are made
in memory and meet the same checks as files do; of those that pass, and of mutants on disk, some are run in a fork with
512 MB and 2 s. Hypothesis draws seeds of whole blocks of mutants, since its own work for each input would take longer
than the checks: a failure names the seed, and there is nothing to shrink.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from runnable import Base
from worker import Worker

from crowdsim.errors import CrowdsimError

SEEDS = st.integers(0, 2**40)
Check = Callable[[int], Any]


def blocks(count: int) -> settings:
    """Return settings that draw so many seeds."""
    checks = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
    return settings(max_examples=count, deadline=None, phases=[Phase.generate], suppress_health_check=checks)


def check_block(kind: str, check: Check, worker: Worker, seed: int, count: int, runs: int) -> None:
    """Check so many mutants, and run some of those that pass."""
    accepted = []
    with np.errstate(all="ignore"):
        for one in range(seed * count, seed * count + count):
            try:
                check(one)
            except CrowdsimError:
                continue
            except Exception as error:
                pytest.fail(f"{kind} {one}: {type(error).__name__}: {error}")
            else:
                accepted.append(one)
    assert count < 50 or 0.05 * count < len(accepted) < 0.95 * count, "mutants are too tame, or too wild"
    for one in accepted[:runs]:
        assert not worker.fate(kind, one)


def check_bundle(base: Base, seed: int) -> None:
    base.check_bundle(*base.bundle_mutant(seed))


def check_take(base: Base, seed: int) -> None:
    base.checked_take(*base.take_mutant(seed))


@blocks(3)
@given(SEEDS)
def test_a_mutant_of_a_bundle_is_refused_or_runs(base: Base, worker: Worker, seed: int) -> None:
    check_block("bundle", lambda one: check_bundle(base, one), worker, seed, 200, 1)


@blocks(3)
@given(SEEDS)
def test_a_mutant_of_a_take_is_refused_or_is_posed(base: Base, worker: Worker, seed: int) -> None:
    check_block("take", lambda one: check_take(base, one), worker, seed, 200, 1)


@blocks(20)
@given(SEEDS)
def test_a_mutant_of_a_checkpoint_is_refused_or_is_continued(worker: Worker, seed: int) -> None:
    assert not worker.fate("state", seed)


@pytest.mark.parametrize(("kind", "count"), [("bundle files", 12), ("run files", 4), ("archive", 3)])
def test_a_mutant_on_disk_is_refused_or_is_used(worker: Worker, kind: str, count: int) -> None:
    for seed in range(count):
        assert not worker.fate(kind, seed)


@pytest.mark.slow
@blocks(50)
@given(SEEDS)
def test_100000_mutants_of_a_bundle(base: Base, worker: Worker, seed: int) -> None:
    check_block("bundle", lambda one: check_bundle(base, one), worker, seed, 2000, 1)


@pytest.mark.slow
@blocks(50)
@given(SEEDS)
def test_100000_mutants_of_a_take(base: Base, worker: Worker, seed: int) -> None:
    check_block("take", lambda one: check_take(base, one), worker, seed, 2000, 1)


@pytest.mark.slow
@blocks(400)
@given(SEEDS)
def test_400_mutants_of_a_checkpoint(worker: Worker, seed: int) -> None:
    assert not worker.fate("state", seed)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "count"), [("bundle files", 200), ("run files", 60), ("archive", 30)])
def test_hundreds_of_mutants_on_disk(worker: Worker, kind: str, count: int) -> None:
    @blocks(count)
    @given(SEEDS)
    def check(seed: int) -> None:
        assert not worker.fate(kind, seed)

    check()


@pytest.mark.parametrize(
    ("kind", "answer"),
    [
        ("crash", -signal.SIGSEGV),
        ("traceback", 4),
        ("memory", 4),
        pytest.param("hang", -signal.SIGXCPU, marks=pytest.mark.slow),
    ],
)
def test_a_crash_a_hang_a_traceback_and_too_much_memory_are_noticed(worker: Worker, kind: str, answer: int) -> None:
    assert worker.fate(kind, 0).startswith(f"{kind} 0 ended with {answer}:")


def test_whoever_checks_nothing_is_caught(base: Base, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crowdsim.array_checks.Index.__call__", lambda *_: "")
    for seed in range(3000):
        try:
            check_bundle(base, seed)
        except CrowdsimError:
            continue
        except IndexError:
            # An index that no check has seen has reached what comes behind the table.
            return
    pytest.fail("an index out of range has not been noticed")
