"""What is drawn for each avatar: its type, and numbers from the distributions of that, such as its size."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.random import Purpose, normal, uniform
from crowdsim.scenario.distributions import Distribution, Uniform, middle
from crowdsim.scenario.parts import AvatarType
from crowdsim.scenario.scenario import Scenario

EVEN_TEMPERED = (1.0, 0.0, 0.0)
"""The temperament of an avatar that keeps its cohort's tempo, is neither bold nor shy, and keeps the usual distance."""


def draw(seed: int, purpose: Purpose, avatars: Array, distribution: Distribution) -> Array:
    """Return a number of a distribution for each avatar, whoever the others are. Shape as ``avatars``."""
    if isinstance(distribution, float | int):
        return np.full(len(avatars), float(distribution))
    if isinstance(distribution, Uniform):
        width = distribution.maximum - distribution.minimum
        return distribution.minimum + width * uniform(seed, purpose, avatars)
    low, high = distribution.limits
    return np.clip(distribution.mean + distribution.deviation * normal(seed, purpose, avatars), low, high)


def draw_types(scenario: Scenario) -> Array:
    """Return the index of each avatar's type; those of a mix are drawn by its weights. Shape (N,), int32."""
    numbers = {name: number for number, name in enumerate(scenario.types)}
    types, first = np.empty(scenario.avatar_count, np.int32), 0
    for group in scenario.groups:
        own = np.arange(first, first + group.count)
        first += group.count
        if group.type is not None:
            types[own] = numbers[group.type]
        elif group.mix is not None:
            names = [name for name in numbers if group.mix.get(name, 0) > 0]
            edges = np.cumsum([group.mix[name] for name in names])
            chosen = np.searchsorted(edges / edges[-1], uniform(scenario.seed, Purpose.TYPE, own), side="right")
            types[own] = np.array([numbers[name] for name in names], np.int32)[np.minimum(chosen, len(names) - 1)]
        for avatar, row in zip(own, group.rows, strict=bool(group.rows)):
            if row.type.text:
                types[avatar] = numbers[row.type.text]
    return types


def draw_numbers(scenario: Scenario, types: Array, key: str) -> Array:
    """Return the number of each avatar for a key of its type, such as ``scale``; NaN where the type has none.

    Args:
        scenario: The scenario.
        types: Index of the type of each avatar. Shape (N,).
        key: A key whose values are distributions.

    Returns:
        Shape (N,), float64.
    """
    drawn = np.full(len(types), np.nan)
    for index, kind in enumerate(scenario.types.values()):
        distribution = getattr(kind, key)
        if distribution is not None:
            own = np.flatnonzero(types == index)
            drawn[own] = draw(scenario.seed, Purpose[key.upper()], own, distribution)
    return drawn


def is_tempered(kind: AvatarType) -> bool:
    """Return whether avatars of a type have a tempo, an aggression or a range of their own."""
    return not isinstance(kind.tempo, float | int | None) or kind.aggression != 1.0 or kind.range != 0.0


def temperaments_of(scenario: Scenario, types: Array, tempos: Array, aggressions: Array, ranges: Array) -> Array:
    """Return the temperament of each avatar, or none where all are even-tempered.

    Args:
        scenario: The scenario.
        types: Index of the type of each avatar. Shape (N,).
        tempos: What ``draw_numbers`` has drawn for each. Shape (N,).
        aggressions: Likewise. Shape (N,).
        ranges: Likewise. Shape (N,).

    Returns:
        How much longer than its cohort the avatar recovers from a strike, as a factor; its aggression in doublings,
        from -2 for 0.25 to 2 for 4; its range [m]. Shape (N, 3), or (0, 3).
    """
    if not any(is_tempered(scenario.types[name]) for name in scenario.used_types):
        return np.zeros((0, 3))
    usual = np.array([np.nan if kind.tempo is None else middle(kind.tempo) for kind in scenario.types.values()])
    slowness = np.where(np.isnan(tempos), 1.0, usual[types] / tempos)
    return np.stack([slowness, np.log2(aggressions), ranges], axis=1)
