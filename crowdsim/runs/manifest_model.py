"""What the manifest of a run must hold, as far as it is read."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from crowdsim.config.documents import DocumentModel, OpenModel
from crowdsim.config.files import Fault

_Count = Annotated[int, Field(ge=0, le=1 << 62)]
_Seconds = Annotated[float, Field(ge=0.0, le=1e12)]


class FileEntry(DocumentModel):
    """A file of a run: its size [bytes] and SHA-256."""

    bytes: _Count
    sha256: str


class RunManifest(OpenModel):
    """A manifest; keys that are missing are those of a run of an earlier version, or of none."""

    files: dict[str, FileEntry]
    status: str = ""
    scenario: str = ""
    seed: int = 0
    avatars: _Count = 0
    control_frames: _Count = 0
    policies: dict[str, str] = Field(default_factory=dict)
    inputs: list[str] = Field(default_factory=list)
    origin: dict[str, Any] = Field(default_factory=dict)
    exports: dict[str, dict[str, Any]] = Field(default_factory=dict)
    statistics: dict[str, Any] = Field(default_factory=dict)
    outcome: dict[str, Any] | None = None
    seconds: dict[str, _Seconds] = Field(default_factory=lambda: {"total": 0.0})

    @model_validator(mode="after")
    def _has_total(self) -> RunManifest:
        if "total" not in self.seconds:
            raise Fault("lacks 'total'", "seconds")
        return self
