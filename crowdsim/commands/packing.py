"""The command ``pack``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crowdsim.commands.common import Force, Json, print_json, say, size_text
from crowdsim.core.workers import CORES


def pack(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The archive.")],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Pack a run with its policies into one file, which other machines export, render, inspect and verify."""
    from crowdsim.runs.archive import pack_run

    count, size = pack_run(folder, out, CORES, force)
    if as_json:
        print_json({"file": str(out), "files": count, "bytes": size})
    else:
        say(f"{out}: {count} files, {size_text(size)}")
