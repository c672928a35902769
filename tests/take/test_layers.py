"""Layers of poses: one more is one class in the list, and what reads others reads it too."""

from typing import Any

import numpy as np
import pytest
from take.synthetic_take import actions, build_take, database, sampler

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.poses.contacts import body_points
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.layer import Layer, Part, reading_of, times_of
from crowdsim.poses.layers import LAYERS
from crowdsim.poses.poser import Poser
from crowdsim.poses.sampler import unseen_layers
from crowdsim.take.take import Events, Take

RISE, BREATHS = 0.05, 0.3


class Swaying(Layer):
    """A chest that leans back and forth, the more so the further the avatar is in its breath."""

    name = "swaying"

    def plan(self, part: Part) -> Array:
        """Return by how much chests lean [rad]. Shape (T, n)."""
        times = np.broadcast_to(part.moments.times, part.playback.frames.shape)
        return RISE * np.sin(2.0 * np.pi * BREATHS * times + part.window.avatars[part.moments.columns])

    def apply(self, part: Part, poses: Posed) -> None:
        """Lean them."""
        chest, leans = part.window.motion.body.roles["chest"], part.plans[self.name]
        spin = quaternion.from_rotation_vector(leans[..., None] * np.array([1.0, 0.0, 0.0]))
        poses.rotations[:, :, chest] = quaternion.multiply(poses.rotations[:, :, chest].astype(float), spin)


SWAYING = (*LAYERS[:4], Swaying, *LAYERS[4:])
ASKED = np.arange(3), np.arange(10, 90) / 60.0


def fight() -> tuple[Take, Any]:
    """Three boxers close together; the second one hits the first, who hits the third."""
    first, lengths = actions(90)
    rows: dict[str, list[Any]] = {
        "frame": [9.3, 9.6], "attacker": [1, 0], "victim": [0, 2], "hand": [0, 1], "limb": [0, 1],
        "point": [(0.1, 1.4, 0.2), (0.4, 1.5, 0.3)], "speed": [8.0, 7.0], "landed": [True, True],
    }  # fmt: skip
    kinds = {"frame": np.float64, "speed": np.float32, "landed": bool, "point": np.float32}
    events = Events(**{name: np.array(values, kinds.get(name, np.int32)) for name, values in rows.items()})
    queues = [list(range(30 * n, 30 * n + 30)) for n in range(3)]
    return build_take(queues, first, lengths, 40, events=events, start=[(0, 0, 0), (0.5, 0.6, 3.0), (0.9, 0, 1.5)])


def posed(poser: Poser, avatars: Array, times: Array) -> tuple[Array, Array]:
    """Roots (T, n, 3) and rotations (T, n, J, 4)."""
    [block] = poser.sample(avatars, times)
    return block.poses.roots, block.poses.rotations


def poser(**more: Any) -> Poser:
    take, policy = fight()
    return Poser(take, sampler(take, policy).motions, **more)


def test_a_layer_more_shows_and_is_read_by_the_fists_of_others() -> None:
    still, breathing = (posed(poser(kinds=kinds), *ASKED)[1] for kinds in (LAYERS, SWAYING))
    chest = database().body.roles["chest"]
    turns = quaternion.multiply(quaternion.conjugate(still[:, :, chest].astype(float)), breathing[:, :, chest])
    apart = np.linalg.norm(quaternion.to_rotation_vector(turns), axis=-1)
    assert 0.5 * RISE < apart.max() < 4.0 * RISE
    # At its strike the second one's fist is on the first one's head or trunk, wherever breath has moved these.
    when, (body, fists) = np.array([9.3 / 15.0]), (database().body, [])
    for kinds in (LAYERS, SWAYING):
        [(_, _, scales, positions, rotations)] = poser(kinds=kinds).joints(np.array([1]), when)
        fists.append(body_points(body, positions, rotations, scales)[3][0, 0])
    assert np.linalg.norm(fists[0] - fists[1]) > 0.002


def test_with_a_layer_more_a_part_is_what_it_is_in_the_whole() -> None:
    roots, rotations = posed(poser(kinds=SWAYING), *ASKED)
    part = posed(poser(kinds=SWAYING), np.array([0, 2]), ASKED[1][30:41])
    np.testing.assert_array_equal(part[0], roots[30:41][:, [0, 2]])
    np.testing.assert_array_equal(part[1], rotations[30:41][:, [0, 2]])


def test_blocks_and_tiles_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    roots, rotations = posed(poser(), *ASKED)
    monkeypatch.setattr("crowdsim.poses.poser._TOGETHER", 1)
    monkeypatch.setattr("crowdsim.poses.poser.POSES_AT_ONCE", 1)
    blocks = list(poser().sample(*ASKED))
    assert len(blocks) == 3
    for block in blocks:
        np.testing.assert_array_equal(block.poses.roots, roots[:, block.which])
        np.testing.assert_array_equal(block.poses.rotations, rotations[:, block.which])


def test_layers_that_are_left_out_leave_the_caches_of_others_alone() -> None:
    whole = poser()
    before = posed(whole, *ASKED)
    without = frozenset({"deflection", "second deflection", "fists"})
    some = Poser(whole.take, whole.motions, without=without, base=whole)
    assert some.layers["separation"] is whole.layers["separation"]
    alone = Poser(whole.take, whole.motions, without=without)
    for shared, own in zip(posed(some, *ASKED), posed(alone, *ASKED), strict=True):
        np.testing.assert_array_equal(shared, own)
    assert not np.array_equal(posed(some, *ASKED)[1], before[1])
    np.testing.assert_array_equal(posed(whole, *ASKED)[1], before[1])


def sizes_of_layers() -> dict[str, float]:
    """By name what can be left out of poses, and how far that moves bodies at the most [m]."""
    return {
        name: least
        for kind in LAYERS
        for name, least in (
            (kind.name, kind.size),
            (reading_of(kind.name), kind.reading),
            (times_of(kind.name), kind.sparse),
        )
    }


def test_layers_are_left_out_where_they_move_bodies_by_less_than_half_a_pixel() -> None:
    scales = np.array([0.0, np.inf, 26.0, 6.0, 0.5, 2.0])
    unseen = {int(avatar): names for avatars, names in unseen_layers(scales) for avatar in avatars}
    assert set(unseen) == {1, 2, 3, 4, 5}
    assert unseen[1] == unseen[2] == frozenset()
    sizes = sizes_of_layers()
    for avatar in (3, 4, 5):
        assert unseen[avatar] == {name for name, size in sizes.items() if size * scales[avatar] < 0.5}
    assert "blend" not in unseen[4]


def test_layers_move_no_further_than_they_say() -> None:
    """What is left out at some size moves no joint of 99 of 100 avatars by more; all of it by half as much more."""
    take, policy = fight()
    whole = sampler(take, policy)
    joints = whole.sample(0, 150, 60)[0].joints()[0]

    def moves(*names: str) -> np.ndarray:
        moved = whole.sample(0, 150, 60, without=frozenset(names))[0].joints()[0] - joints
        return np.linalg.norm(moved, axis=-1).max(axis=-1)

    sizes = {name: size for name, size in sizes_of_layers().items() if np.isfinite(size)}
    for name, size in sizes.items():
        assert np.percentile(moves(name), 99) < size
    for most in sorted(set(sizes.values())):
        assert np.percentile(moves(*(name for name, size in sizes.items() if size <= most)), 99) < 1.5 * most


def test_from_far_away_limbs_are_pushed_out_of_others_around_the_times_that_are_shown() -> None:
    """From far away neither other times nor other avatars that are asked for make a difference, and limbs do go."""
    whole = poser()
    far = frozenset({times_of("deflection"), "second deflection"})
    roots, rotations = posed(Poser(whole.take, whole.motions, without=far), *ASKED)
    part = posed(Poser(whole.take, whole.motions, without=far), np.array([0, 2]), ASKED[1][30:41])
    np.testing.assert_array_equal(part[0], roots[30:41][:, [0, 2]])
    np.testing.assert_array_equal(part[1], rotations[30:41][:, [0, 2]])
    none = posed(Poser(whole.take, whole.motions, without=frozenset({"deflection", "second deflection"})), *ASKED)
    assert np.abs(rotations - none[1]).max() > 0.01
