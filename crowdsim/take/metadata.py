"""Metadata of a take on disk: what each file of it must say before an array is read."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, model_validator

from crowdsim.config.documents import DocumentModel, OpenModel, document_fault, parse_json
from crowdsim.config.files import Fault
from crowdsim.errors import TakeError
from crowdsim.files import NotPlainError, entries, open_plain, stat_plain, walk
from crowdsim.scenario.looks import Hands, Sex

_MOST_BYTES, _MOST_METADATA = 1 << 26, 1 << 26
"""Largest chunk, uncompressed, and longest file of metadata [bytes]."""
_MOST_NAMES = 1 << 29
"""Largest chunk of names [bytes]."""
_MOST_ROWS = 1 << 18
"""Most control frames, or strikes, of a chunk."""
_ITEM_BYTES = {"<i2": 2, "<i4": 4, "<f4": 4, "<f8": 8, "|u1": 1, "|b1": 1}
_TEXT = re.compile(r"<U([1-9]\d{0,2})")

_Length = Annotated[int, Field(ge=0, le=1 << 40)]


class Codec(OpenModel):
    """How chunks are compressed."""

    id: Literal["zstd"]


class ArrayFacts(DocumentModel):
    """The file ``.zarray``, as takes have it."""

    zarr_format: Literal[2]
    shape: list[_Length] = Field(min_length=1, max_length=3)
    chunks: list[Annotated[int, Field(ge=1, le=1 << 40)]] = Field(min_length=1, max_length=3)
    dtype: str
    compressor: Codec
    fill_value: None
    filters: None
    order: Literal["C"]
    dimension_separator: Literal["."] = "."

    @model_validator(mode="after")
    def _fits(self) -> ArrayFacts:
        if len(self.chunks) != len(self.shape):
            raise Fault(f"have {len(self.chunks)} axes, expected {len(self.shape)}", "chunks")
        text = _TEXT.fullmatch(self.dtype)
        size = 4 * int(text[1]) if text else _ITEM_BYTES.get(self.dtype)
        if size is None:
            raise Fault(f"is {self.dtype!r}, expected a type of numbers or text that takes have", "dtype")
        if math.prod(self.chunks) * size > (_MOST_NAMES if text else _MOST_BYTES):
            raise Fault(f"are of {self.chunks} entries, too many to be read at once", "chunks")
        return self


class FramesFacts(ArrayFacts):
    """Likewise, of what is recorded for every control frame and avatar."""

    shape: list[_Length] = Field(min_length=2, max_length=2)


_Near = Annotated[float, Field(ge=-1000.0, le=1000.0)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]


class PropFacts(DocumentModel):
    """A capsule that avatars of a type carry, see ``crowd.props.PROP``."""

    type: Annotated[int, Field(ge=0, le=1 << 14)]
    joint: Annotated[int, Field(ge=0, le=1 << 14)]
    start: list[_Near] = Field(min_length=3, max_length=3)
    end: list[_Near] = Field(min_length=3, max_length=3)
    radius: Annotated[float, Field(gt=0.0, le=1000.0)]
    colour: list[_Share] = Field(min_length=3, max_length=3)
    blocks: bool = False


class FaceFacts(DocumentModel):
    """A triangle of a mesh that avatars of a type carry, see ``crowd.props.FACE``."""

    type: Annotated[int, Field(ge=0, le=1 << 14)]
    joint: Annotated[int, Field(ge=0, le=1 << 14)]
    corners: list[Annotated[list[_Near], Field(min_length=3, max_length=3)]] = Field(min_length=3, max_length=3)
    colour: list[_Share] = Field(min_length=3, max_length=3)
    blocks: bool


class BodyFacts(OpenModel):
    """What the body of a type is like."""

    sex: Sex
    hands: Hands


class TakeAttributes(OpenModel):
    """The file ``.zattrs`` of a take."""

    scenario: str
    seed: int
    control_rate: Annotated[float, Field(ge=0.01, le=10_000.0)]
    status: Literal["running", "done", "interrupted"]
    frames_planned: _Length
    type_names: list[str] = Field(min_length=1)
    team_names: list[str] = Field(min_length=1)
    policy_names: list[str] = Field(min_length=1)
    policy_fingerprints: list[str]
    target_names: list[str] = Field(max_length=4096)
    group_names: list[str] = Field(default_factory=list)
    reactions: bool = True
    collision_avoidance: bool = True
    attachments: list[PropFacts] = Field(default_factory=list, max_length=1 << 20)
    faces: list[FaceFacts] = Field(default_factory=list, max_length=1 << 18)
    type_colours: list[list[Annotated[float, Field(ge=0.0, le=1.0)] | None]]
    type_bodies: list[BodyFacts] = Field(default_factory=list)

    @model_validator(mode="after")
    def _lengths(self) -> TakeAttributes:
        if len(self.policy_fingerprints) != len(self.policy_names):
            what = f"has {len(self.policy_fingerprints)} items, expected {len(self.policy_names)}, one a policy"
            raise Fault(what, "policy_fingerprints")
        if len(self.type_colours) != len(self.type_names) or any(len(row) != 3 for row in self.type_colours):
            raise Fault(f"expected red, green and blue of each of {len(self.type_names)} types", "type_colours")
        if self.type_bodies and len(self.type_bodies) != len(self.type_names):
            raise Fault(f"expected sex and hands of each of {len(self.type_names)} types", "type_bodies")
        carried: dict[str, Sequence[PropFacts | FaceFacts]] = {"attachments": self.attachments, "faces": self.faces}
        for key, props in carried.items():
            for index, prop in enumerate(props):
                if prop.type >= len(self.type_names):
                    raise Fault(f"is {prop.type}, expected one of {len(self.type_names)} types", key, index, "type")
        return self


def read_metadata(folder: Path, name: str) -> Any:
    """Return the plain data of a file of JSON in a take.

    Raises:
        TakeError: It is missing, too long, or no JSON.
    """
    path = folder / name
    try:
        with open_plain(folder, name) as file:
            data = file.read(_MOST_METADATA + 1)
        if len(data) > _MOST_METADATA:
            raise ValueError("too long")
        return parse_json(data.decode("utf-8"))
    except OSError as error:
        raise TakeError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise TakeError(f"{path}: is damaged: {error}") from None


def read_model(folder: Path, name: str, model: type[BaseModel]) -> dict[str, Any]:
    """Return the plain data of a file of JSON in a take that a model describes.

    Raises:
        TakeError: It is missing, no JSON, or something else.
    """
    data = read_metadata(folder, name)
    fault = document_fault(model, data)
    if fault:
        raise TakeError(f"{folder / name}: is damaged: {fault}")
    result: dict[str, Any] = data
    return result


def check_first_chunks(folder: Path, shape: tuple[int, ...], chunks: tuple[int, ...]) -> None:
    """See to it that an array has a first chunk for all of its rows, so that it is no longer than its files.

    Args:
        folder: Folder of an array none of whose chunks at the beginning of a row is ever left out.
        shape: Shape of the array.
        chunks: Shape of a chunk.

    Raises:
        TakeError: One is missing, or chunks are longer than those of takes.
    """
    if chunks[0] > _MOST_ROWS:
        raise TakeError(f"{folder}: has {chunks[0]} rows a chunk, expected at most {_MOST_ROWS}")
    held, rows = set(entries(folder)), -(-shape[0] // chunks[0])
    if rows > len(held):
        raise TakeError(f"{folder}: holds {len(held)} files, expected {rows} chunks or more")
    for row in range(rows):
        name = ".".join([str(row), *("0" for _ in shape[1:])])
        if name not in held:
            raise TakeError(f"{folder / name}: is missing")


def check_files(folder: Path) -> None:
    """Refuse a take that holds anything but files and folders: links lead elsewhere, and reading a pipe never ends."""
    for name in walk(folder):
        try:
            stat_plain(folder, name)
        except NotPlainError as error:
            raise TakeError(f"{error.filename}: {error.strerror}") from None
