"""Ranges of work in several threads."""

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from crowdsim.core.workers import CORES, limited, share


@pytest.mark.parametrize("threads", [None, 1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 7, 8, 16, 17, 1000])
def test_ranges_cover_every_item_once(threads, count):
    done = np.zeros(count, int)

    def work(low: int, high: int, step: int) -> None:
        done[low:high] += step

    share(count, work, 3, threads=threads)
    assert (done == 3).all()


def test_ranges_have_at_least_as_many_items_as_asked_for():
    sizes = []
    share(100, lambda low, high: sizes.append(high - low), threads=3, least=20)
    assert sum(sizes) == 100
    assert min(sizes) >= 20
    assert len(sizes) == 5


def test_threads_work_at_the_same_time():
    meeting = threading.Barrier(3)
    names = set()

    def work(low: int, high: int) -> None:
        names.add(threading.current_thread().name)
        meeting.wait(20.0)

    share(3, work, threads=3, least=1)
    assert len(names) == 3


def test_one_thread_is_the_calling_one():
    names = []
    with limited(1):
        share(1000, lambda low, high: names.append((low, high, threading.current_thread())))
    assert names == [(0, 1000, threading.current_thread())]


def test_a_limit_ends_where_it_was_set():
    def used(expected: int) -> int:
        meeting, names = threading.Barrier(expected), set()

        def work(low: int, high: int) -> None:
            names.add(threading.current_thread().name)
            meeting.wait(20.0)

        share(expected, work, least=1)
        return len(names)

    with limited(1):
        with pytest.raises(RuntimeError), limited(CORES):
            raise RuntimeError
        assert used(1) == 1
        share(1000, lambda low, high: (low, high) == (0, 1000) or pytest.fail("more than one range"))
    assert used(CORES) == CORES


@pytest.mark.parametrize("where", [0, 500])
def test_an_error_is_raised_and_ends_the_work(where):
    done = []

    def work(low: int, high: int) -> None:
        if low <= where < high:
            raise KeyError(where)
        time.sleep(0.01)
        done.append(low)

    with pytest.raises(KeyError):
        share(1000, work, threads=2)
    done_then = len(done)
    time.sleep(0.05)
    assert len(done) == done_then
    share(10, lambda low, high: None, threads=2)


def test_work_may_share_out_work_of_its_own():
    done = np.zeros((64, 64), int)

    def inner(low: int, high: int, row: int) -> None:
        done[row, low:high] += 1

    def outer(low: int, high: int) -> None:
        for row in range(low, high):
            share(64, inner, row, threads=2)

    share(64, outer, threads=2)
    assert (done == 1).all()


def test_several_threads_may_share_out_work():
    done = np.zeros((4, 1000), int)

    def add(low: int, high: int, row: int) -> None:
        done[row, low:high] += 1

    def call(row: int) -> None:
        for _ in range(50):
            share(1000, add, row, threads=3)

    callers = [threading.Thread(target=call, args=(row,)) for row in range(4)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(60.0)
    assert (done == 50).all()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a system without fork")
def test_a_forked_process_has_threads_of_its_own():
    program = (
        "import os, warnings\n"
        "from crowdsim.core.workers import share\n"
        "warnings.simplefilter('ignore')\n"
        "def count():\n"
        "    found = []\n"
        "    share(1000, lambda low, high: found.append(high - low), threads=2)\n"
        "    return sum(found)\n"
        "assert count() == 1000\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    raise SystemExit(0 if count() == 1000 else 1)\n"
        "assert os.waitpid(child, 0)[1] == 0\n"
        "assert count() == 1000\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
