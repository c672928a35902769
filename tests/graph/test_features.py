import dataclasses

import numpy as np
import pytest
import synthetic_motion

from crowdsim.errors import MotionError
from crowdsim.graph.features import frame_features
from crowdsim.graph.settings import GraphSettings, JointWeights
from crowdsim.motion import ground as grounds
from crowdsim.motion import quaternion as quaternions
from crowdsim.motion.kinematics import forward_kinematics

UP = np.array([0.0, 1.0, 0.0])
PLACES = GraphSettings(threshold=1, velocity_weight=0)


@pytest.fixture(scope="module")
def motion():
    return synthetic_motion.wander(np.random.default_rng(1), 60)


def moved(motion, place):
    """Return the clip carried to another ground transform."""
    roots, rotations, headings, contacts = motion
    rotations = rotations.copy()
    rotations[:, 0] = quaternions.multiply(quaternions.about_y(place[2]), rotations[:, 0])
    return grounds.to_world(np.array(place), roots), rotations, headings + place[2], contacts


def test_features_are_invariant_to_position_and_heading(motion):
    here = frame_features(synthetic_motion.database([motion]), GraphSettings())
    there = frame_features(synthetic_motion.database([moved(motion, (3.0, -2.0, 2.5))]), GraphSettings())
    assert np.abs(here - there).max() < 1e-5


def test_features_depend_on_the_height_of_the_root(motion):
    roots, *rest = motion
    low = frame_features(synthetic_motion.database([motion]), PLACES)
    high = frame_features(synthetic_motion.database([(roots + np.array([0, 0.2, 0]), *rest)]), PLACES)
    assert np.linalg.norm(high - low, axis=1) == pytest.approx(0.2, abs=1e-5)


def test_the_distance_is_the_weighted_mean_of_joint_distances_on_a_body_of_standard_height(motion):
    weights = JointWeights(hand=3.0, foot=0.0)
    settings = GraphSettings(velocity_weight=0, joint_weights=weights)
    database = synthetic_motion.database([motion], height=1.4)
    features = frame_features(database, settings)
    positions = forward_kinematics(database.skeleton, *(array.astype(float) for array in motion[:2]))[0][::4]
    local = grounds.to_local(database.ground[::4, None, :], positions) * 1.75 / 1.4
    counted = {
        "pelvis": 1,
        "chest": 0.5,
        "head": 1,
        "left_elbow": 0.5,
        "left_hand": 3,
        "right_elbow": 0.5,
        "right_hand": 3,
    }
    total = sum(
        weight * ((local[7, database.body.roles[role]] - local[40, database.body.roles[role]]) ** 2).sum()
        for role, weight in counted.items()
    )
    expected = np.sqrt(total / sum(counted.values()))
    assert np.linalg.norm(features[7] - features[40]) == pytest.approx(expected, rel=1e-4)


def test_a_body_that_glides_faster_differs_by_its_speed_times_the_weight_of_velocities(motion):
    _, rotations, _, contacts = motion
    frames = len(rotations)
    still = np.broadcast_to(rotations[:1], rotations.shape)
    databases = [
        synthetic_motion.database(
            [(np.outer(np.arange(frames) / 60, [0, 0, speed]) + UP, still, np.zeros(frames), contacts)]
        )
        for speed in (1.0, 1.5)
    ]
    settings = GraphSettings(velocity_weight=0.1)
    slow, fast = (frame_features(database, settings) for database in databases)
    assert np.linalg.norm(fast - slow, axis=1) == pytest.approx(0.05, rel=1e-3)


def test_velocities_do_not_reach_into_the_next_clip(motion):
    alone = frame_features(synthetic_motion.database([motion]), GraphSettings())
    other = moved(motion, (10.0, 0.0, 1.0))
    together = frame_features(synthetic_motion.database([motion, other]), GraphSettings())
    assert np.abs(together[:60] - alone).max() < 1e-6
    assert np.abs(together[60:] - alone).max() < 1e-5


def test_features_do_not_depend_on_the_chunk_size(motion, monkeypatch):
    database = synthetic_motion.database([motion, motion])
    whole = frame_features(database, GraphSettings())
    monkeypatch.setattr("crowdsim.graph.features._CHUNK", 7)
    assert np.array_equal(frame_features(database, GraphSettings()), whole)


def test_control_at_the_playback_rate_works(motion):
    database = synthetic_motion.database([motion], control_rate=60, playback_rate=60)
    assert np.isfinite(frame_features(database, GraphSettings())).all()
    assert len(frame_features(database, GraphSettings())) == 240


def test_a_number_that_is_not_finite_names_clip_and_frame(motion):
    database = synthetic_motion.database([motion, motion])
    rotations = database.rotations.copy()
    rotations[(60 + 7) * 4, 2] = np.nan
    rotations[(60 + 7) * 4, 1] = np.nan
    broken = dataclasses.replace(database, rotations=rotations)
    with pytest.raises(MotionError, match=r"clip 'clip_1', control frame 7: .* not finite \(in 1 frames"):
        frame_features(broken, GraphSettings())


def test_a_skeleton_without_any_joint_that_counts_is_refused(motion):
    nothing = {name: 0.0 for name in JointWeights.model_fields}
    settings = GraphSettings(joint_weights=JointWeights(**{**nothing, "toe": 1.0}))
    with pytest.raises(MotionError, match="no joint that counts"):
        frame_features(synthetic_motion.database([motion]), settings)
