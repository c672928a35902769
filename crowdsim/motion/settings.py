"""Settings of a recipe that say what is found in motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from crowdsim.config.files import Fault, StrictModel
from crowdsim.motion.strikers import GROUPS, LIMBS

_Metres = Annotated[float, Field(ge=-3.0, le=3.0)]


class StrikingProp(StrictModel):
    """What a hand holds that strikes: a stick or a bat."""

    hand: Literal["left", "right"] = Field(description="The hand that it lies in.")
    point: tuple[_Metres, _Metres, _Metres] = Field(
        description="Which point of it strikes, in the frame of the hand's joint: x, y, z [m]."
    )
    radius: float = Field(default=0.02, gt=0.0, le=0.5, description="Its radius there [m].")


class StrikeSettings(StrictModel):
    """The ``strikes`` section of a recipe: what counts as a strike."""

    limbs: list[
        Literal[
            "hands", "feet", "elbows", "knees", "props", "head",
            "left_hand", "right_hand", "left_foot", "right_foot", "left_elbow", "right_elbow", "left_knee",
            "right_knee", "left_prop", "right_prop",
        ]
    ] = Field(
        default=["hands"],
        min_length=1,
        description="What strikes: limbs whose strikes are found in the motion, rewarded, and land; those of feet are "
        "kicks, and `props` are what hands hold. Mirror images have those of the other side.",
    )  # fmt: skip
    props: list[StrikingProp] = Field(
        default_factory=list,
        max_length=2,
        description="What hands hold that strikes, one for each hand at the most; not where motion is mirrored, since "
        "an avatar does not change hands.",
    )

    @model_validator(mode="after")
    def _holds_what_strikes(self) -> StrikeSettings:
        held = [prop.hand for prop in self.props]
        if len(set(held)) < len(held):
            raise Fault(f"hold two for the {held[1]} hand, expected one for each hand", "props", 1, "hand")
        for side, limb in zip(("left", "right"), GROUPS["props"], strict=True):
            named = LIMBS[limb] in self.limbs or ("props" in self.limbs and not held)
            if named and side not in held:
                what = "is asked for, but no hand holds one; expected strikes.props to say what it is"
                raise Fault(what, "limbs", _place(self.limbs, LIMBS[limb]))
            if side in held and limb not in self.numbers():
                raise Fault("strikes nothing; expected 'props' in strikes.limbs", "props", held.index(side))
        return self

    def numbers(self) -> tuple[int, ...]:
        """Return them as numbers of ``strikers.LIMBS``, ascending."""
        groups = {number: name for name, numbers in GROUPS.items() for number in numbers}
        held = {f"{prop.hand}_prop" for prop in self.props}
        return tuple(
            n
            for n, limb in enumerate(LIMBS)
            if (limb in self.limbs or groups[n] in self.limbs) and (groups[n] != "props" or limb in held)
        )

    def held(self, roles: Mapping[str, int]) -> tuple[dict[str, Any], ...]:
        """Return what hands hold as ``Body.props``, for a body with these roles of joints."""
        return tuple(
            {
                "joint": int(roles[f"{prop.hand}_hand"]),
                "side": int(prop.hand == "right"),
                "offset": list(prop.point),
                "radius": prop.radius,
            }
            for prop in self.props
        )


def _place(limbs: list[Any], name: str) -> int:
    """Return where a limb, or all props, are named."""
    return limbs.index(name) if name in limbs else limbs.index("props")
