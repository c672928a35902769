"""What several commands share: options, and ways to print."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.errors import OutputError


def _count_cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


CORES = _count_cores()

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]
Threads = Annotated[int, typer.Option("--threads", min=1, max=1024, help="Threads; results never depend on them.")]
Force = Annotated[bool, typer.Option("--force", help="Do it again although it is done.")]
Search = Annotated[
    str | None,
    typer.Option(help="How nearest opponents are found: auto, kd_tree or scipy; results never depend on it."),
]
Mocap = Annotated[
    Path | None,
    typer.Option(help="Folder of motion capture, for recipes that train from it.", envvar="CROWDSIM_MOCAP"),
]


def print_json(document: Any) -> None:
    """Print plain data as one JSON document."""
    print(json.dumps(document, indent=2, allow_nan=False))


def print_tree(told: Any, depth: int) -> None:
    """Print plain data as indented lines, numbers to four digits."""
    for key, value in told.items():
        if isinstance(value, dict):
            print("  " * depth + f"{key}:")
            print_tree(value, depth + 1)
        else:
            print("  " * depth + f"{key}: {f'{value:.4g}' if isinstance(value, float) else value}")


def size_text(count: float) -> str:
    """Return a number of bytes in the unit that suits it."""
    for unit in ("bytes", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"


def make_folder(folder: Path) -> None:
    """Make a folder for outputs.

    Raises:
        OutputError: It cannot be made or is a file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is a file, expected a folder to write into") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror}") from None
