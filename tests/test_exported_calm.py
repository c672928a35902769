"""Exported motion beside the source where nothing disturbs it, and jumps of the source as it is played."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_exported_measures import FPS, HAND, NECK, benchmark_modules, figure, make_run


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    return benchmark_modules(monkeypatch)


def test_calm_motion_is_held_against_the_source(modules: SimpleNamespace) -> None:
    figures = [figure(modules, (0.0, 0.0)), figure(modules, (0.0, 3.0), np.pi)]
    run = make_run(modules, figures)
    outcome = modules.calm.undisturbed(run)
    assert outcome["frames"] == 2 * 240
    assert outcome["greatest_gap"] == pytest.approx(0.0, abs=1e-12)
    figures[0].joints[100, NECK, 0] += 0.02
    assert modules.calm.undisturbed(run)["greatest_gap"] == pytest.approx(0.02)


def test_frames_around_blocked_strikes_and_lifted_feet_are_not_calm(modules: SimpleNamespace) -> None:
    figures = [figure(modules, (0.0, 0.0)), figure(modules, (0.0, 3.0), np.pi)]
    run = make_run(modules, figures, strikes=[(2.0, 1, 0, 0, False)])
    whole = modules.calm.undisturbed(run)["frames"]
    assert whole == 2 * 240 - 37  # 0.3 s around a strike that is thrown
    run.events["blocked"][:] = True
    assert modules.calm.undisturbed(run)["frames"] == whole - 43  # 0.7 s after one that is taken
    run.source.figure.soles[:50, 0, 0, 1] = -0.01
    assert modules.calm.undisturbed(run)["frames"] == whole - 43 - 2 * 50


def test_frames_in_which_bodies_touch_are_counted_apart(modules: SimpleNamespace) -> None:
    figures = [figure(modules, (0.0, 0.0)), figure(modules, (0.0, 1.5), np.pi)]
    figures[0].fists[:] = figures[1].fists[:] = [0.0, 3.0, 0.0]
    figures[1].fists[:] = [0.0, 4.0, 0.0]
    run = make_run(modules, figures)
    run.capsules[1][120, 1] = run.capsules[0][120, 0]
    figures[0].joints[118, NECK, 0] += 0.02
    outcome = modules.calm.undisturbed(run)
    assert outcome["where_bodies_touch"]["frames"] == 2 * 37
    assert outcome["where_bodies_touch"]["greatest_gap"] == pytest.approx(0.02)
    assert outcome["frames"] == 2 * (240 - 37)
    assert outcome["greatest_gap"] == pytest.approx(0.0, abs=1e-12)


def test_jumps_of_the_source_count_as_often_as_they_are_played(modules: SimpleNamespace) -> None:
    run = make_run(modules, [figure(modules, (0.0, 0.0)), figure(modules, (0.0, 3.0))])
    angle = np.radians(15.0)
    turn = np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])
    run.source.figure.turns[100:, HAND] = turn
    again = np.concatenate([np.arange(120.0), np.arange(120.0)])
    run = replace(run, frames=np.stack([again, np.full(240, 99.0)]))
    rows = [modules.jumps.played_jumps(run, avatar) for avatar in range(2)]
    np.testing.assert_array_equal(np.flatnonzero(rows[0]), [99, 219])
    assert not rows[1].any()
    found = modules.jumps.measure_jumps(run)
    assert found["rotation_jumps_per_minute_of_the_source_as_played"] == pytest.approx(2 / (2 * 240 / FPS / 60.0))
    assert found["rotation_jumps_per_minute"] == 0.0
