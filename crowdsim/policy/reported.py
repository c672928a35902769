"""What bundles report of themselves, which is printed and never computed with: its shape."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, RootModel, model_validator

from crowdsim.config.documents import OpenModel
from crowdsim.config.files import Fault
from crowdsim.policy.document_parts import LOOKUPS, AxisPart, Count, Number


class MotionStatistics(OpenModel):
    """What is reported of the motion."""

    clips: Count
    frames: Count
    seconds: Number
    frames_kept: Count
    mirrored: bool
    strikes: Count
    frames_kept_by_clip: dict[str, Count]


class GraphFigures(OpenModel):
    """What is reported of the graph, see ``graph.statistics.GraphStatistics``."""

    frames: Count
    transitions: Count
    states: Count
    actions: Count
    branching: Number
    action_frames: Number
    action_frames_most: Count
    cost_mean: Number
    cost_95: Number
    threshold: Number
    transitions_per_second: Number
    seconds_between_transitions: Number


class Success(OpenModel):
    """What is reported of a behaviour's trials."""

    task: Literal["arrive", "strike", "evade"]
    share: Number
    seconds: Number
    share_behind: Number | None


class BehaviourFigures(OpenModel):
    """What is reported of a behaviour."""

    axes: list[AxisPart] = Field(min_length=1)
    cells: Count
    entries: Count
    bytes: Count
    lookup: LOOKUPS
    solver: str
    sweeps: Count
    residual: Number
    converged: bool
    success: Success


class StrikeFigures(OpenModel):
    """What is reported of the strikes."""

    reach: dict[str, list[Number]]
    striking_range: list[Number]
    by_hand: dict[str, Count]
    by_kind: dict[str, Count]
    by_height: dict[str, Count]
    used_share: Number
    paper: dict[str, list[Number]]

    @model_validator(mode="after")
    def _pairs(self) -> StrikeFigures:
        pairs = [*self.reach.values(), *self.paper.values(), self.striking_range]
        if any(len(pair) != 2 for pair in pairs) or not {"distance", "height"} <= self.reach.keys():
            raise Fault("holds ranges that are no pairs, or lacks distance and height", "reach")
        if "head" not in self.by_height:
            raise Fault("lacks 'head'", "by_height")
        return self


class FallFigures(OpenModel):
    """What is reported of falls and staggers: their directions [rad]."""

    directions: list[Number] = Field(min_length=1)
    stagger_directions: list[Number]


class RestFigures(OpenModel):
    """What is reported of rests: how many on the spot, from how many states they begin, at what cost [m], and walks."""

    count: Count
    states: Count
    walks: Count = 0
    cost_mean: Number
    cost_most: Number


class DuelFigures(OpenModel):
    """What is reported of duels of the policy with itself, see ``self_play.grading.Duels``."""

    seconds: Number
    thrown: Number
    landed: Number
    longest_wait: Number
    turned_away_share: Number
    still_share: Number
    distance: Number
    waiting_distance: Number
    waiting_actions: Count


class Statistics(OpenModel):
    """What is reported of a policy, see ``training.statistics.policy_statistics``."""

    motion: MotionStatistics
    graph: GraphFigures
    sustained_speed: Number
    warnings: list[str]
    behaviours: dict[str, BehaviourFigures]
    strikes: StrikeFigures | None = None
    falls: FallFigures | None = None
    rests: RestFigures | None = None
    duel: DuelFigures | None = None

    @model_validator(mode="after")
    def _strikes_are_there(self) -> Statistics:
        if self.motion.strikes and self.strikes is None:
            raise Fault("missing, since there are some", "strikes")
        return self


class BehaviourTimings(OpenModel):
    """What a behaviour took."""

    seconds: Number
    updates_per_second: Number | None = None


class Timings(RootModel[dict[str, Number | dict[str, BehaviourTimings]]]):
    """What ``timings.json`` holds."""
