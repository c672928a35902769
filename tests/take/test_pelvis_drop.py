"""Pelvises go down evenly where legs are too short for planted feet."""

import numpy as np
import pytest
from synthetic_take import actions, build_take, database, sampler

from crowdsim.poses.layers.pelvis import Lowering
from crowdsim.poses.sampler import PoseSampler
from crowdsim.take.take import Take


def short_legs() -> tuple[Take, object]:
    """Boxers who change motions at random, so that feet have far to go."""
    first, lengths = actions(200, longest=10)
    rng = np.random.default_rng(4)
    return build_take([rng.permutation(200).tolist() for _ in range(12)], first, lengths, 75)


def lowering(posing: PoseSampler) -> Lowering:
    return posing.poser.layers["pelvis"]


def heights(posing: PoseSampler) -> np.ndarray:
    return posing.sample(0, 280, 60)[0].joints()[0][:, :, database().body.roles["pelvis"], 1].astype(float)


def test_pelvises_go_down_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    take, policy = short_legs()
    lows = lowering(sampler(take, policy)).rows(0, take.frame_count, np.arange(12))
    assert 0.01 < lows.max() < 0.11
    even = heights(sampler(take, policy))
    monkeypatch.setattr(
        Lowering, "rows", lambda _, first, stop, avatars: np.zeros((stop - first, len(avatars)), np.float32)
    )
    sudden = heights(sampler(take, policy))
    drops = [np.percentile(np.abs(np.diff(paths, 2, axis=0)), 99.9) * 3600.0 for paths in (even, sudden)]
    assert drops[0] < 0.8 * drops[1]
    assert (even - sudden).max() < 0.015


def test_rows_of_some_avatars_of_a_long_take_are_those_of_a_short_one(monkeypatch: pytest.MonkeyPatch) -> None:
    take, policy = short_legs()
    whole = lowering(sampler(take, policy)).rows(0, take.frame_count, np.arange(12))
    monkeypatch.setattr("crowdsim.poses.kept._NUMBERS", 0)
    monkeypatch.setattr("crowdsim.poses.kept._FRAMES", 5)
    monkeypatch.setattr("crowdsim.poses.layers.pelvis._FRAMES_AT_ONCE", 5)
    monkeypatch.setattr("crowdsim.poses.poser.POSES_AT_ONCE", 5)
    some = lowering(sampler(take, policy))
    for low, high in ((7, 19), (30, 33), (0, 4), (70, take.frame_count)):
        np.testing.assert_array_equal(some.rows(low, high, np.array([0, 2])), whole[low:high][:, [0, 2]])


def test_pelvises_at_times_of_their_own_go_down_as_each_alone() -> None:
    """Where a take begins, between control frames, and beyond its end; one avatar is there twice."""
    take, policy = short_legs()
    avatars, times = np.array([0, 2, 2, 7, 9]), np.array([0.0, 1.31, 3.47, take.seconds, take.seconds + 0.3])
    together, alone = sampler(take, policy).poser, sampler(take, policy).poser
    [(which, _, _, positions, _)] = together.joints(avatars, times, "feet", 1)
    for row, at in enumerate(which):
        [(_, _, _, expected, _)] = alone.joints(avatars[[at]], times[[at]], "feet", 1)
        np.testing.assert_array_equal(positions[row], expected[0])
