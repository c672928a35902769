"""Pictures are what geometry says they are, and the same for any sharing out of the work."""

import hashlib
import math

import naive_raycast as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED, MISSED
from crowdsim.render.kernels import tiles
from crowdsim.render.kernels.cones import meet_cone, start_tile
from crowdsim.render.kernels.ground import _checks
from crowdsim.render.kernels.records import CAMERA
from crowdsim.render.raycast import Capsules, Flashes, draw, sun_direction
from crowdsim.render.view import View, directions, look_at

SUN = sun_direction(0.7)


def capsules(*rows, owners=None):
    """Capsules of red paint from rows of both ends and both radii."""
    shapes = np.array(rows, np.float32).reshape(-1, 8)
    paints = np.tile(np.array([0.7, 0.05, 0.05, 0.2], np.float32), (len(shapes), 1))
    return Capsules(shapes, paints, np.arange(len(shapes), dtype=np.int32) if owners is None else owners)


def crowd(count, seed=0):
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-3, 3, (count, 3)) + np.array([0, 4, 0])
    return capsules(
        *np.concatenate([starts, starts + rng.normal(size=(count, 3)) * 0.5, rng.uniform(0.02, 0.3, (count, 2))], 1)
    )


VIEW = look_at(np.array([0.0, 3.0, 9.0]), np.array([0.0, 1.5, 0.0]))


def digest(picture):
    return hashlib.sha256(picture.tobytes()).hexdigest()


cones = st.builds(
    lambda way, middle, half, radius, share: np.array(
        [*(np.array([middle[0], middle[1], -1.0]) * way), *half, radius, radius * share], np.float32
    ),
    st.floats(1.5, 80.0),
    st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)),
    st.tuples(*[st.floats(-0.4, 0.4)] * 3),
    st.floats(0.02, 0.3),
    st.floats(-0.6, 0.6),
)


def cone_of(way, across, half, radius, change):
    return np.array([across[0] * way, across[1] * way, -way, *half, radius, change], np.float32)


INTO = [
    cone_of(5.0, (0.0, 0.0), (0.02, 0.01, 0.03), 0.2, 0.1),
    cone_of(5.0, (0.01, 0.0), (0.0, 0.0, 0.0), 0.2, -0.1),
    cone_of(3.0, (0.0, 0.005), (0.1, 0.0, 0.0), 0.25, 0.1),
    cone_of(9.0, (0.01, -0.01), (0.06, -0.05, 0.06), 0.2, -0.11),
]
"""Rounded cones of which one end's sphere holds, or just holds, the other's."""
ALONG = [
    cone_of(4.0, (0.0, 0.0), (0.0, 0.0, side * 0.4), 0.2, change)
    for side in (-1.0, 1.0)
    for change in (-0.12, 0.0, 0.12)
] + [cone_of(1.5, (0.0, 0.0), (0.0, 0.0, side * 0.125), 0.25, side * -0.0625) for side in (-1.0, 1.0)]
ALONG += [cone_of(4.0, (0.012, -0.007), (0.03, 0.02, side * 0.35), 0.15, 0.1) for side in (-1.0, 1.0)]
"""Rounded cones that are looked at along their axis."""


@pytest.mark.parametrize("cone", [*INTO, *ALONG])
def test_rays_meet_cones_within_their_own_ends_and_along_their_axis(cone):
    rays_meet(cone)


@settings(max_examples=60, deadline=None)
@given(cones)
def test_rays_meet_rounded_cones_where_the_spheres_are_that_make_them(cone):
    rays_meet(cone)


def rays_meet(cone):
    """Hold every ray of a tile against the naive twin."""
    way = float(np.linalg.norm(cone[:3]))
    focal = 8.0 * way / (2.5 * (np.linalg.norm(cone[3:6]) + cone[6] + abs(cone[7])))
    camera = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, -1, focal, 4.0, 4.0, 50.0], float).view(CAMERA)[0]
    buf = np.zeros(tiles.SCRATCH, np.float32)
    start_tile(buf, 0, 0, camera)
    meet_cone(buf, 0, 64, np.float32(0), tuple(np.float32(value) for value in cone))
    for pixel in range(64):
        ray = np.array([buf[tiles.DX + pixel], buf[tiles.DY + pixel], buf[tiles.DZ + pixel]], float)
        ray /= np.linalg.norm(ray)
        wide = way / focal
        distance = naive.gap(ray, cone.astype(float))
        if distance < -0.75 * wide and naive.spheres(cone.astype(float))[1].min() > wide:
            t, normal = naive.first_hit(ray, cone.astype(float))
            s = buf[tiles.FRONT_S + pixel]
            found = ray * buf[tiles.FRONT_T + pixel] - cone[:3] - s * cone[3:6]
            assert buf[tiles.FRONT_T + pixel] == pytest.approx(t, abs=2e-3 + 1e-4 * t)
            # Normals turn fast near the rim; a millimetre of distance allows a few degrees there.
            assert found @ normal / np.linalg.norm(found) > 0.98
        elif distance > 0.75 * wide:
            assert buf[tiles.FRONT_T + pixel] == tiles.FAR
            assert buf[tiles.EDGE_T + pixel] == tiles.FAR


@pytest.mark.parametrize("way", [3.0, 20.0, 150.0])
def test_coverage_of_a_ball_sums_to_the_area_of_its_disc(way):
    radius = 0.5
    focal = 60.0 * way
    shares = 0.0
    for y0 in range(0, 72, 8):
        for x0 in range(0, 72, 8):
            camera = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, -1, focal, 36.3, 35.6, 50.0], float).view(CAMERA)[0]
            buf = np.zeros(tiles.SCRATCH, np.float32)
            start_tile(buf, x0, y0, camera)
            meet_cone(buf, 0, 64, np.float32(0), tuple(np.float32(v) for v in (0, 0, -way, 0, 0, 0, radius, 0)))
            shares += np.count_nonzero(buf[tiles.FRONT_T : tiles.FRONT_T + 64] < tiles.FAR)
            edges = buf[tiles.EDGE_T : tiles.EDGE_T + 64] < tiles.FAR
            shares += buf[tiles.EDGE_C : tiles.EDGE_C + 64][edges].sum()
    seen = focal * radius / math.sqrt(way * way - radius * radius)
    assert shares == pytest.approx(math.pi * seen * seen, rel=0.01)


def test_thin_capsules_cover_as_much_as_they_are_wide():
    camera = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, -1, 100.0, 4.0, 4.0, 50.0], float).view(CAMERA)[0]
    buf = np.zeros(tiles.SCRATCH, np.float32)
    start_tile(buf, 0, 0, camera)
    radius = 0.0015
    cone = tuple(np.float32(v) for v in (0.003, 0, -1, 0, 5, 0, radius, 0))
    meet_cone(buf, 0, 64, np.float32(0), cone)
    cover = buf[tiles.EDGE_C : tiles.EDGE_C + 64].reshape(8, 8).sum(axis=1)
    assert cover == pytest.approx(np.full(8, 100.0 * 2 * radius), rel=0.03)


@pytest.mark.parametrize("threads", [2, 3, 5])
def test_any_number_of_threads_gives_the_same_pixels(threads):
    scene = crowd(60)
    one = draw(scene, VIEW, (203, 117), SUN)
    assert digest(draw(scene, VIEW, (203, 117), SUN, threads=threads)) == digest(one)
    assert one.shape == (117, 203, 3)
    assert len(np.unique(one.reshape(-1, 3), axis=0)) > 300


def test_the_order_of_avatars_does_not_show():
    scene = crowd(60)
    order = np.random.default_rng(3).permutation(60)
    mixed = Capsules(scene.shapes[order], scene.paints[order], scene.owners[order])
    there, here = draw(mixed, VIEW, (160, 96), SUN), draw(scene, VIEW, (160, 96), SUN)
    assert np.abs(there.astype(int) - here).max() <= 1


def test_a_scene_far_from_the_origin_looks_like_one_at_it():
    scene = crowd(40)
    shift = np.array([1230.0, 0.0, -870.0])
    moved = scene.shapes.astype(float)
    moved[:, :3] += shift
    moved[:, 3:6] += shift
    far = draw(
        Capsules(moved.astype(np.float32), scene.paints, scene.owners),
        View(VIEW.eye + shift, VIEW.ahead, VIEW.right, VIEW.distance),
        (160, 96),
        SUN,
    )
    difference = np.abs(draw(scene, VIEW, (160, 96), SUN).astype(int) - far)
    assert np.quantile(difference, 0.99) <= 2


def test_what_is_nearer_hides_what_is_behind():
    back = [0, 1, -1, 0, 2, -1, 0.4, 0.4]
    front = [-0.4, 1.5, 1, 0.4, 1.5, 1, 0.1, 0.1]
    scene = capsules(back, front)
    scene.paints[1, :3] = [0.05, 0.7, 0.05]
    picture = draw(scene, look_at(np.array([0, 1.5, 6.0]), np.array([0, 1.5, 0.0])), (96, 96), SUN).astype(int)
    assert picture[48, 48, 1] > 2 * picture[48, 48, 0]
    assert picture[56, 48, 0] > 2 * picture[56, 48, 1]


def shares_of_sun(scene, view, size=(64, 64)):
    """Share of the sun in every pixel, by the picture of a white floor against that of an empty one."""
    empty = draw(
        Capsules(np.zeros((0, 8), np.float32), np.zeros((0, 4), np.float32), np.zeros(0, np.int32)), view, size, SUN
    )
    return draw(scene, view, size, SUN)[..., 0].astype(float) / empty[..., 0]


def test_shadows_lie_where_rays_to_the_sun_are_stopped():
    right, _, ahead = directions(0.4, math.pi / 2)
    eye = np.array([0.0, 14.0, 0.0])
    view = View(eye, ahead, right, 3e5, math.radians(25.0))
    scene = capsules([-0.8, 1.0, 0.2, 0.6, 1.3, -0.4, 0.15, 0.3], [0.9, 0.6, 0.9, 0.9, 0.6, 0.9, 0.2, 0.2])
    cone = [
        np.concatenate(
            [(row[:3] + row[3:6]) / 2, (row[3:6] - row[:3]) / 2, [(row[6] + row[7]) / 2, (row[7] - row[6]) / 2]]
        )
        for row in scene.shapes.astype(float)
    ]
    ratio = shares_of_sun(scene, view)
    half = math.tan(math.radians(12.5))
    up = np.cross(view.right, view.ahead)
    wrong = checked = 0
    for y in range(2, 62, 3):
        for x in range(2, 62, 3):
            ray = view.ahead + half * ((x - 31.5) / 32 * view.right - (y - 31.5) / 32 * up)
            point = eye + ray * (-eye[1] / ray[1])
            shades = [
                naive.is_shaded(point + np.array([dx, 0, dz]), SUN, cone) for dx in (-0.1, 0.1) for dz in (-0.1, 0.1)
            ]
            seen = any(
                np.isfinite(naive.first_hit(ray / np.linalg.norm(ray), np.concatenate([c[:3] - eye, c[3:]]))[0])
                for c in cone
            )
            if not seen and all(shades) != any(shades):
                continue
            if not seen:
                checked += 1
                wrong += (ratio[y, x] < 0.75) != all(shades)
    assert checked > 250
    assert wrong == 0


def test_a_lone_ball_does_not_shade_itself():
    scene = capsules([0, 5, 0, 0, 5, 0, 1, 1])
    view = look_at(np.array([0, 5, 0]) + 6 * SUN, np.array([0, 5.0, 0]), distance=3e5)
    red = draw(scene, view, (96, 96), SUN)[..., 0].astype(float)
    y, x = np.mgrid[:96, :96] - 47.5
    inside = np.hypot(x, y) < 20
    middle = red[47:49, 47:49].mean()
    # Seen from the sun, light falls off smoothly from the middle to the rim.
    assert red[inside].min() > 0.75 * middle
    assert np.abs(np.diff(red, axis=1))[inside[:, 1:] & inside[:, :-1]].max() < 12


def test_shadows_touch_figures_on_the_floor():
    scene = capsules([0, 0.05, 0, 0, 1.7, 0, 0.05, 0.05])
    away = -SUN * [1, 0, 1] / np.linalg.norm(SUN[[0, 2]])
    right, _, ahead = directions(0.0, math.pi / 2)
    view = View(np.array([0.0, 9.0, 0.0]), ahead, right, 3e5, math.radians(20.0))
    picture = shares_of_sun(scene, view, (256, 256))
    metre = 128 / (9.0 * math.tan(math.radians(10.0)))
    for way in (0.12, 0.3, 0.6, 1.0):
        place = way * away
        x, y = 128 + metre * float(place @ right), 128 - metre * float(place @ np.cross(right, ahead))
        assert picture[int(y), int(x)] < 0.75


@settings(max_examples=100, deadline=None)
@given(st.floats(-9, 9), st.floats(0.002, 0.75))
def test_the_floor_is_the_mean_of_its_squares_over_a_pixel(x, wide):
    found = _checks(np.float32(x + 20), np.float32(wide))
    assert found == pytest.approx(naive.checker(x + 20, 0.5, wide, 1e-6, 2001), abs=0.02)


def test_squares_fade_out_where_a_pixel_holds_several():
    view = look_at(np.array([0.0, 2.0, 0.0]), np.array([0.3, 1.8, 5.0]), distance=3e4)
    empty = Capsules(np.zeros((0, 8), np.float32), np.zeros((0, 4), np.float32), np.zeros(0, np.int32))
    picture = draw(empty, view, (320, 200), SUN)[..., 0].astype(float)
    horizon = int(100 - 100 * math.tan(math.atan2(0.2, 5.0)) / math.tan(math.radians(18.0)))
    far, near = picture[horizon + 2 : horizon + 8], picture[-40:]
    assert far.std(axis=1).max() < 2.0
    assert near.std(axis=1).max() > 5.0


@pytest.mark.parametrize(
    "row",
    [
        [0, 1, 0, 0, 1, 0, 0.2, 0.2],
        [0, 1, 0, 0, 2, 0, 0.0, 0.0],
        [0, 1, 0, 0, 1.01, 0, 0.5, 0.1],
        [0, 1, 200, 0, 1, -200, 0.1, 0.1],
        [0, 3, 9, 0, 3, 9, 0.5, 0.5],
        [0, 3, 12, 0, 3, 15, 0.5, 0.5],
        [0, -5, 0, 0, -4, 0, 0.5, 0.5],
        [np.nan, 1, 0, 0, 1, 0, 0.2, 0.2],
        [0, 1, 0, 0, 1, 0, 500.0, 500.0],
    ],
    ids=["ball", "thread", "ball in ball", "through the eye", "about the eye", "behind", "below", "nan", "giant"],
)
def test_odd_capsules_neither_crash_nor_spoil_the_picture(row):
    picture = draw(capsules(row), VIEW, (64, 48), SUN)
    assert picture.shape == (48, 64, 3)
    empty = draw(
        Capsules(np.zeros((0, 8), np.float32), np.zeros((0, 4), np.float32), np.zeros(0, np.int32)), VIEW, (64, 48), SUN
    )
    if np.isnan(row).any() or row[2] == 12:
        np.testing.assert_array_equal(picture, empty)


def test_flashes_brighten_their_surroundings_and_fade():
    scene = crowd(1)
    point = np.array([[0.0, 1.5, 0.0]])
    plain = draw(scene, VIEW, (128, 96), SUN).astype(int)
    glow = [
        draw(scene, VIEW, (128, 96), SUN, Flashes(point, np.array([age]), np.ones(1), np.ones(1))).astype(int) - plain
        for age in (0.0, 0.5, 0.99)
    ]
    assert glow[0].min() >= 0
    assert glow[0][44:52, 60:68].max() > 40
    assert glow[0].sum() > glow[1].sum() > glow[2].sum()
    assert glow[0][:10, :10].max() == 0


def test_outcomes_of_strikes_have_marks_of_their_own():
    scene, point = crowd(1), np.array([[0.0, 1.5, 0.0]])
    plain = draw(scene, VIEW, (128, 96), SUN).astype(int)
    marks = [
        draw(scene, VIEW, (128, 96), SUN, Flashes(point, np.full(1, 0.2), np.ones(1), np.full(1, outcome))) - plain
        for outcome in range(4)
    ]
    strongest = [int(mark.sum(axis=(0, 1)).argmax()) for mark in marks]
    assert [strongest[outcome] for outcome in (LANDED, BLOCKED, EVADED)] == [0, 2, 1]
    assert all(mark.max() > 20 for mark in marks)
    assert marks[MISSED].sum() < min(marks[outcome].sum() for outcome in (LANDED, BLOCKED, EVADED))


def test_flashes_behind_something_are_hidden():
    scene = capsules([-3, 1.5, 3, 3, 1.5, 3, 1.4, 1.4])
    hidden = Flashes(np.array([[0.0, 1.5, -2.0]]), np.zeros(1), np.ones(1), np.ones(1))
    plain = draw(scene, VIEW, (128, 96), SUN)
    np.testing.assert_array_equal(draw(scene, VIEW, (128, 96), SUN, hidden), plain)


def test_capsules_that_show_thinner_than_a_pixel_cast_no_shadow_of_their_own():
    rows = [[0, 1, 0, 0, 2, 0, 0.05, 0.05], [1, 1, 0, 1, 2, 0, 0.3, 0.3]]
    right, _, ahead = directions(0.4, math.pi / 2)
    for height, cast in ((8.0, (True, True)), (90.0, (False, True))):
        view = View(np.array([0.0, height, 0.0]), ahead, right, 3e5, math.radians(50.0))
        ratios = [shares_of_sun(capsules(row), view, (256, 256)) for row in rows]
        foot = -SUN * 1.5 / SUN[1]
        up = np.cross(view.right, view.ahead)
        for row, ratio, shaded in zip(rows, ratios, cast, strict=True):
            point = np.array(row[:3]) * [1, 0, 1] + foot * [1, 0, 1]
            scale = 128 / (height * math.tan(math.radians(25.0)))
            x, y = 128 + scale * float(point @ view.right), 128 - scale * float(point @ up)
            around = ratio[int(y) - 1 : int(y) + 2, int(x) - 1 : int(x) + 2]
            assert (around.min() < 0.93) == shaded


ABOVE = View(np.array([1.0, 12.0, -2.0]), np.array([0.0, -1.0, 0.0]), np.array([-1.0, 0.0, 0.0]), distance=3e5)


def floor_points(view, size):
    """Where the middle of every pixel of a view from straight above lies on the floor: x and z."""
    camera = view.pack(*size)
    rows, columns = np.mgrid[: size[1], : size[0]] + 0.5
    right, up = camera[3:6], camera[6:9]
    across, along = (columns - camera[13]) / camera[12], -(rows - camera[14]) / camera[12]
    way = across[..., None] * right + along[..., None] * up
    return camera[0] + camera[1] * way[..., 0], camera[2] + camera[1] * way[..., 2]


@pytest.mark.parametrize("kind", [1.0, 2.0])
def test_a_white_line_surrounds_the_arena_and_the_floor_outside_is_darker(kind):
    size = (320, 240)
    arena = np.array([kind, 1.5, -1.5, 3.0, 3.0 if kind == 1.0 else 2.0])
    plain = draw(capsules(), ABOVE, size, SUN).astype(int).sum(axis=-1)
    picture = draw(capsules(), ABOVE, size, SUN, arena=arena).astype(int).sum(axis=-1)
    x, z = floor_points(ABOVE, size)
    beyond = naive.beyond_arena(x, z, arena)
    pixel = 12.0 / ABOVE.pack(*size)[12]
    edge = 0.04 + 1.5 * pixel
    assert (picture[np.abs(beyond) < 0.01] > plain[np.abs(beyond) < 0.01] + 60).all()
    np.testing.assert_array_equal(picture[beyond < -edge], plain[beyond < -edge])
    outside = beyond > edge
    assert outside.any()
    assert (picture[outside] < plain[outside] - 20).all()


def test_the_line_around_an_arena_is_seen_from_far_away_too():
    far = look_at(np.array([0.0, 60.0, 90.0]), np.zeros(3), distance=3e5)
    arena = np.array([1.0, 0.0, 0.0, 20.0, 20.0])
    plain, picture = (draw(capsules(), far, (320, 180), SUN, arena=a).astype(int).sum(axis=-1) for a in (None, arena))
    column = (picture - plain)[:, 160]
    assert (column > 15).sum() >= 2
    assert column.min() < -15


def test_open_ground_has_no_line():
    open_ground = draw(crowd(30), VIEW, (160, 96), SUN, arena=np.zeros(5))
    assert digest(draw(crowd(30), VIEW, (160, 96), SUN)) == digest(open_ground)
