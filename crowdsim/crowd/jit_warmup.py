"""Loads or compiles the kernels of a simulation before its clock starts, by running a few avatars unrecorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.crowd.arrays import Model
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.script import Script
from crowdsim.crowd.simulation import SMALL, Simulation

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_FEW = 40
"""Avatars that make kernels ready; more than fit into one leaf of a tree."""

_FRAMES = (1, 2)
"""Control frames of the chunks that they run; in the first one no avatar moves."""


def warm_up(
    crowd: Crowd,
    policies: Sequence[Policy],
    script: Script | None = None,
    search: str = "auto",
    profiled: bool = False,
) -> Model:
    """Compile or load every kernel that a simulation needs, by a few of its avatars; return its model.

    Args:
        crowd: The crowd.
        policies: Its policies.
        script: What is planned.
        search: How nearest opponents are found.
        profiled: Whether the time of every stage is taken.
    """
    few = first_avatars(crowd, _FEW)
    targets = Script(() if script is None else script.targets, ())
    changes = script is not None and bool(script.changes)
    searches = [search]
    if search == "auto":
        # One frame is run stage by stage where some enter later, and all frames where there are many.
        searches = ["kd_tree"] if crowd.count > SMALL else ["auto", "kd_tree"] if changes else ["auto"]
        searches += ["auto"] if crowd.count > SMALL and int(np.count_nonzero(crowd.present)) <= SMALL else []
    model: Model | None = None
    for one in searches:
        simulation = Simulation(few, policies, targets, 1, one, profiled=profiled, model=model)
        try:
            for frames in _FRAMES:
                simulation.run(frames)
        finally:
            simulation.close()
        model = simulation.model
    assert model is not None
    return model


def first_avatars(crowd: Crowd, count: int) -> Crowd:
    """Return a crowd of the first avatars of another, all of them present; their opponents may differ."""
    count = min(count, crowd.count)
    each = ["x", "z", "heading", "policy", "team", "group", "cohort", "scale", "girth", "speed", "skip", "fixed"]
    each += ["present", "temperaments", "stances"]
    fields = {name: getattr(crowd, name)[:count] for name in each}
    fields["fixed"] = np.where(fields["fixed"] >= count, -1, fields["fixed"]).astype(crowd.fixed.dtype)
    fields["present"] = np.ones(count, bool)
    return replace(crowd, **fields)
