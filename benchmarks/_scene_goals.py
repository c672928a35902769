"""What is asked of the shipped scenes, and which of several seeds is the worst."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

Measured = Mapping[str, float | None]

MORE_IS_BETTER = (
    "landed_per_minute", "least_landed_per_minute", "landed_share", "within_share", "arrived_share",
    "arrived_in_time_share",
)  # fmt: skip
NEVER = ("first_landed_seconds", "arrival_seconds")
"""Times that are None where it never happened, which is the worst of all; other figures are None where nothing could be
measured."""


@dataclass(frozen=True)
class Goal:
    """What a figure should be, of the worst seed, or in the mean of the seeds.

    Attributes:
        least: Least value.
        most: Greatest value.
        mean: Whether the mean of the seeds counts.
    """

    least: float = float("-inf")
    most: float = float("inf")
    mean: bool = False

    def met(self, value: float | None) -> bool:
        """Return whether a value is what it should be; None is not."""
        return value is not None and self.least <= value <= self.most

    def __str__(self) -> str:
        """Return the goal as text, such as ``<= 0.02``."""
        if self.least == float("-inf"):
            text = f"<= {self.most:g}"
        elif self.most == float("inf"):
            text = f">= {self.least:g}"
        else:
            text = f"{self.least:g} to {self.most:g}"
        return f"{text}, mean" if self.mean else text


STRIKES = {"air_share": Goal(most=0.02), "landed_share": Goal(0.35)}
FIGHT = {
    "first_landed_seconds": Goal(most=6.0),
    **STRIKES,
    "out_of_reach_share": Goal(most=0.02),
    "stuck_share": Goal(most=0.005),
    "turned_away_share": Goal(most=0.03),
    "thrown_per_minute": Goal(30.0, 60.0),
    "landed_per_minute": Goal(10.0),
    "distance_median": Goal(0.85, 1.15),
    "overlap_share": Goal(most=0.02),
}
FEW = {**FIGHT, "stuck_avatars": Goal(most=0), "least_landed_per_minute": Goal(4.0, mean=True)}
TARGET = {
    "first_landed_seconds": Goal(most=8.0),
    **STRIKES,
    "stuck_avatars": Goal(most=0),
    "turned_away_share": Goal(most=0.03),
    "within_share": Goal(0.9),
    "landed_per_minute": Goal(8.0),
}
PLACES = {"pelvis_outside_share": Goal(most=0.0), "feet_outside_share": Goal(most=0.02)}
# Rests and falls part those who fight until they are down.
DAMAGE = {**STRIKES, "first_landed_seconds": FIGHT["first_landed_seconds"], "overlap_share": FIGHT["overlap_share"]}
GOALS: dict[str, dict[str, Goal]] = {
    "duel": {**FEW, "within_share": Goal(0.9)},
    "alley": {**DAMAGE, **PLACES},
    "bout": {**DAMAGE, **PLACES},
    "moving_target": TARGET,
    "moving_target_fast": {**TARGET, "within_share": Goal(0.8), "landed_per_minute": Goal(4.0)},
    "armies_200": FIGHT,
    "brawl_30": FEW,
    "brawl_30_cmu": FEW,
    "brawl_last_standing": DAMAGE,
    "crowd_10k": FIGHT,
    "crowd_100k": FIGHT,
    "crowd_1m": FIGHT,
    **{
        f"ring_{radius}": {"arrived_share": Goal(0.99), "arrived_in_time_share": Goal(0.95)}
        for radius in (2, 3, 4, 8, 12)
    },
}
"""Goals of figures by scene: those of a fight hold for all of its variants. Figures without one are only reported."""


def worst_of(key: str, values: Sequence[float | None], goal: Goal | None = None) -> float | None:
    """Return the worst value of several seeds.

    Of a goal with two ends it is the value farthest from their middle, of ``MORE_IS_BETTER`` the least, else the
    greatest.
    """
    found = [value for value in values if value is not None]
    if not found or (key in NEVER and len(found) < len(values)):
        return None
    if goal is not None and float("-inf") < goal.least and goal.most < float("inf"):
        middle = (goal.least + goal.most) / 2.0
        return max(found, key=lambda value: abs(value - middle))
    return min(found) if key in MORE_IS_BETTER else max(found)


def summarise(scene: str, seeds: Sequence[Measured]) -> dict[str, object]:
    """Return the worst of the seeds for every figure, and beside them ``mean`` and ``missed``, the goals not met."""
    goals = GOALS.get(scene, {})
    keys = [key for key in seeds[0] if key != "seed"]
    worst = {key: worst_of(key, [one[key] for one in seeds], goals.get(key)) for key in keys}
    mean: dict[str, float | None] = {}
    for key in keys:
        values = [value for one in seeds if (value := one[key]) is not None]
        mean[key] = fmean(values) if values else None
    missed = [key for key, goal in goals.items() if not goal.met(mean[key] if goal.mean else worst[key])]
    return {**worst, "mean": mean, "missed": missed}
