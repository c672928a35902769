"""Finer and coarser grids: what is carried from one to another, and what solving by levels finds."""

import numpy as np
import pytest
from naive_policy import corners, random_actions

from crowdsim.errors import RecipeError
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.rewards import ProximityTerm, StrikeTerm, TargetBody
from crowdsim.training.model import build_model
from crowdsim.training.recipe import load_recipe
from crowdsim.training.refinement import coarser_grids, fit, interpolate, refine, solve_by_levels
from crowdsim.training.value_iteration import value_iteration

BODY = TargetBody()
GRID = build_grid(
    [
        Axis("distance", 0.2, 1.8, 6),
        Axis("bearing", -np.pi, np.pi, 8, wraps=True),
        Axis("height", 1.2, 1.6, 3),
    ]
)
STRETCHED = build_grid(
    [
        Axis("distance", 0.2, 3.0, 6, stretch=0.7),
        Axis("bearing", -np.pi, np.pi, 8, wraps=True),
        Axis("height", 1.2, 1.6, 3, stretch=2.0),
    ]
)
TERMS = (StrikeTerm(kind="strike", tolerance=0.2), ProximityTerm(kind="proximity", distance=0.5, weight=0.1))


def model_on(grid):
    return build_model(random_actions(), grid, TERMS, BODY, 0.8)


def read(values, grid, target):
    cells, weights = corners(grid, target)
    return values[..., cells] @ weights


@pytest.mark.parametrize("grid", [GRID, STRETCHED], ids=["even", "stretched"])
def test_a_refined_grid_holds_all_points_of_the_given_one(grid):
    finer = refine(grid, 3)
    assert finer.shape == (16, 24, 3)
    for one, two in zip(grid.axes, finer.axes, strict=True):
        assert (one.minimum, one.maximum, one.wraps, one.stretch) == (two.minimum, two.maximum, two.wraps, two.stretch)
        times = 1 if one.name == "height" else 3
        np.testing.assert_allclose(two.points[::times][: one.count], one.points, atol=1e-12)


def test_coarser_grids_halve_the_steps_over_the_ground_and_end_with_the_grid_itself():
    grid = build_grid([Axis("distance", 0.0, 2.0, 41), Axis("bearing", -np.pi, np.pi, 90, wraps=True), GRID.axes[2]])
    assert [one.shape for one in coarser_grids(grid)] == [(11, 22, 3), (21, 45, 3), (41, 90, 3)]
    assert coarser_grids(GRID) == [GRID]


def test_values_on_another_grid_are_those_that_interpolation_reads_there():
    values = np.random.default_rng(1).random((2, GRID.cells)).astype(np.float32)
    other = build_grid(
        [Axis("distance", 0.2, 1.8, 9), Axis("bearing", -np.pi, np.pi, 11, wraps=True), Axis("height", 1.2, 1.6, 2)]
    )
    expected = np.stack([read(values, GRID, target) for target in other.targets()], axis=-1)
    np.testing.assert_allclose(interpolate(values, GRID, other), expected, atol=1e-5)


def test_what_a_stretched_grid_holds_stays_on_a_finer_one_and_comes_back():
    values = np.random.default_rng(4).random((2, STRETCHED.cells)).astype(np.float32)
    finer = refine(STRETCHED, 2)
    carried = interpolate(values, STRETCHED, finer)
    expected = np.stack([read(values, STRETCHED, target) for target in finer.targets()], axis=-1)
    np.testing.assert_allclose(carried, expected, atol=1e-5)
    at_points = carried.reshape(2, *finer.shape)[:, ::2, ::2].reshape(2, -1)
    np.testing.assert_allclose(at_points, values, atol=1e-6)
    for back in (interpolate, fit):
        np.testing.assert_allclose(back(carried, finer, STRETCHED), values, atol=2e-5)


def test_a_fit_is_the_least_squares_solution_over_all_points_of_the_finer_grid():
    finer = refine(GRID, 2)
    values = np.random.default_rng(2).random((2, finer.cells)).astype(np.float32)
    design = np.zeros((finer.cells, GRID.cells))
    for row, target in enumerate(finer.targets()):
        cells, weights = corners(GRID, target)
        np.add.at(design[row], cells, weights)
    expected = np.linalg.lstsq(design, values.T.astype(float), rcond=None)[0].T
    np.testing.assert_allclose(fit(values, finer, GRID), expected, atol=2e-5)


def test_a_table_that_is_interpolated_to_a_finer_grid_is_what_is_fitted_to_it():
    values = np.random.default_rng(3).random((2, GRID.cells)).astype(np.float32)
    finer = refine(GRID, 2)
    np.testing.assert_allclose(fit(interpolate(values, GRID, finer), finer, GRID), values, atol=2e-5)


def test_levels_lead_to_the_values_that_sweeps_on_the_grid_alone_find():
    grid = build_grid([Axis("distance", 0.2, 1.8, 21), Axis("bearing", -np.pi, np.pi, 40, wraps=True), GRID.axes[2]])
    assert len(coarser_grids(grid)) == 2
    by_levels = solve_by_levels(model_on, grid, tolerance=1e-5)
    alone = value_iteration(model_on(grid), tolerance=1e-5)
    np.testing.assert_allclose(by_levels.values, alone.values, atol=1e-4)
    assert by_levels.converged
    assert by_levels.residuals[-1] <= 1e-5
    assert len(by_levels.residuals) == by_levels.sweeps


def test_a_fitted_table_reads_nearer_to_the_finer_values_than_their_own_points_do():
    finer = refine(GRID, 2)
    exact = value_iteration(model_on(finer), tolerance=1e-4).values
    found = solve_by_levels(model_on, GRID, finer=2, tolerance=1e-4).values
    at_points = interpolate(exact, finer, GRID)
    errors = [np.square(interpolate(table, GRID, finer) - exact).mean() for table in (found, at_points)]
    assert found.shape == (len(exact), GRID.cells)
    assert errors[0] < 0.8 * errors[1]


def test_a_recipe_cannot_fit_what_interpolates_q(tmp_path):
    text = """
version: 1
motion: {performer: {seconds: 20}}
behaviours:
  punch:
    axes: {distance: {count: 4}}
    rewards: [{kind: strike}]
    backup: max_of_interpolated
    finer: 2
"""
    file = tmp_path / "recipe.yaml"
    file.write_text(text)
    with pytest.raises(RecipeError, match=r"behaviours\.punch\.finer: is 2, expected 1 with the backup"):
        load_recipe(file)
