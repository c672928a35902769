"""Points on bodies: on the skin, evenly, facing out."""

import numpy as np
import pytest

from crowdsim.body.anatomy import Build
from crowdsim.body.skin import build_skin
from crowdsim.export.cloud_kernels import MOTION_COLUMNS, Bodies, Riders, Wanted, When, place_points
from crowdsim.export.surface import build_skin_surface, build_surface
from crowdsim.motion import quaternion
from crowdsim.motion.body import build_body
from crowdsim.performer.session import perform
from crowdsim.poses.capsules import swelling_capsules


@pytest.fixture(scope="module")
def clip():
    return perform(4.0, seed=1)[0].clip


def distances_to_capsules(body, centres, points):
    found = []
    for capsule, centre in enumerate(centres):
        start, end = centre + body.capsule_starts[capsule], centre + body.capsule_ends[capsule]
        axis = end - start
        share = np.clip((points - start) @ axis / max(axis @ axis, 1e-12), 0, 1)
        radius = body.capsule_radii[capsule, 0] * (1 - share) + body.capsule_radii[capsule, 1] * share
        found.append(np.linalg.norm(points - start - share[:, None] * axis, axis=1) - radius)
    return np.array(found).min(axis=0)


@pytest.mark.parametrize("count", [1, 7, 500, 4000])
def test_points_lie_on_the_skin_and_inside_nothing(clip, count: int) -> None:
    body = build_body(clip.skeleton)
    surface = build_surface(clip.skeleton, body, count)
    assert surface.positions.shape == (count, 3)
    rest = clip.skeleton.rest_positions()
    gaps = distances_to_capsules(body, rest[body.capsule_joints], rest[surface.joints] + surface.positions)
    assert gaps.min() > -0.003
    assert gaps.max() < 0.01
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, atol=1e-9)


def test_points_are_spread_evenly(clip) -> None:
    body = build_body(clip.skeleton)
    surface = build_surface(clip.skeleton, body, 2000)
    positions = clip.skeleton.rest_positions()[surface.joints] + surface.positions
    gaps = np.linalg.norm(positions[:, None] - positions[None], axis=-1)
    np.fill_diagonal(gaps, np.inf)
    nearest = gaps.min(axis=1)
    assert np.percentile(nearest, 95) < 3.0 * np.percentile(nearest, 50)


@pytest.mark.parametrize("count", [1, 500, 4000])
def test_points_of_a_skin_are_spread_by_area_and_counted_to_what_carries_them(clip, count: int) -> None:
    skin = build_skin(clip.skeleton, build_body(clip.skeleton), Build())
    surface = build_skin_surface(skin, count)
    np.testing.assert_allclose(surface.shares.sum(axis=1), 1.0)
    assert surface.shares.min() >= 0.0
    corners = surface.positions.astype(float)
    points = np.einsum("kc,kcx->kx", surface.shares, corners)
    owners = np.concatenate([np.arange(len(skin.parents)), skin.helpers])
    for row in range(0, count, max(1, count // 40)):
        carried = np.zeros(len(skin.parents))
        for corner in range(3):
            for slot in range(4):
                weight = surface.weights[row, corner, slot] * surface.shares[row, corner]
                carried[owners[surface.joints[row, corner, slot]]] += weight
        assert carried[surface.labels[row]] > carried.max() - 1e-6
    if count == 4000:
        triangles = skin.vertices[skin.triangles].astype(float)
        areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
        for axis in range(3):
            above = areas[triangles[:, :, axis].mean(axis=1) > 0.0].sum() / areas.sum()
            assert abs((points[:, axis] > 0.0).mean() - above) < 0.02
        gaps = np.linalg.norm(points[:1000, None] - points[None], axis=-1)
        gaps[np.arange(1000), np.arange(1000)] = np.inf
        nearest = gaps.min(axis=1)
        assert np.percentile(nearest, 95) < 3.0 * np.percentile(nearest, 50)


def test_points_ride_on_their_joints(clip) -> None:
    body = build_body(clip.skeleton)
    surface = build_surface(clip.skeleton, body, 50)
    generator = np.random.default_rng(5)
    joints_at = generator.normal(size=(3, 4, clip.skeleton.joint_count, 3)).astype(np.float32)
    rotations = quaternion.normalise(generator.normal(size=(3, 4, clip.skeleton.joint_count, 4))).astype(np.float32)
    joints_at[0, 2] = joints_at[2, 3] = np.nan  # one avatar comes at row 1, one leaves after it
    scales = np.array([1.0, 0.5, 2.0, 1.5], np.float32)
    girths = np.array([1.0, 1.25, 0.85, 1.1], np.float32)
    stretches = np.array([[1.0, 1.0, 1.0], [1.0, 1.1, 0.9], [1.0, 0.9, 1.1], [1.0, 1.05, 0.95]], np.float32)
    columns = np.array([0, 2, 3])
    values, labels = np.full((150, 9), np.inf, np.float32), np.full((150, 3), -1, np.int32)
    riders = Riders(*(getattr(surface, name) for name in Riders._fields))
    wanted = Wanted(columns, np.array([7, 9, 10], np.int32), np.array([0, 1, 1], np.int32))
    motions = np.full((clip.skeleton.joint_count, MOTION_COLUMNS), np.inf)
    place_points(
        Bodies(joints_at, rotations, scales, girths, stretches), When(0, 1, 2, 0.1), wanted, riders, motions, values,
        labels,
    )  # fmt: skip
    joints = surface.joints
    for number, avatar in enumerate(columns):
        here = slice(number * 50, 50 + number * 50)
        places = surface.positions + (girths[avatar] - 1.0) * surface.swells
        places += (stretches[avatar, surface.segments] - 1.0)[:, None] * surface.cores
        rows = [
            joints_at[row, avatar, joints] + quaternion.rotate(rotations[row, avatar, joints], places * scales[avatar])
            for row in range(3)
        ]
        low, high = {0: (0, 2), 2: (1, 2), 3: (0, 1)}[int(avatar)]
        np.testing.assert_allclose(values[here, :3], rows[1], atol=1e-5)
        expected = quaternion.rotate(rotations[1, avatar, joints], surface.normals)
        np.testing.assert_allclose(values[here, 3:6], expected, atol=1e-5)
        expected = (rows[high] - rows[low]) / (0.1 * (high - low))
        np.testing.assert_allclose(values[here, 6:], expected, atol=2e-4)
        assert (labels[here, :2] == [[7, 0], [9, 1], [10, 1]][number]).all()
        np.testing.assert_array_equal(labels[here, 2], joints)


def test_a_single_frame_does_not_move(clip) -> None:
    surface = build_surface(clip.skeleton, build_body(clip.skeleton), 20)
    joints_at = np.zeros((1, 1, clip.skeleton.joint_count, 3), np.float32)
    rotations = np.zeros((1, 1, clip.skeleton.joint_count, 4), np.float32)
    rotations[..., 0] = 1.0
    values, labels = np.full((20, 9), np.inf, np.float32), np.full((20, 3), -1, np.int32)
    riders = Riders(*(getattr(surface, name) for name in Riders._fields))
    bodies = Bodies(joints_at, rotations, *np.ones((2, 1), np.float32), np.ones((1, 3), np.float32))
    wanted = Wanted(np.array([0]), np.array([0], np.int32), np.array([0], np.int32))
    motions = np.full((clip.skeleton.joint_count, MOTION_COLUMNS), np.inf)
    place_points(bodies, When(0, 0, 0, 0.1), wanted, riders, motions, values, labels)
    assert (values[:, 6:] == 0).all()


def test_points_lie_on_capsules_that_are_as_thick_as_the_girth_says(clip) -> None:
    body = build_body(clip.skeleton)
    surface = build_surface(clip.skeleton, body, 400)
    thick = swelling_capsules(body.capsule_parts)
    assert thick.any()
    assert not thick.all()
    for girth in (0.85, 1.25):
        radii = body.capsule_radii * np.where(thick, girth, 1.0)[:, None]
        places = surface.positions + (girth - 1.0) * surface.swells
        for joint, place in zip(surface.joints, places, strict=True):
            own = np.flatnonzero(body.capsule_joints == joint)
            gaps = []
            for capsule in own:
                start, axis = body.capsule_starts[capsule], body.capsule_ends[capsule] - body.capsule_starts[capsule]
                share = np.clip((place - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
                radius = radii[capsule, 0] * (1 - share) + radii[capsule, 1] * share
                gaps.append(abs(np.linalg.norm(place - start - share * axis) - radius))
            assert min(gaps) < 0.002
