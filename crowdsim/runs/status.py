"""What became of the runs in a folder: finished, going on or interrupted, how far they are, and who is at work."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from crowdsim.errors import TakeError
from crowdsim.files import exists_plain, is_folder, walk
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import frames_done
from crowdsim.runs.folder import RESOLVED
from crowdsim.runs.lock import find_owner
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import RUN, read_manifest
from crowdsim.runs.stage import TAKE, read_note
from crowdsim.take.metadata import FramesFacts, TakeAttributes, read_model

_OWN = {CHECKPOINT, RESOLVED, TAKE}
"""Files of a run that are no outputs of its take."""


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
        owner = find_owner(folder)
        at_work = {} if owner is None else {"owner": asdict(owner)}
        note = read_note(folder / RUN)
        if exists_plain(folder, MANIFEST):
            report = read_manifest(folder, ("avatars", "control_frames", "seconds"))
            numbers = {name: report[name] for name in ("avatars", "control_frames")}
            counts = _count(name for name in report["files"] if name.split("/")[0] not in _OWN)
            outputs = {kind: {"done": count, "planned": count} for kind, count in sorted(counts.items())}
            facts = {"state": "done", **numbers, "seconds": report["seconds"]["total"], "outputs": outputs, **at_work}
            if note is not None and not note.get("done"):
                facts["extension"] = _describe_growing(folder / RUN)
            return facts
        if note is None:
            return _describe_take(folder) if is_folder(folder, TAKE) else {"state": "none"}
        counts, planned = _count(walk(folder / RUN)), note.get("planned")
        listed = sorted(planned.items()) if isinstance(planned, dict) else ()
        outputs = {str(kind): {"done": counts[kind], "planned": most} for kind, most in listed if type(most) is int}
        facts = _describe_growing(folder / RUN)
        return {"state": "running" if at_work else "interrupted", **facts, "outputs": outputs, **at_work}
    except (TakeError, OSError) as error:
        return {"state": "damaged", "why": str(error)}


def _describe_take(folder: Path) -> dict[str, Any]:
    from crowdsim.take.store import open_take

    take = open_take(folder)
    return {"state": "unfinished", "avatars": take.avatar_count, "control_frames": take.frame_count}


def _describe_growing(folder: Path) -> dict[str, Any]:
    """Return how far a take is that is not finished, or whose outputs are not."""
    name = TAKE if is_folder(folder, TAKE) else f"{TAKE}.partial"
    if not exists_plain(folder, f"{name}/.zattrs") or not exists_plain(folder, f"{name}/x/.zarray"):
        return {"control_frames": 0}
    attributes = read_model(folder / name, ".zattrs", TakeAttributes)
    frames, avatars = read_model(folder / name, "x/.zarray", FramesFacts)["shape"]
    planned = attributes["frames_planned"]
    if attributes["status"] != "running":
        return {"avatars": avatars, "control_frames": frames, "planned_frames": planned}
    return {"avatars": avatars, "control_frames": frames_done(folder), "planned_frames": planned}


def _count(names: Iterable[str]) -> Counter[str]:
    """Return the number of whole files by their top folder, or their name without one."""
    return Counter(name.split("/")[0] for name in names if not name.split("/", 1)[-1].startswith("."))
