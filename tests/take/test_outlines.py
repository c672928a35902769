"""Where what strikes stays on the skin of bodies."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_take import database

from crowdsim.body.anatomy import Build
from crowdsim.body.skin import build_skin_of, pose_skins
from crowdsim.motion.body import HEIGHT, PARTS
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules
from crowdsim.poses.contacts import body_points, surface_point
from crowdsim.poses.outlines import WRIST_IN, find_outlines, find_surface, striker_radii, touch_surface, upper_arms

COUNT = 40
FITS = {
    (0.1, 0.1): (0.0, 0.0, 0.0, 0.0),
    (0.115, 0.115): (0.036, -0.006, -0.01, -0.01),
    (0.12, 0.075): (0.049, -0.014, 0.002, -0.008),
    (0.07, 0.07): (0.0, -0.007, -0.002, -0.002),
    (0.052, 0.052): (0.0, 0.0, 0.015, 0.015),
    (0.105, 0.105): (0.0, 0.003, -0.014, -0.014),
    (0.056, 0.043): (0.0, 0.0, 0.005, -0.003),
}
"""By radii of capsules: how far skins go to both sides and ahead, and how much thicker they are at both ends [m]."""


def gaps_to(points, bodies):
    """How far points (n, 3) are outside trunks, heads and upper arms, capsule by capsule [m]. Shape (n,)."""
    body, capsules = bodies.body, place_capsules([bodies], 1, COUNT)
    limbs = [joint for role, joint in body.roles.items() if role.split("_")[0] in ("left", "right")]
    limbs = np.setdiff1d(limbs, [body.roles["left_shoulder"], body.roles["right_shoulder"]])
    size, order = body.height / HEIGHT, capsule_order(body)
    starts, ends = capsules.starts[0].astype(float), capsules.ends[0].astype(float)
    *_, chest, across = [k for k, one in enumerate(order) if body.capsule_parts[one] == PARTS.index("shirt")]
    found = np.full(len(points), np.inf)
    for k, capsule in enumerate(order):
        if body.capsule_joints[capsule] in limbs:
            continue
        fits = [
            fit for radii, fit in FITS.items() if body.capsule_radii[capsule] == pytest.approx(np.array(radii) * size)
        ]
        ((aside, forward, *more),) = fits
        for n, point in enumerate(points):
            side, up = ends[n, across] - starts[n, across], ends[n, chest] - starts[n, chest]
            ahead = np.cross(up / np.linalg.norm(up), side / np.linalg.norm(side))
            for sign in (-1.0, 1.0):
                moved = size * (sign * aside * side / np.linalg.norm(side) + forward * ahead)
                first, axis = starts[n, k] + moved, ends[n, k] - starts[n, k]
                along = float(np.clip((point - first) @ axis / max(axis @ axis, 1e-12), 0.0, 1.0))
                radii = capsules.radii[n, k] + np.array(more) * size
                far = float(np.linalg.norm(point - first - along * axis))
                found[n] = min(found[n], far - radii[0] - along * (radii[1] - radii[0]))
    return found


def some_bodies(seed):
    """Points near bodies in frames that are drawn, the bodies, and their positions and rotations."""
    rng, data = np.random.default_rng(seed), database()
    body, frames = data.body, rng.integers(0, len(data.rotations), COUNT)
    positions, turns = forward_kinematics(data.skeleton, data.root_positions[frames], data.rotations[frames])
    ones = np.ones(COUNT)
    head, neck, pelvis, _ = body_points(body, positions, turns, ones)
    outline = head, neck, pelvis, (body.head_radius + 0.06) * ones, (body.torso_radius + 0.03) * ones
    bodies = PosedBodies(body, np.arange(COUNT), ones, ones, np.ones((COUNT, 3)), positions[None], turns[None])
    return surface_point(neck + rng.normal(size=(COUNT, 3)) * 0.3, *outline), bodies


def test_upper_arms_go_from_the_shoulder_of_their_side_to_its_elbow() -> None:
    _, bodies = some_bodies(1)
    surface, roles = find_surface(bodies), bodies.body.roles
    for side, columns in zip(("left", "right"), upper_arms(bodies.body), strict=True):
        (column,) = columns
        for role, points in (("shoulder", surface.starts), ("elbow", surface.starts + surface.axes)):
            joint = bodies.positions[0, :, roles[f"{side}_{role}"]]
            np.testing.assert_allclose(points[:, column], joint, atol=0.005)


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_gaps_match_naive(seed: int) -> None:
    points, bodies = some_bodies(seed)
    gaps, out = find_surface(bodies).gaps(points)
    np.testing.assert_allclose(gaps, gaps_to(points, bodies), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0)
    # In a crease another capsule is near.
    further = find_surface(bodies).gaps(points + 1e-4 * out)[0] - gaps
    assert further.max() < 1.01e-4
    assert np.median(further) > 0.99e-4


@settings(deadline=None)
@given(st.integers(0, 10_000), st.floats(0.01, 0.1))
def test_spheres_touch_the_surface_and_move_no_further_than_they_must(seed: int, radius: float) -> None:
    points, bodies = some_bodies(seed)
    surface, radii = find_surface(bodies), np.full(COUNT, radius)
    found = touch_surface(points, None, radii, surface)
    gaps = gaps_to(found, bodies)
    np.testing.assert_allclose(gaps, radius, atol=5e-4)
    further = np.linalg.norm(found - points, axis=1) - 3.0 * np.abs(gaps_to(points, bodies) - radius) - 0.002
    # In a narrow crease between arm and chest one goes further.
    assert np.sort(further)[-2] < 0.0
    assert further.max() < 0.15


@pytest.mark.parametrize("strange", ["a trunk of one capsule", "a trunk on an arm", "all of it on an arm"])
def test_bodies_of_strangers_have_a_surface_too(strange: str) -> None:
    points, bodies = some_bodies(0)
    parts, joints = bodies.body.capsule_parts.copy(), bodies.body.capsule_joints.copy()
    trunk, hand = np.flatnonzero(parts == PARTS.index("shirt")), bodies.body.roles["left_hand"]
    if strange == "a trunk of one capsule":
        parts[trunk[:-1]] = PARTS.index("skin")
    joints[{"a trunk on an arm": trunk, "all of it on an arm": slice(None)}.get(strange, [])] = hand
    body = replace(bodies.body, capsule_parts=parts, capsule_joints=joints)
    found = touch_surface(points, None, np.full(COUNT, 0.05), find_surface(bodies._replace(body=body)))
    assert np.isfinite(found).all()


def test_wrists_behind_fists_stay_out_and_fists_still_touch() -> None:
    alone: list[np.ndarray] = []
    along: list[np.ndarray] = []
    for seed in range(5):
        points, bodies = some_bodies(seed)
        surface, radii = find_surface(bodies), np.full(COUNT, 0.04)
        wrists = np.random.default_rng(seed).normal(size=(COUNT, 3)) * 0.08
        for depths, way in ((alone, None), (along, wrists)):
            found = touch_surface(points, way, radii, surface)
            np.testing.assert_allclose(gaps_to(found, bodies), 0.04, atol=5e-4)
            depths.append(-gaps_to(found + wrists, bodies))
    deep = np.concatenate(alone) > WRIST_IN + 0.01
    assert deep.sum() > 10
    assert np.mean(np.concatenate(along)[deep]) < np.mean(np.concatenate(alone)[deep]) - 0.01


def test_spheres_touch_bodies_beside_forearms_and_hands() -> None:
    alone: list[np.ndarray] = []
    beside: list[np.ndarray] = []
    for seed in range(5):
        points, bodies = some_bodies(seed)
        (surface, arms), radii = find_outlines(bodies), np.full(COUNT, 0.06)
        for gaps, ways in ((alone, None), (beside, arms)):
            found = touch_surface(points, None, radii, surface, ways)
            np.testing.assert_allclose(gaps_to(found, bodies), 0.06, atol=5e-4)
            gaps.append(arms.gaps(found)[0] - 0.06)
    inside = np.concatenate(alone) < -0.01
    assert inside.sum() > 10
    assert np.median(np.concatenate(beside)[inside]) > -2e-3
    far = np.concatenate(alone) > 0.06
    np.testing.assert_allclose(np.concatenate(beside)[far], np.concatenate(alone)[far], atol=1e-6)
    points, bodies = some_bodies(0)
    none = touch_surface(points, None, np.full(COUNT, 0.06), find_surface(bodies), find_outlines(bodies, False)[1])
    np.testing.assert_array_equal(none, touch_surface(points, None, np.full(COUNT, 0.06), find_surface(bodies)))


def test_absent_bodies_are_left_alone() -> None:
    points, bodies = some_bodies(1)
    points[3] = np.nan
    found = touch_surface(points, None, np.full(COUNT, 0.06), find_surface(bodies))
    assert np.isnan(found[3]).all()
    assert np.isfinite(np.delete(found, 3, axis=0)).all()


def test_gloves_are_thicker_than_bare_fists_and_feet_are_what_they_are() -> None:
    body = database().body
    limbs, scales = np.array([0, 1, 2, 10]), np.array([1.0, 1.1, 1.0, 1.0])
    gloves, bare = (striker_radii(body, limbs, scales, np.full(4, hands)) for hands in (False, True))
    assert gloves[1] == pytest.approx(1.1 * gloves[0])
    assert (bare[:2] < 0.7 * gloves[:2]).all()
    np.testing.assert_allclose(gloves[2:], body.strikers["radius"][[2, 10]])
    np.testing.assert_array_equal(bare[2:], gloves[2:])


@pytest.mark.parametrize(("sex", "kind"), [("male", "athletic"), ("male", "lean"), ("female", "athletic")])
def test_surfaces_are_where_skins_are(sex: str, kind: str) -> None:
    data, (_, bodies) = database(), some_bodies(2)
    skin = build_skin_of(data, Build(sex, kind))
    arms = [data.body.roles[f"{side}_{role}"] for side in ("left", "right") for role in ("shoulder", "elbow", "hand")]
    arms += [data.body.roles[f"{side}_{role}"] for side in ("left", "right") for role in ("hip", "knee", "foot", "toe")]
    for joint, parent in enumerate(skin.parents):
        if parent in arms and joint not in arms:
            arms.append(joint)
    one = PosedBodies(bodies.body, np.arange(1), *(np.ones(1),) * 2, np.ones((1, 3)),
                      bodies.positions[:, :1], bodies.rotations[:, :1])  # fmt: skip
    matrices = skin.matrices(one.positions[0].astype(float), one.rotations[0].astype(float), np.ones(1))
    (vertices,), _ = pose_skins([skin], matrices)
    carriers = skin.joints[np.arange(len(skin.joints)), np.argmax(skin.weights, axis=1)]
    of_trunk = ~np.isin(carriers, arms) & (carriers < len(skin.parents))
    surface, points = find_surface(one), vertices[of_trunk].astype(float)
    gaps = np.array([surface.gaps(point[None])[0][0] for point in points[::7]])
    # Hair and the sides of shoulders are beyond.
    assert np.mean(np.abs(gaps) < 0.02) > 0.7, gaps
    assert abs(float(np.median(gaps))) < 0.012
    assert len(points) > 500
