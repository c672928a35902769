"""What is found in a clip: the floor, contacts and strikes, the same for reports and for the motion database."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.errors import MotionError
from crowdsim.motion.analysis import analyse_clip, on_floor
from crowdsim.motion.database import build_database
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import measure_body, measure_clips
from crowdsim.performer.session import perform


@pytest.fixture(scope="module")
def boxer():
    clip = perform(5.0, 2)[0].clip
    return clip, measure_body(clip)


def test_the_database_holds_what_the_analysis_found(boxer):
    clip, body = boxer
    database = build_database(measure_clips([clip]))
    analysis = analyse_clip(clip.sliced(0, 4 * database.frame_count), body)
    assert np.array_equal(database.contacts, analysis.contacts)
    assert np.array_equal(database.strike_frames, analysis.strikes.frames)
    assert np.array_equal(database.strike_speeds, analysis.strikes.speeds)
    assert len(database.strike_frames) > 0


def test_clips_are_measured_by_the_body_of_the_first(boxer):
    clip, body = boxer
    first, second = measure_clips([clip, replace(clip, name="second")])
    assert second.body is first.body
    assert (first.lead_in, second.lead_in) == (0, 0)
    assert first.body.height == body.height


def test_a_clip_that_is_not_finite_is_not_measured(boxer):
    roots = boxer[0].root_positions.copy()
    roots[7] = np.nan
    with pytest.raises(MotionError, match="is not finite in frame 7, and in 1 frames in all"):
        measure_clips([replace(boxer[0], root_positions=roots)])


@pytest.mark.parametrize("lift", [-0.3, 0.0, 0.8])
def test_the_floor_is_moved_to_zero_and_reported(boxer, lift):
    clip, body = boxer
    raised = replace(clip, root_positions=clip.root_positions + np.array([0.0, lift, 0.0]))
    moved, floor = on_floor(raised, body)
    assert floor == pytest.approx(lift, abs=0.01)
    positions, _ = clip_kinematics(moved)
    toes = positions[:, [body.roles["left_toe"], body.roles["right_toe"]], 1]
    assert np.median(toes.min(axis=1)) == pytest.approx(0.02, abs=0.01)


def test_the_floor_moves_translations_too(boxer):
    clip, body = boxer
    offsets = np.repeat(clip.skeleton.offsets[None], clip.frame_count, axis=0)
    offsets[:, 0] = clip.root_positions + np.array([0.0, 0.5, 0.0])
    raised = replace(clip, root_positions=offsets[:, 0], translations=offsets)
    moved, floor = on_floor(raised, body)
    assert floor == pytest.approx(0.5, abs=0.01)
    assert np.array_equal(moved.translations[:, 0], moved.root_positions)
    assert np.array_equal(raised.translations[:, 0], raised.root_positions)
