"""Feet are planted while their balls are low and slow."""

from __future__ import annotations

import numpy as np
import pytest

from crowdsim.motion.contacts import find_contacts, find_floor, runs
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import measure_body
from crowdsim.motion.resampling import resample
from crowdsim.motion.tracks import Tracks, build_tracks, speeds
from crowdsim.performer.session import perform


def _tracks(balls: np.ndarray) -> Tracks:
    """Tracks of two feet (F, 2, 3); the rest of the body stands."""
    frames = len(balls)
    still = np.zeros((frames, 3)) + np.array([0.0, 1.0, 0.0])
    pair = np.repeat(still[:, None], 2, axis=1)
    positions = np.zeros((frames, 3))
    return Tracks(
        positions, positions, pair, pair, pair, still, still, still, balls + np.array([0.0, 0.02, 0.0]), balls,
        np.full((frames, 7, 3), np.nan),
    )  # fmt: skip


def _step(fps: float = 60.0, lift: float = 0.15) -> np.ndarray:
    """A left foot that stands a second, steps half a metre ahead in 0.4 s, and stands again; the right one stands."""
    times = np.arange(round(2.4 * fps)) / fps
    phase = np.clip((times - 1.0) / 0.4, 0.0, 1.0)
    share = phase - np.sin(2 * np.pi * phase) / (2 * np.pi)
    left = np.stack([0.1 + 0 * times, lift * np.sin(np.pi * phase) ** 2, 0.5 * share], axis=1)
    return np.stack([left, np.zeros_like(left)], axis=1)


@pytest.mark.parametrize("fps", [60.0, 120.0])
def test_a_step_is_a_gap_between_two_contacts(fps):
    contacts = find_contacts(_tracks(_step(fps)), 1.75, fps)
    assert contacts[:, 1].all()
    (start, stop), (again, end) = runs(contacts[:, 0]) / fps
    assert start == 0.0
    assert stop == pytest.approx(1.07, abs=0.06)
    assert again == pytest.approx(1.33, abs=0.06)
    assert end == pytest.approx(2.4)


def test_a_foot_held_still_in_the_air_is_not_planted():
    balls = _step()
    balls[:, 1, 1] += 0.3
    assert not find_contacts(_tracks(balls), 1.75, 60.0)[:, 1].any()


def test_a_foot_that_slides_is_not_planted():
    balls = _step()
    balls[:, 1, 2] = np.arange(len(balls)) / 60.0 * 1.0
    assert not find_contacts(_tracks(balls), 1.75, 60.0)[:, 1].any()


def test_noise_of_millimetres_does_not_make_a_contact_flicker():
    noise = np.random.default_rng(1).normal(0.0, 0.002, (144, 2, 3))
    contacts = find_contacts(_tracks(_step() + noise), 1.75, 60.0)
    assert len(runs(contacts[:, 0])) == 2
    assert len(runs(contacts[:, 1])) == 1


def test_thresholds_scale_with_the_body():
    balls = _step()
    ours = find_contacts(_tracks(balls), 1.75, 60.0)
    theirs = find_contacts(_tracks(balls * 0.6), 1.75 * 0.6, 60.0)
    assert np.array_equal(ours, theirs)


def test_the_floor_may_lie_anywhere():
    balls = _step() + np.array([0.0, 1.4, 0.0])
    floor = find_floor(_tracks(balls), 60.0)
    assert floor == pytest.approx(1.4, abs=0.005)
    assert np.array_equal(find_contacts(_tracks(balls), 1.75, 60.0, floor), find_contacts(_tracks(_step()), 1.75, 60.0))


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_a_few_frames_are_enough(frames):
    contacts = find_contacts(_tracks(np.zeros((frames, 2, 3))), 1.75, 60.0)
    assert contacts.shape == (frames, 2)


@pytest.mark.parametrize("fps", [30.0, 100.0, 240.0])
def test_contacts_hardly_depend_on_the_rate_of_the_capture(fps):
    clip = perform(15.0, 8)[0].clip
    body = measure_body(clip)

    def found(rate: float) -> np.ndarray:
        again = resample(resample(clip, rate), 60.0)
        return find_contacts(build_tracks(body, *clip_kinematics(again)), body.height, 60.0)

    ours, theirs = found(60.0), found(fps)
    frames = min(len(ours), len(theirs))
    assert (ours[:frames] == theirs[:frames]).mean() > 0.97


def test_runs_are_half_open_ranges():
    assert runs(np.array([1, 1, 0, 0, 1], bool)).tolist() == [[0, 2], [4, 5]]
    assert runs(np.zeros(4, bool)).shape == (0, 2)


def test_speed_is_distance_over_time():
    path = np.arange(5)[:, None] * np.array([[0.0, 0.0, 0.1]])
    np.testing.assert_allclose(speeds(path, 60.0), 6.0)
    assert speeds(path[:1], 60.0).tolist() == [0.0]
