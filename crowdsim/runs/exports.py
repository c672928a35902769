"""Exports of a run that was written before: all of them appear together, when they are whole."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Progress
from crowdsim.errors import CrowdsimError
from crowdsim.files import is_folder, move_plain, walk
from crowdsim.runs.manifest import EXPORT
from crowdsim.runs.outputs import Export, write_exports
from crowdsim.runs.provenance import sources_hash
from crowdsim.runs.stage import Plan, write_together
from crowdsim.scenario.frame_ranges import parse_frames

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy
    from crowdsim.take.take import Take


@dataclass(frozen=True)
class ExportOptions:
    """What to export of a run, in a user's words.

    Attributes:
        kinds: ``bvh``, ``ply``, ``pcd``.
        avatars: Their numbers or names, ``0-9`` or ``0,3,red_1``; all when None.
        frames: Output frames ``A:B``, in frames or seconds; all when None.
        fps: Output frames a second.
        every: Write every n-th output frame of point clouds.
        points: Points an avatar.
    """

    kinds: Sequence[str]
    avatars: str | None = None
    frames: str | None = None
    fps: float = 60.0
    every: int = 1
    points: int = 500


def export_take(
    folder: Path,
    take: Take,
    policies: Sequence[Policy],
    options: ExportOptions,
    out: Path | None = None,
    threads: int = 1,
    progress: Progress | None = None,
    force: bool = False,
) -> dict[str, list[Path]]:
    """Export a run's take again; return the files of each kind.

    What an interrupted export has finished is kept for the same export, and removed by another one. In the run's own
    folder, exports take the place of those of their kind; in another one only with ``force``.

    Args:
        folder: The run folder.
        take: Its take.
        policies: Its policies.
        options: What to export.
        out: Another folder for ``bvh/``, ``ply/`` and ``pcd/``.
        threads: Threads.
        progress: Called with stage, done and total.
        force: Whether to do it again although it is done, and to replace exports in another folder.

    Raises:
        TakeError: Avatars or frames are asked for that the take does not have, or the manifest is damaged.
        OutputError: A folder cannot be made or is in use, or holds other files of these names.
        RunError: A file cannot be written.
    """
    from crowdsim.export.select import parse_avatars
    from crowdsim.take.poses import PoseSampler

    if not options.kinds:
        raise CrowdsimError("nothing to export, expected --bvh, --ply or --pcd")
    count, fps = take.output_frames(options.fps), options.fps
    frames = (0, count)
    if options.frames is not None:
        frames = parse_frames(options.frames).resolve(count, fps, take.frame_limit(fps))
    avatars = parse_avatars(options.avatars, take.cast)
    wanted = [Export(kind, fps, frames, avatars, options.every, options.points) for kind in options.kinds]
    made_from = {"take": _mark(take), "frames": frames, "avatars": avatars and list(avatars)}
    plan = Plan()
    for one in wanted:
        one.plan(plan, take.cast.names.tolist())
    with write_together(
        out or folder, EXPORT, options.kinds, asdict(options), plan, made_from, folder, options.kinds, force, threads
    ) as writing:
        if writing.done:
            written = {kind: [path for path in writing.done if path.parent.name == kind] for kind in options.kinds}
        else:
            written = write_exports(PoseSampler(take, policies, threads), writing.folder, wanted, threads, progress)
    return {kind: [(out or folder) / kind / path.name for path in files] for kind, files in written.items()}


def adopt_exports(folder: Path, apart: Path, options: ExportOptions, threads: int = 1) -> None:
    """Put exports of a finished run that ``export_take`` wrote into another folder in their places in the run's.

    They appear under their names all together. A process that takes over from one that was killed completes it.

    Args:
        folder: The run folder.
        apart: The other folder, on the same disk, with a folder for each kind.
        options: What was exported.
        threads: Threads that sum up files.

    Raises:
        TakeError: The manifest is damaged.
        OutputError: The folder is in use, or holds other files of these names beside a run's.
        RunError: A file cannot be written.
    """
    folders = [(place, kind) for place in (apart, folder / EXPORT) for kind in options.kinds if is_folder(place, kind)]
    names = {name for place, kind in folders for name in walk(place, kind)}
    if not names:
        return
    with write_together(
        folder, EXPORT, options.kinds, asdict(options), Plan(names), None, folder, options.kinds, threads=threads
    ) as writing:
        for kind in options.kinds if not writing.done else ():
            for name in walk(apart, kind) if is_folder(apart, kind) else ():
                move_plain(apart, name, writing.folder)


def _mark(take: Take) -> str:
    """Return a checksum of what the files of an export depend on beside the options."""
    last = [np.ascontiguousarray(values[-1:]).tobytes() for values in (take.action, take.x, take.z, take.heading)]
    made = [take.scenario, str(take.seed), *take.fingerprints, str(take.frame_count), sources_hash()]
    return hashlib.sha256(b"".join(last) + "\n".join(made).encode()).hexdigest()
