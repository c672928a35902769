"""Ranges are taken by whichever thread is free."""

import threading
from concurrent.futures import Future
from typing import Any

import pytest

from crowdsim.crowd.workers import Workers


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("count", [0, 1, 9, 10, 1477])
def test_ranges_cover_all_items_once(threads: int, count: int) -> None:
    done: list[int] = []
    with Workers(threads) as workers:
        workers.each(lambda first, last: done.extend(range(first, last)), count, grain=5)
    assert sorted(done) == list(range(count))


def test_a_thread_that_is_free_takes_what_another_has_not_begun() -> None:
    took: dict[str, list[int]] = {}
    release = threading.Event()

    def work(first: int, last: int) -> None:
        took.setdefault(threading.current_thread().name, []).append(first)
        if first == 0:
            # The first range lasts until all others are done, which another thread must do meanwhile.
            assert release.wait(60)
        elif sum(map(len, took.values())) == 8:
            release.set()

    with Workers(2) as workers:
        workers.each(work, 80, grain=1)
    assert sorted(map(len, took.values())) == [1, 7]


def test_no_range_is_begun_after_an_error_of_any_thread() -> None:
    begun: list[int] = []
    both, failed = threading.Barrier(2, timeout=60), threading.Event()
    main = threading.get_ident()

    def work(first: int, last: int) -> None:
        begun.append(first)
        both.wait()
        if threading.get_ident() == main:
            # The range of the thread that works here lasts until the other thread has stopped.
            assert failed.wait(60)
            return
        raise ValueError(f"range {first} to {last}")

    with Workers(2) as workers:
        assert workers._pool is not None
        submit = workers._pool.submit

        def observed(*given: Any) -> Future[Any]:
            future = submit(*given)
            future.add_done_callback(lambda _: failed.set())
            return future

        workers._pool.submit = observed  # type: ignore[method-assign]
        with pytest.raises(ValueError, match="range"):
            workers.each(work, 80, grain=1)
    assert len(begun) == 2
