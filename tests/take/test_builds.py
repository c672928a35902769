"""Bodies of different build: capsules, what fists that land touch, and what is measured of avatars."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import crowdsim
from crowdsim.crowd.stances import leading_feet
from crowdsim.motion.body import PARTS
from crowdsim.poses.builds import capsule_segments
from crowdsim.poses.capsules import PosedBodies, capsule_body, capsule_order, place_capsules
from crowdsim.poses.kernels.capsules import place_bodies
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.sampler import PoseSampler
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.population_metrics import measure_people
from crowdsim.take.quality import measure_take

SCENARIO = {
    "version": 1,
    "name": "builds",
    "seed": 5,
    "duration": 500,
    "types": {
        "boxer": {
            "policy": "tiny",
            "stance": {"southpaw": 0.5},
            "tempo": {"kind": "uniform", "minimum": 40, "maximum": 80},
            "aggression": {"kind": "uniform", "minimum": 0.5, "maximum": 2},
            "scale": {"kind": "uniform", "minimum": 0.9, "maximum": 1.1},
            "girth": {"kind": "uniform", "minimum": 0.85, "maximum": 1.25},
            "legs": {"kind": "uniform", "minimum": 0.9, "maximum": 1.1},
            "arms": {"kind": "uniform", "minimum": 0.9, "maximum": 1.1},
        },
        "calm": {"policy": "tiny", "tempo": None},
    },
    "groups": [
        {"type": "boxer", "count": 8, "placement": {"kind": "disc", "radius": 2.2, "distance": 0.8}},
        {"type": "calm", "count": 1, "placement": {"kind": "points", "points": [[9.0, 9.0]]}},
    ],
}


@pytest.fixture
def take(workplace):
    path = workplace / "builds.yaml"
    path.write_text(yaml.safe_dump(SCENARIO), encoding="utf-8")
    return crowdsim.run(load_scenario(path), threads=1)


def test_takes_hold_what_was_drawn_for_each_avatar(take):
    cast = take.cast
    for values, low, high in (
        (cast.girths, 0.85, 1.25), (cast.scales, 0.9, 1.1), (cast.tempos, 40.0, 80.0), (cast.aggressions, 0.5, 2.0),
        (cast.legs, 0.9, 1.1), (cast.arms, 0.9, 1.1),
    ):  # fmt: skip
        assert len(np.unique(values[:8])) == 8
        assert low <= values[:8].min() < values[:8].max() <= high
    assert set(cast.stances[:8]) == {1, 2}
    assert (cast.legs[8], cast.arms[8]) == (1.0, 1.0)
    assert (cast.girths[8], cast.aggressions[8], cast.ranges[8], cast.stances[8]) == (1.0, 1.0, 0.0, 0)
    assert np.isnan(cast.tempos[8])


def test_capsules_of_trunk_and_limbs_are_as_thick_as_the_girth_says(take):
    [poses] = take.sampler.sample(0, 1, 60)
    body, numbers = take.policies[0].database.body, np.arange(len(poses.scales))
    capsules = place_capsules(
        [PosedBodies(body, numbers, poses.scales, poses.girths, poses.stretches, *poses.joints())], 1, len(numbers)
    )
    soft = [PARTS.index(part) for part in ("skin", "shirt", "trunks")]
    for n in numbers:
        for k, capsule in enumerate(capsule_order(body)):
            girth = take.cast.girths[n] if body.capsule_parts[capsule] in soft else 1.0
            radii = body.capsule_radii[capsule] * take.cast.scales[n] * girth
            np.testing.assert_allclose(capsules.radii[n, k], radii, rtol=1e-6)
            half = 0.5 * np.linalg.norm(body.capsule_ends[capsule] - body.capsule_starts[capsule])
            half *= poses.stretches[n, capsule_segments(body)[capsule]]
            assert capsules.bounds[n, k] >= half * take.cast.scales[n] + radii.max()


def test_capsules_and_limbs_of_bodies_are_placed_where_all_their_joints_in_the_world_say(take):
    [poses] = take.sampler.sample(0, 6, 60)
    motion, rows, columns = take.sampler.motions[0], np.array([1, 3, 4]), np.arange(len(poses.scales))[::-1].copy()
    positions, rotations = poses.joints()
    posed = PosedBodies(motion.body, columns, poses.scales.astype(float), poses.girths, poses.stretches,
                        positions[rows], rotations[rows])  # fmt: skip
    expected = place_capsules([posed], len(rows), len(columns))
    ends = np.full((2, *expected.starts.shape), np.nan, np.float32)
    joints = np.full((len(rows), len(columns), 4, 3, 3), np.nan, np.float32)
    whole, body = Posed(poses.root_positions, poses.rotations), capsule_body(motion)
    for low, high in ((0, 5), (5, 6), (6, len(rows) * len(columns))):
        place_bodies(low, high, rows, whole, body, posed.scales, poses.stretches, columns, ends, joints)
    np.testing.assert_array_equal(ends, np.stack([expected.starts, expected.ends]))
    np.testing.assert_array_equal(joints[:, columns], positions[rows][:, :, body.limbs])


def test_fists_stop_at_the_surface_of_bodies_of_all_builds(take):
    assert np.count_nonzero(take.events.landed) > 30
    found = measure_take(take.sampler)
    assert found["fist_gap_median"] < 0.01
    assert found["fists_off_share"] < 0.15


def test_the_skeleton_and_the_feet_do_not_depend_on_the_girth(take):
    quiet = replace(take, collision_avoidance=False, reactions=False, events=replace_none(take.events))
    usual = replace(quiet, cast=replace(quiet.cast, girths=np.ones(9, np.float32)))
    [stout], [plain] = (PoseSampler(one, take.policies).sample(100, 140, 60) for one in (quiet, usual))
    np.testing.assert_array_equal(stout.root_positions, plain.root_positions)
    np.testing.assert_array_equal(stout.rotations, plain.rotations)


def replace_none(events):
    """No strikes."""
    return type(events)(**{name: getattr(events, name)[:0] for name in events.__dataclass_fields__})


def test_the_share_of_time_in_a_stance_is_that_of_a_plain_count(take):
    policy = take.policies[0]
    leads, kept, other = leading_feet(policy.database), 0, 0
    for n in np.flatnonzero(take.cast.stances):
        sign = {1: 1, 2: -1}[int(take.cast.stances[n])]
        for action, done in zip(take.action[:, n], take.action_frame[:, n], strict=True):
            if action >= 0:
                shown = min(float(done), float(policy.actions.lengths[action]))
                lead = leads[int(policy.graph.action_first[action]) - 1 + int(np.rint(shown))]
                kept, other = kept + (lead == sign), other + (lead == -sign)
    found = measure_people(take, take.policies)
    assert found.stance_share == kept / (kept + other)
    assert found.orthodox + found.southpaws == 8
    assert found.tempo_spread == np.percentile(take.cast.tempos[:8].astype(float), (10, 50, 90)).tolist()
    nobody = replace(take, cast=replace(take.cast, stances=np.zeros(9, np.uint8)))
    assert measure_people(nobody, take.policies).stance_share is None
