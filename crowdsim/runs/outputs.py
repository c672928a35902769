"""What a run writes beside its take."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from os.path import commonpath
from pathlib import Path
from typing import TYPE_CHECKING

from crowdsim.runs.stage import Plan
from crowdsim.scenario.output import Extent, Output, Series

if TYPE_CHECKING:
    from crowdsim.core.types import Array
    from crowdsim.policy.policy import Policy
    from crowdsim.runs.run import Run
    from crowdsim.take.take import Take


def plan_outputs(outputs: Iterable[Output], extent: Extent, avatars: Sequence[str]) -> Plan:
    """Return the names of all files that outputs of a take may have; ``avatars`` are those of its avatars."""
    plan = Plan()
    for output in outputs:
        for one in output.files(extent, avatars):
            if isinstance(one, Series):
                plan.series.append(one)
            else:
                plan.files.add(one)
    return plan


def write_outputs(
    run: Run, take: Take, policies: Sequence[Policy], timings: Array | None
) -> dict[str, tuple[Path, list[Path]]]:
    """Write the outputs that a run's scenario asks for from its take; return the files of each, and where they are.

    Files that are there already are whole, and are not written again.

    Args:
        run: The run.
        take: Its take.
        policies: Its policies.
        timings: What control cost where that was measured. Shape (frames, 6), int64 [ns].

    Raises:
        OutputError: A file cannot be written.
        Interrupted: A signal has come.
    """
    from crowdsim.crowd.draw import pack_arena
    from crowdsim.export.posed import FinishedTake, PosedOutput, write_posed
    from crowdsim.poses.sampler import PoseSampler

    arena = pack_arena(run.scenario.arena)
    done = FinishedTake(take, policies, run.work, run.threads, run.advance_outputs, arena, timings)
    found: dict[str, tuple[Path, list[Path]]] = {}
    wanted = run.scenario.outputs.wanted()
    posed = [output for output in wanted if isinstance(output, PosedOutput)]
    if posed:
        sampler = PoseSampler(take, policies, run.threads)
        for kind, files in write_posed(sampler, run.work, posed, run.threads, run.advance_outputs).items():
            found[kind] = run.work / kind, files
        run.clock.lap("export")
    for output in wanted:
        files = [] if isinstance(output, PosedOutput) else output.write(done)
        if files:
            # One file is named, of several the folder that they are in.
            found[output.label or output.name] = Path(commonpath(files)), files
            run.clock.lap(output.stage)
    return {kind: (place, files) for kind, (place, files) in found.items() if files}
