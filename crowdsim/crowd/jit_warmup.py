"""Loads or compiles the kernels of a simulation before its clock starts, by running a few avatars unrecorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.core.types import Progress
from crowdsim.crowd.arrays import Model
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.simulation import SMALL, Simulation, crowd_model

_FEW = 40
"""Avatars that make kernels ready; more than fit into one leaf of a tree."""

_FRAMES = (1, 2)
"""Control frames of the chunks that they run; in the first one no avatar moves."""


def warm_up(
    crowd: Crowd,
    search: str = "auto",
    profiled: bool = False,
    device: str = "cpu",
    progress: Progress | None = None,
) -> Model:
    """Compile or load every kernel that a simulation needs, by a few of its avatars; return its model.

    Args:
        crowd: The crowd.
        search: How nearest opponents are found.
        profiled: Whether the time of every stage is taken.
        device: Where the simulation runs, ``cpu`` or ``cuda``.
        progress: Called with stage, done and total while kernels are compiled for a GPU.
    """
    few = replace(first_avatars(crowd, _FEW), changes=(), until=None, pre_roll=0)
    searches = [search]
    if search == "auto":
        # One frame is run stage by stage where some enter later, and all frames where there are many.
        searches = ["kd_tree"] if crowd.count > SMALL else ["auto", "kd_tree"] if crowd.changes else ["auto"]
        searches += ["auto"] if crowd.count > SMALL and int(np.count_nonzero(crowd.present)) <= SMALL else []
    if device == "cuda":
        searches = ["kd_tree"]
    model = crowd_model(crowd)
    for one in searches:
        simulation = Simulation(few, 1, one, profiled=profiled, model=model, device=device, compiling=progress)
        try:
            for frames in _FRAMES:
                simulation.run(frames)
        finally:
            simulation.close()
    return model


def first_avatars(crowd: Crowd, count: int) -> Crowd:
    """Return a crowd of the first avatars of another, all of them present; their opponents may differ."""
    count = min(count, crowd.count)
    each = ("x", "z", "heading", "group", "cohort", "skip", "fixed", "temperaments")
    fields = {name: getattr(crowd, name)[:count] for name in each}
    fields["fixed"] = np.where(fields["fixed"] >= count, -1, fields["fixed"]).astype(crowd.fixed.dtype)
    fields["present"] = np.ones(count, bool)
    return replace(crowd, cast=crowd.cast.first(count), **fields)
