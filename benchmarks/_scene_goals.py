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


PLACES = {"pelvis_outside_share": Goal(most=0.0), "feet_outside_share": Goal(most=0.02)}
CROWD = {"stuck_share": Goal(most=0.005), "turned_away_share": Goal(most=0.06), "air_share": Goal(most=0.03)}
GOALS: dict[str, dict[str, Goal]] = {
    "duel": {"first_landed_seconds": Goal(most=6.0), "air_share": Goal(most=0.02)},
    "moving_target": {"within_share": Goal(0.9), "landed_per_minute": Goal(8.0)},
    "moving_target_fast": {"within_share": Goal(0.8), "landed_per_minute": Goal(4.0)},
    "armies_200": {
        "first_landed_seconds": Goal(most=8.0),
        "air_share": Goal(most=0.05),
        "out_of_reach_share": Goal(most=0.4),
    },
    "brawl_30": {
        "stuck_avatars": Goal(most=0),
        "out_of_reach_share": Goal(most=0.02),
        "turned_away_share": Goal(most=0.03),
        "air_share": Goal(most=0.02),
        "thrown_per_minute": Goal(30.0, 60.0),
        "landed_share": Goal(0.35),
        "least_landed_per_minute": Goal(4.0, mean=True),
        "distance_median": Goal(0.85, 1.15),
    },
    "brawl_30_cmu": {
        "stuck_avatars": Goal(most=0),
        "turned_away_share": Goal(most=0.06),
        "air_share": Goal(most=0.02),
        "thrown_per_minute": Goal(most=75.0),
    },
    "alley": PLACES,
    "bout": PLACES,
    "crowd_10k": CROWD,
    "crowd_100k": CROWD,
    "crowd_1m": CROWD,
}
"""Goals of figures by scene; scenes and figures without one are only reported."""


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
