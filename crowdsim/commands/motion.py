"""The commands ``perform`` and ``train``, which make what runs start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crowdsim.commands.common import CORES, Force, Mocap, Threads, make_folder
from crowdsim.commands.progress import Bars
from crowdsim.errors import under_way


def perform(
    seconds: Annotated[float, typer.Option(min=2.0, max=86400.0, help="Length of all clips together [s].")] = 437.0,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another session.")] = 1,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the BVH files.")] = Path("output/performer"),
) -> None:
    """Write clips of the embedded boxer as BVH at 60 Hz."""
    from crowdsim.motion.performer import write_performance

    make_folder(out)
    with Bars() as bars, under_way():
        paths = write_performance(out, seconds, seed, progress=bars)
    print(f"{len(paths)} clips in {out}")


def train(
    recipe: Annotated[str, typer.Argument(help="A recipe's file, or its name.")],
    mocap: Mocap = None,
    threads: Threads = CORES,
    force: Force = False,
) -> None:
    """Train a policy from motion capture or from the embedded boxer."""
    from crowdsim.policy.train import train_recipe

    with Bars() as bars:
        folder, trained = train_recipe(recipe, mocap, threads, force, bars)
    print(f"{folder}: {'trained' if trained else 'up to date'}")
