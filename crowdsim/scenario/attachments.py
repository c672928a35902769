"""What avatars hold or wear: props at joints, given in a type."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, WithJsonSchema, model_validator

from crowdsim.config.files import Fault, StrictModel
from crowdsim.config.findings import show

MESHES = (".obj",)
_COLOUR = r"^#[0-9a-fA-F]{6}$"
_Metre = Annotated[float, Field(ge=-10, le=10)]
_Length = Annotated[float, Field(ge=0.001, le=10)]
_Angle = Annotated[float, Field(ge=-360, le=360)]
_Vector = tuple[_Metre, _Metre, _Metre]


def _joint(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise ValueError("expected the name of a joint, or its role, such as right_hand")
    return text


class _Attachment(StrictModel):
    """A prop at a joint."""

    joint: Annotated[str, AfterValidator(_joint), WithJsonSchema({"type": "string"})] = Field(
        description="The joint that carries it: its name, or its role in a body, such as `right_hand` or `head`."
    )
    offset: _Vector = Field(
        default=(0.0, 0.0, 0.0), description="Where its origin is in the joint's frame: x, y, z [m]."
    )
    rotation: tuple[_Angle, _Angle, _Angle] = Field(
        default=(0.0, 0.0, 0.0),
        description="How it is turned there: about x, then y, then z of the joint's frame [deg].",
    )
    blocks: bool = Field(
        default=False,
        description="Whether it is a shield, on a hand or an elbow: strikes that meet it are blocked. It counts as a "
        "forearm or glove that is as wide as the middle one of its three sizes.",
    )
    strikes: bool | None = Field(
        default=None,
        description="Whether its end strikes, of a prop in a hand: true where the policy has learned strikes with it "
        "(`strikes.props` of its recipe), which is checked; false where it is only shown. null: as the policy has "
        "learned, with a warning where a prop reaches out of a hand and does not strike.",
    )
    colour: Annotated[str, Field(pattern=_COLOUR)] | None = Field(
        default=None, description="Colour in pictures as '#rrggbb'; null: that of wood."
    )


class PropCapsule(StrictModel):
    """A capsule of a prop."""

    start: _Vector = Field(description="One end of its axis in the prop's frame: x, y, z [m].")
    end: _Vector = Field(description="The other end [m].")
    radius: Annotated[float, Field(ge=1e-4, le=2)] = Field(description="Its radius [m].")


class CapsulesAttachment(_Attachment):
    """A prop of capsules, such as a stick or a bat."""

    kind: Literal["capsules"] = Field(description="A prop of capsules, such as a stick or a bat.")
    capsules: tuple[PropCapsule, ...] = Field(min_length=1, max_length=200, description="The capsules.")


class BoxAttachment(_Attachment):
    """A box, such as a shield or a case."""

    kind: Literal["box"] = Field(description="A box, such as a shield or a case.")
    size: tuple[_Length, _Length, _Length] = Field(description="Its size along x, y and z of the prop's frame [m].")


class MeshAttachment(_Attachment):
    """A mesh from a file."""

    kind: Literal["mesh"] = Field(description="A mesh from a file.")
    file: str = Field(
        description="An OBJ file in the scenario's folder, of at most 500 triangles, in the prop's frame. Pictures "
        "and clouds show it by rods that lie side by side on its faces, glTF files and the player by its triangles."
    )
    scale: float = Field(default=1.0, gt=0, le=1000, description="Metres to a unit of the file.")

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> MeshAttachment:
        if "\\" in self.file:
            raise Fault(f"{show(self.file)}, expected / between folders", "file")
        inner = PurePosixPath(self.file)
        if inner.is_absolute() or ".." in inner.parts or ":" in self.file:
            raise Fault(f"{show(self.file)}, expected a path inside the scenario's folder", "file")
        if inner.suffix.lower() not in MESHES:
            raise Fault(f"{show(self.file)}, expected a file that ends in {', '.join(MESHES)}", "file")
        folder: Path | None = (info.context or {}).get("folder")
        if folder is None:
            return self
        path = folder / inner
        if not os.path.isfile(path):
            near = sorted(other.name for other in folder.glob("*") if other.suffix.lower() in MESHES)
            choice = f"one of {', '.join(near[:10])}" if near else "an OBJ file; the folder has none"
            raise Fault(f"{show(self.file)}, and {folder} holds no such file, expected {choice}", "file")
        if not path.resolve().is_relative_to(folder.resolve()):
            raise Fault(f"{show(self.file)}, a link that leaves the scenario's folder, expected a file in it", "file")
        return self


Attachment = Annotated[CapsulesAttachment | BoxAttachment | MeshAttachment, Field(discriminator="kind")]
