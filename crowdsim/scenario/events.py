"""Events of a scenario: what happens once, at a time or on a condition."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from crowdsim.config.files import Fault, StrictModel
from crowdsim.scenario.groups import Gait, Opponents, Until, check_path
from crowdsim.scenario.parts import MAXIMUM_FRAMES, MAXIMUM_SECONDS, TEMPOS, Name, Point, Weights


class FrameCondition(StrictModel):
    """At a control frame."""

    kind: Literal["frame"] = Field(description="At a control frame.")
    frame: int = Field(ge=0, le=MAXIMUM_FRAMES, description="Control frame, from 0.")


class SecondsCondition(StrictModel):
    """At a time."""

    kind: Literal["seconds"] = Field(description="At a time.")
    seconds: float = Field(ge=0, le=MAXIMUM_SECONDS, description="Time from the start of the run [s].")


class StrikesCondition(StrictModel):
    """When a number of strikes have landed."""

    kind: Literal["strikes"] = Field(description="As soon as this number of strikes have landed.")
    count: int = Field(ge=1, le=1_000_000_000, description="Number of strikes landed.")
    team: Name | None = Field(
        default=None, description="Team that must have landed them; without it all teams together."
    )


class DistanceCondition(StrictModel):
    """When two groups come near each other."""

    kind: Literal["distance"] = Field(description="As soon as avatars of two groups are this near to each other.")
    group: Name = Field(description="One group.")
    to: Name = Field(description="The other group.")
    below: float = Field(gt=0, le=100_000, description="Distance [m].")


class LandedOnCondition(StrictModel):
    """When strikes have landed on a group."""

    kind: Literal["landed_on"] = Field(description="As soon as this number of strikes have landed on a group.")
    group: Name = Field(description="The group.")
    count: int = Field(ge=1, le=1_000_000_000, description="Number of strikes.")


class DownCondition(StrictModel):
    """When avatars have been knocked down."""

    kind: Literal["down"] = Field(description="As soon as avatars have been knocked down this number of times.")
    group: Name | None = Field(default=None, description="Group that they are of; without it all groups together.")
    count: int = Field(default=1, ge=1, le=1_000_000_000, description="Number of knock-downs.")


class HealthCondition(StrictModel):
    """When an avatar's health has fallen."""

    kind: Literal["health_below"] = Field(description="As soon as the health of an avatar of a group is below this.")
    group: Name = Field(description="The group.")
    points: float = Field(gt=0, le=1_000_000, description="Health [points].")


class EndedCondition(StrictModel):
    """When the end of the run has come."""

    kind: Literal["ended"] = Field(
        description="As soon as the scenario's `until` is met; the run goes on for as long as its `linger` says."
    )


Condition = Annotated[
    FrameCondition
    | SecondsCondition
    | StrikesCondition
    | DistanceCondition
    | LandedOnCondition
    | DownCondition
    | HealthCondition
    | EndedCondition,
    Field(discriminator="kind"),
]


Member = Annotated[
    int | None,
    Field(ge=0, description="Number of the one avatar in that group that it concerns, from 0; without it all of them."),
]


class WeightsEvent(StrictModel):
    """Other weights for behaviours."""

    kind: Literal["weights"] = Field(
        description="Gives behaviours of a group other weights, or it another temperature, tempo or time to react."
    )
    when: Condition = Field(description="When it happens.")
    group: Name | None = Field(default=None, description="Group that it concerns; without it everyone.")
    type: Name | None = Field(default=None, description="Type of avatars that it concerns; without it all types.")
    behaviours: Weights = Field(default_factory=dict, description="New weights; those not named stay as they are.")
    temperature: float | None = Field(default=None, ge=0, le=100, description="New temperature.")
    tempo: float | None = Field(
        default=None,
        ge=TEMPOS[0],
        le=TEMPOS[1],
        description="New tempo [strikes per minute]; where tempos of a type vary, its avatars keep their differences.",
    )
    reaction: float | None = Field(
        default=None, ge=0, le=2, description="New time to see what an opponent has decided [s]."
    )

    @model_validator(mode="after")
    def _check(self) -> WeightsEvent:
        if not self.behaviours and self.temperature is None and self.tempo is None and self.reaction is None:
            raise Fault("changes nothing, expected 'behaviours', 'temperature', 'tempo' or 'reaction'")
        return self


class RetargetEvent(StrictModel):
    """Other opponents."""

    kind: Literal["retarget"] = Field(description="Gives a group other opponents.")
    when: Condition = Field(description="When it happens.")
    group: Name | None = Field(default=None, description="Group that it concerns; without it everyone.")
    member: Member = None
    opponents: Opponents = Field(description="Their opponents from then on.")


class AddEvent(StrictModel):
    """A waiting group enters."""

    kind: Literal["add"] = Field(
        description="Lets a group with `waits: true`, or one that has left, enter at its placement or along its path; "
        "avatars that are placed where others are enter up to 1 m beside it, or wait for room."
    )
    when: Condition = Field(description="When it happens.")
    group: Name = Field(description="Group that enters.")
    member: Member = None


class RemoveEvent(StrictModel):
    """A group leaves."""

    kind: Literal["remove"] = Field(description="Takes a group out of the scene.")
    when: Condition = Field(description="When it happens.")
    group: Name = Field(description="Group that leaves.")
    member: Member = None


class LeaveEvent(StrictModel):
    """A group goes away along a path."""

    kind: Literal["leave"] = Field(
        description="Lets avatars go away along a path, at whose end they leave the scene; those that are down, as "
        "soon as they are up. An event of kind `add` brings them back."
    )
    when: Condition = Field(description="When it happens.")
    group: Name | None = Field(default=None, description="Group that it concerns; without it everyone.")
    path: tuple[Point, ...] = Field(description="Points that they go to in turn, x and z each [m].")
    gait: Gait = "walk"
    until: Until = Field(
        default="end",
        description="`attacked`: an avatar at which another one strikes fights again; `end`: none does.",
    )
    health_below: float | None = Field(
        default=None,
        gt=0,
        le=1_000_000,
        description="From then on avatars leave whose health is below this [points], each as soon as it is; without it "
        "all of them leave at once.",
    )

    @model_validator(mode="after")
    def _check(self) -> LeaveEvent:
        check_path(self.path, 1)
        if self.until == "attacked" and self.health_below is not None:
            what = "is 'attacked', but avatars whose health is low leave again at once, expected no 'health_below'"
            raise Fault(f"{what}, or 'end'", "until")
        return self


class FleeEvent(StrictModel):
    """A group runs away."""

    kind: Literal["flee"] = Field(description="Lets avatars run away from their opponents.")
    when: Condition = Field(description="When it happens.")
    group: Name | None = Field(default=None, description="Group that it concerns; without it everyone.")


class WatchEvent(StrictModel):
    """A group keeps its distance."""

    kind: Literal["watch"] = Field(
        description="Lets avatars keep a distance from their opponents, face them, and wait."
    )
    when: Condition = Field(description="When it happens.")
    group: Name | None = Field(default=None, description="Group that it concerns; without it everyone.")
    distance: float = Field(default=2.5, ge=1, le=20, description="The distance [m].")


class RestEvent(StrictModel):
    """A group stands at ease."""

    kind: Literal["rest"] = Field(
        description="Lets avatars come to a distance from their opponents, drop their guard, and stand at ease."
    )
    when: Condition = Field(description="When it happens.")
    group: Name | None = Field(default=None, description="Group that it concerns; without it everyone.")
    distance: float = Field(default=2.5, ge=1, le=20, description="The distance [m].")


class FightEvent(StrictModel):
    """A group fights again."""

    kind: Literal["fight"] = Field(description="Lets avatars fight again that flee, watch or rest.")
    when: Condition = Field(description="When it happens.")
    group: Name | None = Field(default=None, description="Group that it concerns; without it everyone.")


class PlaceEvent(StrictModel):
    """An avatar is put somewhere else."""

    kind: Literal["place"] = Field(
        description="Takes an avatar out of the scene and puts it at a point in the next control frame, with the "
        "heading, health, stamina and journey that it had; up to 1 m beside the point where others or obstacles are, "
        "or as soon as there is room. One that is down, or not there, stays as it is."
    )
    when: Condition = Field(description="When it happens.")
    group: Name = Field(description="Group of the avatar.")
    member: int = Field(default=0, ge=0, description="Number of the avatar in that group, from 0.")
    point: Point = Field(description="Where it is put, x and z [m].")


Moment = Annotated[FrameCondition | SecondsCondition, Field(discriminator="kind")]


class HealEvent(StrictModel):
    """Health is restored."""

    kind: Literal["heal"] = Field(
        description="Gives avatars that are there full health and stamina, and lets those get up that are down for "
        "good; their knock-downs count anew."
    )
    when: Moment = Field(description="When it happens.")
    group: Name | None = Field(default=None, description="Group that it concerns; without it everyone.")
    member: Member = None


Event = Annotated[
    WeightsEvent
    | RetargetEvent
    | AddEvent
    | RemoveEvent
    | LeaveEvent
    | FleeEvent
    | WatchEvent
    | RestEvent
    | FightEvent
    | PlaceEvent
    | HealEvent,
    Field(discriminator="kind"),
]
