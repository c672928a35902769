"""Falls and staggers are found in motion alone, and held against what the performer truly did."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from falling import falling_database

from crowdsim.motion import ground
from crowdsim.motion.analysis import analyse_clip
from crowdsim.motion.body import build_body
from crowdsim.motion.database import MotionDatabase, build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.motion.skeleton import Clip
from crowdsim.performer.falls import FALLS, STAGGERS
from crowdsim.performer.session import Performance, perform

FPS = 60.0
BEARINGS = {
    **dict.fromkeys(("forward", "timber_forward", "crumple_forward"), 0.0),
    **dict.fromkeys(("backward", "timber_back", "crumple_back", "sit", "spin_left", "spin_right"), np.pi),
    **dict.fromkeys(("left", "wall", "fold", "knee_left"), np.pi / 2),
    **dict.fromkeys(("right", "knee_right"), -np.pi / 2),
}


@cache
def performances() -> list[Performance]:
    return perform(40, 7, falls=2)


def fallen() -> list[Performance]:
    return [one for one in performances() if one.truth.falls]


@pytest.mark.parametrize("index", range(2 * len(FALLS)))
def test_falls_are_found_where_they_truly_are(index: int) -> None:
    performance = fallen()[index]
    found = analyse_clip(performance.clip, build_body(performance.clip.skeleton)).falls
    (truth,) = performance.truth.falls
    assert len(found.starts) == 1
    start, down, rise, stop = (int(one[0]) for one in (found.starts, found.downs, found.rises, found.stops))
    # A body that topples begins to sink late.
    assert abs(start - truth.start) <= (14 if truth.kind.startswith("timber") else 8)
    assert abs(down - truth.down) <= 12
    assert abs(rise - truth.rise) <= 12
    assert truth.rise + 60 < stop <= truth.end
    # The trunk goes where the fall is named for, seen by the stance.
    seen = ground.wrap(found.directions[0] - performance.truth.stance[start, 2] - BEARINGS[truth.kind])
    assert abs(seen) < np.radians(35.0)


def test_staggers_are_found_where_they_truly_are_and_nowhere_else() -> None:
    for performance in performances():
        found = analyse_clip(performance.clip, build_body(performance.clip.skeleton)).falls
        if not performance.truth.staggers:
            assert not len(found.staggers)
            continue
        (truth,) = performance.truth.staggers
        ((first, last),) = found.staggers
        assert truth.start - 10 < first < truth.start + 8
        # A dazed body has been caught before its guard stands again.
        assert truth.end - (50 if truth.kind.startswith("heavy") else 10) < last < truth.end + 10
        bearing = {"back": np.pi, "left": np.pi / 2, "right": -np.pi / 2}[truth.kind.split("_")[-1]]
        seen = ground.wrap(found.stagger_directions[0] - performance.truth.stance[first, 2] - bearing)
        assert abs(seen) < np.radians(35.0)


def test_boxing_is_no_falling() -> None:
    for performance in perform(120, 11):
        found = analyse_clip(performance.clip, build_body(performance.clip.skeleton)).falls
        assert not found.any
        assert not len(found.spans)


@pytest.mark.parametrize("part", ["begins", "ends", "is whole"])
def test_who_lies_when_a_clip_begins_or_ends_does_not_fall(part: str) -> None:
    performance = fallen()[1]
    (truth,) = performance.truth.falls
    middle = (truth.down + truth.rise) // 2
    slices = {"begins": (middle, -1), "ends": (0, middle), "is whole": (truth.down + 10, truth.rise - 10)}
    first, last = slices[part]
    clip = performance.clip.sliced(first, performance.clip.frame_count if last < 0 else last)
    assert not analyse_clip(clip, build_body(clip.skeleton)).falls.any


@pytest.mark.parametrize("scale", [0.6, 1.4])
def test_sizes_of_bodies_do_not_matter(scale: float) -> None:
    clip = fallen()[0].clip
    skeleton = replace(
        clip.skeleton, offsets=clip.skeleton.offsets * scale, end_offsets=clip.skeleton.end_offsets * scale
    )
    scaled = Clip(clip.name, skeleton, clip.fps, clip.root_positions * scale, clip.rotations)
    assert analyse_clip(scaled, build_body(skeleton)).falls.any


def database(falls: int) -> MotionDatabase:
    return build_database(measure_clips([one.clip for one in perform(30, 3, falls=falls)]), mirror=True)


def test_a_database_has_falls_in_control_frames_and_their_mirror_images() -> None:
    motion = falling_database()
    falls, half = motion.falls, motion.captured_frames
    count = len(FALLS)
    assert len(falls.starts) == 2 * count
    assert len(falls.staggers) == 2 * len(STAGGERS)
    for name in ("starts", "downs", "rises", "stops"):
        frames = getattr(falls, name)
        np.testing.assert_array_equal(frames[count:], frames[:count] + half)
    np.testing.assert_allclose(falls.directions[count:], -falls.directions[:count], atol=1e-5)
    assert (falls.starts < falls.downs).all()
    assert (falls.downs < falls.rises).all()
    assert (falls.rises < falls.stops).all()
    clips = [np.searchsorted(motion.clip_starts, ends, side="right") for ends in (falls.starts, falls.stops)]
    np.testing.assert_array_equal(*clips)


def test_ground_transforms_follow_a_fall_smoothly() -> None:
    motion = falling_database()
    stride = motion.stride
    for start, down, rise, stop in zip(*(getattr(motion.falls, n) for n in ("starts", "downs", "rises", "stops")),
                                       strict=True):  # fmt: skip
        track = motion.ground[start * stride - 10 : stop * stride + 10]
        assert np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1).max() * FPS < 3.5
        assert np.abs(np.diff(track[:, 2])).max() * FPS < 5.0
        # A lying body lies around its ground transform.
        assert np.abs(motion.pelvises[down * stride : rise * stride, [0, 2]]).max() < 0.25


def test_there_are_no_strikes_in_falls_and_heads_are_those_of_standing_bodies() -> None:
    motion = falling_database()
    fallen_frames = np.repeat(motion.falls.mask(motion.frame_count), motion.stride)
    assert not fallen_frames[motion.strike_frames].any()
    assert motion.heads[:, 1].min() < 0.2
    assert motion.head_heights.min() > 1.0


def test_motion_without_falls_is_as_ever() -> None:
    motion = database(0)
    assert not motion.falls.any
    assert motion.segment_starts is motion.clip_starts
    assert motion.segment_names == motion.clip_names
    assert len(motion.head_heights) == len(motion.heads)


def test_segments_cut_clips_at_falls() -> None:
    motion = falling_database()
    starts = motion.segment_starts
    assert set(motion.clip_starts) <= set(starts)
    for first, last in motion.falls.spans:
        assert first in starts
        assert last + 1 in starts
    whole = [name for name in motion.segment_names if name]
    assert whole == [
        name for name in motion.clip_names if not any(word in name for word in ("fall", "stagger", "cheer"))
    ]


@pytest.mark.parametrize("seed", [14, 16])
def test_staggers_of_other_sessions_are_found_and_nothing_else(seed: int) -> None:
    for performance in perform(30, seed, falls=2):
        found = analyse_clip(performance.clip, build_body(performance.clip.skeleton)).falls
        assert len(found.starts) == len(performance.truth.falls)
        assert len(found.staggers) == len(performance.truth.staggers)
        assert len(found.cheers) == len(performance.truth.cheers)
        for (first, last), truth in zip(found.cheers, performance.truth.cheers, strict=True):
            assert abs(first - truth.start) < 15
            assert abs(last - truth.end) < 15
