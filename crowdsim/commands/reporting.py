"""The command ``report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crowdsim.commands.common import Force, Frames, Threads, fps_option, note, say, size_text
from crowdsim.commands.process import opened_run
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError


def report(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder, or its archive.")],
    avatars: Annotated[
        str | None,
        typer.Option(metavar="AVATARS", help="Avatars that the player shows: 0-9 or 0,3,red_1; all by default."),
    ] = None,
    frames: Frames = None,
    fps: Annotated[float | None, fps_option("Frames a second of the player; the scenario's")] = None,
    player: Annotated[bool, typer.Option(help="Whether the page has the player.")] = True,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of report.html; the run's, or one beside an archive.")
    ] = None,
    threads: Threads = CORES,
    force: Force = False,
) -> None:
    """Write a report of a run as one page: statistics with verdicts, pictures, the player, how to repeat it."""
    from crowdsim.compilation import watch_compilation
    from crowdsim.runs.exports import choose_report
    from crowdsim.runs.opening import open_run

    if not player and (avatars is not None or frames is not None or fps is not None):
        raise CrowdsimError("--avatars, --frames and --fps are of the player, which --no-player leaves out")
    target = out or (folder.with_suffix("") if folder.is_file() else folder)
    with opened_run(folder) as unpacked:
        run = open_run(unpacked)
        for line in run.notes:
            note(line)
        output = choose_report(run, fps or run.fps, frames, avatars, player)
        with Bars() as bars, watch_compilation(bars.note, [output.kernels], threads):
            (path,) = run.write([output], target, threads, bars, force)[output.name]
    say(f"{path}: {size_text(path.stat().st_size)}")
