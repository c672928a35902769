"""Segments of a rendering: frames that are drawn by several threads or processes, and encoded together."""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crowdsim.core.types import Array
from crowdsim.errors import CrowdsimError, OutputError
from crowdsim.render.options import RenderOptions
from crowdsim.render.source import PoseSource
from crowdsim.render.stage import Stage
from crowdsim.render.video import encode, has_mark, planes, write_png

SEGMENT = 240
"""Frames that are encoded together; an interrupted video continues from the last whole segment."""


@dataclass(frozen=True)
class Work:
    """A segment of frames to draw, and where to.

    Attributes:
        start: First frame.
        stop: One past the last.
        folder: Folder for pictures; None when there are none to write.
        part: File for the segment of the video; None when there is none to write.
    """

    start: int
    stop: int
    folder: Path | None
    part: Path | None


def divide(stage: Stage, start: int, stop: int, folder: Path | None, parts: Path | None) -> tuple[list[Work], int]:
    """Return the segments that are to be drawn, and how many frames are there already."""
    works, kept = [], 0
    for low in range(start - start % SEGMENT, stop, SEGMENT):
        first, last = max(low, start), min(low + SEGMENT, stop)
        part = parts / f"{first:08d}-{last:08d}.mp4" if parts else None
        pictures = [folder / f"{frame:06d}.png" for frame in range(first, last)] if folder else []
        if (part is None or part.exists()) and all(has_mark(path, stage.mark) for path in pictures):
            kept += last - first if part or folder else 0
        elif part or folder:
            works.append(Work(first, last, folder, part))
    return works, kept


def segment_files(parts: Path, start: int, stop: int) -> list[Path]:
    """Return the files of the segments of a range, in order."""
    lows = range(start - start % SEGMENT, stop, SEGMENT)
    return [parts / f"{max(low, start):08d}-{min(low + SEGMENT, stop):08d}.mp4" for low in lows]


def draw_segment(stage: Stage, work: Work, threads: int, count: Callable[[int], None]) -> None:
    """Draw the frames of a segment, several at a time, and write them in order."""
    # Where there are fewer pictures than threads, these share a picture.
    within = max(1, threads // (work.stop - work.start))

    def draw(frame: int) -> Array | None:
        path = work.folder / f"{frame:06d}.png" if work.folder else None
        if path and work.part is None and has_mark(path, stage.mark):
            return None
        picture = stage.picture(frame, within, work.stop)
        if path and not has_mark(path, stage.mark):
            write_png(path, picture, stage.mark)
        return planes(picture) if work.part else None

    def ordered() -> Iterator[Array | None]:
        waiting: deque[Future[Array | None]] = deque()
        with ThreadPoolExecutor(threads) as pool:
            try:
                for frame in range(work.start, work.stop):
                    waiting.append(pool.submit(draw, frame))
                    if len(waiting) > threads + 1:
                        yield waiting.popleft().result()
                        count(1)
                while waiting:
                    yield waiting.popleft().result()
                    count(1)
            finally:
                for future in waiting:
                    future.cancel()

    if work.part:
        encode(work.part, (block for block in ordered() if block is not None), stage.size, stage.source.fps)
    else:
        for _ in ordered():
            pass


_COUNTER: Any = None
_STOP: Any = None


class _Stopped(Exception):
    """The process that shares the work out has given up."""


def _start_worker(counter: Any, stop: Any) -> None:
    global _COUNTER, _STOP
    _COUNTER, _STOP = counter, stop
    # Ctrl-C reaches every process; the first one stops the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _draw_apart(source: PoseSource, options: RenderOptions, work: Work, threads: int) -> None:
    """Draw a segment in a process of its own."""

    def count(more: int) -> None:
        if _STOP.value:
            raise _Stopped
        with _COUNTER.get_lock():
            _COUNTER.value += more

    draw_segment(options.stage(source), work, threads, count)


def share(works: list[Work], source: PoseSource, options: RenderOptions, count: Callable[[int], None]) -> None:
    """Draw segments in several processes; finished ones stay when another fails.

    Args:
        works: The segments.
        source: Where motion comes from.
        options: How to draw.
        count: Called with the number of frames that have become ready.
    """
    threads, jobs = max(1, options.thread_count // options.jobs), min(options.jobs, len(works))
    context = multiprocessing.get_context("spawn")
    counter, stop = context.Value("q", 0), context.Value("b", 0)
    seen = 0
    pool = ProcessPoolExecutor(jobs, context, _start_worker, (counter, stop))
    try:
        futures = {pool.submit(_draw_apart, source, options, work, threads) for work in works}
        while futures:
            finished, futures = wait(futures, timeout=0.2)
            if counter.value > seen:
                count(counter.value - seen)
                seen = counter.value
            for future in finished:
                error = future.exception()
                if isinstance(error, CrowdsimError):
                    raise error
                if error is not None:
                    raise OutputError(f"a rendering process failed: {type(error).__name__}: {error}") from error
    finally:
        stop.value = 1
        pool.shutdown(wait=True, cancel_futures=True)
