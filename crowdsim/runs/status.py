"""What became of the runs in a folder: finished, going on or interrupted, how far they are, and who is at work."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from crowdsim.errors import TakeError
from crowdsim.files import exists_plain, walk
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import frames_done
from crowdsim.runs.folder import RESOLVED, TAKE
from crowdsim.runs.journal import EXTENSION, Noted, read_journal
from crowdsim.runs.journal import NAME as JOURNAL
from crowdsim.runs.lock import find_owner
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest
from crowdsim.take.metadata import FramesFacts, TakeAttributes, read_model


def describe_run(folder: Path) -> dict[str, Any]:
    """Return what became of a run.

    Returns:
        ``state``: ``done``; ``running``; ``interrupted`` (killed, stopped or failed: its command goes on with it);
        ``unfinished`` (a take alone, without notes from which a run could go on); ``damaged``, and ``why``; or
        ``none`` where the folder is no run's. Then, as far as they are known: ``avatars``, ``control_frames`` (of
        those that are done), ``planned_frames``, ``seconds``, ``outputs`` (files done and planned, by kind), the
        ``owner`` that holds the folder, and how far an ``extension`` is.
    """
    try:
        held = [path.name for path in folder.iterdir()]
        owner = find_owner(folder)
        at_work = {} if owner is None else {"owner": asdict(owner)}
        if MANIFEST in held:
            report = read_manifest(folder, ("avatars", "control_frames", "seconds"))
            numbers = {name: report[name] for name in ("avatars", "control_frames")}
            outputs = _count(report["files"], _outputs(report["files"]))
            facts = {"state": "done", **numbers, "seconds": report["seconds"]["total"], "outputs": outputs, **at_work}
            if (folder / EXTENSION).is_dir():
                facts["extension"] = _describe_growing(folder / EXTENSION)
            return facts
        journal = read_journal(folder) if JOURNAL in held else None
        if journal is None:
            return _describe_take(folder) if TAKE in held else {"state": "none"}
        outputs = _count(walk(folder), _outputs(journal.files))
        facts = _describe_growing(folder)
        return {"state": "running" if at_work else "interrupted", **facts, "outputs": outputs, **at_work}
    except (TakeError, OSError) as error:
        return {"state": "damaged", "why": str(error)}


def _describe_take(folder: Path) -> dict[str, Any]:
    from crowdsim.take.store import open_take

    take = open_take(folder)
    return {"state": "unfinished", "avatars": take.avatar_count, "control_frames": take.frame_count}


def _describe_growing(folder: Path) -> dict[str, Any]:
    """Return how far a take is that is not finished, or whose outputs are not."""
    name = TAKE if (folder / TAKE).exists() else f"{TAKE}.partial"
    if not exists_plain(folder, f"{name}/.zattrs") or not exists_plain(folder, f"{name}/x/.zarray"):
        return {"control_frames": 0}
    attributes = read_model(folder / name, ".zattrs", TakeAttributes)
    frames, avatars = read_model(folder / name, "x/.zarray", FramesFacts)["shape"]
    planned = attributes["frames_planned"]
    if attributes["status"] != "running":
        return {"avatars": avatars, "control_frames": frames, "planned_frames": planned}
    return {"avatars": avatars, "control_frames": frames_done(folder), "planned_frames": planned}


def _outputs(names: Iterable[str]) -> list[str]:
    """Return which of a run's files are outputs of its take."""
    own = {CHECKPOINT, RESOLVED, TAKE, f"{TAKE}.partial"}
    return [name for name in names if name.split("/")[0] not in own]


def _count(held: Iterable[str], planned: Iterable[str]) -> dict[str, dict[str, int]]:
    """Return how many files of each kind of output are there, and how many are planned."""
    noted = Noted(planned)
    counts = {kind: {"done": 0, "planned": count} for kind, count in sorted(noted.count_by_folder().items())}
    for name in held:
        kind = name.split("/")[0]
        if kind in counts and noted.names(name):
            counts[kind]["done"] += 1
    return counts
