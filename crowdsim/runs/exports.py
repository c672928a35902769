"""Outputs of a take: those of a run in progress, and exports and reports of one that was written before."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import ValidationError

from crowdsim.config.schema import join
from crowdsim.errors import CrowdsimError, TakeError, nearest
from crowdsim.export.posed import FinishedTake, PosedOutput
from crowdsim.export.select import parse_avatars
from crowdsim.files import is_folder, move_plain, walk
from crowdsim.outputs.report import ReportOutput
from crowdsim.runs.manifest import EXPORT
from crowdsim.runs.provenance import sources_hash
from crowdsim.runs.stage import Wanted, write_together
from crowdsim.scenario.frame_ranges import parse_frames
from crowdsim.scenario.output import FPS, Output
from crowdsim.scenario.outputs import REGISTRY
from crowdsim.scenario.rates import parse_rate

if TYPE_CHECKING:
    from crowdsim.take.take import Take

_Kind = TypeVar("_Kind", bound=Output)

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
        own = {key: _listed(output, key, value) for key, value in more.items() if key in output.model_fields}
        wanted = _checked(output, {**given, **own})
        chosen.append(wanted.of_take(take.cast.names.tolist(), getattr(take, "cameras", {})))
    return chosen


def _listed(output: type[PosedOutput], key: str, value: Any) -> Any:
    """Return a value; words with commas between as a list where the output wants one."""
    is_text = isinstance(value, str) and "tuple" in str(output.model_fields[key].annotation)
    return [word.strip() for word in value.split(",")] if is_text else value


def _options(kinds: Iterable[str]) -> str:
    return join([f"--{kind}" for kind in kinds])


def choose_report(take: Take, fps: float, frames: str | None, avatars: str | None, player: bool) -> ReportOutput:
    """Return a report that a user chooses, with or without the player; all else as of ``choose_outputs``."""
    if not take.frame_count:
        raise TakeError(f"take {take.scenario!r}: has no control frames, so that there is nothing to report")
    given: dict[str, Any] = {"fps": fps, "player": player, "avatars": parse_avatars(avatars, take.cast)}
    if frames is not None:
        given["frames"] = parse_frames(frames).resolve(take.output_frames(fps), fps)
    return _checked(ReportOutput, given)


def _checked(output: type[_Kind], keys: Mapping[str, Any]) -> _Kind:
    try:
        return output.model_validate(keys)
    except ValidationError as error:
        found = error.errors()[0]
        where, why = ".".join(map(str, found["loc"])), found.get("ctx", {}).get("error", found["msg"])
        raise CrowdsimError(f"{output.name}: {where}{': ' if where else ''}{why}") from None


def write_outputs(
    done: FinishedTake, outputs: Sequence[Output], lap: Callable[[str], None] = lambda stage: None
) -> dict[str, Sequence[Path]]:
    """Write what is missing of outputs of a take; return the files of each that has some, by their label.

    Args:
        done: The take, and where its outputs go.
        outputs: The outputs.
        lap: Called with the name of each stage when it is over.
    """
    from crowdsim.export.posed import write_posed
    from crowdsim.poses.sampler import PoseSampler

    found: dict[str, Sequence[Path]] = {}
    posed = [output for output in outputs if isinstance(output, PosedOutput)]
    if posed:
        sampler = PoseSampler(done.take, done.policies, done.threads, obstacles=done.obstacles)
        found |= write_posed(sampler, done.folder, posed, done.threads, done.progress)
        lap("export")
    for output in outputs:
        if not isinstance(output, PosedOutput) and (files := output.write(done)):
            found[output.label or output.name] = files
            lap(output.stage)
    return {kind: files for kind, files in found.items() if files}


def adopt_export(folder: Path, apart: Path, output: PosedOutput) -> None:
    """Put an export of a finished run that was written into another folder in its place in the run's.

    Its files appear under their names all together. A process that takes over from one that was killed completes it.

    Args:
        folder: The run folder.
        apart: The other folder, on the same disk.
        output: What was exported.

    Raises:
        TakeError: The manifest is damaged.
        OutputError: The folder is in use, or holds other files of these names beside a run's.
        RunError: A file cannot be written.
    """
    places = [place for place in (apart, folder / EXPORT) if is_folder(place, output.name)]
    names = {name for place in places for name in walk(place, output.name)}
    if names:
        with write_together(folder, wanted_files([output], names, {}), folder) as writing:
            if apart in places and not writing.done:
                for name in walk(apart, output.name):
                    move_plain(apart, name, writing.folder)


def wanted_files(outputs: Sequence[Output], files: Set[str], made_from: Mapping[str, Any]) -> Wanted:
    """Return what a command writes: files of outputs, and what they are made from."""
    asked = {output.name: output.model_dump(mode="json", exclude_none=True) for output in outputs}
    return Wanted(EXPORT, asked, files, made_from, [one.name for one in outputs if isinstance(one, PosedOutput)])


def take_mark(take: Take) -> str:
    """Return a checksum of what the files of an export depend on beside the options."""
    last = [np.ascontiguousarray(values[-1:]).tobytes() for values in (take.action, take.x, take.z, take.heading)]
    made = [take.scenario, str(take.seed), *take.fingerprints, str(take.frame_count), sources_hash()]
    return hashlib.sha256(b"".join(last) + "\n".join(made).encode()).hexdigest()
