"""Reports of runs that were written before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from crowdsim.core.types import Progress
from crowdsim.errors import CrowdsimError, TakeError
from crowdsim.export.posed import FinishedTake
from crowdsim.export.select import parse_avatars
from crowdsim.outputs.report import ReportOutput
from crowdsim.runs.exports import take_mark
from crowdsim.runs.folder import RESOLVED, place_of, read_resolved
from crowdsim.runs.manifest import FILES
from crowdsim.runs.recorded import RecordedRun
from crowdsim.runs.stage import Wanted, write_together
from crowdsim.scenario.frame_ranges import parse_frames


def write_report(
    run: RecordedRun,
    folder: Path,
    out: Path | None = None,
    avatars: str | None = None,
    frames: str | None = None,
    fps: float | None = None,
    player: bool = True,
    threads: int = 1,
    progress: Progress | None = None,
    force: bool = False,
) -> Path:
    """Write the report of a run, the same bytes as its scenario's ``outputs.report``; return its path.

    Args:
        run: The run.
        folder: Its folder.
        out: Another folder for the report.
        avatars: Numbers or names of the avatars that the player shows; all when None.
        frames: Output frames ``A:B`` of the player, in frames or seconds; all when None.
        fps: Frames a second of the player; those of the scenario when None.
        player: Whether the report has the player.
        threads: Threads; the report does not depend on them.
        progress: Called with stage, done and total.
        force: Whether to write it again although it is there, and to replace one in another folder.

    Raises:
        TakeError: Avatars or frames are not in the take, or the scenario cannot be read.
        CrowdsimError: The page would be too large, or the rate is invalid.
        OutputError: The folder cannot be made or is in use, or holds another file of this name.
    """
    rate = fps or run.fps
    keys: dict[str, Any] = {"fps": rate, "player": player, "avatars": parse_avatars(avatars, run.cast)}
    if frames is not None:
        keys["frames"] = parse_frames(frames).resolve(run.output_frames(rate), rate)
    try:
        output = ReportOutput.model_validate(keys)
    except ValidationError as error:
        found = error.errors()[0]
        raise CrowdsimError(f"report: {'.'.join(map(str, found['loc']))}: {found['msg']}") from None
    return write_output(output, run, folder, out, threads, progress, force)


def write_output(
    output: ReportOutput,
    run: RecordedRun,
    folder: Path,
    out: Path | None = None,
    threads: int = 1,
    progress: Progress | None = None,
    force: bool = False,
) -> Path:
    """Write a report of a finished run; return its path. Further arguments and errors are those of ``write_report``.

    Args:
        output: The report.
        run: The run.
        folder: Its folder.
        out: Another folder for the report.
        threads: Threads.
        progress: Called with stage, done and total.
        force: Whether to write it again although it is there, and to replace one in another folder.
    """
    scenario = read_resolved(place_of(folder))
    if not scenario:
        raise TakeError(f"{folder / RESOLVED}: cannot be read, and the report shows it")
    place = out or folder
    asked = {output.name: output.model_dump(mode="json", exclude_none=True)}
    wanted = Wanted(FILES, asked, {"report.html"}, {"take": take_mark(run), "of": scenario})
    with write_together(place, wanted, folder, force, threads) as writing:
        if not writing.done:
            done = FinishedTake(
                run, run.policies, writing.folder, threads, progress, run.arena,
                obstacles=run.obstacles, cameras=run.cameras, health=run.health, heals=run.heals,
            )  # fmt: skip
            output.write_page(done, scenario)
    return place / "report.html"
