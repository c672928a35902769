"""Ranges are taken by whichever thread is free."""

import threading

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


def test_an_error_of_any_thread_is_raised_when_all_have_stopped() -> None:
    running: list[int] = []

    def work(first: int, last: int) -> None:
        running.append(first)
        try:
            raise ValueError(f"range {first} to {last}")
        finally:
            running.remove(first)

    with Workers(2) as workers:
        with pytest.raises(ValueError, match="range"):
            workers.each(work, 80, grain=1)
        assert not running
