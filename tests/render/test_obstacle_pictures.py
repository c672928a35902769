"""Obstacles are in pictures: as large as they are, doors while they are closed, and in those of runs."""

from pathlib import Path

import numpy as np
import pytest
from render_sources import Walkers
from scenes import crowdsim, write_scene

from crowdsim.config.files import dump_yaml
from crowdsim.places.arrays import pack_parts
from crowdsim.places.description import BoxObstacle, DiscObstacle, Door, RopesObstacle, WallObstacle
from crowdsim.places.kernels.records import PART
from crowdsim.render.look import Look
from crowdsim.render.obstacles import add_obstacles, hide_avatars
from crowdsim.render.raycast import Capsules
from crowdsim.render.stage import build_stage
from crowdsim.runs.opening import open_run
from crowdsim.scenario.cameras import KINDS

WALL = WallObstacle(
    kind="wall", points=((-2.0, 1.0), (2.0, 1.0)), height=2.0, doors=(Door(at=2.0, width=1.0, opens=3.0),)
)


NONE = Capsules(np.empty((0, 8), np.float32), np.empty((0, 4), np.float32), np.empty(0, np.int32))


def bounds(*shapes, seconds=0.0):
    capsules, faces = add_obstacles(NONE, None, pack_parts(list(enumerate(shapes)), 1.0), seconds)
    if faces is not None:
        return faces.vertices.min(axis=0), faces.vertices.max(axis=0)
    shapes_of = capsules.shapes
    ends = shapes_of[:, :6].reshape(-1, 2, 3)
    radii = shapes_of[:, 6:, None]
    return (ends - radii).min(axis=(0, 1)), (ends + radii).max(axis=(0, 1))


@pytest.mark.parametrize(
    ("shape", "low", "high"),
    [
        (WALL, [-2.1, 0.0, 0.9], [2.1, 2.0, 1.1]),
        (BoxObstacle(kind="box", centre=(1.0, 2.0), size=(2.0, 0.6), height=0.9), [0.0, 0.0, 1.7], [2.0, 0.9, 2.3]),
        (DiscObstacle(kind="disc", centre=(1.0, 2.0), radius=0.4, height=3.0), [0.6, 0.0, 1.6], [1.4, 3.0, 2.4]),
        (
            RopesObstacle(kind="ropes", points=((-2.0, -1.0), (-2.0, 1.0), (2.0, 1.0), (2.0, -1.0))),
            [-2.05, -0.05, -1.05],
            [2.05, 1.35, 1.05],
        ),
    ],
)
def test_obstacles_are_as_large_in_pictures_as_they_are(shape, low, high):
    found = bounds(shape)
    np.testing.assert_allclose(found[0], low, atol=1e-5)
    np.testing.assert_allclose(found[1], high, atol=1e-5)


def test_a_turned_box_is_turned_as_an_avatar_with_that_heading():
    # From +z towards +x: what is along x points to -z after a quarter.
    low, high = bounds(BoxObstacle(kind="box", centre=(0.0, 0.0), size=(3.0, 1.0), rotation=90.0))
    np.testing.assert_allclose([low[0], low[2], high[0], high[2]], [-0.5, -1.5, 0.5, 1.5], atol=1e-5)


def test_a_door_is_shown_until_it_opens():
    parts = pack_parts([(0, WALL)], 1.0)
    (shut, closed), (still, _), (gap, opened) = (add_obstacles(NONE, None, parts, time) for time in (0.0, 2.99, 3.0))
    assert shut.shapes.tobytes() == still.shapes.tobytes()
    assert np.abs(opened.vertices[:, 0]).min() == pytest.approx(0.5)
    assert np.abs(closed.vertices[:, 0]).min() < 0.3
    assert len(np.unique(shut.owners)) == len(np.unique(gap.owners)) + 1 == 3


def test_faces_are_seen_instead_of_the_capsules_that_cast_their_shadows():
    parts = pack_parts(
        [(0, WALL), (1, RopesObstacle(kind="ropes", points=((-4.0, -4.0), (-4.0, 4.0), (4.0, 4.0))))], 1.0
    )
    walkers = add_obstacles(NONE, None, pack_parts([(0, WALL)], 1.0), 0.0)
    capsules, faces = add_obstacles(*walkers, parts, 0.0)
    hidden = np.isin(capsules.owners, faces.avatars)
    of_ropes = capsules.owners == -2 - 3  # behind the stretches of the wall and its door
    assert of_ropes.any()
    assert not hidden[of_ropes].any()
    assert hidden[capsules.owners > -5].all()
    assert (capsules.owners[faces.homes] < 0).all()
    assert faces.triangles.max() == len(faces.vertices) - 1
    corners = faces.vertices[faces.triangles]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() <= 0.6 + 1e-5
    assert faces.looks.max() < len(faces.paints)


def test_no_obstacles_are_no_capsules():
    some = add_obstacles(NONE, None, pack_parts([(0, WALL)], 1.0), 0.0)
    joined, faces = add_obstacles(*some, np.zeros(0, PART), 0.0)
    assert joined.shapes.shape == some[0].shapes.shape
    assert joined.owners.dtype == np.int32
    assert faces is some[1]
    assert add_obstacles(NONE, None, np.zeros(0, PART), 0.0)[1] is None


def test_obstacles_are_in_the_pictures_of_run_and_of_render_alike(workplace: Path) -> None:
    pictures = {"png": True, "mp4": False, "fps": 15, "size": [160, 96], "frames": [0, 1]}
    drawn = {}
    for name, obstacles in (("walled", [{"kind": "wall", "points": [[-3, 3], [3, 3]]}]), ("bare", [])):
        outputs = {"render": pictures}
        write_scene(workplace / f"{name}.yaml", name="four", obstacles=obstacles, duration=3, outputs=outputs)
        assert crowdsim("run", f"{name}.yaml", "--out", name, "--quiet") == 0
        size = ["--size", "160x96", "--fps", "15", "--frames", "0:1"]
        assert crowdsim("render", name, "--png", *size, "--out", f"{name}_again", "--quiet") == 0
        again = (workplace / f"{name}_again" / "frames" / "000000.png").read_bytes()
        drawn[name] = (workplace / name / "frames" / "000000.png").read_bytes()
        assert drawn[name] == again
        assert len(open_run(workplace / name).obstacles) == len(obstacles)
    assert drawn["walled"] != drawn["bare"]


def hidden(eye, *avatars, height=2.0):
    wall = WallObstacle(kind="wall", points=((-2.0, 1.0), (2.0, 1.0)), height=height)
    far = WallObstacle(kind="wall", points=((-2.0, -9.0), (2.0, -9.0)), height=height)
    parts = pack_parts([(0, wall), (1, far)], 1.0)
    return hide_avatars(parts, np.array(eye, float), np.array(avatars, float)).tolist()


def test_what_hides_avatars_from_an_eye_is_between_them():
    assert hidden((0, 1.5, 6), (0, 0)) == [True, False]
    assert hidden((0, 1.5, 6), (0, 3)) == [False, False], "the avatar stands before the wall"
    assert hidden((0, 1.5, 6), (9, 0)) == [False, False], "the wall ends beside the line of sight"
    assert hidden((0, 1.5, 6), (9, 0), (0, 0)) == [True, False]
    assert hidden((0, 9.0, 6), (0, -4)) == [False, False], "the eye sees over the wall"
    assert hidden((0, 9.0, 6), (0, -4), height=6.0) == [True, False]
    assert hidden((0, 1.5, 6), (np.nan, np.nan)) == [False, False]
    assert hidden((0, 1.5, 1.8), (0, 4)) == [True, False], "the eye is right before the wall"


class Walled(Walkers):
    """Walkers behind a wall."""

    def __post_init__(self):
        super().__post_init__()
        wall = WallObstacle(kind="wall", points=((-9.0, 1.0), (9.0, 1.0)), height=3.0)
        self.obstacles = pack_parts([(0, wall)], 1.0)

    def seconds(self, frame):
        return frame / self.fps


def test_cameras_that_are_placed_by_hand_show_what_hides_avatars():
    paths = np.zeros((2, 2, 3))
    paths[:, :, 0] = [-0.5, 0.5]
    look = Look(caption=False, marks="none")
    pictures = {}
    for kind, keys in (("front", {}), ("fixed", {"position": (0, 1.5, 5)}), ("side", {})):
        for source in (Walkers, Walled):
            camera = KINDS[kind](kind=kind, **keys)
            pictures[kind, source] = build_stage(source(paths), (96, 64), camera, look).picture(0)
    assert (pictures["fixed", Walkers] != pictures["fixed", Walled]).mean() > 0.3
    seen = {kind: (pictures[kind, Walkers] != pictures[kind, Walled]).any() for kind in ("front", "side")}
    # One of the two looks along z, from one side or the other.
    assert not all(seen.values())


def test_thousands_of_walls_in_a_scenario_are_shown(workplace: Path) -> None:
    write_scene(workplace / "four.yaml", duration=3)
    assert crowdsim("run", "four.yaml", "--out", "run", "--quiet") == 0
    walls = [{"kind": "wall", "points": [[i % 60, i // 60], [i % 60 + 0.5, i // 60 + 0.25]]} for i in range(20000)]
    path = workplace / "run" / "scenario.resolved.yaml"
    before = path.read_text(encoding="utf-8")
    path.write_text(before.replace("obstacles: []\n", dump_yaml({"obstacles": walls})), encoding="utf-8")
    assert path.stat().st_size > 1.2 * 2**20
    assert len(open_run(workplace / "run").obstacles) == 20000
