"""Fists that land stop at the bodies that they hit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from take.synthetic_take import database, sampler
from take.test_poses import duel

from crowdsim.poses.capsules import PosedBodies
from crowdsim.poses.contacts import body_points
from crowdsim.poses.kernels import fists
from crowdsim.poses.kernels.fists import _ROUND, MOTION, _stop_point
from crowdsim.poses.layers import fists as layer
from crowdsim.poses.outlines import find_surface

WRIST = 0.03
"""How much further off wrists have to stay than fists [m]."""


def stop(start: tuple[float, ...], end: tuple[float, ...], radius: float, after: float = 0.0) -> np.ndarray:
    """A capsule that moves along x by ``after`` until ``MOTION`` seconds after the strike."""
    one = np.array([[*start, *end, radius, radius, WRIST]])
    way = after * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    return np.stack([one - way, one, one + way])


def depth_of(point: np.ndarray, capsule: np.ndarray) -> float:
    """How deep a point is in a capsule of one radius [m], naively: by the nearest of many points of its axis."""
    along = np.linspace(0.0, 1.0, 20_001)[:, None]
    axis = capsule[:3] + along * (capsule[3:6] - capsule[:3])
    return float(capsule[6] - np.linalg.norm(axis - point, axis=1).min())


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_a_fist_in_a_capsule_is_brought_to_its_surface_and_one_outside_stays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    capsule = stop(tuple(rng.normal(0.0, 0.1, 3)), tuple(rng.normal(0.0, 0.1, 3)), 0.15)
    fist, shift = rng.normal(0.0, 0.12, 3), np.zeros(3)
    before = depth_of(fist, capsule[1, 0])
    _stop_point(fist, capsule, 0.0, 0.0, 1.0, shift)
    if before <= 0.0:
        assert not shift.any()
        return
    left = depth_of(fist + shift, capsule[1, 0])
    assert left == pytest.approx(before * _ROUND / (before + _ROUND), abs=5e-4)
    assert np.linalg.norm(shift) == pytest.approx(before - left, abs=5e-4)


def test_capsules_move_with_the_body_before_and_after_the_strike() -> None:
    capsule, found = stop((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.1, after=0.2), []
    for moved in (-1.0, 0.0, 0.5, 1.0):
        shift = np.zeros(3)
        _stop_point(np.array([0.1 + 0.2 * moved, 0.5, 0.0]) - [0.05, 0.0, 0.0], capsule, 0.0, moved, 1.0, shift)
        found.append(shift[0])
    np.testing.assert_allclose(found, 0.05 * 0.05 / (0.05 + _ROUND), atol=1e-9)
    shift = np.zeros(3)
    _stop_point(np.array([0.15, 0.5, 0.0]), capsule, 0.0, 1.0, 1.0, shift)
    assert shift[0] < 0.0


def test_a_weight_of_half_goes_half_the_way_and_missing_capsules_stop_nothing() -> None:
    capsule, fist = stop((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.1), np.array([0.04, 0.5, 0.0])
    half, whole, none = np.zeros(3), np.zeros(3), np.zeros(3)
    _stop_point(fist, capsule, 0.0, 0.0, 0.5, half)
    _stop_point(fist, capsule, 0.0, 0.0, 1.0, whole)
    _stop_point(fist, np.full_like(capsule, np.nan), 0.0, 0.0, 1.0, none)
    np.testing.assert_allclose(half, 0.5 * whole)
    assert not none.any()


def test_a_wrist_stays_as_much_further_off_as_its_capsule_says() -> None:
    capsule, wrist = stop((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.1), np.array([0.11, 0.5, 0.0])
    alone, both = np.zeros(3), np.zeros(3)
    _stop_point(wrist, capsule, 0.0, 0.0, 1.0, alone)
    _stop_point(wrist, capsule, 1.0, 0.0, 1.0, both)
    assert not alone.any()
    depth = WRIST - 0.01
    np.testing.assert_allclose(both, [depth * depth / (depth + _ROUND), 0.0, 0.0], atol=1e-9)


def deepest(monkeypatch: pytest.MonkeyPatch, stops: bool, gap: float) -> float:
    """How deep the middle of the striking fist is in the skin of the other around the strike [m]."""
    if not stops:
        found = layer.find_stops
        monkeypatch.setattr(layer, "find_stops", lambda *given: np.full_like(found(*given), np.nan))
    take, policy, frame = duel(gap)
    body, hand = database().body, int(take.events.hand[0])
    take = replace(take, collision_avoidance=False)
    poses = sampler(take, policy).sample(frame - 6, frame + 7, 60)[0]
    positions, turns = poses.joints()
    build = poses.scales[1:], take.cast.girths[1:], take.cast.stretches[1:]
    depths = []
    for at in range(len(positions)):
        fist = body_points(body, positions[at], turns[at], poses.scales)[3][:1, hand]
        other = PosedBodies(body, np.arange(1), *build, positions[at : at + 1, 1:], turns[at : at + 1, 1:])
        depths.append(-float(find_surface(other, np.array(["male"])).gaps(fist)[0][0]))
    return max(depths)


def test_fists_go_no_deeper_before_and_after_a_strike(monkeypatch: pytest.MonkeyPatch) -> None:
    through = deepest(monkeypatch, False, -0.16)
    monkeypatch.undo()
    stopped = deepest(monkeypatch, True, -0.16)
    assert stopped < through - 0.015


def test_times_over_which_fists_stop_are_within_those_that_bodies_are_read_for() -> None:
    assert fists._LEAVES <= fists.LEAN
    assert layer.Fists.looks[0] >= fists.LEAN + MOTION


def test_a_fast_fist_that_a_body_stops_is_slowed_over_centimetres() -> None:
    capsule, speed, rate = stop((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.1), 8.0, 10_000.0
    path = []
    for x in np.arange(0.2, 0.02, -speed / rate):
        shift = np.zeros(3)
        _stop_point(np.array([x, 0.5, 0.0]), capsule, 0.0, 0.0, 1.0, shift)
        path.append(x + shift[0])
    slowed = np.diff(path, 2) * rate**2
    assert slowed.min() > -1e-3
    assert slowed.max() < 4_800.0
    assert path[-1] > 0.07
