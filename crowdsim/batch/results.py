"""What came of the runs of a batch, a small file each: figures of those that are done, or why they failed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim.batch.plan import RESULTS, PlannedRun
from crowdsim.files import make_folder, walk, write_text
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest

if TYPE_CHECKING:
    from crowdsim.take.take import Take


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

    manifest = read_manifest(folder)
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
    """Return what came of a run; nothing where that is not known."""
    try:
        found = json.loads((folder / RESULTS / f"{id}.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def is_done(folder: Path, run: PlannedRun, result: Mapping[str, Any] | None = None) -> bool:
    """Whether a run is finished, with the outputs that are planned."""
    result = read_result(folder, run.id) if result is None else result
    is_same = result.get("state") == "done" and result.get("outputs") == run.mark
    return is_same and (folder / run.folder / MANIFEST).is_file()
