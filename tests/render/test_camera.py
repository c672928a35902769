"""Cameras frame what they should at every frame, and move without jerks."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from render_sources import Walkers, random_walk

from crowdsim.errors import CrowdsimError
from crowdsim.render.camera import build_track, resolve_camera
from crowdsim.render.crowd_path import watch
from crowdsim.render.line_of_sight import are_in_sight
from crowdsim.render.view import directions
from crowdsim.render.viewpoints import HEADINGS, find_course
from crowdsim.scenario.camera import Lens, avatar_number
from crowdsim.scenario.cameras import KINDS

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
    source = Walkers(random_walk(60, 5, 0))
    named, numbered = (build_track(source, f"follow:{avatar}", SIZE).view(30) for avatar in ("walker_2", 2))
    np.testing.assert_array_equal(named.pack(*SIZE), numbered.pack(*SIZE))


def test_the_name_of_a_group_of_one_means_its_avatar():
    names = ["red_0", "red_1", "referee_0"]
    assert avatar_number("referee", names) == 2
    with pytest.raises(CrowdsimError, match="no avatar 'red', expected a number from 0 to 2"):
        avatar_number("red", names)


def test_a_lens_may_be_a_focal_length_or_a_field_of_view():
    lens = Lens(focal_length=50.0, sensor=24.0)
    assert math.degrees(lens.field) == pytest.approx(26.99, abs=0.01)
    for keys in ({}, {"focal_length": 50.0, "field_of_view": 20.0}):
        with pytest.raises(ValidationError, match="either field_of_view or focal_length"):
            Lens(**keys)
    source = Walkers(random_walk(60, 5, 0))
    for kind in ("auto", "orbit", "follow", "fight", "eye", "top"):
        camera = KINDS[kind](kind=kind, lens={"field_of_view": 20.0})
        assert build_track(source, camera, SIZE).view(30).field == pytest.approx(math.radians(20.0))


def test_following_goes_around_what_stands_in_the_way():
    paths = np.zeros((200, 4, 3))
    # A wall of three behind the back and to its left, where the camera would be.
    paths[:, 1:, 0], paths[:, 1:, 1] = [0.4, 0.75, 1.1], -2.5
    source, head = Walkers(paths), np.array([[0.0, 1.2, 0.0]])
    shown = []
    for avoid in (False, True):
        camera = KINDS["follow"](kind="follow", height=1.4, avoid=avoid)
        eye = build_track(source, camera, SIZE).view(100).eye
        bodies = np.array([[x, 0.2, z, x, 1.7, z, 0.2, 0.2] for x, z in paths[100, 1:, :2]])
        shown.append(bool(are_in_sight(head, eye[None], bodies)[0, 0]))
    assert shown == [False, True]


def test_absent_avatars_do_not_matter_to_the_camera():
    paths = random_walk(100, 4, 3)
    away = np.concatenate([paths, np.full((100, 1, 3), np.nan)], axis=1)
    few, more = (build_track(Walkers(p), "auto", SIZE, watch(Walkers(p))) for p in (paths, away))
    eye = more.view(50).eye
    assert np.isfinite(eye).all()
    assert few.view(50).eye == pytest.approx(eye, abs=0.5)


def test_a_path_passes_through_its_keys_and_rests_at_the_ends():
    positions = [(0, 2, 9), (5, 3, 8), (9, 2, 0)]
    keys = [
        {"seconds": float(i), "position": position, "look_at": (0.0, 0.0, 0.0)} for i, position in enumerate(positions)
    ]
    track = build_track(Walkers(random_walk(90, 2, 1)), KINDS["path"](kind="path", keys=keys), SIZE)
    for frame, key in ((0, 0), (30, 1), (60, 2), (89, 2)):
        assert track.view(frame).eye == pytest.approx(positions[key])
    first = np.linalg.norm(track.view(1).eye - track.view(0).eye)
    assert first < 0.2 * np.linalg.norm(track.view(16).eye - track.view(15).eye)


def test_right_up_and_ahead_are_square_to_one_another():
    for azimuth, elevation in ((0.0, 0.0), (1.0, 0.4), (-2.5, math.pi / 2)):
        basis = np.stack(directions(azimuth, elevation))
        assert basis @ basis.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(np.stack([basis[0], basis[1], -basis[2]])) == pytest.approx(1.0)


KNOWN = "near, auto, fight, fight:AVATAR, orbit, follow, follow:AVATAR, eye, eye:AVATAR, top, side, front"
THERE = "expected a number from 0 to 4 or a name such as 'walker_0'"
NEAR = KINDS["fixed"](kind="fixed", position=(0, 1, 2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("autto", f"camera 'autto' is unknown, expected one of {KNOWN} (did you mean 'auto'?)"),
        ("nea", f"camera 'nea' is unknown, expected one of {KNOWN} (did you mean 'near'?)"),
        ("fixed", f"camera 'fixed' is unknown, expected one of {KNOWN} (fixed needs keys: position)"),
        ("side:3", f"camera 'side:3' is unknown, expected one of {KNOWN} (did you mean 'side'?)"),
        ("follow:9", f"camera 'follow:9': no avatar 9, {THERE}"),
        ("eye:walker_7", f"camera 'eye:walker_7': no avatar 'walker_7', {THERE} (did you mean 'walker_0'?)"),
    ],
)
def test_unknown_cameras_and_avatars_are_refused(text, message):
    with pytest.raises(CrowdsimError) as caught:
        resolve_camera(Walkers(random_walk(5, 5, 0), cameras={"near": NEAR}), text)
    assert str(caught.value) == message


def test_cameras_are_found_by_name_in_files_and_by_kind(tmp_path):
    source = Walkers(random_walk(5, 5, 0), cameras={"near": NEAR})
    assert resolve_camera(source, "near") == (NEAR,)
    assert [one.kind for one in resolve_camera(source, "front+near")] == ["front", "fixed"]
    file = tmp_path / "cameras.yaml"
    file.write_text("cameras:\n  low: {kind: follow, avatar: walker_2, height: 0.4}\n  high: {kind: top}\n")
    (low,) = resolve_camera(source, f"{file}#low")
    assert (low.kind, low.avatar, low.height) == ("follow", 2, 0.4)
    with pytest.raises(CrowdsimError) as caught:
        resolve_camera(source, f"{file}#hihg")
    assert str(caught.value) == (
        f"camera '{file}#hihg' is unknown, expected {file}#NAME with one of low, high (did you mean 'high'?)"
    )


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


def test_two_fighters_are_seen_from_between_the_side_and_the_back_of_one():
    paths = line(2, 1.2)
    x, _, z = build_track(Walkers(paths), "auto", SIZE).view(30).ahead
    assert 35.0 < math.degrees(math.atan2(abs(x), abs(z))) < 85.0


def test_a_fight_is_seen_past_the_one_who_stands_in_the_way():
    paths = np.concatenate([line(2, 1.2), np.zeros((60, 3, 3))], axis=1)
    # Three stand on the side from which the pair would be seen otherwise.
    for camera in ("fight:walker_0,walker_1",):
        free = build_track(Walkers(paths[:, :2]), "fight", SIZE).view(30).eye
        way = (free - [0.0, free[1], 0.0]) / np.linalg.norm(free[[0, 2]])
        paths[:, 2:, 0] = -0.5 + 1.5 * way[0] + np.array([-0.4, 0.0, 0.4]) * way[2]
        paths[:, 2:, 1] = 1.5 * way[2] - np.array([-0.4, 0.0, 0.4]) * way[0]
        eye = build_track(Walkers(paths), camera, SIZE).view(30).eye
        bodies = np.array([[x, 0.2, z, x, 1.6, z, 0.2, 0.2] for x, z in paths[30, 2:, :2]])
        heads = np.array([[x, 1.5, z] for x, z in paths[30, :2, :2]])
        assert not are_in_sight(heads, free[None], bodies).all()
        assert are_in_sight(heads, eye[None], bodies).all()


def test_what_lies_between_a_point_and_an_eye_is_found_as_by_points_along_the_way():
    rng = np.random.default_rng(5)
    points, eyes = rng.normal(size=(40, 3)), 3.0 * rng.normal(size=(30, 3))
    shapes = np.concatenate([rng.normal(size=(5, 6)), rng.uniform(0.1, 0.3, (5, 1))], axis=1)[:, [*range(6), 6, 6]]
    found = are_in_sight(points, eyes, shapes)
    along = np.linspace(0.0, 1.0, 400)[:, None]
    for e, eye in enumerate(eyes):
        for p, point in enumerate(points):
            way = point + along * (eye - point)
            gaps = []
            for one in shapes:
                t = np.clip((way - one[:3]) @ (one[3:6] - one[:3]) / np.sum((one[3:6] - one[:3]) ** 2), 0.0, 1.0)
                gaps.append(np.linalg.norm(way - one[:3] - t[:, None] * (one[3:6] - one[:3]), axis=1).min() - one[6])
            if abs(min(gaps)) > 1e-3:
                assert found[e, p] == (min(gaps) > 0.0)


def test_a_course_stays_cuts_at_lulls_and_never_elsewhere():
    costs = np.full((40, HEADINGS, 1), 10.0)
    costs[:20, 0] = costs[20:, HEADINGS // 2] = 0.0
    cuts = np.full(40, np.inf)
    cuts[17] = 1.0
    course = find_course(costs, np.zeros(1), cuts, 1)
    assert course.starts.tolist() == [0, 17]
    assert course.at(10.0)[0] == pytest.approx(0.0)
    assert course.at(30.0)[0] == pytest.approx(math.pi)
    still = find_course(costs, np.zeros(1), np.full(40, np.inf), 1)
    assert still.starts.tolist() == [0]
    turns = np.abs(np.diff([still.at(moment)[0] for moment in range(40)]))
    assert turns.max() <= 2.0 * math.pi / HEADINGS + 1e-9
