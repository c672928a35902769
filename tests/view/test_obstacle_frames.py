"""Obstacles in the player are frames that lie along their edges."""

import numpy as np
import pytest
from naive_view import unpack_scene
from scenes import scene

import crowdsim
from crowdsim.crowd.obstacles import pack_obstacles
from crowdsim.view.obstacle_frames import obstacle_frames

OBSTACLES = [
    {"kind": "box", "centre": [6, 4], "size": [2, 1], "rotation": 90, "height": 0.9},
    {"kind": "disc", "centre": [-6, 4], "radius": 0.5, "height": 1.2},
    {"kind": "wall", "points": [[-5, 8], [5, 8]], "height": 2, "doors": [{"at": 5, "width": 1.6, "opens": 2}]},
    {"kind": "ropes", "points": [[-12, -12], [12, -12], [12, 12], [-12, 12]], "height": 1.2},
]


@pytest.fixture
def frames(workplace):
    scenario = crowdsim.load_scenario(scene(obstacles=OBSTACLES))
    parts = pack_obstacles(scenario, None)
    return parts, obstacle_frames(parts)


def edges_of(frame):
    return np.array(frame["edges"]).reshape(-1, 7)


def test_a_box_has_its_twelve_edges_where_it_is(frames) -> None:
    _, (box, *_) = frames
    edges = edges_of(box)
    assert len(edges) == 12
    corners = np.unique(np.round(np.concatenate([edges[:, :3], edges[:, 3:6]]), 3), axis=0)
    # Rotated by a quarter, it is 2 m deep and 1 m wide.
    assert corners.tolist() == [[x, y, z] for x in (5.5, 6.5) for y in (0.0, 0.9) for z in (3.0, 5.0)]
    assert (box["opens"], box["closes"]) == (None, None)


def test_frames_reach_as_far_as_their_parts(frames) -> None:
    parts, found = frames
    assert len(found) == len(parts)
    for part, frame in zip(parts, found, strict=True):
        edges = edges_of(frame)
        points = np.concatenate([edges[:, :3], edges[:, 3:6]])
        assert points[:, 1].min() == 0.0
        assert points[:, 1].max() == pytest.approx(part["height"])
        far = np.hypot(points[:, 0] - part["x"], points[:, 2] - part["z"]).max()
        assert far <= (np.hypot(part["half_along"], part["half_across"]) + part["radius"]) * 1.5 + 0.01
        assert far >= part["half_along"] - 0.01


def test_doors_say_when_they_are_open(frames) -> None:
    opening = [frame for frame in frames[1] if frame["opens"] is not None]
    assert [(frame["opens"], frame["closes"]) for frame in opening] == [(2.0, None)]


def test_a_recording_has_its_obstacles(workplace) -> None:
    run = crowdsim.run(crowdsim.load_scenario(scene(obstacles=OBSTACLES)))
    assert unpack_scene(run.recording(fps=15.0).scene())["obstacles"] == obstacle_frames(run.obstacles)
