"""Colours mean what they say, and light, background and marks are what they are called."""

import colorsys

import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError
from render_sources import Walkers, random_walk

from crowdsim.body.palette import avatar_paints
from crowdsim.errors import CrowdsimError
from crowdsim.motion.body import PARTS
from crowdsim.render.batch import render
from crowdsim.render.look import Look
from crowdsim.render.options import RenderOptions
from crowdsim.render.raycast import Capsules, draw, sun_direction
from crowdsim.render.stage import build_stage
from crowdsim.render.view import look_at
from crowdsim.scenario.camera import Lens
from crowdsim.scenario.cameras import KINDS, chosen_cameras

SIZE = (96, 64)
FRONT = look_at(np.array([0.0, 1.2, 3.0]), np.array([0.0, 1.0, 0.0]))
ABOVE = look_at(np.array([0.0, 5.0, 0.1]), np.zeros(3))
UP = look_at(np.array([0.0, 1.2, 3.0]), np.array([0.0, 3.0, 0.0]))


def ball(paint, radius=0.5) -> Capsules:
    shape = np.array([[0.0, 1.0, 0.0, 0.0, 1.0, 0.0, radius, radius]], np.float32)
    return Capsules(shape, np.array([[*paint, 0.0]], np.float32), np.zeros(1, np.int32))


@pytest.mark.parametrize("colour", ["#ff9000", "#ffffff", "#8020c0", "#00b140", "#c8553d"])
def test_a_colour_that_a_type_has_is_the_colour_of_its_lit_clothes(colour):
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    paint = avatar_paints([0, 1], np.array([wanted / 255.0] * 2))[0, PARTS.index("shirt"), :3]
    picture = draw(ball(paint), FRONT, SIZE, sun_direction(0.6)).astype(float)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    inside = picture[(x - 48) ** 2 + (y - 32) ** 2 < 12**2]
    shown = np.median(inside, axis=0)
    assert np.abs(shown - wanted).max() < 40
    if wanted.min() < wanted.max():
        hue, full = (colorsys.rgb_to_hsv(*(values / 255.0))[0] for values in (shown, wanted))
        assert abs((hue - full + 0.5) % 1.0 - 0.5) < 0.03


def lab(colours):
    """CIELAB of linear light."""
    xyz = colours @ np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                              [0.0193339, 0.1191920, 0.9503041]]).T / [0.95047, 1.0, 1.08883]  # fmt: skip
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


# Machado, Oliveira and Fernandes (2009), severity 1.
SEEN_BY = {
    "all cones": np.eye(3),
    "protanopia": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                            [-0.003882, -0.048116, 1.051998]]),
    "deuteranopia": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                              [-0.011820, 0.042940, 0.968881]]),
}  # fmt: skip


@pytest.mark.parametrize("eyes", SEEN_BY)
@pytest.mark.parametrize(("teams", "least"), [(2, 80.0), (4, 35.0), (10, 20.0)])
def test_team_colours_stay_apart_for_the_colour_blind(eyes, teams, least):
    paints = avatar_paints(np.repeat(np.arange(teams), 2))[::2, PARTS.index("glove"), :3]
    colours = lab(np.clip(paints @ SEEN_BY[eyes].T, 0.0, 1.0))
    distances = np.linalg.norm(colours[:, None] - colours, axis=-1) + 1e9 * np.eye(teams)
    assert distances.min() > least


@pytest.mark.parametrize(
    ("background", "shown"), [("white", (255, 255, 255)), ("black", (0, 0, 0)), ("#ff9000", (255, 144, 0))]
)
def test_a_flat_background_has_its_colour(background, shown):
    for view in (FRONT, UP):
        picture = draw(Capsules(*(part[:0] for part in vars(ball((1, 1, 1))).values())), view, SIZE, sun_direction(0.6),
                       look=Look(background=background)).astype(int)  # fmt: skip
        assert np.abs(picture - shown).max() <= 1


def test_a_flat_background_shows_shadows():
    picture = draw(ball((0.9, 0.9, 0.9), 0.3), ABOVE, SIZE, sun_direction(2.6), look=Look(background="white"))
    assert (picture < 220).all(axis=-1).sum() > 20


def test_a_transparent_picture_holds_figures_alone():
    picture = draw(ball((0.0, 0.0, 0.5)), FRONT, SIZE, sun_direction(0.6), look=Look(transparent=True)).astype(int)
    assert picture.shape == (SIZE[1], SIZE[0], 4)
    assert picture[32, 48, 3] == 255
    assert (picture[:4, :, 3] == 0).all()
    edge = (picture[..., 3] > 30) & (picture[..., 3] < 220)
    assert edge.sum() > 20
    # The colour of an edge is the figure's, not mixed with a background.
    assert (picture[edge][:, 2] > 2 * picture[edge][:, 0]).mean() > 0.9


def test_transparent_pictures_are_png_with_a_fourth_channel(tmp_path):
    walkers = Walkers(random_walk(4, 2, 0))
    options = RenderOptions(size=(64, 48), frames=(0, 1), mp4=False, png=True, look=Look(transparent=True))
    (path,) = render(walkers, tmp_path, options).files
    assert Image.open(path).mode == "RGBA"
    with pytest.raises(CrowdsimError, match="a video cannot be transparent"):
        render(walkers, tmp_path, RenderOptions(look=Look(transparent=True)))


def test_marks_are_of_all_strikes_of_those_that_landed_or_of_none():
    paths = random_walk(20, 2, 0)
    strikes = np.array([[0.3, 0.0, 1.5, 0.0]])
    pictures = {}
    for marks in ("none", "landed", "all"):
        pictures[marks] = build_stage(Walkers(paths, strikes=strikes), SIZE, "top", Look(marks, caption=False)).picture(
            10
        )
    plain = build_stage(Walkers(paths), SIZE, "top", Look(caption=False)).picture(10)
    np.testing.assert_array_equal(pictures["none"], plain)
    np.testing.assert_array_equal(pictures["landed"], pictures["all"])
    assert (pictures["landed"] != plain).any()


class Runners(Walkers):
    """Walkers who run across the picture, at any rate."""

    def at_rate(self, fps):
        times = np.arange(round((self.frame_count - 1) * fps / self.fps) + 1) / fps
        return Runners(np.stack([6.0 * times - 2.0, 0 * times, 0 * times], axis=-1)[:, None], fps=fps)


def test_motion_blur_is_the_mean_of_moments_while_a_shutter_is_open():
    source = Runners(np.zeros((20, 1, 3))).at_rate(30.0)
    camera = KINDS["fixed"](kind="fixed", position=(0, 1, 6))
    blurred = build_stage(source, SIZE, camera, Look(caption=False, motion_blur=4)).picture(5).astype(float)
    finer = build_stage(source.at_rate(240.0), SIZE, camera, Look(caption=False))
    moments = [finer.picture(40 + i).astype(float) ** 2 for i in range(4)]
    assert np.abs(blurred - np.sqrt(np.mean(moments, axis=0))).max() <= 1.0
    sharp = build_stage(source, SIZE, camera, Look(caption=False)).picture(5)
    assert (np.abs(blurred - sharp) > 8).sum() > 50
    clear = build_stage(source, SIZE, camera, Look(transparent=True, motion_blur=4)).picture(5).astype(float)
    alone = build_stage(source.at_rate(240.0), SIZE, camera, Look(transparent=True))
    covers = np.mean([alone.picture(40 + i)[..., 3].astype(float) for i in range(4)], axis=0)
    assert np.abs(clear[..., 3] - covers).max() <= 1.0
    # Where a figure passes, its colour is no darker for being there half of the time.
    passing = (covers > 60) & (covers < 190)
    assert clear[passing][:, :3].max(axis=1).mean() > 0.8 * clear[covers > 250][:, :3].max(axis=1).mean()
    with pytest.raises(CrowdsimError, match="motion blur needs a run, not a BVH file"):
        build_stage(Walkers(source.paths), SIZE, "top", Look(motion_blur=2))


def test_a_floor_without_a_grid_is_plain_and_lights_differ():
    def floor(**keys):
        return draw(ball((1, 1, 1), 0.05), ABOVE, SIZE, sun_direction(0.6),
                    look=Look(**keys)).astype(float)  # fmt: skip

    assert floor(grid=False)[:16].std(axis=(0, 1)).max() < 4.0 < floor()[:16].std(axis=(0, 1)).max()
    means = {light: floor(light=light).mean(axis=(0, 1)) for light in ("day", "soft", "evening", "night")}
    assert means["night"].mean() < 0.7 * means["day"].mean()
    assert means["evening"][0] > 1.2 * means["evening"][2]


def test_a_contact_sheet_has_moments_with_motion_blur(tmp_path):
    source = Runners(np.zeros((20, 1, 3))).at_rate(30.0)
    options = RenderOptions(size=SIZE, mp4=False, contact_sheet=2, look=Look(motion_blur=2, caption=False))
    render(source, tmp_path, options)
    assert np.asarray(Image.open(tmp_path / "contact_sheet.png")).std() > 1.0


def test_a_transparent_contact_sheet_covers_nothing_but_figures(tmp_path):
    look = Look(transparent=True, caption=False)
    render(Walkers(random_walk(6, 1, seed=3)), tmp_path, RenderOptions(SIZE, mp4=False, contact_sheet=2, look=look))
    sheet = np.asarray(Image.open(tmp_path / "contact_sheet.png"))
    assert (sheet[:3, :, 3] == 0).all()
    inside, edges = sheet[sheet[..., 3] == 255], sheet[(sheet[..., 3] > 60) & (sheet[..., 3] < 200)]
    assert edges[:, :3].mean() > 0.6 * inside[:, :3].mean(), "edges have no dark fringe"


def test_a_view_of_a_point_in_the_eye_is_ahead():
    view = look_at(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(view.ahead, [0.0, 0.0, 1.0])


@pytest.mark.parametrize("text", ["follow:a b", "follow:-1", "follow:a,b", "fight:" + ",".join("0" * 101)])
def test_avatars_of_cameras_that_cannot_be_are_an_error_of_the_camera(text):
    with pytest.raises(CrowdsimError, match="camera '"):
        chosen_cameras(text)


def test_a_lens_has_no_sensor_beside_its_field_of_view():
    with pytest.raises(ValueError, match="sensor"):
        Lens(field_of_view=40, sensor=36)


def test_what_is_out_of_focus_is_blurred_as_the_lens_says():
    paths = np.zeros((2, 2, 3))
    paths[:, :, 0], paths[:, :, 1] = [-0.6, 1.5], [0.0, -6.0]  # 4 m and 10 m from the camera
    size, shown = (240, 160), {}
    for focus in (None, 4.0, 10.0):
        keys = {} if focus is None else {"f_number": 1.0, "focus": focus}
        camera = KINDS["fixed"](kind="fixed", position=(0, 1, 4), lens={"focal_length": 50.0, **keys})
        stage = build_stage(Walkers(paths), size, camera, Look(caption=False, grid=False, background="white"))
        shown[focus] = stage.picture(0).astype(float)
    near, far = np.s_[:, :100], np.s_[:, 110:]
    for focus, sharp, soft in ((4.0, near, far), (10.0, far, near)):
        changed = [np.abs(shown[focus][part] - shown[None][part]).mean() for part in (sharp, soft)]
        assert changed[0] < 0.35 * changed[1]
        assert abs(shown[focus].mean() - shown[None].mean()) < 3.0
    lens = Lens(focal_length=50.0, f_number=2.0)
    assert lens.aperture == pytest.approx(0.0125)
    with pytest.raises(ValidationError, match="is given without f_number"):
        Lens(focal_length=50.0, focus=3.0)
