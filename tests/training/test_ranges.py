"""Ranges of grids: those of a recipe, and those that come from the motion."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from crowdsim.errors import MotionError
from crowdsim.training.ranges import SWING, resolve_grid, strike_reach, striking_range
from crowdsim.training.recipe import BehaviourSpec


@pytest.fixture
def motion():
    """Strikes all over a region, and heads between 1.4 and 1.6 m, of a database that has nothing else."""
    draw = np.random.default_rng(1)
    bearing, distance = draw.uniform(-0.4, 0.9, 500), draw.uniform(0.5, 1.0, 500)
    places = np.stack([distance * np.sin(bearing), draw.uniform(1.1, 1.7, 500), distance * np.cos(bearing)], axis=-1)
    heads = np.stack([np.zeros(900), draw.uniform(1.4, 1.6, 900), np.zeros(900)], axis=-1)
    return SimpleNamespace(
        strike_frames=np.arange(500),
        strike_positions=places,
        heads=heads,
        head_heights=heads[:, 1],
        body=SimpleNamespace(torso_radius=0.15),
        control_rate=15.0,
    )


def test_a_recipes_seconds_are_a_grids_control_frames(motion):
    reward = [{"kind": "hit", "distance": [0.5, 1.0]}, {"kind": "strike"}]
    axes = {
        "distance": {"count": 4},
        "velocity": {"count": 3, "minimum": -1.5, "maximum": 3.0, "fade": 0.3},
        "impact": {"count": 4, "maximum": 0.6, "fade": 0.2},
    }
    spec = BehaviourSpec.model_validate({"axes": axes, "rewards": reward})
    velocity, impact = resolve_grid(spec, motion).axes[1:]
    assert (velocity.minimum, velocity.maximum, velocity.fade) == pytest.approx((-0.1, 0.2, 0.02))
    assert (impact.minimum, impact.maximum, impact.fade) == pytest.approx((0.0, 9.0, 3.0))


def test_velocities_that_are_left_out_are_those_of_the_motion_and_of_no_jump_between_clips(motion):
    steps = np.where(np.arange(99) == 49, 30.0, np.linspace(0.0, 0.02, 99))
    way = np.concatenate([[0.0], np.cumsum(steps)])
    moving = SimpleNamespace(
        **{**vars(motion), "ground": np.stack([way, 0.0 * way, 0.0 * way], -1), "stride": 1},
        clip_starts=np.array([0, 50, 100]),
    )
    velocity = grid_of(moving, distance={}, velocity={})["velocity"]
    assert velocity.maximum == pytest.approx(np.percentile(np.delete(steps, 49), 95.0), abs=1e-4)
    assert velocity.minimum == -velocity.maximum


def grid_of(motion, **axes):
    result = {name: {"count": 4, **axis} for name, axis in axes.items()}
    spec = BehaviourSpec.model_validate({"axes": result, "rewards": [{"kind": "strike", "tolerance": 0.1}]})
    return {axis.name: axis for axis in resolve_grid(spec, motion).axes}


def test_axes_end_where_strikes_reach_if_the_recipe_asks_for_it(motion):
    found = grid_of(motion, distance={"reach": True}, bearing={"reach": True}, height={"reach": True})
    reach = strike_reach(motion)
    for name, axis in found.items():
        assert (axis.minimum, axis.maximum) == pytest.approx(getattr(reach, name), abs=5e-4)
        assert not axis.wraps
    assert found["bearing"].minimum == pytest.approx(-0.335, abs=0.03)
    assert found["bearing"].maximum == pytest.approx(0.835, abs=0.03)


def test_an_end_of_the_recipe_goes_before_where_strikes_reach(motion):
    found = grid_of(motion, distance={"reach": True, "minimum": 0.0}, bearing={"reach": True, "maximum": 3.0})
    assert (found["distance"].minimum, found["bearing"].maximum) == (0.0, 3.0)
    assert found["distance"].maximum == pytest.approx(strike_reach(motion).distance[1], abs=5e-4)


def test_other_axes_go_all_round_and_a_step_past_what_strikes_reach(motion):
    found = grid_of(motion, distance={}, bearing={}, height={})
    assert found["bearing"].wraps
    assert (found["bearing"].minimum, found["bearing"].maximum) == (-math.pi, math.pi)
    assert found["distance"].minimum == 0.0
    assert found["distance"].maximum > strike_reach(motion).distance[1] + 0.75
    assert 1.4 <= found["height"].minimum < found["height"].maximum <= 1.6


def test_motion_without_strikes_has_no_reach(motion):
    still = SimpleNamespace(
        **{**vars(motion), "strike_frames": np.zeros(0, int), "body": SimpleNamespace(height=1.75)},
        clip_starts=np.array([0, 15, 30]), clip_names=("a", "a~mirror"),
    )  # fmt: skip
    with pytest.raises(MotionError, match=r"no strikes found in 1\.0 s of motion, .* moves at 2\.3 m/s or more"):
        grid_of(still, distance={"reach": True})


@pytest.mark.parametrize(("limb", "expected"), [(0, 0.8), (1, 0.8), (2, 1.3), (3, 1.3)])
def test_a_kick_reaches_from_where_the_leg_swings_out_and_a_punch_from_where_it_lands(limb, expected):
    rate, count = 60.0, 200
    walked = np.linspace(0.0, 0.5 / SWING * count / rate, count)  # half a metre ahead in the time of a kick
    frames = np.array([60, 110, 160])
    motion = SimpleNamespace(
        strike_frames=frames,
        strike_limbs=np.full(3, limb, np.uint8),
        strike_positions=np.tile([0.0, 1.2, 0.7], (3, 1)),
        ground=np.stack([np.zeros(count), walked, np.zeros(count)], axis=-1),
        clip_starts=np.array([0, 10, 50]),
        stride=4,
        playback_rate=rate,
        body=SimpleNamespace(head_radius=0.1),
    )
    near, far = striking_range(motion)
    assert (near, far) == pytest.approx((expected, expected), abs=0.02)


def test_a_kick_at_the_start_of_a_clip_reaches_from_there():
    ground = np.stack([np.zeros(40), np.arange(40.0), np.zeros(40)], axis=-1)
    motion = SimpleNamespace(
        strike_frames=np.array([22]),
        strike_limbs=np.array([2], np.uint8),
        strike_positions=np.array([[0.0, 1.2, 0.7]]),
        ground=ground,
        clip_starts=np.array([0, 5, 10]),
        stride=4,
        playback_rate=60.0,
        body=SimpleNamespace(head_radius=0.1),
    )
    assert striking_range(motion) == pytest.approx((2.8, 2.8))
