"""Rests are found in motion alone, and held against what the performer truly did."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from crowdsim.motion.analysis import analyse_clip
from crowdsim.motion.body import build_body
from crowdsim.motion.database import MotionDatabase, build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.motion.rests import (
    DOWN,
    FIRST,
    LAST,
    START,
    STOP,
    UP,
    RestSpans,
    find_rests,
    in_control_frames,
    rests_on_the_spot,
)
from crowdsim.motion.skeleton import Clip
from crowdsim.performer.rests import AT_EASE, RESTS
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
        found = found_in(performance.clip)
        assert len(found.frames) == len(performance.truth.rests)
        for row, walk, truth in zip(found.frames, found.walks, performance.truth.rests, strict=True):
            assert row[FIRST] == 0
            assert abs(row[START] - truth.start) <= 18
            down = row[DOWN] if truth.kind in AT_EASE else walk[0]
            assert abs(down - truth.down) <= 40
            assert abs(row[UP] - truth.up) <= 40
            assert abs(row[STOP] - truth.end) <= 18
            assert row[LAST] == performance.clip.frame_count - 1


def test_walks_are_found_where_they_truly_are() -> None:
    for performance in performances():
        found = found_in(performance.clip)
        strolls = [one for one in performance.truth.travels if one.gait == "stroll"]
        np.testing.assert_array_equal(found.walked, [kind not in AT_EASE for kind in kinds_of(performance)])
        np.testing.assert_array_equal(found.walks[~found.walked], found.frames[~found.walked][:, [DOWN, DOWN]])
        for stroll, (_, go), row in zip(strolls, found.walks[found.walked], found.frames[found.walked], strict=True):
            assert -6 <= go - stroll.start <= 30
            assert abs(row[DOWN] - stroll.end) <= 20


def kinds_of(performance: Performance) -> list[str]:
    return [rest.kind for rest in performance.truth.rests]


def test_who_walks_away_before_he_stands_at_ease_does_not_rest() -> None:
    performance = perform_solo("walk_off_left", 2)
    (walk,) = found_in(performance.clip).walks
    stroll = next(one for one in performance.truth.travels if one.gait == "stroll")
    clip, kept = performance.clip, np.ones(performance.clip.frame_count, bool)
    kept[walk[0] + 5 : stroll.start + 10] = False
    hurried = replace(clip, root_positions=clip.root_positions[kept], rotations=clip.rotations[kept])
    assert not len(found_in(hurried).frames)


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
    rounded = in_control_frames(rests_on_the_spot(found), twice.frame_count // 4 - 1, 4).frames
    assert len(rounded) == 2
    assert rounded[0, LAST] < rounded[1, FIRST]


def test_a_database_has_rests_where_they_are_searched_for_and_their_mirror_images() -> None:
    assert not len(database(False).rests.frames)
    rests, count = database().rests, len(RESTS)
    assert len(rests.frames) == len(rests.walks) == 2 * count
    for rows in (rests.frames, rests.walks):
        np.testing.assert_array_equal(rows[:count] + database().captured_frames, rows[count:])
    assert np.count_nonzero(rests.walked) == 2 * (count - len(AT_EASE))
    assert (rests.frames[:, START] <= rests.walks[:, 0]).all()
    assert (rests.walks[:, 1] <= rests.frames[:, DOWN]).all()


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
