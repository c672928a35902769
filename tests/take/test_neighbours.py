"""Avatars near others, and pieces of posing that several threads work on."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from crowdsim.poses.neighbours import TOUCH, near_avatars
from crowdsim.poses.together import each, threads_left


def walking(count: int, frames: int, stray: float = 0.0) -> Any:
    """Avatars that walk at random over a square of 60 m, some of them absent, one at a distance."""
    rng = np.random.default_rng(4)
    x, z = rng.uniform(0.0, 60.0, (2, 1, count)) + np.cumsum(rng.normal(0.0, 0.1, (2, frames, count)), axis=1)
    x[:, 7] += stray
    action = np.where(rng.random((frames, count)) < 0.1, -1, 3)
    x[action < 0] = z[action < 0] = np.nan
    return SimpleNamespace(avatar_count=count, x=x.astype(np.float32), z=z.astype(np.float32), action=action)


@pytest.mark.parametrize("stray", [0.0, 1e6])
def test_all_avatars_near_others_are_found_and_few_more(stray: float) -> None:
    take, some = walking(400, 12, stray), np.array([3, 7, 150, 151, 380])
    found = near_avatars(take, some, 4, 9)
    places = np.stack([take.x, take.z], axis=-1).astype(float)[4:9]
    gaps = np.linalg.norm(places[:, :, None] - places[:, None, some], axis=-1)
    expected = np.union1d(some, np.flatnonzero((gaps <= TOUCH).any(axis=(0, 2))))
    assert len(expected) > 8
    assert np.isin(expected, found).all()
    assert (np.diff(found) > 0).all()
    if not stray:
        ever = np.linalg.norm(places[:, None, :, None] - places[None, :, None, some], axis=-1)
        assert np.nanmin(ever[..., found, :], axis=(0, 1, 3)).max() < 2.5 * TOUCH


def test_avatars_that_are_absent_are_near_nobody() -> None:
    take = walking(100, 5)
    take.action[:, 20] = -1
    np.testing.assert_array_equal(near_avatars(take, np.array([20]), 0, 5), [20])


def test_pieces_come_in_order_and_leave_no_threads_to_pieces_of_theirs() -> None:
    both = threading.Barrier(2, timeout=30.0)

    def work(item: int) -> tuple[int, list[int], int]:
        both.wait()
        return item, each(lambda inner: threading.get_ident() + inner, [0, 0], 2), threads_left(8)

    found = each(work, [0, 1, 2, 3], 2)
    assert [item for item, _, _ in found] == [0, 1, 2, 3]
    assert all(first == second for _, (first, second), _ in found)
    assert all(left == 1 for _, _, left in found)
    assert threads_left(8) == 8


def test_an_error_of_a_piece_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        each(lambda item: 1 // item, [1, 0, 2], 2)
