"""Figures cover their skeletons, stand where poses say, and wear what tells them apart."""

import colorsys
import math

import numpy as np
import pytest

from crowdsim.body.palette import EYES, avatar_paints
from crowdsim.motion import quaternion
from crowdsim.motion.body import PARTS, build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.performer.session import perform
from crowdsim.render.figure import bone_capsules, dress
from crowdsim.render.raycast import draw, sun_direction
from crowdsim.render.scene import build_cast
from crowdsim.render.view import look_at


def spider() -> Skeleton:
    """A body with eight legs of three bones, an end site on each."""
    names, parents, offsets, ends = ["body"], [-1], [[0.0, 0.5, 0.0]], []
    for leg in range(8):
        for bone in range(3):
            parents.append(0 if bone == 0 else len(names) - 1)
            names.append(f"leg_{leg}_{bone}")
            angle = leg * math.pi / 4
            offsets.append([0.3 * math.cos(angle), 0.2 - 0.25 * bone, 0.3 * math.sin(angle)])
        ends.append(len(names) - 1)
    return Skeleton(
        tuple(names), np.array(parents, np.int32), np.array(offsets), np.array(ends, np.int32), np.full((8, 3), 0.1)
    )


def test_every_bone_and_end_site_of_any_skeleton_gets_a_capsule():
    skeleton = spider()
    figure = bone_capsules(skeleton)
    spans = {(int(j), tuple(np.round(e, 6))) for j, e in zip(figure.capsule_joints, figure.capsule_ends, strict=True)}
    for joint in range(1, skeleton.joint_count):
        assert (int(skeleton.parents[joint]), tuple(np.round(skeleton.offsets[joint], 6))) in spans
    for parent, offset in zip(skeleton.end_parents, skeleton.end_offsets, strict=True):
        assert (int(parent), tuple(np.round(offset, 6))) in spans
    assert len(spans) == skeleton.joint_count - 1 + 8
    assert (figure.capsule_radii > 0).all()
    lengths = np.linalg.norm(figure.capsule_ends, axis=1)
    assert (figure.capsule_radii.max(axis=1) < lengths).all()


def test_limbs_taper_towards_their_ends():
    figure = bone_capsules(spider())
    assert (figure.capsule_radii[:, 0] >= figure.capsule_radii[:, 1] - 1e-12).all()


@pytest.mark.parametrize("joints", [1, 2])
def test_the_smallest_skeletons_show_something(joints):
    skeleton = Skeleton(("a", "b")[:joints], np.array([-1, 0][:joints], np.int32), np.zeros((joints, 3)))
    figure = bone_capsules(skeleton)
    assert len(figure.capsule_joints) >= 1
    assert np.isfinite(figure.capsule_radii).all()
    assert (figure.capsule_radii > 0).all()


def test_capsules_are_at_the_positions_of_their_joints():
    skeleton = spider()
    rng = np.random.default_rng(1)
    rotations = quaternion.normalise(rng.normal(size=(3, skeleton.joint_count, 4)))
    positions, turns = forward_kinematics(skeleton, rng.normal(size=(3, 3)), rotations)
    figure = bone_capsules(skeleton)
    scales = np.array([1.0, 0.9, 1.3])
    placed = build_cast([figure], np.zeros(3, int), [0, 1, 0], scales).place([(positions, turns)])
    count = len(figure.capsule_joints)
    for avatar in range(3):
        for k in range(count):
            row = placed.shapes[avatar * count + k]
            joint = figure.capsule_joints[k]
            for end, local in ((0, figure.capsule_starts[k]), (1, figure.capsule_ends[k])):
                place = positions[avatar, joint] + scales[avatar] * quaternion.rotate(turns[avatar, joint], local)
                assert row[3 * end : 3 * end + 3] == pytest.approx(place, abs=1e-5)
            assert row[6:] == pytest.approx(scales[avatar] * figure.capsule_radii[k])
    assert placed.owners.tolist() == np.repeat(np.arange(3), count).tolist()


def test_several_kinds_of_bodies_are_drawn_together():
    spiders, stick = bone_capsules(spider()), bone_capsules(Skeleton(("a", "b"), np.array([-1, 0]), np.ones((2, 3))))
    cast = build_cast([spiders, stick], [1, 0, 1], [0, 0, 1])
    assert [members.tolist() for members in cast.members] == [[1], [0, 2]]
    still = [
        (np.zeros((1, 25, 3)), np.tile([1.0, 0, 0, 0], (1, 25, 1))),
        (np.zeros((2, 2, 3)), np.tile([1.0, 0, 0, 0], (2, 2, 1))),
    ]
    placed = cast.place(still, np.array([[1.0, 2.0, 3.0]]))
    assert placed.owners.tolist() == [1] * 32 + [0, 2] + [3]
    assert placed.shapes[-1, :6].tolist() == [1, 2, 3, 1, 2, 3]
    assert len(placed.paints) == len(placed.shapes)


def test_a_body_wears_a_guard_behind_its_face():
    clip = perform(2.0, 1)[0].clip
    body = build_body(clip.skeleton)
    dressed = dress(body)
    more = len(dressed.capsule_joints) - len(body.capsule_joints)
    assert more == 4
    middle = 0.5 * (dressed.capsule_starts + dressed.capsule_ends)[-more:]
    guard, nose, eyes, waist = middle - np.stack([*[body.head_offset] * 3, dressed.capsule_ends[-1] / 2])
    assert np.linalg.norm(waist) < 0.02
    ahead = (body.sole_offsets[:, 1] - body.sole_offsets[:, 0]).sum(axis=0)
    assert guard @ ahead < 0 < eyes @ ahead
    assert nose @ ahead > 0
    assert dressed.capsule_joints[-more:].tolist() == [body.roles[role] for role in ("head", "head", "head", "pelvis")]
    assert bone_capsules(clip.skeleton) is not None
    plain = bone_capsules(clip.skeleton)
    assert dress(plain) is plain


def test_a_head_shows_dark_eyes_where_it_faces_and_none_from_behind():
    clip = perform(2.0, 1)[0].clip
    body = build_body(clip.skeleton)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (1, clip.skeleton.joint_count, 1))
    positions, turns = forward_kinematics(clip.skeleton, np.array([[0.0, 1.0, 0.0]]), still)
    placed = build_cast([body], [0], [0]).place([(positions, turns)])
    head = positions[0, body.roles["head"]] + body.head_offset
    dark, ahead = [], np.array([0.0, 0.0, 0.9])
    for side in (1.0, -1.0):
        picture = draw(placed, look_at(head + side * ahead, head), (96, 96), sun_direction(0.5))
        dark.append(int((picture.max(axis=-1) < 70).sum()))
    assert dark[0] > 40 > 5 > dark[1]


def test_eyes_are_darker_than_any_skin():
    paints = avatar_paints(np.arange(30))
    assert paints.shape == (30, len(PARTS) + 1, 4)
    brightness = paints[..., :3].sum(axis=-1)
    assert brightness[:, EYES].max() < 0.3 * brightness[:, PARTS.index("head")].min()


def hues(paints, part):
    return np.array([colorsys.rgb_to_hsv(*np.sqrt(paint[PARTS.index(part), :3]))[0] for paint in paints])


def apart(a, b):
    return np.abs((a - b + 0.5) % 1.0 - 0.5)


def test_teams_differ_in_hue_and_their_avatars_in_shade():
    teams = np.arange(40) % 4
    paints = avatar_paints(teams)
    for part in ("glove", "trunks", "shirt"):
        hue = hues(paints, part)
        for one in range(4):
            for other in range(one):
                assert apart(hue[teams == one][:, None], hue[teams == other]).min() > 0.05
    shades = np.sqrt(paints[:, PARTS.index("trunks"), :3])
    for team in range(4):
        own = shades[teams == team]
        distances = np.linalg.norm(own[:, None] - own, axis=-1) + np.eye(10)
        assert distances.min() > 0.01


@pytest.mark.parametrize("teams", [np.zeros(30, int), np.arange(30)])
def test_where_all_fight_all_avatars_have_hues_of_their_own(teams):
    hue = hues(avatar_paints(teams), "trunks")
    assert (apart(hue[:, None], hue) + np.eye(30)).min() > 0.015


def test_a_given_colour_replaces_the_teams():
    colours = np.full((4, 3), np.nan)
    colours[2] = [0.1, 0.8, 0.2]
    plain, given = avatar_paints([0, 1, 0, 1]), avatar_paints([0, 1, 0, 1], colours)
    np.testing.assert_array_equal(plain[[0, 1, 3]], given[[0, 1, 3]])
    assert hues(given[2:3], "glove")[0] == pytest.approx(colorsys.rgb_to_hsv(0.1, 0.8, 0.2)[0], abs=0.02)


def test_hues_of_their_own_are_those_of_colorsys():
    paints = avatar_paints(np.arange(300))
    expected = [colorsys.hsv_to_rgb(avatar * 0.6180339887498949 % 1.0, 0.88, 0.86) for avatar in range(300)]
    np.testing.assert_array_equal(paints[:, PARTS.index("glove"), :3], (np.array(expected) ** 2.0).astype(np.float32))
