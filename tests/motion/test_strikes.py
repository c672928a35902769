"""A strike is a fist's speed peak and then its furthest reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import measure_body
from crowdsim.motion.resampling import resample
from crowdsim.motion.strikes import REASONS, find_strikes
from crowdsim.motion.swings import Rejection, find_peaks
from crowdsim.motion.tracks import Tracks, build_tracks
from crowdsim.performer.session import perform

FPS = 60.0


def _tracks(left: np.ndarray, right: np.ndarray) -> Tracks:
    """Tracks of someone who stands at the origin, facing +z, with given fists (F, 3)."""
    frames = len(left)
    ones = np.ones((frames, 1, 1))
    shoulders = ones * np.array([[0.2, 1.45, 0.0], [-0.2, 1.45, 0.0]])
    feet = ones * np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    body = ones[:, 0]
    return Tracks(
        ground=np.zeros((frames, 3)),
        stances=np.zeros((frames, 3)),
        fists=np.stack([left, right], axis=1),
        feet=feet,
        shoulders=shoulders,
        heads=body * [0.0, 1.65, 0.0],
        necks=body * [0.0, 1.5, 0.0],
        pelvises=body * [0.0, 0.95, 0.0],
        heels=feet,
        balls=feet,
        others=np.full((frames, 7, 3), np.nan),
    )


def _reach(times: np.ndarray, at: float, out: float = 0.15, back: float = 0.3, far: float = 0.45) -> np.ndarray:
    """A fist before the face that goes out to ``at`` and comes back. Shape (F, 3)."""
    going = np.clip((times - at + out) / out, 0.0, 1.0)
    coming = np.clip((times - at) / back, 0.0, 1.0)

    def smooth(x: np.ndarray) -> np.ndarray:
        return x * x * (3.0 - 2.0 * x)

    share = smooth(going) - smooth(coming)
    return np.array([0.1, 1.4, 0.2]) + share[:, None] * np.array([0.0, 0.05, far])


TIMES = np.arange(180) / FPS
REST = np.repeat([[-0.1, 1.4, 0.2]], len(TIMES), axis=0)


def test_a_jab_is_found_with_frame_hand_position_and_speed():
    found = find_strikes(_tracks(_reach(TIMES, 1.5), REST), 1.75, FPS)
    assert found.limbs.tolist() == [0]
    assert found.frames[0] == pytest.approx(90, abs=1)
    assert found.peaks[0] == pytest.approx(90 - 4.5, abs=1)
    np.testing.assert_allclose(found.positions[0], [0.1, 1.45, 0.65], atol=0.02)
    assert found.speeds[0] == pytest.approx(1.5 * np.hypot(0.45, 0.05) / 0.15, rel=0.08)
    assert found.highest_speed == pytest.approx(float(found.speeds[0]), rel=1e-6)


def test_the_return_of_the_fist_is_no_strike_however_fast():
    fist = _reach(TIMES, 1.5, out=0.8, back=0.1)
    assert len(find_strikes(_tracks(fist, REST), 1.75, FPS).frames) == 0


def _hook(times: np.ndarray, at: float) -> np.ndarray:
    """A left fist that goes out while it swings across, is furthest out at ``at`` and fastest a little later."""
    share = np.clip((times - at + 0.4) / 0.8, 0.0, 1.0)
    out = 64.0 * (share * (1.0 - share)) ** 3
    turn = 0.5 - 1.4 / (1.0 + np.exp(-(times - at - 0.03) / 0.035)) + 1.4 / (1.0 + np.exp(-(times - at - 0.6) / 0.1))
    far = 0.25 + 0.35 * out
    return np.stack([far * np.sin(turn), 1.45 + 0.0 * times, far * np.cos(turn)], axis=1)


def test_a_hook_that_is_fastest_past_its_furthest_reach_is_found_where_it_reaches_furthest():
    fist = _hook(TIMES, 1.5)
    assert np.argmax(np.linalg.norm(np.diff(fist, axis=0), axis=1)) > 90
    found = find_strikes(_tracks(fist, REST), 1.75, FPS)
    assert found.limbs.tolist() == [0]
    assert found.frames[0] == pytest.approx(90, abs=1)
    assert found.peaks[0] > 90


def test_a_slow_reach_is_no_strike():
    assert len(find_strikes(_tracks(_reach(TIMES, 1.5, out=0.9), REST), 1.75, FPS).frames) == 0


def test_a_short_twitch_is_no_strike():
    assert len(find_strikes(_tracks(_reach(TIMES, 1.5, out=0.06, far=0.12), REST), 1.75, FPS).frames) == 0


def _rejections(fist: np.ndarray) -> list[tuple[int, Rejection]]:
    rejected = find_strikes(_tracks(fist, REST), 1.75, FPS).rejected
    assert (rejected.speeds >= 2.3).all()
    return [(int(peak), Rejection(reason)) for peak, reason in zip(rejected.peaks, rejected.reasons, strict=True)]


def test_fast_swings_that_are_no_strikes_are_kept_with_the_reason():
    way_back, twitch = _reach(TIMES, 1.5, out=0.8, back=0.1), _reach(TIMES, 1.5, out=0.06, back=0.8, far=0.12)
    assert _rejections(way_back) == [(pytest.approx(93, abs=1), Rejection.NO_REACH)]
    assert _rejections(twitch) == [(pytest.approx(88, abs=1), Rejection.SHORT)]
    leaving = REST * [-1.0, 1.0, 1.0] + np.maximum(TIMES - 1.5, 0.0)[:, None] * [0.0, 0.0, 4.0]
    leaving[:, 2] += 0.05 * np.sin(20.0 * TIMES) * (TIMES > 1.5)
    assert {reason for _, reason in _rejections(leaving)} == {Rejection.NOT_ARRIVED}


def _swung(start: list[float], end: list[float], seconds: float = 0.2) -> np.ndarray:
    """A left fist that goes from one place to another, is there at 1.5 s and stays. Shape (F, 3)."""
    share = np.clip((TIMES - 1.5 + seconds) / seconds, 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    return np.array(start) + share[:, None] * (np.array(end) - np.array(start))


GUARD = [0.12, 1.4, 0.2]


@pytest.mark.parametrize("end", [[0.1, 1.5, 0.65], [-0.1, 1.1, 0.55], [0.45, 1.45, 0.4], [0.1, 1.75, 0.4]])
def test_a_fist_that_goes_ahead_to_the_head_or_the_body_strikes(end):
    assert len(find_strikes(_tracks(_swung(GUARD, end), REST), 1.75, FPS).frames) == 1


@pytest.mark.parametrize(
    "end",
    [[0.85, 1.45, 0.0], [0.82, 1.45, 0.25], [0.3, 1.0, -0.3], [0.35, 1.0, 0.0], [0.25, 0.75, 0.3], [0.3, 2.1, 0.2]],
    ids=["to_a_t", "to_a_t_a_little_ahead", "behind", "beside_the_hip", "below_the_hips", "overhead"],
)
def test_arms_that_are_spread_drop_or_rise_over_the_head_do_not_strike(end):
    assert {reason for _, reason in _rejections(_swung(GUARD, end))} == {Rejection.AWAY}


def test_an_arm_that_swings_far_from_the_body_does_not_strike():
    swing = _swung([0.3, 0.95, 0.15], [0.3, 1.45, 0.85], 0.3)
    assert {reason for _, reason in _rejections(swing)} == {Rejection.FAR}


def test_a_fist_that_is_drawn_back_strikes_where_it_is_furthest_ahead():
    places = np.array(
        [GUARD, GUARD, [0.3, 0.98, -0.1], [0.35, 0.97, -0.1], [0.15, 1.15, 0.52], [0.15, 1.2, 0.45], GUARD]
    )
    at = [0.0, 1.2, 1.4, 1.45, 1.55, 1.7, 2.2]
    fist = np.stack([np.interp(TIMES, at, column) for column in places.T], axis=1)
    found = find_strikes(_tracks(fist, REST), 1.75, FPS)
    assert found.frames.tolist() == [pytest.approx(93, abs=1)]
    assert 87 <= found.peaks[0] < 93
    assert found.positions[0, 2] > 0.5
    slow = np.stack([np.interp(TIMES, [*at[:4], 1.9, 2.2, 2.6], column) for column in places.T], axis=1)
    assert len(find_strikes(_tracks(slow, REST), 1.75, FPS).frames) == 0


def test_arms_spread_by_a_body_that_spins_do_not_strike():
    tracks = _tracks(_swung(GUARD, [0.8, 1.45, 0.2]), REST)
    angle = 6.0 * TIMES
    cos, sin = np.cos(angle), np.sin(angle)

    def spun(points: np.ndarray) -> np.ndarray:
        c, s = (one.reshape((-1,) + (1,) * (points.ndim - 2)) for one in (cos, sin))
        return np.stack(
            [points[..., 0] * c + points[..., 2] * s, points[..., 1], points[..., 2] * c - points[..., 0] * s], axis=-1
        )

    spinning = {name: spun(getattr(tracks, name)) for name in ("fists", "shoulders", "heads", "necks", "pelvises")}
    heading = np.stack([0.0 * angle, 0.0 * angle, angle], axis=1)
    found = find_strikes(replace(tracks, ground=heading, **spinning), 1.75, FPS)
    assert len(found.frames) == 0
    assert Rejection.AWAY in found.rejected.reasons


def test_no_swing_of_the_performer_ends_away_from_his_opponent():
    for performance in perform(60.0, 5):
        clip = performance.clip
        body = measure_body(clip)
        found = find_strikes(build_tracks(body, *clip_kinematics(clip)), body.height, clip.fps)
        assert len(found.frames)
        assert not np.isin(found.rejected.reasons, [Rejection.AWAY, Rejection.FAR]).any()


def test_of_two_swings_too_close_to_be_two_strikes_the_slower_is_rejected_as_repeated():
    shares = np.interp(TIMES, [0.0, 1.3, 1.4, 1.42, 1.5, 2.2], [0.0, 0.0, 0.62, 0.6, 1.0, 0.0])
    fist = np.array([0.1, 1.4, 0.1]) + shares[:, None] * np.array([0.0, 0.0, 0.7])
    found = find_strikes(_tracks(fist, REST), 1.75, FPS)
    assert len(found.frames) == 1
    assert found.rejected.reasons.tolist() == [Rejection.REPEATED]
    assert found.rejected.speeds[0] <= found.speeds[0]


def test_every_candidate_is_a_strike_or_rejected_and_every_reason_has_words():
    clip = perform(15.0, 8)[0].clip
    found = find_strikes(build_tracks(measure_body(clip), *clip_kinematics(clip)), 1.75, clip.fps)
    assert len(found.rejected.peaks) > 5
    strikes = set(zip(found.limbs.tolist(), found.peaks.tolist(), strict=True))
    assert not strikes & set(zip(found.rejected.limbs.tolist(), found.rejected.peaks.tolist(), strict=True))
    assert (np.diff(found.rejected.peaks) >= 0).all()
    assert set(REASONS) == set(Rejection)


def test_a_one_two_is_two_strikes_in_order():
    right = _reach(TIMES, 1.75) * [-1.0, 1.0, 1.0]
    found = find_strikes(_tracks(_reach(TIMES, 1.5), right), 1.75, FPS)
    assert found.limbs.tolist() == [0, 1]
    assert (np.diff(found.frames) > 0).all()


def test_two_jabs_of_one_hand_are_two_strikes():
    fist = np.maximum(_reach(TIMES, 1.2), _reach(TIMES, 1.7, back=0.2))
    assert find_strikes(_tracks(fist, REST), 1.75, FPS).limbs.tolist() == [0, 0]


def test_thresholds_scale_with_the_body():
    tracks = _tracks(_reach(TIMES, 1.5), REST)
    small = Tracks(**{name: getattr(tracks, name) * 0.6 for name in tracks.__dataclass_fields__})
    ours, theirs = find_strikes(tracks, 1.75, FPS), find_strikes(small, 1.75 * 0.6, FPS)
    assert np.array_equal(ours.frames, theirs.frames)
    np.testing.assert_allclose(theirs.speeds, 0.6 * ours.speeds, rtol=1e-5)
    # A body of full size would have to move faster than that.
    assert len(find_strikes(small, 1.75 / 0.6, FPS).frames) == 0


def test_walking_along_does_not_speed_up_a_fist():
    tracks = _tracks(REST * [-1.0, 1.0, 1.0], REST)
    along = TIMES[:, None] * [0.0, 0.0, 6.0]
    moved = {
        name: getattr(tracks, name) + (along if getattr(tracks, name).ndim == 2 else along[:, None])
        for name in tracks.__dataclass_fields__
        if name not in ("ground", "stances")
    }
    assert find_strikes(replace(tracks, **moved), 1.75, FPS).highest_speed < 0.01


def test_a_clip_without_strikes_gives_empty_arrays():
    found = find_strikes(_tracks(REST * [-1.0, 1.0, 1.0], REST), 1.75, FPS)
    assert found.frames.shape == (0,)
    assert found.positions.shape == (0, 3)
    assert find_strikes(_tracks(REST[:1], REST[:1]), 1.75, FPS).frames.shape == (0,)


@pytest.mark.parametrize("fps", [50.0, 120.0, 240.0])
def test_strikes_hardly_depend_on_the_rate_of_the_capture(fps):
    clip = perform(15.0, 8)[0].clip
    body = measure_body(clip)

    def found(rate: float):
        again = resample(resample(clip, rate), 60.0)
        return find_strikes(build_tracks(body, *clip_kinematics(again)), body.height, 60.0)

    ours, theirs = found(60.0), found(fps)
    assert len(ours.frames) > 5
    assert np.array_equal(ours.limbs, theirs.limbs)
    np.testing.assert_allclose(ours.frames, theirs.frames, atol=2)


@given(st.integers(0, 10_000), st.integers(1, 60))
def test_peaks_are_those_that_scipy_finds(seed: int, count: int) -> None:
    # Few different values, so that peaks and sides are often level.
    values = np.random.default_rng(seed).integers(0, 4, count).astype(float)
    np.testing.assert_array_equal(find_peaks(values, 2.0), signal.find_peaks(values, height=2.0)[0])
