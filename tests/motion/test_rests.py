"""Rests are found in motion alone, and held against what the performer truly did."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from crowdsim.motion.analysis import analyse_clip
from crowdsim.motion.body import build_body
from crowdsim.motion.database import MotionDatabase, build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.motion.rests import DOWN, FIRST, LAST, START, STOP, UP, RestSpans, find_rests, in_control_frames
from crowdsim.motion.skeleton import Clip
from crowdsim.performer.rests import AT_EASE
from crowdsim.performer.session import Performance, perform, perform_solo

FPS = 60.0


@cache
def performances() -> list[Performance]:
    return perform(40, 7, falls=1, rests=1)


@cache
def database(rests: bool = True) -> MotionDatabase:
    return build_database(measure_clips([one.clip for one in performances()]), mirror=True, rests=rests)


def found_in(clip: Clip) -> RestSpans:
    analysis = analyse_clip(clip, build_body(clip.skeleton))
    return find_rests(analysis.tracks, analysis.falls.mask(clip.frame_count), analysis.body.height, clip.fps)


def test_rests_are_found_where_they_truly_are_and_nowhere_else() -> None:
    for performance in performances():
        found = found_in(performance.clip).frames
        assert len(found) == len(performance.truth.rests)
        for row, truth in zip(found, performance.truth.rests, strict=True):
            assert row[FIRST] == 0
            assert abs(row[START] - truth.start) <= 18
            assert abs(row[DOWN] - truth.down) <= 40
            assert abs(row[UP] - truth.up) <= 40
            assert abs(row[STOP] - truth.end) <= 18
            assert row[LAST] == performance.clip.frame_count - 1


def test_who_walks_away_before_he_stands_at_ease_does_not_rest_on_the_spot() -> None:
    assert not len(found_in(perform_solo("walk_off_left", 2).clip).frames)


@pytest.mark.parametrize(("first", "last"), [(150, None), (0, 300)])
def test_hands_that_hang_from_the_start_or_to_the_end_are_no_rest(first: int, last: int | None) -> None:
    clip = perform_solo("look_about", 1).clip
    cut = clip.sliced(first, clip.frame_count if last is None else last)
    assert not len(found_in(cut).frames)


def test_two_rests_in_a_clip_do_not_meet() -> None:
    clip = perform_solo("at_ease", 1).clip
    twice = replace(
        clip,
        root_positions=np.concatenate([clip.root_positions] * 2),
        rotations=np.concatenate([clip.rotations] * 2),
    )
    found = found_in(twice).frames
    assert len(found) == 2
    assert found[0, LAST] < found[1, FIRST]
    assert (np.diff(found, axis=1) >= 0).all()
    rounded = in_control_frames(RestSpans(found), twice.frame_count // 4 - 1, 4).frames
    assert len(rounded) == 2
    assert rounded[0, LAST] < rounded[1, FIRST]


def test_a_database_has_rests_where_they_are_searched_for_and_their_mirror_images() -> None:
    assert not len(database(False).rests.frames)
    rests = database().rests.frames
    assert len(rests) == 2 * len(AT_EASE)
    np.testing.assert_array_equal(rests[: len(AT_EASE)] + database().captured_frames, rests[len(AT_EASE) :])


def test_rests_neither_strike_nor_count_among_frames_of_fights() -> None:
    found, frames = database(), database().frame_count
    inside = found.rests.mask(frames)
    assert not inside[found.strike_frames // found.stride].any()
    assert not inside[np.flatnonzero(found.standing())].any()
    assert np.isin(found.rests.frames[:, FIRST], found.segment_starts).all()


def test_rests_do_not_turn_where_bodies_face_elsewhere() -> None:
    outside = ~database().rests.mask(database().frame_count)
    plain = build_database(
        measure_clips([one.clip for one in performances() if not one.truth.rests]), mirror=True, rests=True
    )
    stride = database().stride
    np.testing.assert_array_equal(database().ground[::stride][outside], plain.ground[::stride])
