"""Cameras frame what they should at every frame, and move without jerks."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from render_sources import Walkers, random_walk

from crowdsim.errors import CrowdsimError
from crowdsim.render.camera import Keys, build_track, parse_camera
from crowdsim.render.crowd_path import watch
from crowdsim.render.view import directions

SIZE = (320, 180)


def project(view, points, size=SIZE):
    """Places of points (n, 3) on a picture, -1..1 across and up, and their distance ahead."""
    camera = view.pack(*size)
    x, y, z = camera[3:12].reshape(3, 3) @ (points - camera[:3]).T
    return camera[12] * x / z / (size[0] / 2), camera[12] * y / z / (size[1] / 2), z


@settings(max_examples=15, deadline=None)
@given(
    st.integers(1, 40),
    st.integers(0, 1000),
    st.floats(0.2, 60.0),
    st.sampled_from(["auto", "side", "top", "front", "orbit"]),
)
def test_cameras_of_the_crowd_show_all_avatars_completely_at_every_frame(count, seed, spread, camera):
    source = Walkers(random_walk(200, count, seed, spread))
    track = build_track(source, camera, SIZE)
    for frame in range(0, 200, 3):
        ground = source.paths[frame, :, :2]
        points = np.concatenate([np.insert(ground, 1, height, axis=1) for height in (0.0, 1.8)])
        x, y, ahead = project(track.view(frame), points)
        assert ahead.min() > 0.5
        assert np.abs(x).max() < 1.0
        assert np.abs(y).max() < 1.0


@pytest.mark.parametrize("camera", ["auto", "side", "front", "top"])
@pytest.mark.parametrize("spread", [0.3, 4.0, 30.0])
def test_the_crowd_is_centred_and_fills_the_picture(camera, spread):
    source = Walkers(random_walk(300, 30, 11, spread))
    track = build_track(source, camera, SIZE)
    centres, fills = [], []
    for frame in range(0, 300, 10):
        ground = source.paths[frame, :, :2]
        points = np.concatenate([np.insert(ground, 1, height, axis=1) for height in (0.0, 1.8)])
        x, y, _ = project(track.view(frame), points)
        centres.append([x.max() + x.min(), y.max() + y.min()])
        fills.append(max(x.max() - x.min(), y.max() - y.min()) / 2)
    assert np.abs(centres).mean(axis=0).max() < 0.16
    assert np.mean(fills) > 0.5


def test_cameras_of_the_crowd_show_what_it_fights_too():
    paths = random_walk(200, 1, 3)
    angles = np.linspace(0.0, 6.0, 200)
    things = np.stack([3.0 * np.sin(angles), np.full(200, 1.5), 3.0 * np.cos(angles)], axis=-1)[:, None]
    source = Walkers(paths, things=things)
    for camera in ("auto", "side", "top", "orbit"):
        track = build_track(source, camera, SIZE)
        for frame in range(0, 200, 5):
            x, y, ahead = project(track.view(frame), things[frame])
            assert ahead > 0.5
            assert abs(x) < 1.0
            assert abs(y) < 1.0


@pytest.mark.parametrize("camera", ["auto", "side", "top", "orbit", "follow:2"])
def test_cameras_move_without_jerks(camera):
    paths = random_walk(400, 6, 5)
    # One leaves at a run, which no camera may follow with a jump.
    paths[150:, 0, 0] += np.linspace(0.0, 25.0, 250)
    track = build_track(Walkers(paths), camera, SIZE)
    eyes = np.array([track.view(frame).eye for frame in range(400)])
    ahead = np.array([track.view(frame).ahead for frame in range(400)])
    speed, jerk = np.diff(eyes, axis=0) * 30.0, np.diff(eyes, 2, axis=0) * 900.0
    assert np.linalg.norm(speed, axis=1).max() < 14.0
    assert np.linalg.norm(jerk, axis=1).max() < 30.0
    assert np.linalg.norm(np.diff(ahead, axis=0), axis=1).max() * 30.0 < math.radians(60.0)


def test_a_camera_does_not_depend_on_the_order_of_frames():
    source = Walkers(random_walk(90, 4, 2))
    forwards, backwards = build_track(source, "auto", SIZE), build_track(source, "auto", SIZE)
    there = [forwards.view(frame).pack(*SIZE) for frame in range(90)]
    back = [backwards.view(frame).pack(*SIZE) for frame in reversed(range(90))][::-1]
    np.testing.assert_array_equal(there, back)


def test_following_keeps_the_avatar_in_sight():
    source = Walkers(random_walk(300, 5, 9))
    track = build_track(source, "follow:3", SIZE)
    for frame in range(0, 300, 5):
        ground = source.paths[frame, 3]
        x, y, ahead = project(track.view(frame), np.array([[ground[0], 1.0, ground[1]]]))
        assert ahead > 1.0
        assert abs(x) < 0.8
        assert abs(y) < 0.8


def test_avatars_may_be_followed_by_name():
    assert parse_camera("follow:walker_2", 5, Walkers(random_walk(5, 5, 0)).avatar_names) == "follow:2"


def test_absent_avatars_do_not_matter_to_the_camera():
    paths = random_walk(100, 4, 3)
    away = np.concatenate([paths, np.full((100, 1, 3), np.nan)], axis=1)
    few, more = (build_track(Walkers(p), "auto", SIZE, watch(Walkers(p))) for p in (paths, away))
    eye = more.view(50).eye
    assert np.isfinite(eye).all()
    assert few.view(50).eye == pytest.approx(eye, abs=0.5)


def test_a_keyed_camera_passes_through_its_keys_and_rests_at_the_ends():
    keys = Keys(np.array([0.0, 1.0, 2.0]), np.array([[0, 2, 9.0], [5, 3, 8], [9, 2, 0]]), np.zeros((3, 3)))
    track = build_track(Walkers(random_walk(90, 2, 1)), keys, SIZE)
    for frame, key in ((0, 0), (30, 1), (60, 2), (89, 2)):
        assert track.view(frame).eye == pytest.approx(keys.positions[key])
    first = np.linalg.norm(track.view(1).eye - track.view(0).eye)
    assert first < 0.2 * np.linalg.norm(track.view(16).eye - track.view(15).eye)


def test_right_up_and_ahead_are_square_to_one_another():
    for azimuth, elevation in ((0.0, 0.0), (1.0, 0.4), (-2.5, math.pi / 2)):
        basis = np.stack(directions(azimuth, elevation))
        assert basis @ basis.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(np.stack([basis[0], basis[1], -basis[2]])) == pytest.approx(1.0)


KNOWN = "auto, orbit, follow:AVATAR, top, side, front"
THERE = "expected a number from 0 to 4 or a name such as 'walker_0'"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("autto", f"camera 'autto' is unknown, expected one of {KNOWN} (did you mean 'auto'?)"),
        ("follow", f"camera 'follow' is unknown, expected one of {KNOWN} (follow whom? 'follow:0' say)"),
        ("follow:9", f"camera 'follow:9': no avatar '9', {THERE}"),
        ("follow:walker_7", f"camera 'follow:walker_7': no avatar 'walker_7', {THERE} (did you mean 'walker_0'?)"),
    ],
)
def test_unknown_cameras_and_avatars_are_refused(text, message):
    with pytest.raises(CrowdsimError) as caught:
        parse_camera(text, 5, tuple(f"walker_{i}" for i in range(5)))
    assert str(caught.value) == message


def fills(track, ground, frames):
    """Greatest share of the picture's width or height that a crowd at the places (F, N, 2) takes up, mean of frames."""
    shares = []
    for frame in frames:
        points = np.concatenate([np.insert(ground[frame], 1, height, axis=1) for height in (0.0, 1.8)])
        x, y, _ = project(track.view(frame), points)
        shares.append(max(np.ptp(x), np.ptp(y)) / 2)
    return float(np.mean(shares))


def test_one_who_runs_off_does_not_make_a_large_crowd_small():
    paths = random_walk(200, 80, 4)
    alone = build_track(Walkers(paths), "auto", SIZE)
    paths[:, 0, 0] += np.linspace(0.0, 120.0, 200)
    track = build_track(Walkers(paths), "auto", SIZE)
    frames, others = range(0, 200, 10), paths[:, 1:, :2]
    assert fills(track, others, frames) > 0.8 * fills(alone, others, frames) > 0.5
    for frame in frames:
        points = np.concatenate([np.insert(others[frame], 1, height, axis=1) for height in (0.0, 1.8)])
        x, y, _ = project(track.view(frame), points)
        assert np.abs(x).max() < 1.0
        assert np.abs(y).max() < 1.0


def test_small_crowds_are_framed_whole_however_far_apart():
    paths = random_walk(200, 12, 4)
    paths[:, 0, 0] += np.linspace(0.0, 60.0, 200)
    track = build_track(Walkers(paths), "auto", SIZE)
    for frame in range(0, 200, 10):
        x, y, _ = project(track.view(frame), np.insert(paths[frame, :, :2], 1, 1.0, axis=1))
        assert np.abs(x).max() < 1.0
        assert np.abs(y).max() < 1.0


def line(count: int, deep: float) -> np.ndarray:
    """Two ranks of avatars who face each other, 1 m apart along x and ``deep`` apart along z. Shape (60, N, 3)."""
    x = np.repeat(np.arange(count // 2), 2) - count / 4
    z = np.tile([-deep / 2, deep / 2], count // 2)
    heading = np.tile([0.0, math.pi], count // 2)
    return np.repeat(np.stack([x, z, heading], axis=1)[None], 60, axis=0)


def test_a_line_of_fighters_is_seen_obliquely_so_that_it_fills_the_picture():
    paths = line(40, 3.0)
    track = build_track(Walkers(paths), "auto", SIZE)
    points = np.concatenate([np.insert(paths[0, :, :2], 1, height, axis=1) for height in (0.0, 1.8)])
    x, y, _ = project(track.view(30), points)
    assert np.ptp(x) / 2 > 0.7
    assert np.ptp(y) / 2 > 0.55


def test_two_fighters_are_seen_from_the_side():
    paths = line(2, 1.2)
    ahead = build_track(Walkers(paths), "auto", SIZE).view(30).ahead
    assert abs(ahead[0]) > 0.95
