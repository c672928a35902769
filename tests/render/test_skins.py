"""Bodies in pictures: skins cover what their triangles cover, are seen from near, and hide what is behind."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pydantic import ValidationError
from render_sources import Walkers

from crowdsim.body.anatomy import Build
from crowdsim.body.kernels import carry_skin, nearest_capsules
from crowdsim.body.skin import build_skin
from crowdsim.errors import CrowdsimError
from crowdsim.motion.body import build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.outputs.render import RenderOutput
from crowdsim.performer.session import perform
from crowdsim.render import skins as render_skins
from crowdsim.render.command import scenario_options
from crowdsim.render.look import Look
from crowdsim.render.raycast import Capsules, PosedSkins, draw, sun_direction
from crowdsim.render.skins import BODY_SCALE
from crowdsim.render.source import no_strikes
from crowdsim.render.stage import build_stage
from crowdsim.render.view import look_at

SIZE = (96, 72)
FRONT = look_at(np.array([0.0, 1.2, 3.0]), np.array([0.0, 1.0, 0.0]))
SUN = sun_direction(0.6)
CLEAR = Look(transparent=True)


class Fighters:
    """Performed boxers at some distances along z, in the poses of a clip; a ``PoseSource`` with skins."""

    fps, name, cameras = 30.0, "fighters", {}

    def __init__(self, distances=(0.0,)) -> None:
        clip = perform(12.0, 3)[0].clip
        count = len(distances)
        self.clip, self.offsets = clip, np.stack([np.zeros(count), np.zeros(count), np.asarray(distances)], axis=1)
        self.body = build_body(clip.skeleton)
        self.figures, self.avatar_figures = (self.body,), np.zeros(count, np.int32)
        self.frame_count, self.fingerprint = 60, f"fighters {distances}"
        self.avatar_names = tuple(f"fighter_{i}" for i in range(count))
        self.avatar_teams = np.arange(count) % 2
        self.avatar_scales, self.avatar_girths = np.ones(count), np.ones(count)
        self.avatar_stretches = np.ones((count, 3))
        self.avatar_heights = np.full(count, 1.8)
        self.avatar_colours = np.full((count, 3), np.nan)
        self.arena = np.zeros(5)

    def skin(self, avatar, coarseness):
        return build_skin(self.clip.skeleton, self.body, Build(), self.clip.rotations[::30], coarseness)

    def at_rate(self, fps):
        return self

    def ground(self, frames):
        return np.repeat(self.offsets[None, :, [0, 2, 1]], len(frames), axis=0)

    def poses(self, frame, shown=None):
        root = self.clip.root_positions[frame] * [0.0, 1.0, 0.0]
        places, turned = forward_kinematics(
            self.clip.skeleton, root + self.offsets, np.repeat(self.clip.rotations[frame][None], len(self.offsets), 0)
        )
        return [(places, turned)]

    def recent_strikes(self, frame):
        return no_strikes()

    def markers(self, frame):
        return np.zeros((0, 3))


@pytest.fixture(scope="module")
def fighters():
    return Fighters()


def mesh_skins(mesh, avatars=(0,), shifts=((0.0, 0.0, 0.0),), colour=(0.5, 0.1, 0.1, 0.0)):
    """A mesh as the skin of each of some avatars, moved."""
    count, vertices, faces = len(avatars), np.asarray(mesh.vertices), np.asarray(mesh.faces)
    numbers = np.repeat(np.arange(count), len(faces))
    return PosedSkins(
        avatars=np.asarray(avatars),
        vertices=np.concatenate([vertices + shift for shift in shifts]).astype(np.float32),
        normals=np.tile(np.asarray(mesh.vertex_normals), (count, 1)).astype(np.float32),
        triangles=np.concatenate([faces + len(vertices) * i for i in range(count)]).astype(np.int32),
        owners=np.asarray(avatars)[numbers].astype(np.int32),
        looks=numbers.astype(np.int32),
        homes=np.zeros(len(numbers), np.int32),
        paints=np.array([colour] * count, np.float32),
    )


def capsules(avatars=(0,)):
    """Capsules of no size to speak of, since those of skins are not seen."""
    shapes = np.array([[0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.01, 0.01]] * len(avatars), np.float32)
    return Capsules(shapes, np.zeros((len(avatars), 4), np.float32), np.asarray(avatars, np.int32))


def ball(radius=0.4, detail=3):
    mesh = trimesh.creation.icosphere(detail, radius)
    mesh.apply_translation([0.0, 1.0, 0.0])
    return mesh


def sample_cover(skins, view, size):
    """Which triangle is nearest at each of four samples of each pixel, one by one. Shape (height, width, 4)."""
    width, height = size
    camera = view.pack(width, height)
    relative = skins.vertices.astype(float) - camera[:3]
    x, y, z = camera[3:12].reshape(3, 3) @ relative.T
    u, v = camera[13] + camera[12] * x / z, camera[14] - camera[12] * y / z
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    depth, found = np.full((height, width, 4), np.inf), np.full((height, width, 4), -1)
    for number, corners in enumerate(skins.triangles):
        (ax, bx, cx), (ay, by, cy) = u[corners], v[corners]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area >= 0:
            continue
        for sample, column in enumerate((1, 3, 0, 2)):
            px, py = columns + (column + 0.5) / 4, rows + (sample + 0.5) / 4
            a = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
            b = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
            own = 1.0 / ((np.stack([a, b, 1 - a - b], -1) / z[corners]).sum(-1))
            inside = (a >= 0) & (b >= 0) & (a + b <= 1) & (own < depth[..., sample])
            depth[..., sample][inside] = own[inside]
            found[..., sample][inside] = number
    return found


def test_pixels_are_covered_as_their_samples_are():
    skins = mesh_skins(ball(detail=2))
    alpha = draw(capsules(), FRONT, SIZE, SUN, look=CLEAR, skins=skins)[..., 3]
    expected = (sample_cover(skins, FRONT, SIZE) >= 0).mean(axis=2)
    wrong = np.abs(alpha / 255.0 - expected) > 0.01
    assert wrong.sum() <= 3, "samples on an edge may go either way"
    assert 0.05 < expected.mean() < 0.5


def test_coverage_of_a_ball_is_the_area_of_its_disc():
    alpha = draw(capsules(), FRONT, (480, 360), SUN, look=CLEAR, skins=mesh_skins(ball(detail=4)))[..., 3]
    focal = FRONT.pack(480, 360)[12]
    distance = np.linalg.norm(FRONT.eye - [0.0, 1.0, 0.0])
    assert alpha.sum() / 255.0 == pytest.approx(np.pi * (focal * 0.4) ** 2 / (distance**2 - 0.4**2), rel=0.01)


def test_there_are_no_cracks_between_triangles():
    alpha = draw(capsules(), FRONT, (640, 480), SUN, look=CLEAR, skins=mesh_skins(ball(0.9, 5)))[..., 3]
    y, x = np.mgrid[:480, :640]
    middle = FRONT.pack(640, 480)[12] * 0.2 / 3.0
    assert (alpha[(x - 320) ** 2 + (y - 240 - middle) ** 2 < 150**2] == 255).all()


def test_a_ball_of_triangles_looks_like_one_of_capsules():
    shape = np.array([[0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.4, 0.4]], np.float32)
    drawn = Capsules(shape, np.array([[0.5, 0.1, 0.1, 0.0]], np.float32), np.zeros(1, np.int32))
    plain = draw(drawn, FRONT, SIZE, SUN).astype(float)
    skinned = draw(drawn, FRONT, SIZE, SUN, skins=mesh_skins(ball(detail=5))).astype(float)
    assert np.abs(plain - skinned).mean() < 1.0
    assert np.median(np.abs(plain - skinned)[27:45, 39:57]) <= 3


def test_nearer_skins_hide_those_behind_and_the_floor_does_not_shine_through():
    near, far = (0.5, 0.02, 0.02, 0.0), (0.02, 0.02, 0.5, 0.0)
    skins = mesh_skins(ball(), (0, 1), ((0.0, 0.0, 0.8), (0.3, 0.0, -0.4)), near)
    skins = replace(skins, paints=np.array([near, far], np.float32))
    picture = draw(capsules((0, 1)), FRONT, SIZE, SUN, skins=skins, look=Look(background="green"))
    seen = sample_cover(skins, FRONT, SIZE)
    front = ((seen >= 0) & (seen < len(skins.triangles) // 2)).all(axis=2)
    back = (seen >= len(skins.triangles) // 2).all(axis=2)
    both = (seen >= 0).all(axis=2) & ~front & ~back
    assert both.sum() > 10
    red, green, blue = np.moveaxis(picture.astype(float), -1, 0)
    assert (red[front] > blue[front]).all()
    assert (blue[back] > red[back]).all()
    assert (green[both] < np.maximum(red, blue)[both]).all()


def test_capsules_and_skins_hide_one_another():
    wall = np.array([[-1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.2, 0.2], [0, 1, 0, 0, 1, 0, 0.01, 0.01]], np.float32)
    both = Capsules(wall, np.array([[0.1, 0.5, 0.1, 0.0]] * 2, np.float32), np.array([1, 0], np.int32))
    front = draw(both, FRONT, SIZE, SUN, skins=mesh_skins(ball(), (0,), ((0, 0, 0.8),)))[36, 48]
    behind = draw(both, FRONT, SIZE, SUN, skins=mesh_skins(ball(), (0,), ((0, 0, -0.8),)))[36, 48]
    assert front[0] > front[1]
    assert behind[1] > behind[0]


def test_triangles_behind_and_around_the_eye_are_left_out():
    inside = draw(capsules(), FRONT, SIZE, SUN, look=CLEAR, skins=mesh_skins(ball(), shifts=((0.0, 0.2, 3.0),)))
    behind = draw(capsules(), FRONT, SIZE, SUN, look=CLEAR, skins=mesh_skins(ball(), shifts=((0.0, 0.2, 5.0),)))
    assert not inside[..., 3].any()
    assert not behind[..., 3].any()


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_any_number_of_threads_gives_the_same_picture_of_bodies(fighters, threads):
    stage = build_stage(fighters, (200, 150), "front", Look(figure="body"))
    np.testing.assert_array_equal(stage.picture(10, threads=threads), stage.picture(10))


def test_a_body_covers_about_what_its_capsules_cover(fighters):
    cover = {}
    for figure in ("body", "capsules"):
        look = Look(figure=figure, transparent=True)
        cover[figure] = build_stage(fighters, (240, 240), "front", look).picture(20)[..., 3] > 127
    assert (cover["body"] & cover["capsules"]).sum() > 0.75 * (cover["body"] | cover["capsules"]).sum()


def test_bodies_are_seen_from_near_and_capsules_from_far_away(fighters):
    def picture(figure, height):
        stage = build_stage(fighters, (height, height), "front", Look(figure=figure, caption=False))
        return stage.picture(0), float(stage.scales(0)[0])

    near, far = (picture("auto", height) for height in (240, 24))
    assert far[1] < BODY_SCALE < near[1]
    np.testing.assert_array_equal(near[0], picture("body", 240)[0])
    np.testing.assert_array_equal(far[0], picture("capsules", 24)[0])
    assert (near[0] != picture("capsules", 240)[0]).any()
    assert (far[0] != picture("body", 24)[0]).any()


def test_one_picture_may_have_both():
    stage = build_stage(Fighters((0.0, -40.0)), (160, 120), "side", Look(caption=False))
    scales = np.array([2.0, 0.5]) * BODY_SCALE
    skins = stage.skins.pose(stage.source.poses(0), scales, BODY_SCALE)
    assert skins.avatars.tolist() == [0]
    assert set(skins.owners) == {0}
    assert stage.skins.pose(stage.source.poses(0), 0.4 * scales, BODY_SCALE) is None


def test_skins_seen_from_far_away_have_fewer_triangles(fighters):
    stage = build_stage(fighters, SIZE, "front")
    fine, coarse = (stage.skins.pose(fighters.poses(0), np.array([scale]), BODY_SCALE) for scale in (500.0, 100.0))
    assert len(coarse.triangles) < 0.5 * len(fine.triangles)
    for skins in (fine, coarse):
        assert trimesh.Trimesh(skins.vertices, skins.triangles, process=False).is_watertight


def test_motion_blur_and_transparency_show_bodies(fighters):
    look = Look(figure="body", motion_blur=3, transparent=True)
    stage = build_stage(fighters, (120, 120), "front", look)
    moments = [stage.finer._still(frame, 1, None) for frame in (12, 13, 14)]
    blurred = stage.picture(2)[..., 3].astype(float)
    np.testing.assert_allclose(blurred, np.mean([one[..., 3].astype(float) for one in moments], axis=0), atol=1.0)


def test_sources_without_skins_are_drawn_as_capsules():
    walkers = Walkers(np.zeros((2, 1, 3)))
    pictures = [build_stage(walkers, SIZE, "front", Look(figure=figure)).picture(0) for figure in ("auto", "capsules")]
    np.testing.assert_array_equal(*pictures)
    with pytest.raises(CrowdsimError) as caught:
        build_stage(walkers, SIZE, "front", Look(figure="body"))
    assert str(caught.value) == "walkers: figure body needs a run, not a BVH file"


def test_a_figure_that_there_is_not_is_refused():
    with pytest.raises(CrowdsimError) as caught:
        Look(figure="bodies")
    assert str(caught.value).startswith("figure 'bodies': expected auto, body, capsules")


def test_a_scenario_names_the_figure_and_so_does_the_command_that_draws_it_again():
    output = RenderOutput(fps=30.0, figure="body")
    assert scenario_options(output).look.figure == "body"
    words = output.command("run")
    assert words[words.index("--figure") + 1] == "body"
    assert "--figure" not in RenderOutput(fps=30.0).command("run")
    with pytest.raises(ValidationError, match="figure"):
        RenderOutput(figure="bodies")


def test_large_sets_of_bodies_are_forgotten(fighters, monkeypatch):
    monkeypatch.setattr(render_skins, "_KEPT_TRIANGLES", 1)
    stage = build_stage(Fighters((0.0, 1.0)), SIZE, "front")
    for scales in ([100.0, 0.0], [0.0, 100.0], [100.0, 100.0], [100.0, 0.0]):
        found = stage.skins.pose(stage.source.poses(0), np.array(scales), BODY_SCALE)
        assert found.avatars.tolist() == np.flatnonzero(scales).tolist()
        assert len(stage.skins._sets) == 1


def test_skins_are_carried_as_their_matrices_say(fighters):
    skin, clip = fighters.skin(0, 1.0), fighters.clip
    places, turned = forward_kinematics(clip.skeleton, clip.root_positions[10:14], clip.rotations[10:14])
    expected = skin.matrices(places, turned, np.array([0.9, 1.0, 1.1, 1.2]))
    for row, scale in enumerate((0.9, 1.0, 1.1, 1.2)):
        out = np.full(expected.shape[1:], np.inf, np.float32)
        carry_skin(
            places[row], turned[row], scale, skin.inverse_bindings(), skin.parents, skin.helpers, skin.straights(), out
        )
        np.testing.assert_allclose(out, expected[row], atol=1e-6)


def test_vertices_lie_on_the_capsule_whose_surface_is_nearest():
    rng = np.random.default_rng(0)
    points, starts, ends = rng.normal(size=(50, 3)), rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    radii, found = rng.uniform(0.05, 0.3, (6, 2)), np.full(50, -9, np.int32)
    ends[0] = starts[0]
    nearest_capsules(points, starts, ends, radii, found)
    for point, capsule in zip(points, found, strict=True):
        shares = np.linspace(0.0, 1.0, 2001)[:, None]
        gaps = []
        for start, end, (first, last) in zip(starts, ends, radii, strict=True):
            way = end - start
            share = np.clip((point - start) @ way / max(way @ way, 1e-12), 0.0, 1.0)
            along = shares[np.argmin(np.linalg.norm(point - start - shares * way, axis=1))]
            assert abs(share - along[0]) < 1e-3 or not way.any()
            gaps.append(np.linalg.norm(point - start - share * way) - first - share * (last - first))
        assert capsule == np.argmin(gaps)
