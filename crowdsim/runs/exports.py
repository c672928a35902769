"""Exports of a run that was written before: all of them appear together, when they are whole."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from crowdsim.config.schema import join
from crowdsim.core.types import Array, Progress
from crowdsim.errors import CrowdsimError, nearest
from crowdsim.export.posed import PosedOutput, extent_of, write_posed
from crowdsim.files import is_folder, move_plain, walk
from crowdsim.runs.manifest import EXPORT
from crowdsim.runs.provenance import sources_hash
from crowdsim.runs.stage import Wanted, planned_files, write_together
from crowdsim.scenario.frame_ranges import parse_frames
from crowdsim.scenario.output import FPS
from crowdsim.scenario.outputs import REGISTRY
from crowdsim.scenario.rates import parse_rate

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy
    from crowdsim.take.take import Take

EXPORTS: dict[str, type[PosedOutput]] = {
    name: output for name, output in REGISTRY.items() if issubclass(output, PosedOutput)
}
"""The outputs that are exported, by name."""


def choose_outputs(
    take: Take,
    kinds: Sequence[str],
    fps: str | float | Fraction | None = None,
    frames: str | None = None,
    avatars: str | None = None,
    **keys: Any,
) -> list[PosedOutput]:
    """Return outputs of a take that a user chooses.

    Args:
        take: The take.
        kinds: Names of outputs, of those in ``EXPORTS``.
        fps: Output frames a second, a fraction such as ``24000/1001`` too; 60 when None.
        frames: Output frames ``A:B``, in frames or seconds; all when None.
        avatars: Their numbers or names, ``0-9`` or ``0,3,red_1``; all when None.
        **keys: Other keys, for the outputs that have them, lists as text with commas too; None for the defaults.

    Raises:
        TakeError: Avatars or frames are asked for that the take does not have.
        CrowdsimError: Nothing is chosen, there is no such output, or none of them has a key or takes its value or rate.
    """
    from crowdsim.export.select import parse_avatars

    if not kinds:
        raise CrowdsimError(f"nothing to export, expected {_options(EXPORTS)}")
    for kind in kinds:
        if kind not in EXPORTS:
            raise CrowdsimError(f"cannot export {kind!r}, expected {', '.join(EXPORTS)}{nearest(str(kind), EXPORTS)}")
    rate = parse_rate(FPS if fps is None else fps)
    count = take.output_frames(rate)
    given: dict[str, Any] = {"fps": rate, "avatars": parse_avatars(avatars, take.cast), "frames": (0, count)}
    if frames is not None:
        given["frames"] = parse_frames(frames).resolve(count, rate)
    more = {key: value for key, value in keys.items() if value is not None}
    for key in more:
        having = [kind for kind, output in EXPORTS.items() if key in output.model_fields]
        if not having:
            known = list(dict.fromkeys(name for output in EXPORTS.values() for name in output.model_fields))
            raise CrowdsimError(f"no export has the key {key!r}, expected {', '.join(known)}{nearest(key, known)}")
        if not set(having) & set(kinds):
            raise CrowdsimError(
                f"--{key.replace('_', '-')} has no effect on {_options(kinds)}, expected {_options(having)} with it"
            )
    chosen = []
    for output in map(EXPORTS.__getitem__, kinds):
        try:
            own = {key: _listed(output, key, value) for key, value in more.items() if key in output.model_fields}
            wanted = output.model_validate({**given, **own})
        except ValidationError as error:
            found = error.errors()[0]
            where, why = ".".join(map(str, found["loc"])), found.get("ctx", {}).get("error", found["msg"])
            raise CrowdsimError(f"{output.name}: {where}{': ' if where else ''}{why}") from None
        chosen.append(wanted.named(lambda name: None, getattr(take, "cameras", {})))
    return chosen


def _listed(output: type[PosedOutput], key: str, value: Any) -> Any:
    """Return a value; words with commas between as a list where the output wants one."""
    is_text = isinstance(value, str) and "tuple" in str(output.model_fields[key].annotation)
    return [word.strip() for word in value.split(",")] if is_text else value


def _options(kinds: Iterable[str]) -> str:
    return join([f"--{kind}" for kind in kinds])


def export_take(
    folder: Path,
    take: Take,
    policies: Sequence[Policy],
    outputs: Sequence[PosedOutput],
    out: Path | None = None,
    threads: int = 1,
    progress: Progress | None = None,
    force: bool = False,
    obstacles: Array | None = None,
) -> dict[str, list[Path]]:
    """Export a run's take again; return the files of each output.

    What an interrupted export has finished is kept for the same export, and removed by another one. In the run's own
    folder, exports take the place of those of their kind; in another one only with ``force``.

    Args:
        folder: The run folder.
        take: Its take.
        policies: Its policies.
        outputs: What to export (``choose_outputs``).
        out: Another folder for the folders of the outputs.
        threads: Threads.
        progress: Called with stage, done and total.
        force: Whether to do it again although it is done, and to replace exports in another folder.
        obstacles: Obstacles of its scenario, whose doors open by seconds. Shape (n,), ``PART``.

    Raises:
        TakeError: The manifest is damaged.
        OutputError: A folder cannot be made or is in use, or holds other files of these names.
        CrowdsimError: An output does not fit the policies.
        RunError: A file cannot be written.
    """
    from crowdsim.poses.sampler import PoseSampler

    for output in outputs:
        for finding in output.findings_with(policies):
            raise CrowdsimError(f"{output.name}: {finding}")
    place, kinds = out or folder, [output.name for output in outputs]
    files = planned_files(outputs, extent_of(take), take.cast.names.tolist(), take.scenario)
    with write_together(place, _wanted(outputs, files, {"take": take_mark(take)}), folder, force, threads) as writing:
        if writing.done:
            written = {kind: [path for path in writing.done if path.parent.name == kind] for kind in kinds}
        else:
            sampler = PoseSampler(take, policies, threads, obstacles=obstacles)
            written = write_posed(sampler, writing.folder, outputs, threads, progress)
    return {kind: [place / kind / path.name for path in files] for kind, files in written.items()}


def adopt_exports(folder: Path, apart: Path, outputs: Sequence[PosedOutput], threads: int = 1) -> None:
    """Put exports of a finished run that ``export_take`` wrote into another folder in their places in the run's.

    They appear under their names all together. A process that takes over from one that was killed completes it.

    Args:
        folder: The run folder.
        apart: The other folder, on the same disk, with a folder for each output.
        outputs: What was exported.
        threads: Threads that sum up files.

    Raises:
        TakeError: The manifest is damaged.
        OutputError: The folder is in use, or holds other files of these names beside a run's.
        RunError: A file cannot be written.
    """
    kinds = [output.name for output in outputs]
    folders = [(place, kind) for place in (apart, folder / EXPORT) for kind in kinds if is_folder(place, kind)]
    names = {name for place, kind in folders for name in walk(place, kind)}
    if not names:
        return
    with write_together(folder, _wanted(outputs, names, {}), folder, threads=threads) as writing:
        for kind in kinds if not writing.done else ():
            for name in walk(apart, kind) if is_folder(apart, kind) else ():
                move_plain(apart, name, writing.folder)


def _wanted(outputs: Sequence[PosedOutput], files: set[str], made_from: dict[str, Any]) -> Wanted:
    asked = {output.name: output.model_dump(mode="json", exclude_none=True) for output in outputs}
    return Wanted(EXPORT, asked, files, made_from, list(asked))


def take_mark(take: Take) -> str:
    """Return a checksum of what the files of an export depend on beside the options."""
    last = [np.ascontiguousarray(values[-1:]).tobytes() for values in (take.action, take.x, take.z, take.heading)]
    made = [take.scenario, str(take.seed), *take.fingerprints, str(take.frame_count), sources_hash()]
    return hashlib.sha256(b"".join(last) + "\n".join(made).encode()).hexdigest()
