"""Settings of the motion graph in a recipe, with all their defaults."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from crowdsim.config.files import StrictModel

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class JointWeights(StrictModel):
    """How much each kind of joint counts when two frames are compared; left and right count alike.

    Only proportions matter. Fingers, eyes and joints without a role count nothing.
    """

    pelvis: float = Field(
        default=1.0, ge=0, description="Weight of the pelvis, which carries the root's height and velocity."
    )
    spine: float = Field(default=0.0, ge=0, description="Weight of the spine.")
    chest: float = Field(default=0.5, ge=0, description="Weight of the chest.")
    neck: float = Field(default=0.0, ge=0, description="Weight of the neck.")
    head: float = Field(default=1.0, ge=0, description="Weight of the head.")
    shoulder: float = Field(default=0.5, ge=0, description="Weight of each shoulder.")
    elbow: float = Field(default=0.5, ge=0, description="Weight of each elbow.")
    hand: float = Field(default=1.0, ge=0, description="Weight of each hand.")
    hip: float = Field(default=0.5, ge=0, description="Weight of each hip.")
    knee: float = Field(default=0.5, ge=0, description="Weight of each knee.")
    foot: float = Field(default=1.0, ge=0, description="Weight of each foot.")
    toe: float = Field(default=0.0, ge=0, description="Weight of each toe, where the skeleton has them.")

    def of_role(self, role: str) -> float:
        """Return the weight of a role of ``body.ROLES``, such as 'left_hand'."""
        return float(getattr(self, role.removeprefix("left_").removeprefix("right_")))

    @model_validator(mode="after")
    def _some_weight(self) -> JointWeights:
        if not any(getattr(self, name) for name in type(self).model_fields):
            raise ValueError("every weight is 0, expected at least one joint that counts")
        return self


class GraphSettings(StrictModel):
    """The ``graph`` section of a recipe: which frame may follow which.

    Costs are in metres: the root of the weighted mean of squared joint distances in the ground frame, on a body of
    1.75 m, to which velocities add by ``velocity_weight``.
    """

    threshold: float | None = Field(
        default=0.25,
        gt=0,
        allow_inf_nan=False,
        description="Highest cost of a transition [m]; null when it is chosen for a number of actions.",
    )
    actions: int | None = Field(
        default=None, ge=2, description="Number of actions for which the threshold is chosen; replaces threshold."
    )
    branching: int = Field(
        default=12, ge=1, le=1000, description="Most transitions out of a frame; the cheapest are kept."
    )
    spacing: NotNegative = Field(
        default=0.2, description="Least time between decisions of a clip [s]; 0 allows transitions after every frame."
    )
    velocity_weight: NotNegative = Field(
        default=0.10, description="Metres that a difference in velocity of 1 m/s counts as [s]."
    )
    near: NotNegative = Field(
        default=0.3, description="Frames of one clip that lie closer in time than this are no transitions [s]."
    )
    windup: NotNegative = Field(
        default=0.0,
        le=2.0,
        description="Least time from a decision to a strike: avatars are committed to a strike for so long, and others "
        "can see it coming [s]; 0: strikes begin at any time.",
    )
    joint_weights: JointWeights = Field(
        default_factory=JointWeights, description="How much each kind of joint counts when frames are compared."
    )

    @model_validator(mode="before")
    @classmethod
    def _one_of_threshold_and_actions(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        threshold, actions = values.get("threshold"), values.get("actions")
        if threshold is not None and actions is not None:
            raise ValueError("threshold and actions are both given, expected one of the two")
        if "threshold" in values and threshold is None and actions is None:
            raise ValueError("threshold is null and actions is not given, expected one of the two")
        return {**values, "threshold": None} if actions is not None else values
