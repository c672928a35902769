"""How a body moves: gravity in flight, feet that bear it, and windows of long clips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.bvh.io import from_clip, write_bvh
from crowdsim.capture.evidence import gather_evidence
from crowdsim.capture.faults.root_drift import _walking
from crowdsim.capture.faults.tilt import _drift
from crowdsim.capture.faults.time_base import _fits
from crowdsim.capture.loading import load_capture
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.measuring import measure_body
from crowdsim.performer.session import perform


@pytest.fixture(scope="module")
def boxer():
    return perform(20.0, 1)[0].clip.sliced(60, 660)


def evidence_of(clip):
    return gather_evidence(clip, measure_body(clip))


def hopping(clip, gravity: float):
    """The clip with a hop of half a second in every second, in which what is in the air falls by ``gravity``."""
    seconds = np.arange(clip.frame_count) / clip.fps % 1.0
    up = np.where(seconds < 0.5, 0.5 * gravity * seconds * (0.5 - seconds), 0.0)
    return replace(clip, root_positions=clip.root_positions + up[:, None] * np.array([0.0, 1.0, 0.0]))


@pytest.mark.parametrize("gravity", [9.81, 25.0])
def test_what_is_in_the_air_falls_as_it_was_made_to(boxer, gravity):
    evidence = evidence_of(hopping(boxer, gravity))
    assert evidence.gravity == pytest.approx(gravity * HEIGHT / measure_body(boxer).height, rel=0.12)


def test_without_flights_there_is_no_gravity(boxer):
    assert evidence_of(boxer).gravity is None


def test_a_clock_that_is_four_times_too_slow_shows_in_flight_and_the_true_rate_is_named(boxer, tmp_path):
    clip = hopping(boxer, 9.81)
    write_bvh(tmp_path / "clip.bvh", from_clip(clip))
    assert load_capture(tmp_path / "clip.bvh").findings == ()
    write_bvh(tmp_path / "clip.bvh", from_clip(replace(clip, fps=15.0)))
    finding, floor = load_capture(tmp_path / "clip.bvh").faults
    # So slow, no second of it holds a whole hop.
    assert floor.startswith("floor: ")
    assert finding.startswith("time_base: frame time 0.0666667 means 15 frames a second")
    rate = int(finding.partition("as on earth at about ")[2].split()[0])
    assert rate == pytest.approx(60, abs=5)


@pytest.fixture(scope="module")
def walk():
    """The boxer as it walks off."""
    return next(one.clip for one in perform(10.0, 1, rests=1) if "walk_off" in one.clip.name)


def test_a_body_falls_away_from_the_foot_below_as_on_earth_whatever_its_clock(walk):
    balance = evidence_of(walk).balance
    assert 5.0 < balance < 20.0
    for factor in (0.25, 2.0):
        assert evidence_of(replace(walk, fps=factor * walk.fps)).balance == pytest.approx(factor**2 * balance, rel=0.2)


def test_a_walk_whose_clock_is_four_times_too_slow_is_refused_with_about_its_rate(walk, tmp_path):
    write_bvh(tmp_path / "clip.bvh", from_clip(walk))
    assert load_capture(tmp_path / "clip.bvh").findings == ()
    write_bvh(tmp_path / "clip.bvh", from_clip(replace(walk, fps=15.0)))
    (finding,) = load_capture(tmp_path / "clip.bvh").faults
    assert "bodies fall away from the foot below" in finding
    assert finding.endswith("unless motion.capture.faults says keep or a number of frames a second")
    rate = int(finding.partition("as on earth at about ")[2].split()[0])
    assert 40 < rate < 90


def test_steps_go_as_far_for_their_time_as_those_of_people_and_twice_as_fast_half_of_that(walk):
    steps = walk.sliced(180, 480)
    pace = evidence_of(steps).pace
    assert 0.3 < pace < 0.5
    assert evidence_of(replace(steps, fps=2.0 * steps.fps)).pace == pytest.approx(pace / 2.0, rel=0.03)


def test_a_walk_drives_the_trunk_as_that_of_people_and_twice_as_fast_four_times_as_hard(walk):
    steps = walk.sliced(180, 480)
    drive = evidence_of(steps).drive
    assert 0.7 < drive < 2.5
    for factor in (0.5, 2.0):
        assert evidence_of(replace(steps, fps=factor * steps.fps)).drive == pytest.approx(factor**2 * drive, rel=0.1)


def test_noise_of_the_root_is_hardly_any_drive(walk):
    steps = walk.sliced(180, 480)
    noise = np.random.default_rng(1).normal(scale=0.01, size=steps.root_positions.shape)
    noisy = evidence_of(replace(steps, root_positions=steps.root_positions + noise))
    # Without smoothing it would be more than 80 m/s^2.
    assert noisy.drive < evidence_of(steps).drive + 1.0


def test_a_root_that_jumps_is_hardly_any_drive(walk):
    steps = walk.sliced(180, 480)
    roots = steps.root_positions.copy()
    roots[150:, 0] += 0.5
    assert evidence_of(replace(steps, root_positions=roots)).drive < evidence_of(steps).drive + 1.0


def test_a_walk_of_usual_pace_whose_trunk_is_hurled_on_has_a_wrong_clock(walk):
    evidence = evidence_of(walk.sliced(180, 480))
    for drive, fits in ((None, True), (5.4, True), (5.6, False)):
        evidence.__dict__.update(pace=0.43, drive=drive, balance=None, gravity=None)
        assert _fits(evidence.fps, evidence) == fits
        assert _fits(2.0 * evidence.fps, evidence) == (drive is None)


def test_who_does_not_walk_has_no_pace_and_who_walks_for_a_short_while_no_drive(boxer, walk):
    for clip in (boxer, hopping(boxer, 9.81)):
        assert evidence_of(clip).pace is None
        assert evidence_of(clip).drive is None
    stands = walk.sliced(0, 180)
    still = np.repeat(stands.rotations[:1], 420, axis=0), np.repeat(stands.root_positions[:1], 420, axis=0)
    partly = replace(
        walk.sliced(0, 480),
        rotations=np.concatenate([still[0], walk.rotations[:480]]),
        root_positions=np.concatenate([still[1], walk.root_positions[:480]]),
    )
    assert evidence_of(partly).pace is not None
    assert evidence_of(partly).drive is None


def test_a_walk_or_hops_with_a_clock_that_is_twice_too_fast_are_refused_with_about_their_rate(walk, boxer, tmp_path):
    for clip, words in ((walk.sliced(180, 480), "of a walk do at about "), (hopping(boxer, 9.81), "earth at about ")):
        for factor in (0.6, 1.0, 1.5):
            write_bvh(tmp_path / "clip.bvh", from_clip(replace(clip, fps=factor * clip.fps)))
            assert load_capture(tmp_path / "clip.bvh").findings == ()
        write_bvh(tmp_path / "clip.bvh", from_clip(replace(clip, fps=2.0 * clip.fps)))
        (finding,) = load_capture(tmp_path / "clip.bvh").faults
        assert int(finding.partition(words)[2].split()[0]) == pytest.approx(60, rel=0.3)


def test_short_steps_that_are_slow_are_those_of_a_shuffle_and_no_wrong_clock(walk, tmp_path):
    evidence = evidence_of(walk.sliced(180, 480))
    for pace, speed, fits in ((0.19, 0.75, True), (0.19, 1.7, False), (0.4, 1.7, True)):
        evidence.__dict__.update(pace=pace, speed=speed, balance=None, gravity=None)
        assert _fits(evidence.fps, evidence) == fits


def test_a_walk_that_drifts_aside_or_ahead_is_brought_back(walk, tmp_path):
    straight = walk.sliced(300, 480)
    write_bvh(tmp_path / "clip.bvh", from_clip(straight))
    assert load_capture(tmp_path / "clip.bvh").findings == ()
    seconds = np.arange(straight.frame_count)[:, None] / straight.fps
    way = straight.root_positions[-1] - straight.root_positions[0]
    ahead = way / np.linalg.norm(way)
    for drift in (0.2 * np.cross([0.0, 1.0, 0.0], ahead), 0.35 * ahead + [0.0, 0.05, 0.0]):
        drifting = replace(straight, root_positions=straight.root_positions + seconds * drift)
        write_bvh(tmp_path / "clip.bvh", from_clip(drifting))
        capture = load_capture(tmp_path / "clip.bvh")
        assert [(one.diagnosis.fault, one.done) for one in capture.diagnoses] == [("root_drift", "repaired")]
        rest = (capture.clip.root_positions - straight.root_positions)[-1] / seconds[-1]
        assert np.linalg.norm(rest) < 0.3 * np.linalg.norm(drift)


def test_feet_of_a_run_are_too_short_on_the_floor_to_show_a_drift(walk, tmp_path):
    straight = walk.sliced(300, 480)
    seconds = np.arange(straight.frame_count)[:, None] / straight.fps
    way = straight.root_positions[-1] - straight.root_positions[0]
    drifting = replace(straight, root_positions=straight.root_positions + seconds * 0.35 * way / np.linalg.norm(way))
    evidence = evidence_of(drifting)
    assert _walking(evidence) is not None
    evidence.__dict__["travel"] = evidence.travel * 3.0
    evidence.__dict__["planted"] = evidence.planted * 3.0
    assert evidence.speed > 2.5
    assert _walking(evidence) is None


def tilting(clip, degrees: float):
    """The clip in a world that tilts by so much from its start to its end, about a level axis."""
    angles = np.deg2rad(degrees) * np.linspace(0.0, 1.0, clip.frame_count)
    turns = quaternion.from_rotation_vector(angles[:, None] * np.array([0.6, 0.0, 0.8]))
    rotations = clip.rotations.copy()
    rotations[:, 0] = quaternion.multiply(turns, rotations[:, 0])
    return replace(clip, rotations=rotations, root_positions=quaternion.rotate(turns, clip.root_positions))


@pytest.mark.parametrize("degrees", [15.0, 25.0])
def test_a_world_that_tilts_slowly_shows_in_how_far_a_body_leans(boxer, walk, degrees):
    for clip in (boxer, walk.sliced(300, 480)):
        assert _drift(evidence_of(clip)) < np.tan(np.deg2rad(9.0))
        assert np.rad2deg(np.arctan(_drift(evidence_of(tilting(clip, degrees))))) == pytest.approx(degrees, abs=6.0)


def test_a_body_that_leans_on_something_over_soles_that_stay_level_is_in_no_world_that_tilts(boxer):
    level, leans = evidence_of(boxer), evidence_of(tilting(boxer, 15.0))
    assert _drift(leans) > 0.0
    feet = [leans.roles["left_foot"], leans.roles["right_foot"]]
    away = leans.positions - leans.positions[:, feet].mean(axis=1, keepdims=True)
    upright = level.positions[:, feet].mean(axis=1, keepdims=True)
    assert _drift(replace(leans, positions=upright + away, tracks=level.tracks)) == 0.0


def test_who_falls_or_is_seen_for_a_moment_is_in_no_world_that_tilts(boxer):
    assert _drift(evidence_of(tilting(boxer.sliced(0, 110), 25.0))) == 0.0
    fall = next(one.clip for one in perform(10.0, 1, falls=1) if "fall_left" in one.clip.name)
    assert _drift(evidence_of(fall)) == 0.0


def test_the_root_of_a_clean_clip_follows_the_feet_that_bear_it_and_that_of_another_clip_does_not(boxer):
    evidence = evidence_of(boxer)
    assert evidence.relation > 0.8
    assert evidence.unrest < 0.1
    other = replace(boxer, root_positions=boxer.root_positions[::-1])
    assert evidence_of(other).relation < 0.3


def test_knees_and_toes_point_ahead_and_in_a_mirror_image_with_its_names_kept_back(boxer):
    evidence = evidence_of(boxer)
    assert evidence.toe_sense > 0.6
    assert evidence.knee_sense > 0.1


def test_a_long_clip_is_looked_at_in_windows_without_steps_between_them(boxer):
    times = -(-24_000 // boxer.frame_count)
    long = replace(
        boxer,
        rotations=np.tile(boxer.rotations, (times, 1, 1)),
        root_positions=np.tile(boxer.root_positions, (times, 1)),
    )
    evidence = evidence_of(long)
    assert len(evidence.frames) == 20_000
    seams = np.flatnonzero(np.diff(evidence.frames) != 1)
    assert len(seams) == 9
    assert not evidence.inside[seams].any()
    assert not evidence.inside[seams + 1].any()
    assert len(evidence.speeds) == 20_000 - 10
