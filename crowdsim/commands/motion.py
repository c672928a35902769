"""The commands ``perform`` and ``train``, which make what runs start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crowdsim.commands.common import (
    CORES,
    Force,
    Json,
    Mocap,
    Threads,
    complete_recipe,
    detail,
    make_folder,
    print_json,
    say,
)
from crowdsim.commands.progress import Bars
from crowdsim.errors import under_way


def perform(
    seconds: Annotated[
        float, typer.Option(metavar="S", min=2.0, max=86400.0, help="Length of all clips together [s].")
    ] = 437.0,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Another seed, another session.")] = 1,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the BVH files.")] = Path(
        "output/performer"
    ),
) -> None:
    """Write clips of the embedded boxer as BVH at 60 Hz."""
    from crowdsim.motion.performer import write_performance

    make_folder(out)
    with Bars() as bars, under_way():
        paths = write_performance(out, seconds, seed, progress=bars)
    say(f"{len(paths)} clips in {out}")


def train(
    recipe: Annotated[
        str, typer.Argument(metavar="RECIPE", help="A recipe's file, or its name.", autocompletion=complete_recipe)
    ],
    mocap: Mocap = None,
    threads: Threads = CORES,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Train a policy from motion capture or from the embedded boxer."""
    from crowdsim.compilation import watch_compilation
    from crowdsim.policy.bundle import read_document, read_timings
    from crowdsim.policy.train import train_recipe

    with Bars() as bars, watch_compilation(bars.note) as compilation:
        folder, trained = train_recipe(recipe, mocap, threads, force, bars)
    document, timings = read_document(folder), read_timings(folder)
    for name, told in (timings.get("behaviours") or {}).items():
        detail(f"{folder}: {name} took {told['seconds']:.1f} s")
    if as_json:
        print_json(
            {
                "policy": document["name"],
                "folder": str(folder),
                "trained": trained,
                "fingerprint": document["fingerprint"],
                "compile_seconds": compilation.seconds,
                "seconds": timings,
            }
        )
        return
    say(f"{folder}: {'trained' if trained else 'up to date'}")
