"""Words and quantities that all parts of a scenario are made of, the arena, and the types of avatars."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, WithJsonSchema, model_validator

from crowdsim.config.files import Faults, Finding, StrictModel
from crowdsim.config.schema import join
from crowdsim.errors import nearest
from crowdsim.places.description import FARTHEST as FARTHEST
from crowdsim.places.description import Point as Point
from crowdsim.scenario.attachments import Attachment
from crowdsim.scenario.distributions import Distribution, QuantitySpread, Spread, limits
from crowdsim.scenario.fitness import Damage, Stamina
from crowdsim.scenario.looks import Hands, Sex
from crowdsim.scenario.names import NAME, NAME_RULE, is_name
from crowdsim.training.pursuit import MARGIN, MOST, TEMPERATURE

_COLOUR = r"#[0-9a-fA-F]{6}"

MAXIMUM_FRAMES = 100_000_000
MAXIMUM_SECONDS = 1_000_000
"""How long a run can be, in control frames or in seconds."""

SCALES = (0.5, 2.0)
SPEEDS = (0.25, 4.0)
TEMPOS = (1.0, 1000.0)
AGGRESSIONS = (0.25, 4.0)
RANGES = (-0.3, 1.0)
GIRTHS = (0.85, 1.25)
LENGTHS = (0.9, 1.1)
STANCES = ("orthodox", "southpaw")
"""Stances: the left foot leads, or the right one."""


def _name(text: str) -> str:
    if not is_name(text):
        raise ValueError(f"expected a name of {NAME_RULE}")
    return text


def _colour(text: str) -> str:
    if not re.fullmatch(_COLOUR, text):
        raise ValueError("expected a colour as '#rrggbb' in quotes, such as '#c8553d'")
    return text


def _policy(text: str, info: ValidationInfo) -> str:
    known: list[str] | None = (info.context or {}).get("policies")
    if known is not None and text not in known:
        choice = (
            f"expected {join(known)}{nearest(text, known)}" if known else "and there are no policies to choose from"
        )
        raise ValueError(f"no known policy, {choice}")
    return text


Name = Annotated[str, AfterValidator(_name), WithJsonSchema({"type": "string", "pattern": f"^{NAME}$"})]
PolicyName = Annotated[Name, AfterValidator(_policy)]
Colour = Annotated[str, AfterValidator(_colour), WithJsonSchema({"type": "string", "pattern": f"^{_COLOUR}$"})]
Metres = Annotated[float, Field(ge=-100_000, le=100_000)]
Weight = Annotated[float, Field(ge=0, le=1000)]
Weights = dict[Name, Weight]


_SOLID = (
    "Whether ropes along the border keep everyone inside, like an obstacle of kind `ropes`; else it can be crossed."
)


class NoArena(StrictModel):
    """Open ground without a border."""

    kind: Literal["none"] = Field(description="Open ground without a border.")


class CircleArena(StrictModel):
    """A round arena; avatars turn back at its border."""

    kind: Literal["circle"] = Field(description="A round arena; avatars turn back at its border.")
    radius: float = Field(gt=0, le=100_000, description="Radius [m].")
    centre: Point = Field(default=(0.0, 0.0), description="Centre, x and z [m].")
    solid: bool = Field(default=False, description=_SOLID)


class RectangleArena(StrictModel):
    """A rectangular arena; avatars turn back at its border."""

    kind: Literal["rectangle"] = Field(description="A rectangular arena; avatars turn back at its border.")
    size: tuple[Annotated[float, Field(gt=0, le=200_000)], Annotated[float, Field(gt=0, le=200_000)]] = Field(
        description="Width along x and depth along z [m]."
    )
    centre: Point = Field(default=(0.0, 0.0), description="Centre, x and z [m].")
    solid: bool = Field(default=False, description=_SOLID)


Arena = Annotated[NoArena | CircleArena | RectangleArena, Field(discriminator="kind")]


class Candidates(StrictModel):
    """Which actions an avatar draws among."""

    margin: float = Field(
        default=MARGIN,
        ge=0,
        le=100,
        description="How far below the best value a candidate may lie, in normalised values.",
    )
    maximum: int = Field(
        default=MOST, ge=1, le=64, description="How many candidates there are at most; 1 always takes the best."
    )


class StanceShare(StrictModel):
    """How many avatars of a type fight in which stance."""

    southpaw: float = Field(ge=0, le=1, description="Share of southpaws; all others are orthodox.")


class AvatarType(StrictModel):
    """What avatars of one type have in common."""

    extends: Name | None = Field(
        default=None, description="Another type of this scenario, whose settings this one inherits."
    )
    policy: PolicyName = Field(
        default="boxer", description="Name of the policy (its recipe's file name without .yaml)."
    )
    behaviours: Weights = Field(
        default_factory=dict,
        description="Weight of each behaviour of the policy; 0 for those that are not named. Where none is named, the "
        "weights of the policy's recipe.",
    )
    candidates: Candidates = Field(default_factory=Candidates, description="Which actions an avatar draws among.")
    temperature: float = Field(
        default=TEMPERATURE,
        ge=0,
        le=100,
        description="Randomness of the draw, in normalised values; 0 always takes the best action.",
    )
    reaction: float = Field(
        default=0.2,
        ge=0,
        le=2,
        description="Time that it takes an avatar that defends itself to see what an opponent has decided [s].",
    )
    tempo: Annotated[float, Field(ge=TEMPOS[0], le=TEMPOS[1])] | QuantitySpread | None = Field(
        default=60.0,
        description="Strikes per minute that an avatar can sustain: it strikes in bursts and rests between them. A "
        f"number from {TEMPOS[0]:g} to {TEMPOS[1]:g}, or a distribution within these limits; null: it never tires.",
    )
    aggression: Annotated[float, Field(ge=AGGRESSIONS[0], le=AGGRESSIONS[1])] | Spread = Field(
        default=1.0,
        description="How readily an avatar strikes while it does not rest, as a factor from "
        f"{AGGRESSIONS[0]:g} to {AGGRESSIONS[1]:g}: a number, or a distribution within these limits. Below 1 it also "
        "keeps further away while it rests, above 1 it presses closer.",
    )
    range: Annotated[float, Field(ge=RANGES[0], le=RANGES[1])] | QuantitySpread = Field(
        default=0.0,
        description="How much further than others an avatar keeps from its opponent while it rests between bursts [m], "
        f"from {RANGES[0]:g} to {RANGES[1]:g}: a number, or a distribution within these limits. It needs a tempo.",
    )
    stance: Literal["orthodox", "southpaw"] | StanceShare | None = Field(
        default=None,
        description="Which foot leads: `orthodox` (the left one), `southpaw` (the right one), or a mapping with the "
        "share of `southpaw`; null: whichever its motion leads to. Its policy needs motion of that stance, such as "
        "`mirror: true` in its recipe gives.",
    )
    damage: Damage | None = Field(
        default=None, description="What strikes take from an avatar, and when it goes down; null: nothing hurts it."
    )
    stamina: Stamina | None = Field(default=None, description="What tires an avatar; null: nothing does.")
    variety: float = Field(
        default=1.0,
        ge=0,
        le=100,
        description="How much an avatar avoids motion that it or others around have shown lately, and strikes that its "
        "opponent throws at the same time; 0 not at all. More costs hits, above all with little captured motion.",
    )
    scale: Annotated[float, Field(ge=SCALES[0], le=SCALES[1])] | Spread = Field(
        default=1.0,
        description=f"Size of the body, as a factor from {SCALES[0]:g} to {SCALES[1]:g}: a number, or a distribution "
        "within these limits.",
    )
    girth: Annotated[float, Field(ge=GIRTHS[0], le=GIRTHS[1])] | Spread = Field(
        default=1.0,
        description=f"Thickness of trunk and limbs for their length, as a factor from {GIRTHS[0]:g} to {GIRTHS[1]:g}: "
        "a number, or a distribution within these limits. Head, hands and feet keep their size.",
    )
    legs: Annotated[float, Field(ge=LENGTHS[0], le=LENGTHS[1])] | Spread = Field(
        default=1.0,
        description=f"Length of thighs and shanks for the size of the body, as a factor from {LENGTHS[0]:g} to "
        f"{LENGTHS[1]:g}: a number, or a distribution within these limits. It shows, and changes no decision.",
    )
    arms: Annotated[float, Field(ge=LENGTHS[0], le=LENGTHS[1])] | Spread = Field(
        default=1.0,
        description=f"Length of upper arms and forearms for the size of the body, as a factor from {LENGTHS[0]:g} to "
        f"{LENGTHS[1]:g}: a number, or a distribution within these limits. It shows, and changes no decision.",
    )
    speed: Annotated[float, Field(ge=SPEEDS[0], le=SPEEDS[1])] | Spread = Field(
        default=1.0,
        description=f"Speed of the motion, as a factor from {SPEEDS[0]:g} to {SPEEDS[1]:g}: a number, or a "
        "distribution within these limits.",
    )
    sex: Sex = Field(
        default="male", description="Sex of the body that pictures, the player, clouds and glTF files show."
    )
    hands: Hands = Field(default="gloves", description="What its hands are like there: `gloves`, or `bare` fists.")
    colour: Colour | None = Field(
        default=None, description="Colour in pictures as '#rrggbb'; without it the team's colour."
    )
    attachments: tuple[Attachment, ...] | None = Field(
        default=None,
        max_length=50,
        description="What avatars hold or wear, which pictures and clouds show. Null: the sticks that their policy "
        "strikes with, if any; an empty list: nothing.",
    )

    @model_validator(mode="after")
    def _check(self) -> AvatarType:
        given: list[tuple[str, Distribution | None, tuple[float, float], str]] = [
            ("tempo", self.tempo, TEMPOS, "strikes per minute"),
            ("aggression", self.aggression, AGGRESSIONS, "factors"),
            ("range", self.range, RANGES, "distances [m]"),
            ("scale", self.scale, SCALES, "factors"),
            ("girth", self.girth, GIRTHS, "factors"),
            ("legs", self.legs, LENGTHS, "factors"),
            ("arms", self.arms, LENGTHS, "factors"),
            ("speed", self.speed, SPEEDS, "factors"),
        ]
        findings = []
        for key, value, (least, most), what in given:
            if value is None:
                continue
            low, high = limits(value)
            if low < least or high > most:
                reach = f"{low:g}" if low == high else f"{low:g} to {high:g}"
                findings.append(Finding((key,), f"is {reach}, expected {what} from {least:g} to {most:g}"))
        if findings:
            raise Faults(findings)
        return self
