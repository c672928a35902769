"""Where what strikes stays on the skin of bodies."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_touching import touch
from synthetic_take import database

from crowdsim.body.anatomy import GIRTHS, SEXES, Build
from crowdsim.body.skin import build_skin_of, pose_skins
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT, PARTS
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.limbs import hinge_axis
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules
from crowdsim.poses.contacts import body_points, surface_point
from crowdsim.poses.facing import face_direction
from crowdsim.poses.outlines import (
    GIVES_WAY,
    LIFTED,
    Balls,
    find_outlines,
    find_surface,
    hand_balls,
    striker_radii,
    touch_surface,
    upper_arms,
)
from crowdsim.poses.skins import ACROSS, BODIES, HAND_BALLS, PIECES

COUNT = 40
KINDS = {
    (0.1, 0.1): "pelvis",
    (0.115, 0.115): "trunk",
    (0.12, 0.075): "chest",
    (0.07, 0.07): "shoulders",
    (0.052, 0.052): "neck",
    (0.105, 0.105): "head",
    (0.056, 0.043): "upper arm",
}
"""Capsules that skins lie along, by their radii [m]."""
MEN = np.array(["male"] * COUNT)


def unit(vector):
    """A vector of length 1."""
    return vector / np.linalg.norm(vector)


def pieces_of(bodies, capsules, n, sex="male"):
    """Start, axis and radii of each piece of the skin of a body, one after the other."""
    body, size = bodies.body, bodies.body.height / HEIGHT * float(bodies.scales[n])
    known = BODIES[sex]
    girth = min(known, key=lambda one: abs(one - float(bodies.girths[n])))
    order, lines, arms = capsule_order(body), [], {}
    for k, capsule in enumerate(order):
        radii = tuple(np.round(body.capsule_radii[capsule] * HEIGHT / body.height, 4))
        joint = body.capsule_joints[capsule]
        roles = [role for role, one in body.roles.items() if one == joint]
        if any(role.split("_")[-1] in ("elbow", "hand", "hip", "knee", "foot", "toe") for role in roles):
            continue
        ends = capsules.starts[0, n, k].astype(float), capsules.ends[0, n, k].astype(float)
        lines.append((KINDS[radii], *ends, 1.0))
        if KINDS[radii] == "upper arm":
            arms[roles[0]] = ends[0]
    ((_, left, right, _),) = (line for line in lines if line[0] == "shoulders")
    ((_, low, high, _),) = (line for line in lines if line[0] == "chest")
    side, up = unit(right - left), unit(high - low)
    lines += [("collar", left, arms["left_shoulder"], -1.0), ("collar", right, arms["right_shoulder"], 1.0)]
    turn = bodies.rotations[0, n, body.roles["head"]].astype(float)
    crown = quaternion.rotate(turn, unit(body.head_offset))
    face = quaternion.rotate(turn, face_direction(body))
    for (kind, twice), piece in zip(PIECES, known[girth], strict=True):
        for own, start, end, sign in lines:
            for mirror in ((1.0, -1.0) if twice else (1.0,)) if own == kind else ():
                axes, width = (side, np.cross(up, side), up), size * float(bodies.girths[n]) / girth
                if kind == "head":
                    axes, width = (np.cross(crown, face), face, crown), size
                elif kind == "upper arm":
                    axes = np.zeros(3), np.zeros(3), unit(end - start)
                rows = piece[::-1] if mirror < 0.0 and kind in ACROSS else piece
                points = []
                for point, (aside, ahead, above, _) in zip((start, end), rows, strict=True):
                    away = sign * mirror * aside * axes[0] + ahead * axes[1] + above * axes[2]
                    points.append(point + width * away)
                yield points[0], points[1] - points[0], width * rows[:, 3]


def gaps_to(points, bodies):
    """How far points (n, 3) are outside trunks, heads and upper arms, piece by piece [m]. Shape (n,)."""
    capsules, found = place_capsules([bodies], 1, len(bodies.columns)), []
    for n, point in enumerate(points):
        starts, axes, thick = (np.array(column) for column in zip(*pieces_of(bodies, capsules, n), strict=True))
        share = np.clip(np.sum((point - starts) * axes, axis=1) / np.maximum(np.sum(axes**2, axis=1), 1e-12), 0.0, 1.0)
        far = np.linalg.norm(point - starts - share[:, None] * axes, axis=1)
        found.append(np.min(far - thick[:, 0] - share * (thick[:, 1] - thick[:, 0])))
    return np.array(found)


def single(radii):
    """Single balls."""
    return Balls(np.zeros((len(radii), 1, 3)), np.asarray(radii)[:, None])


def hands_of(rng):
    """Gloves that point anywhere."""
    axes = np.linalg.qr(rng.normal(size=(COUNT, 3, 3)))[0]
    return Balls(HAND_BALLS["gloves"][:, :3] @ axes, np.tile(HAND_BALLS["gloves"][:, 3], (COUNT, 1)))


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
    surface, roles = find_surface(bodies, MEN), bodies.body.roles
    for side, columns in zip(("left", "right"), upper_arms(bodies.body), strict=True):
        assert len(columns)
        for role, points in (("shoulder", surface.starts), ("elbow", surface.starts + surface.axes)):
            joint = bodies.positions[0, :, roles[f"{side}_{role}"]]
            assert np.linalg.norm(points[:, columns] - joint[:, None], axis=-1).max() < 0.05


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000))
def test_gaps_match_naive(seed: int) -> None:
    points, bodies = some_bodies(seed)
    gaps, out = find_surface(bodies, MEN).gaps(points)
    np.testing.assert_allclose(gaps, gaps_to(points, bodies), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0)
    # In a crease another capsule is near.
    further = find_surface(bodies, MEN).gaps(points + 1e-4 * out)[0] - gaps
    assert further.max() < 1.01e-4
    assert np.median(further) > 0.99e-4


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000), st.floats(0.01, 0.1))
def test_spheres_touch_the_surface_and_move_no_further_than_they_must(seed: int, radius: float) -> None:
    points, bodies = some_bodies(seed)
    surface, radii = find_surface(bodies, MEN), np.full(COUNT, radius)
    found = touch_surface(points, single(radii), surface)
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
    found = touch_surface(points, single(np.full(COUNT, 0.05)), find_surface(bodies._replace(body=body), MEN))
    assert np.isfinite(found).all()


def test_thumbs_and_wrists_stay_out_and_fists_still_touch() -> None:
    depths: dict[bool, list[np.ndarray]] = {True: [], False: []}
    for seed in range(2):
        points, bodies = some_bodies(seed)
        surface, hands = find_surface(bodies, MEN), hands_of(np.random.default_rng(seed))
        for whole, balls in ((True, hands), (False, single(hands.radii[:, 0]))):
            found = touch_surface(points, balls, surface)
            gaps = gaps_to(found, bodies) - hands.radii[:, 0]
            assert np.abs(gaps).max() < LIFTED + 5e-4
            assert np.median(np.abs(gaps)) < 5e-4
            others = [gaps_to(found + hands.offsets[:, ball], bodies) - hands.radii[:, ball] for ball in range(1, 6)]
            depths[whole].append(-np.min(others, axis=0))
    whole, lone = (np.concatenate(depths[kind]) for kind in (True, False))
    assert (lone > 0.02).sum() > 10
    assert np.mean(whole > 0.02) < 0.25 * np.mean(lone > 0.02)
    assert np.median(whole[lone > 0.02]) < GIVES_WAY + 0.001


@settings(deadline=None, max_examples=5)
@given(st.integers(0, 10_000))
def test_strikers_touch_where_their_naive_twins_do(seed: int) -> None:
    points, bodies = some_bodies(seed)
    surface, arms = find_outlines(bodies, MEN)
    hands = hands_of(np.random.default_rng(seed))
    found = touch_surface(points, hands, surface, arms)
    for n in range(0, COUNT, 10):
        skin, beside = (tuple(values[n] for values in one) for one in (surface, arms))
        twin = touch(points[n], hands.offsets[n], hands.radii[n], skin, beside, GIVES_WAY, LIFTED)
        np.testing.assert_allclose(found[n], twin, atol=1e-9)


def test_spheres_touch_bodies_beside_forearms_and_hands() -> None:
    alone: list[np.ndarray] = []
    beside: list[np.ndarray] = []
    for seed in range(5):
        points, bodies = some_bodies(seed)
        (surface, arms), radii = find_outlines(bodies, MEN), np.full(COUNT, 0.06)
        for gaps, ways in ((alone, None), (beside, arms)):
            found = touch_surface(points, single(radii), surface, ways)
            np.testing.assert_allclose(gaps_to(found, bodies), 0.06, atol=5e-4)
            gaps.append(arms.gaps(found)[0] - 0.06)
    inside = np.concatenate(alone) < -0.01
    assert inside.sum() > 10
    assert np.median(np.concatenate(beside)[inside]) > -2e-3
    far = np.concatenate(alone) > 0.06
    np.testing.assert_allclose(np.concatenate(beside)[far], np.concatenate(alone)[far], atol=1e-6)
    points, bodies = some_bodies(0)
    none = touch_surface(
        points, single(np.full(COUNT, 0.06)), find_surface(bodies, MEN), find_outlines(bodies, MEN, False)[1]
    )
    np.testing.assert_array_equal(none, touch_surface(points, single(np.full(COUNT, 0.06)), find_surface(bodies, MEN)))


def test_absent_bodies_are_left_alone() -> None:
    points, bodies = some_bodies(1)
    points[3] = np.nan
    found = touch_surface(points, single(np.full(COUNT, 0.06)), find_surface(bodies, MEN))
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


@pytest.mark.parametrize("hands", ["gloves", "bare"])
@pytest.mark.parametrize(("sex", "kind"), [(sex, kind) for sex in SEXES for kind in GIRTHS])
def test_fists_that_touch_surfaces_touch_skins(
    monkeypatch: pytest.MonkeyPatch, sex: str, kind: str, hands: str
) -> None:
    """Balls as large as fists that touch the pieces are within 2 cm of the mesh, on either side."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    depths_in = importlib.import_module("delivery").depths_in
    data, (points, bodies) = database(), some_bodies(2)
    skin, girth = build_skin_of(data, Build(sex, kind)), GIRTHS[kind]
    bodies = bodies._replace(girths=np.full(COUNT, girth))
    radii = np.full(COUNT, HAND_BALLS[hands][0, 3])
    surface, arms = find_outlines(bodies, np.array([sex] * COUNT))
    found = touch_surface(points, single(radii), surface, arms)
    matrices = skin.matrices(bodies.positions[0].astype(float), bodies.rotations[0].astype(float), np.ones(COUNT))
    gaps = []
    for n in range(COUNT):
        (vertices,), _ = pose_skins([skin], matrices[n : n + 1])
        depths, _ = depths_in(found[n : n + 1], vertices.astype(float)[skin.triangles])
        gaps.append(-depths[0] - radii[n])
    assert np.mean(np.abs(gaps) < 0.02) >= 0.95, np.round(gaps, 3)
    assert abs(float(np.median(gaps))) < 0.004


@pytest.mark.parametrize("hands", ["gloves", "bare"])
def test_balls_of_hands_are_where_skins_are(hands: str) -> None:
    data = database()
    body, skin = data.body, build_skin_of(data, Build(hands=hands))
    positions, turns = forward_kinematics(data.skeleton, data.root_positions[::10], data.rotations[::10])
    chains = [[body.roles[f"{side}_{role}"] for role in ("shoulder", "elbow", "hand")] for side in ("left", "right")]
    hinges = np.array([hinge_axis(*(positions[:, joint] for joint in one), turns[:, one[0]]) for one in chains])
    balls = hand_balls(body, hinges, np.array([0, 1]), np.ones(2), np.array([hands == "bare"] * 2))
    carriers = skin.joints[np.arange(len(skin.joints)), np.argmax(skin.weights, axis=1)]
    for side, role in enumerate(("left_hand", "right_hand")):
        hand = body.roles[role]
        own = skin.vertices[carriers == hand] - skin.positions[hand]
        own = quaternion.rotate(quaternion.conjugate(skin.rotations[hand]), own) - body.fist_offsets[side]
        away = np.linalg.norm(own[:, None] - balls.offsets[side], axis=2) - balls.radii[side]
        assert np.abs(away.min(axis=1)).max() < 0.025
        assert np.median(np.abs(away.min(axis=1))) < 0.005
