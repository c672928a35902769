"""The command ``perform``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crowdsim.commands.common import Force, say
from crowdsim.commands.progress import Bars


def perform(
    seconds: Annotated[
        float, typer.Option(metavar="S", min=2.0, max=86400.0, help="Length of all clips together [s].")
    ] = 437.0,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Another seed, another session.")] = 1,
    falls: Annotated[
        int,
        typer.Option(metavar="N", min=0, max=1000, help="Takes of each kind of fall, stagger and celebration besides."),
    ] = 0,
    rests: Annotated[
        int,
        typer.Option(
            metavar="N", min=0, max=1000, help="Takes of each way of standing at ease, or walking off, besides."
        ),
    ] = 0,
    force: Force = False,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the BVH files.")] = Path(
        "output/performer"
    ),
) -> None:
    """Write clips of the embedded boxer as BVH at 60 Hz."""
    from crowdsim.performer.session import write_performance
    from crowdsim.runs.manifest import FILES
    from crowdsim.runs.stage import Wanted, write_together

    asked = {"seconds": seconds, "seed": seed, "falls": falls, "rests": rests}
    with Bars() as bars, write_together(out, Wanted(FILES, {"clips": asked}), force=force) as writing:
        paths = writing.done or write_performance(
            writing.folder, seconds, seed, progress=bars, falls=falls, rests=rests
        )
    say(f"{len(paths)} clips in {out}")
