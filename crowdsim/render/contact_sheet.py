"""One picture of several moments of a take."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.render.caption import draw_caption, text_height
from crowdsim.render.stage import Stage, mean_light
from crowdsim.render.video import write_png

_GAP = 6
_GROUND = 34
_WIDEST = 2400


def sheet_frames(start: int, stop: int, count: int) -> list[int]:
    """Return ``count`` frames spread over a range, each in the middle of its share; fewer where there are fewer."""
    count = min(count, stop - start)
    return [start + int((i + 0.5) * (stop - start) / count) for i in range(count)]


def draw_sheet(stage: Stage, frames: list[int], threads: int = 1, progress: Progress | None = None) -> Array:
    """Draw moments in rows, each with its time. Shape (height, width, 3), uint8.

    Args:
        stage: What to draw; its size gives the shape of the moments.
        frames: The moments.
        threads: How many threads share a picture.
        progress: Called with stage, done and total.
    """
    columns = max(1, math.ceil(math.sqrt(len(frames) * 1.1 * stage.size[1] / stage.size[0] * 1.6)))
    columns = min(columns, len(frames))
    width = min(stage.size[0], (_WIDEST - _GAP) // columns - _GAP)
    height = max(1, round(width * stage.size[1] / stage.size[0]))
    rows = math.ceil(len(frames) / columns)
    sheet = np.full(
        (rows * (height + _GAP) + _GAP, columns * (width + _GAP) + _GAP, 4 if stage.look.transparent else 3),
        0 if stage.look.transparent else _GROUND,
        np.uint8,
    )
    fine = stage.resized((2 * width, 2 * height), stage.look.plain())
    for index, frame in enumerate(frames):
        large = fine.picture(frame, threads)
        four = np.stack([large[row::2, column::2] for column in range(2) for row in range(2)])
        if stage.look.transparent:
            moment = mean_light(list(four))
        else:
            moment = ((four.sum(axis=0, dtype=np.uint16) + 2) // 4).astype(np.uint8)
        if stage.look.caption and not stage.look.transparent:
            text = f"{frame / stage.source.fps:.2f} s" if index else stage.title(frame)
            draw_caption(moment, text, height=max(text_height(height), round(height / 27)))
        y, x = _GAP + (index // columns) * (height + _GAP), _GAP + (index % columns) * (width + _GAP)
        sheet[y : y + height, x : x + width] = moment
        if progress:
            progress("contact sheet", index + 1, len(frames))
    return sheet


def write_sheet(
    path: Path,
    stage: Stage,
    frames: list[int],
    threads: int = 1,
    progress: Progress | None = None,
) -> None:
    """Draw moments, see ``draw_sheet``, into a PNG file.

    Raises:
        OutputError: The file cannot be written.
    """
    write_png(path, draw_sheet(stage, frames, threads, progress))
