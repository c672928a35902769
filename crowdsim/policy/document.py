"""What ``policy.json`` must hold, so that nothing that is read from one is of another kind or out of range."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from crowdsim.config.documents import DocumentModel, OpenModel
from crowdsim.config.files import Fault
from crowdsim.errors import RecipeError
from crowdsim.motion.body import ROLES
from crowdsim.policy.checks import NEAR
from crowdsim.policy.document_parts import LOOKUPS, AxisPart, Count, Hash, Number, Rate, Size, Text
from crowdsim.policy.environment import MOST_AXES, Axis, build_grid
from crowdsim.policy.reported import Statistics
from crowdsim.policy.rewards import AnyTerm, ProximityTerm

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
