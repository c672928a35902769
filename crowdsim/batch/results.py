"""What came of the runs of a batch, a small file each: figures of those that are done, or why they failed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, RootModel

from crowdsim.batch.documents import read_document
from crowdsim.batch.plan import LOGS, RESULTS, PlannedRun
from crowdsim.config.documents import DocumentModel
from crowdsim.files import exists_plain, make_folder, walk, write_text
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest

if TYPE_CHECKING:
    from crowdsim.take.take import Take


_Count = Annotated[int, Field(ge=0, lt=2**63)]
_Number = Annotated[float, Field(ge=-1e30, le=1e30)]


class Done(DocumentModel):
    """What a finished run amounts to."""

    state: Literal["done"]
    outputs: str
    statistics: dict[str, _Number | None]
    seconds: dict[str, _Number]
    peak_memory_bytes: _Count
    bytes: _Count
    files: _Count


class Failed(DocumentModel):
    """Why a run failed."""

    state: Literal["failed"]
    task: str
    cause: str
    message: str
    attempts: _Count
    log: Annotated[str, Field(pattern=rf"^(|{LOGS}/[0-9a-f]{{16}}/[a-z0-9-]+\.log)$")]
    command: str


class Result(RootModel[Annotated[Done | Failed, Field(discriminator="state")]]):
    """What came of a run."""


def collect(folder: Path, take: Take, mark: str) -> dict[str, Any]:
    """Return what a finished run amounts to.

    Args:
        folder: The run folder.
        take: Its take.
        mark: Checksum of its outputs.

    Raises:
        TakeError: The manifest is missing or damaged.
        OSError: A file cannot be looked at.
    """
    from crowdsim.take.measures import measure_fights

    manifest = read_manifest(folder, ("statistics", "seconds", "peak_memory_bytes"))
    sizes = [os.lstat(folder / name).st_size for name in walk(folder)]
    return {
        "state": "done",
        "outputs": mark,
        "statistics": {**asdict(measure_fights(take)), **manifest["statistics"]},
        "seconds": manifest["seconds"],
        "peak_memory_bytes": manifest["peak_memory_bytes"],
        "bytes": sum(sizes),
        "files": len(sizes),
    }


def write_result(folder: Path, id: str, result: Mapping[str, Any]) -> None:
    """Write what came of a run into the folder of its batch.

    Raises:
        OutputError: It cannot be written.
    """
    make_folder(folder / RESULTS)
    write_text(folder / RESULTS / f"{id}.json", json.dumps(result, indent=1) + "\n")


def read_result(folder: Path, id: str) -> dict[str, Any]:
    """Return what came of a run; nothing where that is not known.

    Raises:
        BatchError: The file is damaged.
    """
    return read_document(folder, f"{RESULTS}/{id}.json", Result)


def is_done(folder: Path, run: PlannedRun, result: Mapping[str, Any] | None = None) -> bool:
    """Whether a run is finished, with the outputs that are planned.

    Raises:
        BatchError: The file that says so is damaged.
    """
    result = read_result(folder, run.id) if result is None else result
    is_same = result.get("state") == "done" and result.get("outputs") == run.mark
    return is_same and exists_plain(folder, f"{run.folder}/{MANIFEST}")
