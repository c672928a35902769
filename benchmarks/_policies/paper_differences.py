"""The differences from the paper, each as a change that takes one of them back, and the recipes they start from."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from crowdsim.scenario.scenario import Scenario
from crowdsim.training.recipe import Recipe, plain

Plain = dict[str, Any]

SECONDS = {False: 120.0, True: 24.0}
"""Motion that ablations are trained on, in full and quick runs [s]."""
COUNTS = {False: {"distance": 20, "bearing": 24, "height": 3}, True: {"distance": 6, "bearing": 8, "height": 2}}
"""Most grid points of each axis, in full and quick runs."""
SWEEPS = {False: 8, True: 1}
"""Rounds of exploration of Q-learning."""
SPEED = 0.5
"""Speed of a target that moves in training [m/s]."""


@dataclass(frozen=True)
class Difference:
    """One difference from the paper, taken back.

    Attributes:
        says: What is as in the paper then.
        recipe: Changes the recipe, as plain data, in place; None where training stays as it is.
        scenario: Changes the scene.
        weighted: Whether it starts from the weighted sum of approach and punch rather than from the recipe's own
            weights, because only a sum of behaviours has it.
    """

    says: str
    recipe: Callable[[Plain], None] | None = None
    scenario: Callable[[Scenario], Scenario] = lambda scenario: scenario
    weighted: bool = False


def smaller(recipe: Recipe, quick: bool, weighted: bool = False) -> Plain:
    """Return a recipe as plain data, cut down to less motion, coarser grids and the behaviours that it weighs.

    Args:
        recipe: The recipe, of the embedded boxer.
        quick: Whether seconds must do.
        weighted: Whether the behaviours are approach and punch with a weight of 1 each.
    """
    outcome = plain(recipe)
    weights = (
        {"approach": 1.0, "punch": 1.0} if weighted else outcome["weights"] or dict.fromkeys(outcome["behaviours"], 1.0)
    )
    outcome["weights"] = {name: weight for name, weight in weights.items() if weight > 0.0}
    outcome["behaviours"] = {name: outcome["behaviours"][name] for name in outcome["weights"]}
    outcome["motion"]["performer"]["seconds"] = min(outcome["motion"]["performer"]["seconds"], SECONDS[quick])
    for spec in outcome["behaviours"].values():
        spec["finer"] = 1
        for name, axis in spec["axes"].items():
            if axis is not None:
                axis["count"] = min(axis["count"], COUNTS[quick][name])
    return outcome


def quicker(recipe: Recipe) -> Recipe:
    """Return the paper's recipe with little motion, few actions and coarse grids."""
    outcome = smaller(recipe, True)
    outcome["graph"].update(actions=300, threshold=None)
    for spec in outcome["behaviours"].values():
        spec["solver"]["max_sweeps"] = SWEEPS[True]
    return Recipe.model_validate(outcome)


def _terms(recipe: Plain, kind: str) -> list[Plain]:
    return [term for spec in recipe["behaviours"].values() for term in spec["rewards"] if term["kind"] == kind]


def _each(recipe: Plain, **changes: Any) -> None:
    for spec in recipe["behaviours"].values():
        spec.update(deepcopy(changes))


def _set(recipe: Plain, kind: str, **changes: Any) -> None:
    for term in _terms(recipe, kind):
        term.update(changes)


def _other_session(recipe: Plain) -> None:
    recipe["motion"]["performer"]["seed"] += 1


def _maximum(recipe: Plain) -> None:
    _set(recipe, "strike", form="max")
    _set(recipe, "proximity", form="max")


def _free_transitions(recipe: Plain) -> None:
    for spec in recipe["behaviours"].values():
        spec["rewards"] = [term for term in spec["rewards"] if term["kind"] != "transition"]


def _without_fade(recipe: Plain) -> None:
    for spec in recipe["behaviours"].values():
        for axis in filter(None, spec["axes"].values()):
            axis["fade"] = 0.0


def _learned(quick: bool) -> Callable[[Plain], None]:
    solver = {"kind": "q_learning", "max_sweeps": SWEEPS[quick]}
    return lambda recipe: _each(recipe, solver=solver, backup="max_of_interpolated")


def _types(scenario: Scenario, **changes: Any) -> Scenario:
    types = {name: kind.model_copy(update=changes) for name, kind in scenario.types.items()}
    return scenario.model_copy(update={"types": types})


def _fickle(scenario: Scenario) -> Scenario:
    def without(thing: Any) -> Any:
        return thing.model_copy(update={"hysteresis": 0.0}) if hasattr(thing, "hysteresis") else thing

    groups = tuple(
        group.model_copy(update={"opponents": without(group.opponents or scenario.opponents)})
        for group in scenario.groups
    )
    return scenario.model_copy(update={"groups": groups, "opponents": without(scenario.opponents)})


def as_in_the_paper(scenario: Scenario) -> Scenario:
    """Return a scene without what control adds to the paper: tempo, hysteresis and collision avoidance.

    Reactions to hits are a matter of poses, which nothing here looks at.
    """
    return _types(_fickle(scenario).model_copy(update={"collision_avoidance": False}), tempo=None)


def differences(quick: bool) -> dict[str, Difference]:
    """Return every difference from the paper that can be taken back alone, by name.

    The first one, `other_motion`, takes back none: it says how much training on another session moves the figures.
    """
    return {
        "other_motion": Difference("nothing: the performer's session has another seed", _other_session),
        "reward_maximum": Difference("an action earns the maximum over its frames, not a sum", _maximum),
        "q_learning": Difference("Q-learning, and the backup that it needs", _learned(quick)),
        "max_of_interpolated": Difference(
            "the maximum of interpolated Q, by value iteration", lambda r: _each(r, backup="max_of_interpolated")
        ),
        "q_table": Difference("a table of Q(action, cell), without look-ahead", lambda r: _each(r, lookup="q")),
        "moving_target": Difference(
            f"the target moves in training, at {SPEED:g} m/s",
            lambda r: _each(r, target={"speed": SPEED, "directions": 4, "still": 0.0}),
        ),
        "no_pruning": Difference("every transition of the graph is an action", lambda r: r.update(prune=None)),
        "no_transition_price": Difference("transitions cost nothing", _free_transitions),
        "no_effort": Difference(
            "strikes cost neither effort nor waste", lambda r: _set(r, "strike", effort=0.0, waste=0.0)
        ),
        "equal_strikes": Difference(
            "strikes count alike, whatever their speed", lambda r: _set(r, "strike", speed_weight=0.0)
        ),
        "wanted_point": Difference(
            "the target is wanted at a point 0.8 m ahead, not in a band",
            lambda r: _set(r, "proximity", distance=0.8, facing=True, aside=0.0),
        ),
        "strikes_at_15_hz": Difference(
            "motion is kept, and strikes are found, at the control rate",
            lambda r: r.update(playback_rate=r["control_rate"]),
        ),
        "no_mirroring": Difference("motion is not mirrored", lambda r: r["motion"].update(mirror=False)),
        "weighted_sum": Difference("approach and punch, a weighted sum", lambda r: None, weighted=True),
        "weighted_sum_without_fade": Difference(
            "the same, and punch counts beyond its grid too", _without_fade, weighted=True
        ),
        "weighted_sum_without_normalisation": Difference(
            "the same, and values are added as they are", lambda r: _each(r, normalise=False), weighted=True
        ),
        "no_tempo": Difference("avatars never tire", scenario=lambda s: _types(s, tempo=None)),
        "no_hysteresis": Difference("the nearest opponent, always", scenario=_fickle),
        "no_collision_avoidance": Difference(
            "avatars walk through one another", scenario=lambda s: s.model_copy(update={"collision_avoidance": False})
        ),
    }
