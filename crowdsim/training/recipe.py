"""Training recipes: YAML files on motion, graph and behaviours, with all defaults of training, and their reference."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, create_model, model_validator

from crowdsim.config.files import Fault, StrictModel, load_model
from crowdsim.config.reference import reference_page
from crowdsim.core.types import FileName
from crowdsim.errors import RecipeError, nearest
from crowdsim.graph.settings import GraphSettings
from crowdsim.motion.settings import StrikeSettings
from crowdsim.policy.axes.axis import AxisKind
from crowdsim.policy.axes.registry import AXES, NAMES, kind_named
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.policy.environment import MOST_AXES
from crowdsim.policy.rewards import AnyTerm, HitTerm, ProximityTerm, StrikeTerm, term_name
from crowdsim.training.motion_source import MAXIMUM_SEED, Motion

MEASURED = ("distance", "bearing", "height")
"""Axes on which the region lies that strikes reach (``ranges.Reach``)."""
_MOST_CELLS = 1_000_000

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]


class AxisSpec(StrictModel):
    """One axis of a behaviour's grid; ranges that are left out come from the data."""

    count: int = Field(ge=1, le=1000, description="Number of grid points.")
    minimum: float | None = Field(
        default=None,
        ge=-1000.0,
        le=1000.0,
        description="First grid point; null: 0 for a distance or an impact, the full circle for a bearing or a "
        "heading, the lowest heads of the motion for a height, and for a velocity the motion's pace towards the "
        "avatar.",
    )
    maximum: float | None = Field(
        default=None,
        ge=-1000.0,
        le=1000.0,
        description="Last grid point; null: a step past what strikes reach for a distance, the full circle for a "
        "bearing or a heading, the highest heads of the motion for a height, its pace away from the avatar for a "
        "velocity, 0.8 s for an impact.",
    )
    fade: float = Field(
        default=0.0, ge=0.0, le=1000.0, description="How far beyond the range the behaviour stops counting; 0: never."
    )
    reach: bool = Field(
        default=False,
        description="Whether ends that are left out are those of the region that strikes reach, from the 5th to the "
        "95th percentile of the motion's strikes.",
    )
    stretch: float | None = Field(
        default=None,
        gt=0.0,
        le=1000.0,
        description="Where steps between grid points are four times as long as at 0, so that a grid is fine near and "
        "coarse far, of a distance, height or impact; null: all are equal.",
    )

    @model_validator(mode="after")
    def _upwards(self) -> AxisSpec:
        if self.minimum is not None and self.maximum is not None and not self.minimum < self.maximum:
            raise Fault(f"is {self.maximum:g}, expected more than the minimum {self.minimum:g}", "maximum")
        return self


class _Axes(StrictModel):
    """The axes of a behaviour's grid."""

    def given(self) -> dict[str, AxisSpec]:
        """Return the axes that there are, in the order of ``AXES``."""
        return {name: axis for name in NAMES if (axis := getattr(self, name)) is not None}


def _axis_field(kind: AxisKind) -> tuple[Any, Any]:
    """Return type and description of the key of an axis; a grid must have the first one."""
    if kind is AXES[0]:
        return AxisSpec, Field(description=kind.description)
    return AxisSpec | None, Field(default=None, description=kind.description)


if TYPE_CHECKING:
    Axes = _Axes
else:
    Axes = create_model("Axes", __base__=_Axes, __doc__=_Axes.__doc__, **{one.name: _axis_field(one) for one in AXES})


class TargetMovement(StrictModel):
    """How the target moves in training, drawn for every action."""

    speed: float = Field(default=0.0, ge=0.0, le=10.0, description="Its speed when it moves [m/s]; 0: it never moves.")
    directions: int = Field(default=4, ge=1, le=64, description="Directions in which it may move.")
    still: float = Field(default=0.5, ge=0.0, le=1.0, description="Probability that it does not move.")


class ValueIterationSpec(StrictModel):
    """Solve by value iteration."""

    kind: Literal["value_iteration"] = "value_iteration"
    tolerance: float = Field(
        default=1e-3, gt=0.0, description="Greatest change of a value at the end, over the spread of values."
    )
    max_sweeps: int = Field(default=2000, ge=1, le=1_000_000, description="Most sweeps.")


class QLearningSpec(StrictModel):
    """Solve by Q-learning, the paper's trial and error."""

    kind: Literal["q_learning"]
    tolerance: float = Field(default=1e-2, gt=0.0, description="Mean error of a trial at the end, over the mean value.")
    max_sweeps: int = Field(default=30, ge=1, le=1_000_000, description="Most rounds of exploration.")
    omega: float = Field(default=0.75, gt=0.5, le=1.0, description="How fast step sizes fall with visits.")
    settle: float = Field(default=60.0, gt=0.0, le=1e6, description="Visits before they fall.")
    exploitations: int = Field(
        default=8, ge=0, le=1000, description="Rounds of exploitation after each of exploration."
    )
    tries: int = Field(default=4, ge=1, le=1000, description="Trials of an entry in each, where the target moves.")
    seed: int = Field(default=0, ge=0, le=MAXIMUM_SEED, description="Seed of the draws.")


class BehaviourSpec(StrictModel):
    """A behaviour: what an avatar learns to do to its target."""

    axes: Axes = Field(description="The grid on which it sees the target.")
    rewards: list[AnyTerm] = Field(min_length=1, max_length=100, description="The terms of its reward, which add up.")
    discount: float = Field(default=0.97, gt=0.0, lt=1.0, description="Factor of rewards per control frame.")
    beyond: float = Field(
        default=0.75,
        ge=0.0,
        le=1000.0,
        description="A step: how far a distance from the data reaches past strikes [m].",
    )
    lookup: Literal["q", "v"] = Field(
        default="v", description="Table of Q(action, cell), or of V(state, cell) with a step of look-ahead."
    )
    backup: Literal["interpolation_of_max", "max_of_interpolated"] = Field(
        default="interpolation_of_max", description="What is interpolated in training: V, or as in the paper Q."
    )
    solver: Annotated[ValueIterationSpec | QLearningSpec, Field(discriminator="kind")] = Field(
        default_factory=ValueIterationSpec, description="How it is solved."
    )
    finer: int = Field(
        default=1,
        ge=1,
        le=4,
        description="The table is fitted to values on a grid this many times finer over the ground; 1: to none.",
    )
    target: TargetMovement = Field(default_factory=TargetMovement, description="How the target moves in training.")
    normalise: bool = Field(
        default=True,
        description="Whether values are divided by how much the actions of a state differ in them, before behaviours "
        "are added up; false: they are added as they are.",
    )

    @property
    def strikes(self) -> bool:
        """Whether a strike is rewarded."""
        return any(isinstance(term, StrikeTerm) for term in self.rewards)

    @property
    def measured_by_strikes(self) -> list[str]:
        """What is left out of it in words, and so comes from the region that strikes reach."""
        missing = []
        for name, kind in {"proximity": ProximityTerm, "hit": HitTerm}.items():
            if any(isinstance(term, kind) and term.distance is None for term in self.rewards):
                missing.append(f"a distance in its {name} rewards")
        for name, axis in self.axes.given().items():
            if axis.reach or (name == "distance" and axis.maximum is None):
                missing.append(f"a minimum and a maximum of its {name} axis")
        return missing

    @model_validator(mode="after")
    def _learns_what_it_says(self) -> BehaviourSpec:
        given = self.axes.given()
        cells = math.prod(axis.count for axis in given.values())
        if cells > _MOST_CELLS:
            raise Fault(f"make a grid of {cells:,} cells, expected at most {_MOST_CELLS:,}", "axes")
        if len(given) > MOST_AXES:
            raise Fault(f"are {len(given)}, {', '.join(given)}, expected {MOST_AXES} at most", "axes")
        for name, axis in given.items():
            kind = kind_named(name)
            if kind.after is not None and not kind.period and axis.count < 2:
                raise Fault(f"is {axis.count}, expected 2 or more, since one {name} is no range", "axes", name, "count")
            if kind.period and axis.stretch is not None:
                raise Fault(f"is stretched, expected even steps of a {name}", "axes", name, "stretch")
            if axis.reach and name not in MEASURED:
                raise Fault(f"is true, but strikes reach no {name}, expected false", "axes", name, "reach")
            if kind.after is not None and self.backup != "interpolation_of_max":
                what = f"changes with each action, which needs the backup interpolation_of_max, not {self.backup}"
                raise Fault(what, "axes", name)
            for end in ("minimum", "maximum"):
                value, (least, greatest) = getattr(axis, end), kind.bounds
                if value is not None and not least <= value <= greatest:
                    what = f"is {value:g}, expected values from {least:g} to {greatest:g} {kind.unit}"
                    raise Fault(what, "axes", name, end)
            if name == "impact" and not axis.fade and not any(name in term.axes for term in self.rewards):
                raise Fault("changes nothing, expected a reward 'hit' or a fade", "axes", name)
            if kind.time < 0 and axis.stretch is not None:
                raise Fault(f"is stretched, expected even steps of a {name}", "axes", name, "stretch")
        for index, term in enumerate(self.rewards):
            for name in term.axes:
                if name not in given:
                    what = f"({term_name(term)}) needs the axis {name}, the grid has {', '.join(given)}"
                    raise Fault(what, "rewards", index)
        if isinstance(self.solver, QLearningSpec) and self.backup != "max_of_interpolated":
            raise Fault("is interpolation_of_max, expected max_of_interpolated with q_learning", "backup")
        if self.finer > 1 and self.backup == "max_of_interpolated":
            raise Fault(f"is {self.finer}, expected 1 with the backup max_of_interpolated", "finer")
        return self


class PruningSpec(StrictModel):
    """Which transitions of a wide graph are kept: those that are worth most to the behaviours (``pruning.py``)."""

    renamed: ClassVar[dict[str, str]] = {"ways": "transitions"}

    transitions: int = Field(default=8, ge=1, le=1000, description="Most transitions out of a frame.")
    spacing: float = Field(
        default=0.33, ge=0.0, le=1000.0, description="Least time between decisions of a clip [s]; 0 keeps them all."
    )
    landing: float = Field(
        default=0.25,
        ge=0.0,
        le=1000.0,
        description="Least time from a transition to the next decision, and so to the next transition [s].",
    )


class DefenceSpec(StrictModel):
    """How the behaviour ``defend`` is learned: in fights of pairs of avatars with the recipe's other behaviours."""

    rounds: int = Field(
        default=4, ge=1, le=100, description="Rounds of fights; in all but the first, one of each pair defends itself."
    )
    pairs: int = Field(default=192, ge=1, le=200, description="Pairs that fight at a time.")
    seconds: float = Field(default=900.0, ge=10.0, le=100_000.0, description="How long each round lasts [s].")
    temperature: float = Field(
        default=0.5, ge=0.0, le=100.0, description="Randomness of the draw of those that learn, see the type's key."
    )
    counter: float = Field(
        default=0.1, ge=0.0, le=10.0, description="What a hit is worth that an avatar lands, over one that it takes."
    )
    seed: int = Field(default=0, ge=0, le=MAXIMUM_SEED, description="Seed of the fights.")


class RestSpec(StrictModel):
    """How avatars rest that need not fight: they stand at ease, by what the motion holds of that."""

    seconds: float = Field(
        default=1.0, ge=0.2, le=10.0, description="About how long avatars at ease go on before they decide anew [s]."
    )


class Recipe(StrictModel):
    """A training recipe."""

    version: Literal[1] = Field(description="Version of the recipe format.")
    description: str = Field(default="", description="What it is for.")
    motion: Motion = Field(description="Where motion comes from.")
    strikes: StrikeSettings = Field(default_factory=StrikeSettings, description="What counts as a strike.")
    control_rate: float = Field(
        default=15.0, ge=1.0, le=120.0, description="Decisions can fall on this many frames a second."
    )
    playback_rate: float = Field(
        default=60.0, ge=1.0, le=480.0, description="Poses are kept at this rate, a multiple of it."
    )
    graph: GraphSettings = Field(default_factory=GraphSettings, description="Which frame may follow which.")
    prune: PruningSpec | None = Field(
        default=None, description="Which transitions of the graph are kept, by their value; null: all."
    )
    behaviours: dict[Name, BehaviourSpec] = Field(min_length=1, max_length=100, description="What is learned, by name.")
    defend: DefenceSpec | None = Field(
        default=None, description="How avatars learn to defend themselves; null: they do not."
    )
    rest: RestSpec | None = Field(
        default=None,
        description="How avatars stand at ease; null: they do not, and motion with hanging hands is fought with.",
    )
    weights: dict[Name, Annotated[float, Field(ge=0.0, le=1000.0)]] | None = Field(
        default=None,
        description="Weights of the behaviours that avatars use where their scenario names none; null: 1 each.",
    )
    precision: Literal["float32", "float16", "int16", "int8"] = Field(
        default="float32", description="How values are stored."
    )

    @model_validator(mode="after")
    def _weighs_what_is_learned(self) -> Recipe:
        learned = [*self.behaviours, *([DEFEND] if self.defend is not None else [])]
        if DEFEND in self.behaviours:
            raise Fault("is learned in fights, expected the section 'defend' of the recipe", "behaviours", DEFEND)
        for name in self.weights or {}:
            if name not in learned:
                raise Fault(f"is no behaviour of the recipe{nearest(name, learned)}", "weights", name)
        return self

    @model_validator(mode="after")
    def _holds_props_in_one_hand(self) -> Recipe:
        if self.strikes.props and self.motion.mirror:
            raise Fault("is true, but strikes.props lie in one hand, expected false", "motion", "mirror")
        performer = self.motion.performer
        if performer is not None and performer.stick is not None:
            from crowdsim.performer.sticks import stick_point

            side = int(performer.stance == "orthodox")
            hand, point = ("left", "right")[side], ", ".join(f"{value:.2g}" for value in stick_point(side))
            if [prop.hand for prop in self.strikes.props] != [hand]:
                what = f"is {performer.stick}, but strikes.props do not say where that is; "
                what += f"expected there one prop, {{hand: {hand}, point: [{point}]}}"
                raise Fault(what, "motion", "performer", "stick")
        return self

    @model_validator(mode="after")
    def _whole_multiple(self) -> Recipe:
        stride = self.playback_rate / self.control_rate
        if stride < 1.0 or not math.isclose(stride, round(stride)):
            raise Fault(
                f"is {self.playback_rate:g}, expected a whole multiple of the control rate {self.control_rate:g}",
                "playback_rate",
            )
        return self


def load_recipe(path: FileName) -> Recipe:
    """Return the recipe of a YAML file; its folder of capture is seen from the file's, and so is right from anywhere.

    Raises:
        RecipeError: With a line for everything that is wrong, its line and column, and what was expected.
    """
    recipe = load_model(path, Recipe, RecipeError)
    capture = recipe.motion.capture
    if capture is None or capture.folder is None:
        return recipe
    found = capture.model_copy(update={"folder": os.path.normpath(Path(path).parent / capture.folder)})
    return recipe.model_copy(update={"motion": recipe.motion.model_copy(update={"capture": found})})


def plain(recipe: Recipe) -> dict[str, Any]:
    """Return a recipe as plain data, defaults included; without the folder of its capture, which may be anywhere."""
    document = recipe.model_dump(mode="json")
    if document["motion"]["capture"] is not None:
        document["motion"]["capture"]["folder"] = None
    return document


_HEAD = """# Recipe files

Every key of a training recipe, from the schema that checks it. Lengths are metres, times seconds, angles radians. A key
without a default must be given. `crowdsim validate FILE` names everything that is wrong with a recipe, and
`crowdsim train FILE` trains it. The shipped recipes are examples: `boxer.yaml` of the embedded boxer, `boxer_cmu.yaml`
of capture, `boxer_defender.yaml` of a boxer that learns in fights to defend itself, `boxer_paper.yaml` of the paper's
method, `stick_fighter.yaml` of a performer with a stick. A file has at most 1 MiB of UTF-8, 100,000 values and 64
levels; names of clips cannot lead out of the folder of capture.

<!-- Written from the schema by crowdsim.training.recipe; do not edit. -->
"""

_AXES = """
## What axes observe

A grid has a distance and up to four other axes. Control looks an axis up by what it observes in the fight. In training
nobody else acts, so each axis has a model of how the target develops while an action of the avatar runs: Q of an action
is its reward plus the value of what the axes measure at its end, and rewards see the target as it moves meanwhile. With
a `velocity` values are those of moving targets; without one control reads them for where a moving target will be some
time later. An `impact` changes what is learned with the reward `hit`, and when a behaviour counts with a `fade`.

| axis | control observes | in training |
|---|---|---|
"""


def recipe_schema() -> str:
    """Return the JSON Schema of recipe files as text; editors complete and check recipes by it."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Recipe.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def recipe_reference() -> str:
    """Return docs/recipes.md: every key of a recipe with its type, its default and its meaning, and what axes see."""
    rows = "".join(f"| `{kind.name}` | {kind.observed} | {kind.trained} |\n" for kind in AXES)
    return reference_page(json.loads(recipe_schema()), _HEAD) + _AXES + rows
