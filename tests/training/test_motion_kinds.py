"""What actions do, in a word, and maps that are coloured by it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from crowdsim.policy.bundle import load_policy
from crowdsim.policy.policy import build_lookup_tables
from crowdsim.training.motion_kinds import MotionKind, motion_kinds
from crowdsim.training.plots import KIND_COLOURS, chosen_states, maps_figure, strikes_figure


def kinds_of(*displacements, strikes=(), hands=()):
    """Kinds of actions of given displacements; ``strikes`` are pairs of action and strike."""
    count = len(displacements)
    offsets = np.searchsorted([action for action, _ in strikes], np.arange(count + 1))
    ids = np.array([strike for _, strike in strikes], int)
    actions = SimpleNamespace(displacements=np.array(displacements, float), strike_offsets=offsets, strike_ids=ids)
    return [MotionKind(kind) for kind in motion_kinds(actions, np.array(hands, int))]


def test_steps_are_distinguished_by_where_they_lead():
    assert kinds_of([0, 0.5, 0], [0.1, -0.5, 0], [0.5, 0.2, 0], [-0.5, 0.2, 0.1]) == [
        MotionKind.STEP_FORWARD, MotionKind.STEP_BACK, MotionKind.STEP_LEFT, MotionKind.STEP_RIGHT,
    ]  # fmt: skip


def test_actions_that_rotate_more_than_they_travel_are_turns():
    assert kinds_of([0, 0.1, 0.9], [0.1, 0, -0.9], [0, 0.6, 0.9]) == [
        MotionKind.TURN_LEFT, MotionKind.TURN_RIGHT, MotionKind.STEP_FORWARD,
    ]  # fmt: skip


def test_little_of_both_is_to_stay():
    assert kinds_of([0.02, 0.05, 0.1], [0, 0, 0]) == [MotionKind.STAY, MotionKind.STAY]


def test_an_action_with_a_strike_is_one_of_its_first_strikes_hand_wherever_it_leads():
    found = kinds_of([0, 0.5, 0], [0, 0, 0], [0, 0, 2.0], strikes=[(0, 1), (0, 0), (2, 0)], hands=[0, 1])
    assert found == [MotionKind.STRIKE_RIGHT, MotionKind.STAY, MotionKind.STRIKE_LEFT]


def test_every_kind_has_words_and_a_colour_of_its_own():
    assert MotionKind.STRIKE_LEFT.words == "strike left"
    assert set(KIND_COLOURS) == set(MotionKind)
    assert len(set(KIND_COLOURS.values())) == len(MotionKind)


@pytest.fixture(scope="module")
def policy(tiny_policy: Path):
    return load_policy(tiny_policy)


def test_maps_show_the_kind_of_the_best_action_at_the_position_of_the_target(policy):
    from crowdsim.policy.axes.axis import Target
    from crowdsim.policy.kernels.axes import Corners
    from crowdsim.policy.kernels.values import evaluate_actions

    behaviour, states = policy.behaviours[0], chosen_states(policy, 2)
    figure = maps_figure(policy, behaviour, states, points=21)
    kinds = motion_kinds(policy.actions, policy.database.strike_limbs)
    tables = build_lookup_tables(policy.actions, (behaviour,), policy.body)
    near = [axes for axes in figure.axes if axes.get_title().startswith("what the best action does")][-2:]
    for axes, state in zip(near, states, strict=True):
        shown = np.asarray(axes.collections[0].get_array()).reshape(21, 21)
        sides = np.linspace(*axes.get_xlim(), 22)
        sides = 0.5 * (sides[1:] + sides[:-1])
        for row, column in ((10, 15), (15, 10), (4, 8)):
            found = np.empty(64)
            # To the right on the map is -x of the avatar.
            target = Target(-sides[column], 1.5, sides[row], 0.0, 0.0, 0.0)
            n = evaluate_actions(tables, np.ones(1), state, target, Corners(np.empty(64, int), np.empty(64)), found)
            assert shown[row, column] == kinds[int(policy.actions.offsets[state]) + int(found[:n].argmax())]


def test_maps_have_metres_on_all_axes_and_a_legend_of_kinds_in_words(policy):
    figure = maps_figure(policy, policy.behaviours[0], chosen_states(policy, 2), points=9)
    maps = [axes for axes in figure.axes if axes.get_xlabel()]
    assert len(maps) >= 4
    for axes in maps:
        assert [axes.get_xlabel(), axes.get_ylabel()] == ["to the right [m]", "ahead [m]"]
        assert axes.get_aspect() == 1.0
        assert not axes.xaxis_inverted()
    (legend,) = figure.legends
    assert {text.get_text() for text in legend.get_texts()} <= {kind.words for kind in MotionKind}
    assert len(legend.get_texts()) > 1


def test_figures_of_strikes_have_units(policy):
    labels = [axes.get_xlabel() for axes in strikes_figure(policy).axes if axes.axison]
    assert labels == [
        "to the right [m]", "reach over the ground [m]", "height of fist or foot [m]",
        "direction, left is positive [degrees]", "highest speed of fist or foot [m/s]",
    ]  # fmt: skip
