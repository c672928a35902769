"""Resampling keeps constant turns constant, frames where frames meet, and everything smooth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from turns import about

from crowdsim.motion import quaternion
from crowdsim.motion.resampling import resample
from crowdsim.motion.skeleton import Clip, Skeleton
from crowdsim.performer.session import perform

RATES = [24.0, 25.0, 30000 / 1001, 30.0, 50.0, 60.0, 100.0, 120.0, 240.0, 250.0]
BONE = Skeleton(("a",), np.array([-1], np.int32), np.zeros((1, 3)))


def _spin(fps: float, seconds: float = 2.0, turns: float = 0.7) -> Clip:
    times = np.arange(int(seconds * fps) + 1) / fps
    axis = np.array([0.6, 0.0, 0.8])
    rotations = about(axis, 2.0 * np.pi * turns * times)[:, None]
    path = times[:, None] * np.array([1.0, 0.0, -2.0])
    # Signs as exporters leave them: any.
    rotations[1::3] *= -1.0
    return Clip("spin", BONE, fps, path, rotations)


@pytest.mark.parametrize("target", [15.0, 60.0])
@pytest.mark.parametrize("fps", RATES)
def test_constant_angular_and_linear_velocities_are_preserved(fps, target):
    clip = resample(_spin(fps), target)
    times = np.arange(clip.frame_count) / target
    wanted = about(np.array([0.6, 0.0, 0.8]), 2.0 * np.pi * 0.7 * times)
    dots = np.abs(np.sum(clip.rotations[:, 0] * wanted, axis=-1))
    np.testing.assert_allclose(dots, 1.0, atol=1e-9)
    np.testing.assert_allclose(clip.root_positions, times[:, None] * np.array([1.0, 0.0, -2.0]), atol=1e-9)


@pytest.mark.parametrize("fps", RATES)
def test_no_time_is_lost_or_made_up(fps):
    clip = _spin(fps)
    last = (clip.frame_count - 1) / fps
    again = resample(clip, 60.0)
    assert again.fps == 60.0
    assert last - 1.0 / 60.0 < (again.frame_count - 1) / 60.0 <= last + 1e-6


@pytest.mark.parametrize("fps", [120.0, 240.0])
def test_whole_fractions_of_a_rate_pick_frames(fps):
    clip = perform(3.0, 1, fps)[0].clip
    again = resample(clip, 60.0)
    step = round(fps / 60.0)
    np.testing.assert_array_equal(again.root_positions, clip.root_positions[::step])
    dots = np.abs(np.sum(again.rotations * clip.rotations[::step], axis=-1))
    np.testing.assert_allclose(dots, 1.0, atol=1e-12)


def test_the_same_rate_is_the_same_clip():
    clip = _spin(60.0)
    assert resample(clip, 60.0) is clip


def test_captured_motion_survives_a_detour():
    clip = perform(6.0, 3, 120.0)[0].clip
    plain = resample(clip, 60.0)
    detour = resample(resample(clip, 100.0), 60.0)
    count = min(plain.frame_count, detour.frame_count)
    dots = np.abs(np.sum(plain.rotations[:count] * detour.rotations[:count], axis=-1))
    assert np.rad2deg(2.0 * np.arccos(np.clip(dots, 0.0, 1.0))).max() < 3.0
    assert np.abs(plain.root_positions[:count] - detour.root_positions[:count]).max() < 0.002


def test_translations_are_resampled_with_the_rest():
    clip = _spin(30.0)
    moved = np.repeat(clip.root_positions[:, None], 1, axis=1)
    again = resample(replace(clip, translations=moved), 60.0)
    np.testing.assert_allclose(again.translations[:, 0], again.root_positions, atol=1e-12)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_very_short_clips_are_resampled(frames):
    clip = _spin(30.0).sliced(0, frames)
    again = resample(clip, 60.0)
    assert again.frame_count == 2 * frames - 1
    np.testing.assert_allclose(np.linalg.norm(again.rotations, axis=-1), 1.0, atol=1e-9)


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused(fps):
    with pytest.raises(ValueError, match="expected a positive number"):
        resample(_spin(30.0), fps)


def test_an_empty_clip_is_refused():
    with pytest.raises(ValueError, match="has no frames"):
        resample(_spin(30.0).sliced(0, 0), 60.0)


@settings(max_examples=40, deadline=None)
@given(st.floats(5.0, 300.0), st.floats(5.0, 300.0), st.integers(1, 40), st.integers(0, 2**16))
def test_rotations_keep_unit_length_and_positions_stay_in_bounds(fps, target, frames, seed):
    draw = np.random.default_rng(seed)
    rotations = quaternion.normalise(draw.normal(size=(frames, 1, 4)))
    clip = Clip("any", BONE, fps, draw.uniform(-1.0, 1.0, (frames, 3)), rotations)
    again = resample(clip, target)
    np.testing.assert_allclose(np.linalg.norm(again.rotations, axis=-1), 1.0, atol=1e-9)
    assert np.abs(again.root_positions).max() < 2.5
    assert np.isfinite(again.rotations).all()
