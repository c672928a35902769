"""Rows that were read last are kept."""

import numpy as np
import pytest

from crowdsim.poses import recent_rows
from crowdsim.poses.recent_rows import RecentRows


class Counted:
    """An array that counts how often it is read."""

    def __init__(self, values: np.ndarray) -> None:
        self.values, self.shape, self.dtype, self.reads = values, values.shape, values.dtype, 0

    def __getitem__(self, key):
        self.reads += 1
        return self.values[key]


def check(rows: RecentRows, counted: Counted) -> None:
    """Ask for rows here and there, then for some again and again."""
    for low, high in ((100, 140), (90, 150), (2990, 3000), (0, 5), (4, 4), (0, 3000)):
        np.testing.assert_array_equal(rows[low:high], counted.values[low:high])
    np.testing.assert_array_equal(rows[7], counted.values[7])
    np.testing.assert_array_equal(np.asarray(rows), counted.values)
    assert len(rows) == 3000


def test_rows_around_those_of_a_large_array_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recent_rows, "_ENTRIES", 5999)
    counted = Counted(np.arange(6000).reshape(3000, 2))
    rows = RecentRows(counted)
    check(rows, counted)
    before = counted.reads
    for low in range(500, 520):
        np.testing.assert_array_equal(rows[low : low + 40], counted.values[low : low + 40])
    assert counted.reads == before + 1


def test_rows_of_an_array_that_is_not_too_large_are_read_once() -> None:
    counted = Counted(np.arange(6000).reshape(3000, 2))
    rows = RecentRows(counted)
    check(rows, counted)
    for low in (*range(500, 520), 2000, 1990, 500):
        np.testing.assert_array_equal(rows[low : low + 40], counted.values[low : low + 40])
    before = counted.reads
    for low in (*range(500, 520), 2000, 1990, 100):
        np.testing.assert_array_equal(rows[low : low + 40], counted.values[low : low + 40])
    assert counted.reads == before
