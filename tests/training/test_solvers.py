"""Solvers: against a naive one, a known answer and one another; the same bytes on any number of threads."""

import numpy as np
import pytest
from naive_policy import by_action, corners, random_actions
from naive_policy import value_iteration as naive_value_iteration

from crowdsim.core.workers import limited
from crowdsim.policy.actions import Actions
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.rewards import HitTerm, ProximityTerm, StrikeTerm, TargetBody, TransitionTerm
from crowdsim.training.kernels.exploration import Learning, try_everything
from crowdsim.training.kernels.successors import END, GROUND_AXIS, empty_successors, find_successors
from crowdsim.training.model import BACKUPS, build_model, build_movement
from crowdsim.training.q_learning import q_learning
from crowdsim.training.solution import q_table, sweep_model
from crowdsim.training.value_iteration import value_iteration

BODY = TargetBody()
CIRCLE = Axis("bearing", -np.pi, np.pi, 7, wraps=True)
GRIDS = {
    "distance": build_grid([Axis("distance", 0.0, 2.0, 6)]),
    "polar": build_grid([Axis("distance", 0.0, 2.0, 5), CIRCLE]),
    "punch": build_grid([Axis("distance", 0.2, 1.4, 4), CIRCLE, Axis("height", 1.2, 1.6, 3)]),
}
TERMS = (
    StrikeTerm(kind="strike", tolerance=0.2),
    ProximityTerm(kind="proximity", distance=0.5, weight=0.1),
    TransitionTerm(kind="transition", weight=0.05),
)
DISCOUNT = 0.8


def model_of(grid, movement=None, actions=None):
    return build_model(actions or random_actions(), grid, TERMS, BODY, DISCOUNT, movement)


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS.keys())
@pytest.mark.parametrize("backup", BACKUPS)
@pytest.mark.parametrize("movement", [build_movement(), build_movement(1.0, 3, 0.4)], ids=["still", "moving"])
def test_value_iteration_finds_what_a_naive_solver_finds(grid, backup, movement):
    actions = random_actions(states=4)
    naive = naive_value_iteration(actions, grid, TERMS, BODY, DISCOUNT, movement, backup, sweeps=60)
    model = model_of(grid, movement, actions)
    for evaluations in (0, 3):
        found = value_iteration(model, backup, tolerance=1e-6, evaluations=evaluations)
        assert found.converged
        q = found.q if found.q is not None else q_table(model, found.values)
        np.testing.assert_allclose(by_action(actions, grid.cells, q), naive, atol=1e-5)


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS.keys())
def test_successors_are_where_the_plain_grid_sees_the_target_after_each_action(grid):
    movement, actions = build_movement(1.0, 3, 0.4), random_actions()
    cells, weights = model_of(grid, movement, actions).corners(0, actions.action_count)
    found = np.zeros((*cells.shape[:3], grid.cells))
    for corner in range(4):
        np.add.at(found, (*np.indices(cells.shape[:3]), cells[..., corner]), weights[..., corner])
    for outcome, velocity in enumerate(movement.velocities):
        for action, (x, z, heading) in enumerate(actions.displacements.tolist()):
            cos, sin = np.cos(heading), np.sin(heading)
            for m, target in enumerate(grid.targets()[:: grid.layers]):
                dx, dz = target[[0, 2]] + actions.lengths[action] * velocity - [x, z]
                seen = np.array([dx * cos - dz * sin, grid.targets()[0, 1], dx * sin + dz * cos])
                expected = np.zeros(grid.cells)
                np.add.at(expected, *corners(grid, seen))
                np.testing.assert_allclose(found[outcome, action, m], expected, atol=1e-4)


def test_bearings_come_within_a_few_millionths_of_the_arc_tangent():
    angles = np.concatenate([np.linspace(-np.pi, np.pi, 2001), np.arange(-4, 5) * np.pi / 4])
    axes = np.array([(0, 1, 1, 0, 0, 0), (-np.pi, 1000, 7000, 0, 0, 1)], GROUND_AXIS)
    ends, count = np.array([(0, 0, 1, 0, 0, 1, 1)], END), len(angles)
    found = empty_successors(count)
    find_successors(axes, ends[0], *(part(angles).astype(np.float32) for part in (np.sin, np.cos)), found)
    error = (found.lowers + found.around) / 1000.0 - np.pi - angles
    error -= 2.0 * np.pi * np.round(error / (2.0 * np.pi))
    assert np.abs(error).max() < 5e-6


CHANGING = {
    "heading": [Axis("heading", -np.pi, np.pi, 5, wraps=True)],
    "height and heading": [Axis("height", 1.2, 1.6, 2), Axis("heading", -np.pi, np.pi, 4, wraps=True)],
    "part of a heading": [Axis("heading", -2.0, 1.0, 4)],
    "velocity": [Axis("velocity", -0.1, 0.2, 4)],
    "height and velocity": [Axis("height", 1.2, 1.6, 2), Axis("velocity", -0.2, 0.1, 3)],
    "impact": [Axis("impact", 0.0, 5.0, 4)],
    "heading, velocity and impact": [
        Axis("heading", -np.pi, np.pi, 3, wraps=True), Axis("velocity", -0.1, 0.1, 2), Axis("impact", 1.0, 4.0, 2)
    ],
}  # fmt: skip


@pytest.mark.parametrize("layers", CHANGING.values(), ids=CHANGING.keys())
@pytest.mark.parametrize("movement", [build_movement(), build_movement(1.0, 3, 0.4)], ids=["still", "moving"])
def test_what_is_seen_changes_while_the_avatar_acts_as_a_naive_solver_says(layers, movement):
    grid, actions = build_grid([Axis("distance", 0.2, 1.4, 3), CIRCLE, *layers]), random_actions(states=3)
    hit = HitTerm(kind="hit", distance=(0.4, 0.7), sigma=0.2)
    terms = (*TERMS, hit) if grid.axes[-1].name == "impact" else TERMS
    backup = "interpolation_of_max"
    naive = naive_value_iteration(actions, grid, terms, BODY, DISCOUNT, movement, backup, sweeps=60)
    model = build_model(actions, grid, terms, BODY, DISCOUNT, movement)
    found = value_iteration(model, backup, tolerance=1e-6)
    assert found.converged
    np.testing.assert_allclose(by_action(actions, grid.cells, q_table(model, found.values)), naive, atol=1e-5)
    values = found.values.reshape(-1, *grid.shape)
    for place, axis in enumerate(grid.axes, start=1):
        if axis.name in ("velocity", "impact"):
            assert np.ptp(values, axis=place).max() > 0.01, f"{axis.name} counts"


def test_an_mdp_with_a_known_answer_is_solved():
    """Standing still at the wanted distance earns gamma^t a frame for ever; the other action walks off and back."""
    actions = Actions(
        offsets=np.array([0, 2, 3], np.int32),
        next=np.array([0, 1, 0], np.int32),
        lengths=np.array([1, 2, 2], np.int32),
        shifts=np.zeros((3, 3), np.float32),
        costs=np.zeros(3, np.float32),
        path_offsets=np.array([0, 1, 3, 5], np.int32),
        paths=np.array([[0, 0, 0], [0, 50, 0], [0, 50, 0], [0, -50, 0], [0, -50, 0]], np.float32),
        strike_offsets=np.zeros(4, np.int32),
        strike_times=np.zeros(0, np.float32),
        strike_positions=np.zeros((0, 3), np.float32),
        strike_origins=np.zeros((0, 2), np.float32),
        strike_speeds=np.zeros(0, np.float32),
        strike_ids=np.zeros(0, np.int32),
    )
    grid = build_grid([Axis("distance", 1.0, 2.0, 2), CIRCLE])
    term = ProximityTerm(kind="proximity", distance=1.0, sigma=0.5)
    model = build_model(actions, grid, (term,), BODY, 0.9)
    found = value_iteration(model, tolerance=1e-7)
    forever = 0.9 / (1 - 0.9)
    expected = [forever] * 7 + [np.exp(-2.0) * forever] * 7
    np.testing.assert_allclose(found.values[0], expected, rtol=1e-5)


def test_the_interpolation_of_the_maximum_is_never_below_the_maximum_of_the_interpolation():
    model = model_of(GRIDS["punch"])
    low, high = (value_iteration(model, backup, tolerance=1e-7).values for backup in BACKUPS)
    assert (high >= low - 1e-5).all()
    assert (high > low + 1e-3).any()


def test_one_update_of_q_learning_is_the_one_done_on_paper():
    """Q(a, c) := Q(a, c) + alpha (r + gamma^T max over a' of Q(a', e) - Q(a, c)), with numbers that a hand can check.

    In state 0 a target stands 2 m ahead. The action walks 0.25 m towards it in two frames, to state 1, where two
    actions may follow; the target is then seen 1.75 m ahead, a quarter of the way from the cell at 2 m to that at 1 m.
    """
    actions = Actions(
        offsets=np.array([0, 1, 3], np.int32),
        next=np.array([1, 0, 0], np.int32),
        lengths=np.array([2, 1, 1], np.int32),
        shifts=np.zeros((3, 3), np.float32),
        costs=np.zeros(3, np.float32),
        path_offsets=np.array([0, 2, 3, 4], np.int32),
        paths=np.array([[0, 0.1, 0], [0, 0.25, 0], [0, 0, 0], [0, 0, 0]], np.float32),
        strike_offsets=np.zeros(4, np.int32),
        strike_times=np.zeros(0, np.float32),
        strike_positions=np.zeros((0, 3), np.float32),
        strike_origins=np.zeros((0, 2), np.float32),
        strike_speeds=np.zeros(0, np.float32),
        strike_ids=np.zeros(0, np.int32),
    )
    grid = build_grid([Axis("distance", 1.0, 2.0, 2)])
    term = ProximityTerm(kind="proximity", distance=1.0, sigma=0.5)
    model = build_model(actions, grid, (term,), BODY, 0.5)

    # The reward: exp(-|distance - 1| / 0.5), 1.9 m away after one frame and 1.75 m after two.
    reward = 0.5 * np.exp(-1.8) + 0.25 * np.exp(-1.5)
    # What follows: at 1.75 m the first action is worth 4 / 4 + 3 * 2 / 4 = 2.5, the second 0 / 4 + 3 * 6 / 4 = 4.5.
    observed = reward + 0.25 * 4.5
    expected = 3.0 + 0.2 * (observed - 3.0)

    # Q of the action in the cells at 1 and 2 m; then, cell by cell, of the two actions of state 1.
    before = np.array([7.0, 3.0, 4.0, 0.0, 2.0, 6.0], np.float32)
    after, visits, changes = np.empty_like(before), np.zeros(6, np.uint16), np.empty(2)
    learning = Learning(visits, np.array([0.2], np.float32), 0)
    try_everything(0, 2, sweep_model(model), grid.layers, before, after, learning, changes)
    assert after[1] == pytest.approx(expected, rel=1e-6)
    assert visits.tolist() == [1] * 6

    # The first update of all begins with Q = 0 and alpha = 1.
    assert q_learning(model, max_sweeps=1, exploitations=0).q[1] == pytest.approx(reward, rel=5e-6)


def test_q_learning_is_within_2_percent_of_value_iteration_for_a_target_at_rest():
    model = model_of(GRIDS["punch"])
    exact = value_iteration(model, "max_of_interpolated", tolerance=1e-6)
    learned = q_learning(model)
    assert learned.values.mean() == pytest.approx(exact.values.mean(), rel=0.02)


def test_q_learning_settles_on_the_expectation_when_the_target_moves():
    model = model_of(GRIDS["polar"], build_movement(1.0, 4, 0.3))
    exact = value_iteration(model, "max_of_interpolated", tolerance=1e-6)
    learned = q_learning(model, tolerance=0.0, max_sweeps=100, settle=10.0)
    assert learned.values.mean() == pytest.approx(exact.values.mean(), rel=0.02)
    other = q_learning(model, tolerance=0.0, max_sweeps=100, settle=10.0, seed=1)
    assert not np.array_equal(learned.q, other.q)


def test_two_threads_give_the_same_bytes_as_one():
    model = model_of(GRIDS["punch"], build_movement(1.0, 4, 0.3))
    found = []
    for threads in (1, 2):
        with limited(threads):
            again = model_of(GRIDS["punch"], build_movement(1.0, 4, 0.3))
            solutions = [value_iteration(model, backup, tolerance=1e-3) for backup in BACKUPS]
            solutions.append(q_learning(model, max_sweeps=5))
            found.append(
                [one.values.tobytes() for one in solutions] + [again.near.tobytes(), again.landed_rewards.tobytes()]
            )
    assert found[0] == found[1]


def test_results_hold_method_and_iterations():
    model = model_of(GRIDS["polar"])
    found = value_iteration(model, tolerance=1e-3)
    pairs = model.action_count * model.grid.cells
    assert (found.solver, found.backup, found.converged) == ("value_iteration", "interpolation_of_max", True)
    assert found.updates == found.sweeps * pairs == len(found.residuals) * pairs
    assert found.residuals[-1] <= 1e-3 < found.residuals[-2]
    stopped = value_iteration(model, tolerance=1e-9, max_sweeps=3)
    assert (stopped.sweeps, stopped.converged) == (3, False)
    with pytest.raises(ValueError, match="backup is 'max', expected one of max_of_interpolated, interpolation_of_max"):
        value_iteration(model, "max")


def test_progress_never_goes_back_and_ends_at_its_total():
    seen = []
    value_iteration(model_of(GRIDS["polar"]), progress=lambda stage, done, total: seen.append((stage, done, total)))
    assert {stage for stage, _, _ in seen} == {"value iteration"}
    assert [done for _, done, _ in seen] == list(range(1, len(seen) + 1))
    assert all(done <= total for _, done, total in seen)
    assert seen[-1][1] == seen[-1][2]
