"""Figures and pictures of runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crowdsim.take.plots import plot_take
from crowdsim.take.quality import measure_take, overlap_share
from tests.take.synthetic_take import actions, build_take, database, sampler


def test_captured_motion_that_goes_on_has_no_cuts_and_no_jumps() -> None:
    clip = int(database().clip_starts[0])
    take, policy = build_take([[0, 1, 2]] * 2, np.array([1, 31, 61]) + clip, np.array([30, 30, 40]), 90)
    told = measure_take(sampler(take, policy))
    assert (told["avatars"], told["control_frames"], told["strikes_thrown"]) == (2, 90, 0)
    assert told["transitions_per_second"] == 0.0
    assert told["transition_jump_ratio"] is None
    assert told["foot_slide_95"] <= told["foot_slide_95_captured"] + 0.01
    assert told["overlap_share"] == 0.0


def test_cuts_are_counted_and_measured() -> None:
    first, lengths = actions(40, 6)
    take, policy = build_take([list(range(40))] * 3, first, lengths, 61)
    told = measure_take(sampler(take, policy))
    # Every avatar does the same.
    cuts = told["transitions_per_second"] * 61 / 15
    assert cuts == pytest.approx(np.count_nonzero(np.diff(take.action[:, 0])), abs=1)
    assert told["transition_jump_ratio"] > 0.5


def test_overlap_is_the_share_of_bodies_that_touch() -> None:
    take, _ = build_take([[0], [0], [0], [0]], np.array([1]), np.array([60]), 30, start=[(0, 0, 0)] * 4)
    x = np.array([0.0, 0.39, 0.81, 5.0])
    flat = replace(take, x=np.tile(x, (30, 1)), z=np.zeros((30, 4)))
    assert overlap_share(flat) == 0.5
    assert overlap_share(replace(flat, action=np.full((30, 4), -1))) is None


def test_pictures_of_a_run_are_written(tmp_path: Path) -> None:
    first, lengths = actions(40, 6)
    take, policy = build_take([list(range(40))] * 3, first, lengths, 40)
    pictures = plot_take(sampler(take, policy), tmp_path / "plots")
    assert [path.name for path in pictures] == ["hits.png", "distances.png", "actions.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in pictures)
