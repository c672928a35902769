"""What blows do, measured on hand-made bodies with known answers."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_exported_measures import FPS, NECK, PELVIS, benchmark_modules, figure, make_run

TIMES = (1.0, 4.0, 7.0)
SPEEDS = np.array([5.0, 6.0, 9.0])


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    return benchmark_modules(monkeypatch)


def struck(modules: SimpleNamespace, height: float = 1.65) -> tuple[Any, Any]:
    """Three blows along +z at a body that stands still, each harder than the one before, at a height [m]."""
    figures = [figure(modules, (0.0, 0.0), frames=540), figure(modules, (0.0, 1.0), np.pi, frames=540)]
    for one in figures:
        one.fists[:] = [0.0, 5.0, 0.0]
        one.joints[:, NECK, 1] = 1.45
    for seconds in TIMES:
        at = round(seconds * FPS)
        figures[0].fists[at - 3 : at + 1, 0] = [[0.0, height, 0.85 - 0.1 * k] for k in (3, 2, 1, 0)]

    def build(more: tuple[tuple[Any, ...], ...] = (), **events: Any) -> Any:
        strikes = [*((seconds, 0, 1, 0, True) for seconds in TIMES), *more]
        run = make_run(modules, figures, strikes)
        return replace(run, events={**run.events, "speed": np.append(SPEEDS, [6.0] * len(more)), **events})

    return figures, build


def move(path: np.ndarray, far: float, seconds: float, lasts: float = 0.5) -> None:
    """Move points along z for some time from soon after a blow on."""
    at = round(seconds * FPS)
    path[at + 5 : at + round(lasts * FPS), ..., 2] += far


@pytest.mark.parametrize(("order", "sign"), [((0, 1, 2), 1.0), ((2, 1, 0), -1.0)])
def test_heads_that_go_further_the_harder_the_blow_correlate(
    modules: SimpleNamespace, order: tuple[int, ...], sign: float
) -> None:
    figures, build = struck(modules)
    for seconds, rank in zip(TIMES, order, strict=True):
        move(figures[1].head, 0.02 * SPEEDS[rank], seconds)
    head = modules.blows.measure_blows(build())["head"]
    assert sign * head["correlation"] > 0.7
    assert (head["weak"], head["strong"]) == pytest.approx((0.02 * SPEEDS[order[0]], 0.02 * SPEEDS[order[2]]))


def test_a_head_that_goes_with_the_pelvis_moves_over_the_ground_alone(modules: SimpleNamespace) -> None:
    figures, build = struck(modules)
    for path in (figures[1].head, figures[1].joints):
        move(path, 0.2, TIMES[2])
    outcome = modules.blows.measure_blows(build())
    assert outcome["head"]["correlation"] is None
    assert outcome["head_over_ground"]["strong"] == pytest.approx(0.2)


@pytest.mark.parametrize(("far", "share"), [(0.11, 1.0), (0.09, 0.0), (-0.2, 0.0)])
def test_a_pelvis_is_away_that_goes_10_cm_along_a_strong_blow(
    modules: SimpleNamespace, far: float, share: float
) -> None:
    figures, build = struck(modules)
    move(figures[1].joints[:, PELVIS], far, TIMES[2], 0.9)
    pelvis = modules.blows.measure_blows(build())["pelvis"]
    assert pelvis["away_after_strong"] == share
    assert pelvis["unhit"] == 0.0


def test_strikes_of_victims_count_over_their_usual_rate(modules: SimpleNamespace) -> None:
    _, build = struck(modules)
    assert modules.blows.measure_blows(build())["strikes_after"]["all"] is None
    # One within 0.8 s of a blow, two of three elsewhere: in 9 s three are thrown.
    run = build(((1.5, 1, 0, 0, False), (2.5, 1, 0, 0, False), (5.0, 1, 0, 0, False)))
    after = modules.blows.measure_blows(run)["strikes_after"]
    assert after["all"] == pytest.approx(1.0 / (3.0 * 3.0 * 0.8 / 9.0))
    assert after["strong"] == 0.0


@pytest.mark.parametrize(("far", "against"), [(-0.1, 1.0), (-0.05, 0.0), (0.1, 0.0)])
def test_a_trunk_that_folds_over_a_blow_to_the_body_bends_against_it(
    modules: SimpleNamespace, far: float, against: float
) -> None:
    figures, build = struck(modules, 1.2)
    for seconds in TIMES:
        move(figures[1].joints[:, NECK], far, seconds)
    trunk = modules.blows.measure_blows(build())["trunk"]
    assert trunk["to_the_body"] == 3
    assert trunk["against_the_blow"] == against
    assert trunk["in_any_direction"] == float(abs(far) > 0.09)


def test_blows_to_the_head_are_none_to_the_body(modules: SimpleNamespace) -> None:
    _, build = struck(modules)
    trunk = modules.blows.measure_blows(build())["trunk"]
    assert (trunk["to_the_body"], trunk["against_the_blow"]) == (0, None)


def test_a_glove_that_a_blocked_blow_pushes_gives_way(modules: SimpleNamespace) -> None:
    figures, build = struck(modules)
    figures[1].fists[:, 1] = [0.0, 1.65, 0.9]
    figures[0].fists[175:181, 0] = [[0.0, 1.65, 0.85 - 0.1 * k] for k in (5, 4, 3, 2, 1, 0)]
    figures[1].fists[184:, 1, 2] += 0.05
    blocked = np.array([False, False, False, True])
    guard = modules.blows.measure_blows(build(((3.0, 0, 1, 0, False),), blocked=blocked))["guard"]
    assert guard == {"blocked": 1, "median": pytest.approx(0.05)}


def test_few_blows_are_not_measured(modules: SimpleNamespace) -> None:
    figures, _ = struck(modules)
    run = make_run(modules, figures, [(1.0, 0, 1, 0, True), (8.9, 0, 1, 0, True)])
    assert modules.blows.measure_blows(run) == {"landed": 1}
