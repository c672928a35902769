"""Figures of matplotlib without a window, and their files."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from crowdsim.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


STRIKERS = (
    ("left hand", "tab:blue"),
    ("right hand", "tab:red"),
    ("left foot", "tab:cyan"),
    ("right foot", "tab:orange"),
    ("left elbow", "tab:purple"),
    ("right elbow", "tab:pink"),
    ("left knee", "tab:olive"),
    ("right knee", "tab:brown"),
    ("left prop", "navy"),
    ("right prop", "darkred"),
    ("head", "black"),
)
"""Name and colour of each of ``motion.strikers.LIMBS``."""


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """Return an empty figure of a size in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG under a temporary name, rename it, and return its path.

    Raises:
        OutputError: It cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.png")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(temporary, dpi=110, metadata={"Software": "crowdsim"})
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
    return path
