"""What ``policy.json`` and ``timings.json`` must hold, so that nothing that is read is of another kind or out of range.

Statistics and timings are printed and never computed with.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, RootModel, model_validator

from crowdsim.config.documents import DocumentModel, OpenModel
from crowdsim.config.files import Fault
from crowdsim.errors import RecipeError
from crowdsim.motion.body import ROLES
from crowdsim.policy.axes.registry import NAMES
from crowdsim.policy.checks import FAR, NEAR
from crowdsim.policy.environment import MOST_AXES, Axis, build_grid
from crowdsim.policy.rewards import AnyTerm, ProximityTerm

LOOKUPS = Literal["q", "v"]
_FINEST = 1e-9
"""Least step between grid points."""


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("expected text that can be printed")
    return text


Text = Annotated[str, Field(min_length=1, max_length=255), AfterValidator(_printable)]
Count = Annotated[int, Field(ge=0, le=1 << 48)]
Size = Annotated[float, Field(ge=1e-6, le=NEAR)]
Rate = Annotated[float, Field(ge=0.01, le=10_000)]
Number = Annotated[float, Field(ge=-1e12, le=1e12)]
Measure = Annotated[float, Field(ge=-FAR, le=FAR)]
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class AxisPart(DocumentModel):
    """An axis of a grid, see ``environment.Axis``."""

    name: Literal[NAMES]  # type: ignore[valid-type]
    minimum: Measure
    maximum: Measure
    count: Annotated[int, Field(ge=1, le=1 << 20)]
    wraps: bool = False
    fade: Annotated[float, Field(ge=0.0, le=FAR)] = 0.0
    stretch: Annotated[float, Field(ge=0.0, le=FAR)] = 0.0

    @model_validator(mode="after")
    def _step(self) -> AxisPart:
        axis = Axis(**self.model_dump())
        if 0.0 < self.stretch < 1e-3 or not (self.count == 1 or axis.step >= _FINEST):
            raise Fault(f"has steps of {axis.step:g}, expected a range that its grid points divide", "count")
        return self


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


Near = Annotated[float, Field(ge=-NEAR, le=NEAR)]
_TOES = ("left_toe", "right_toe")
_MOST_BEHAVIOURS, _MOST_CELLS = 64, 1 << 31


class FileFacts(DocumentModel):
    """Size [bytes] and SHA-256 of a file."""

    size: Count
    sha256: Hash


class DatabasePart(DocumentModel):
    """What is no array of a motion database."""

    control_rate: Rate
    playback_rate: Rate
    clip_names: list[Text] = Field(min_length=1)

    @model_validator(mode="after")
    def _divides(self) -> DatabasePart:
        stride = round(self.playback_rate / self.control_rate)
        if stride < 1 or abs(stride * self.control_rate - self.playback_rate) > 1e-6 * self.playback_rate:
            what = f"is {self.playback_rate:g}, expected a whole multiple of the control rate {self.control_rate:g}"
            raise Fault(what, "playback_rate")
        return self


class SkeletonPart(DocumentModel):
    """What is no array of a skeleton."""

    names: list[Text] = Field(min_length=1, max_length=4096)


class PropPart(DocumentModel):
    """What a hand holds that strikes, see ``Body.props``."""

    joint: Count
    side: Literal[0, 1]
    offset: list[Near] = Field(min_length=3, max_length=3)
    radius: Size


class BodyPart(DocumentModel):
    """What is no array of a body."""

    roles: dict[str, Count]
    height: Size
    head_radius: Size
    torso_radius: Size
    props: list[PropPart] = Field(default_factory=list, max_length=2)

    @model_validator(mode="after")
    def _complete(self) -> BodyPart:
        missing = [role for role in ROLES if role not in self.roles and role not in _TOES]
        unknown = [role for role in self.roles if role not in ROLES]
        if missing or unknown:
            raise Fault(
                f"{'lacks' if missing else 'has'} {(missing or unknown)[0]!r}, expected a body's roles", "roles"
            )
        return self


class GraphPart(DocumentModel):
    """What is no array of a motion graph."""

    threshold: Annotated[float, Field(ge=0.0, le=NEAR)]
    warnings: list[str]


class TargetPart(DocumentModel):
    """The body of a target, see ``rewards.TargetBody``."""

    head_radius: Size
    torso_radius: Size
    neck_drop: Annotated[float, Field(ge=-NEAR, le=NEAR)]
    pelvis_drop: Annotated[float, Field(ge=-NEAR, le=NEAR)]


class StateValuesPart(DocumentModel):
    """What is no array of ``policy.StateValues``."""

    low: Number
    step: Number
    spread: Number


class BehaviourPart(DocumentModel):
    """A behaviour, see ``policy.Behaviour``."""

    name: Text
    axes: list[AxisPart] = Field(min_length=1, max_length=MOST_AXES)
    lookup: LOOKUPS
    entries: Annotated[int, Field(ge=1, le=1 << 40)]
    scale: Annotated[float, Field(ge=0.0, le=1e12)]
    rewards: list[AnyTerm] = Field(max_length=64)
    discount: Annotated[float, Field(gt=0.0, le=1.0)]
    stored_low: Number
    stored_step: Number
    state_values: StateValuesPart | None = None

    @model_validator(mode="after")
    def _grid(self) -> BehaviourPart:
        try:
            build_grid(Axis(**axis.model_dump()) for axis in self.axes)
        except RecipeError as error:
            raise Fault(str(error), "axes") from None
        if math.prod(axis.count for axis in self.axes) > _MOST_CELLS:
            raise Fault(f"have more than {_MOST_CELLS} cells", "axes")
        if 0.0 < self.scale < 1e-12:
            raise Fault(f"is {self.scale:g}, expected 0 or at least 1e-12", "scale")
        for index, term in enumerate(self.rewards):
            if any(not -NEAR <= number <= NEAR for number in _numbers(term)):
                raise Fault(f"holds numbers beyond {NEAR:g}", "rewards", index)
            if isinstance(term, ProximityTerm) and (term.distance is None or term.sigma < 1e-6):
                raise Fault("lacks its distance, or its sigma is too small", "rewards", index)
        return self


class RecipePart(OpenModel):
    """What is read of the recipe in a bundle."""

    precision: Literal["float32", "float16", "int16", "int8"]
    weights: dict[str, Annotated[float, Field(ge=0.0, le=NEAR)]] | None = None


class PolicyDocument(DocumentModel):
    """All that ``policy.json`` holds."""

    model_config = ConfigDict(title="policy.json")

    kind: str
    version: int
    checksum: str
    files: dict[Annotated[str, Field(pattern=r"^[a-z_]+\.npy$")], FileFacts]
    name: Text
    fingerprint: Hash
    fingerprints: dict[str, Hash]
    units: dict[str, str]
    recipe: RecipePart
    database: DatabasePart
    skeleton: SkeletonPart
    body: BodyPart
    graph: GraphPart
    target: TargetPart
    behaviours: list[BehaviourPart] = Field(min_length=1, max_length=_MOST_BEHAVIOURS)
    statistics: Statistics

    @model_validator(mode="after")
    def _together(self) -> PolicyDocument:
        joints = len(self.skeleton.names)
        for index, prop in enumerate(self.body.props):
            if prop.joint >= joints:
                raise Fault(f"is {prop.joint}, expected a joint below {joints}", "body", "props", index, "joint")
        for role, joint in self.body.roles.items():
            if joint >= joints:
                raise Fault(f"is {joint}, expected a joint from 0 to {joints - 1}", "body", "roles", role)
        names = [behaviour.name for behaviour in self.behaviours]
        if len(set(names)) < len(names):
            raise Fault("have names that are alike", "behaviours")
        if set(self.statistics.behaviours) != set(names):
            raise Fault("are not those of the policy", "statistics", "behaviours")
        return self


def _numbers(term: Any) -> list[float]:
    """Return the numbers of a reward term."""
    found: list[float] = []
    for value in term.model_dump().values():
        found += value if isinstance(value, tuple) else [value] if isinstance(value, int | float) else []
    return found
