"""A kick is a foot's speed peak, and then its furthest reach from the other foot, high and with the leg stretched."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import kicker
import numpy as np
import pytest

from crowdsim.capture.loading import load_capture
from crowdsim.capture.report import describe_capture
from crowdsim.motion.database import build_database
from crowdsim.motion.measuring import measure_body, measure_clips
from crowdsim.motion.mirroring import mirrored
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strike_kinds import KINDS, strike_kinds
from crowdsim.motion.strikes import HANDS, HANDS_AND_FEET, LIMBS, Strikes, find_strikes
from crowdsim.motion.swings import Rejection
from crowdsim.motion.tracks import clip_tracks
from crowdsim.performer.session import perform

FEET = (2, 3)


def found(clip: Clip, limbs: tuple[int, ...] = HANDS_AND_FEET) -> Strikes:
    body = measure_body(clip)
    return find_strikes(clip_tracks(clip, body), body.height, clip.fps, limbs)


@pytest.mark.parametrize("kind", kicker.KINDS)
def test_kicks_are_found_with_frame_foot_and_position(kind: str) -> None:
    clip, times = kicker.kicks((0, 1, 1), kind)
    strikes = found(clip)
    assert [LIMBS[limb] for limb in strikes.limbs] == ["left_foot", "right_foot", "right_foot"]
    np.testing.assert_allclose(strikes.frames / kicker.FPS, times, atol=0.05)
    assert (strikes.peaks < strikes.frames).all()
    assert (strikes.speeds > 5.0).all()
    tracks = clip_tracks(clip, measure_body(clip))
    assert (tracks.feet[strikes.frames, strikes.limbs - 2, 1] > 0.7).all()
    assert strikes.positions[0, 0] > 0.0
    assert (strikes.positions[1:, 0] < 0.0).all()


def test_hands_alone_are_found_by_default() -> None:
    assert len(found(kicker.kicks()[0], HANDS).frames) == 0


@pytest.mark.parametrize("limb", FEET)
def test_one_foot_can_be_asked_for(limb: int) -> None:
    assert found(kicker.kicks()[0], (limb,)).limbs.tolist() == [limb]


@pytest.mark.parametrize("movement", [kicker.swing_heel, kicker.fall])
def test_heels_that_swing_up_and_falls_are_no_kicks(movement: Callable[..., None]) -> None:
    clip = kicker.stand(3.0)
    movement(clip, 1.5, *([0] if movement is kicker.swing_heel else []))
    assert len(found(clip).frames) == 0


def test_a_jump_is_no_kick() -> None:
    clip = kicker.stand(3.0)
    kicker.jump(clip, 1.5)
    strikes = found(clip)
    assert len(strikes.frames) == 0
    assert not np.isin(strikes.rejected.limbs, FEET).any()


def test_a_knee_that_is_lifted_is_a_swing_with_a_bent_leg() -> None:
    clip = kicker.stand(3.0)
    kicker.lift_knee(clip, 1.5, 1)
    strikes = found(clip)
    assert len(strikes.frames) == 0
    feet = strikes.rejected.limbs == 3
    assert set(strikes.rejected.reasons[feet].tolist()) == {Rejection.BENT}


def test_steps_walks_and_jogs_of_the_embedded_boxer_are_no_kicks() -> None:
    for performed in perform(60.0, 5):
        strikes = found(performed.clip)
        assert not np.isin(strikes.limbs, FEET).any()
        assert not np.isin(strikes.rejected.limbs, FEET).any()


def test_kicks_of_a_small_body_are_found_alike() -> None:
    clip, times = kicker.kicks()
    tracks = clip_tracks(clip, measure_body(clip))
    small = type(tracks)(**{name: getattr(tracks, name) * 0.6 for name in tracks.__dataclass_fields__})
    ours, theirs = (find_strikes(one, height, 60.0, FEET) for one, height in ((tracks, 1.75), (small, 1.05)))
    np.testing.assert_array_equal(ours.frames, theirs.frames)
    assert len(ours.frames) == len(times)


def test_mirror_images_kick_with_the_other_foot() -> None:
    clip, _ = kicker.kicks((0, 1, 1), "round")
    image = mirrored(clip, measure_body(clip))
    np.testing.assert_array_equal(found(image).limbs ^ 1, found(clip).limbs)
    np.testing.assert_allclose(found(image).frames, found(clip).frames, atol=1)


def test_the_database_holds_the_strikes_of_the_limbs_that_are_asked_for() -> None:
    clips = measure_clips([kicker.kicks((0, 1, 1))[0]])
    both = build_database(clips, limbs=(0, 2), mirror=True)
    assert both.strike_limbs.tolist() == [2, 3]
    assert [KINDS[kind] for kind in strike_kinds(both)] == ["kick", "kick"]
    assert (both.strike_positions[:, 1] > 0.7).all()
    np.testing.assert_allclose(both.strike_positions[0] * [-1.0, 1.0, 1.0], both.strike_positions[1], atol=0.02)
    assert len(build_database(clips).strike_frames) == 0


def test_a_stance_stays_under_a_body_that_kicks() -> None:
    clip, times = kicker.kicks((1,))
    tracks = clip_tracks(clip, measure_body(clip))
    at = round(times[0] * kicker.FPS)
    # Between the feet it would be half as far ahead as the foot.
    assert np.linalg.norm(tracks.stances[at, :2] - tracks.pelvises[at, [0, 2]]) < 0.05
    assert tracks.balls[at, 1, 2] > 0.8
    paths = tracks.stances[:, :2], tracks.balls.mean(axis=1)[:, [0, 2]]
    ours, between = (np.linalg.norm(np.diff(path, axis=0), axis=1).max() for path in paths)
    assert ours < between


KICKS = {
    "fight_daz/cmu_135_04_front_kick.bvh": 3,
    "fight_daz/cmu_135_07_mawashigeri.bvh": 4,
    "fight_daz/cmu_135_11_yokogeri.bvh": 7,
}


@pytest.mark.mocap
def test_kicks_of_real_capture_are_found_and_nothing_else_is(mocap: Path) -> None:
    for path in sorted(mocap.glob("*/*.bvh")):
        counts = describe_capture(load_capture(path))["strikes_by_limb"]
        name = path.relative_to(mocap).as_posix()
        assert counts["left_foot"] + counts["right_foot"] == KICKS.get(name, 0), name
        if name in KICKS:
            assert min(counts["left_foot"], counts["right_foot"]) >= 1
