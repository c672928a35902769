"""From a source to files: many frames by several threads or processes, and what is finished stays."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crowdsim.core.types import Array, Progress
from crowdsim.errors import CrowdsimError, OutputError, TakeError, under_way
from crowdsim.files import make_folder
from crowdsim.render.camera import Keys
from crowdsim.render.contact_sheet import sheet_frames, write_sheet
from crowdsim.render.parts import is_parts, make_parts, remove_parts
from crowdsim.render.source import PoseSource
from crowdsim.render.stage import Stage, build_stage
from crowdsim.render.video import encode, ffmpeg, has_mark, join, planes, write_png

Record = Callable[[Path, Sequence[Path]], AbstractContextManager[Callable[[Sequence[Path]], None]]]
"""Is handed a folder and all that is about to be written in it, and within its context the files when they are done."""

SEGMENT = 240
"""Frames that are encoded together; an interrupted video goes on from the last whole segment."""


@dataclass(frozen=True)
class Rendered:
    """What a rendering wrote.

    Attributes:
        files: The files: video.mp4, contact_sheet.png, frames/000000.png ...
        drawn: Frames drawn.
        kept: Frames that were there already.
    """

    files: tuple[Path, ...]
    drawn: int
    kept: int


@dataclass(frozen=True)
class _Work:
    """A segment of frames to draw, and where to."""

    start: int
    stop: int
    folder: Path | None
    part: Path | None


def render(
    source: PoseSource,
    out: Path,
    *,
    size: tuple[int, int] = (1280, 720),
    frames: tuple[int, int] | None = None,
    camera: str | Keys = "auto",
    mp4: bool = True,
    png: bool = False,
    contact_sheet: int = 0,
    caption: bool = True,
    threads: int | None = None,
    jobs: int = 1,
    preset: str = "veryfast",
    progress: Progress | None = None,
    record: Record | None = None,
) -> Rendered:
    """Draw frames of a source into ``out``: ``video.mp4``, ``frames/000000.png`` ..., ``contact_sheet.png``.

    The same source, camera and size give the same pixels for any range of frames and any number of threads and jobs.
    Frames of an interrupted rendering are kept when it starts again with the same arguments; no half-written file ever
    stands under a final name.

    Args:
        source: Where motion comes from; its rate is the rate of the video.
        out: The folder, made when missing.
        size: Width and height [px], even for a video.
        frames: First frame and the one after the last; all by default.
        camera: See ``crowdsim.render.camera.parse_camera``; or keys.
        mp4: Write a video.
        png: Write every frame as PNG.
        contact_sheet: Number of moments on a contact sheet; 0 for none.
        caption: Whether a small caption stands in the pictures.
        threads: Frames drawn at once in all, as many as there are processors by default.
        jobs: Processes that share the frames.
        preset: Of x264.
        progress: Called with stage, done and total.
        record: Notes the files before the first is begun, and records them.

    Raises:
        TakeError: The range of frames is empty or reaches beyond the source.
        CrowdsimError: The camera, an avatar or the size is invalid.
        OutputError: A folder cannot be made.
        RunError: A file cannot be written.
    """
    start, stop = check_frames(frames, source.frame_count, source.name)
    if mp4 and (size[0] % 2 or size[1] % 2):
        raise CrowdsimError(f"size {size[0]}x{size[1]}: a video needs an even width and height")
    if threads is not None and threads < 1:
        raise CrowdsimError(f"threads is {threads}, expected 1 or more")
    if jobs < 1:
        raise CrowdsimError(f"jobs is {jobs}, expected 1 or more")
    threads = threads or os.cpu_count() or 1
    stage = build_stage(source, size, camera, caption)
    if mp4:
        ffmpeg()
    planned = picture_files(out, (start, stop), mp4, png, contact_sheet)
    parts = out / f".video-{stage.mark[:16]}" if mp4 else None
    with (record or _unrecorded)(out, planned + ([parts] if parts else [])) as settle:
        make_folder(out)
        if parts:
            for other in out.glob(".video-*"):
                if other != parts and is_parts(other):
                    remove_parts(other)
            make_parts(parts, stage.mark)
        if png:
            make_folder(out / "frames")
        works, kept = _divide(stage, start, stop, out / "frames" if png else None, parts)
        total, done = stop - start, kept

        def count(more: int) -> None:
            nonlocal done
            done += more
            if progress:
                progress("frames", done, total)

        if kept and progress:
            progress("frames", kept, total)
        drawn = sum(work.stop - work.start for work in works)
        with under_way():
            if jobs > 1 and len(works) > 1:
                settings = (size, camera, caption)
                _share(works, source, settings, max(1, threads // jobs), min(jobs, len(works)), preset, count)
            else:
                for work in works:
                    _draw_segment(stage, work, threads, preset, count)
            if parts:
                join(out / "video.mp4", _segments(parts, start, stop))
                remove_parts(parts)
            if contact_sheet > 0:
                moments = sheet_frames(start, stop, contact_sheet)
                write_sheet(out / "contact_sheet.png", stage, moments, threads, progress)
            settle(planned)
    return Rendered(tuple(planned), drawn, kept)


def picture_files(out: Path, frames: tuple[int, int], mp4: bool, png: bool, contact_sheet: int) -> list[Path]:
    """Return the files that ``render`` writes of a range of frames."""
    files = [out / "frames" / f"{frame:06d}.png" for frame in range(*frames)] if png else []
    return files + [out / "video.mp4"] * mp4 + [out / "contact_sheet.png"] * (contact_sheet > 0)


@contextmanager
def _unrecorded(out: Path, planned: Sequence[Path]) -> Iterator[Callable[[Sequence[Path]], None]]:
    """Record nothing."""
    yield lambda files: None


def _divide(stage: Stage, start: int, stop: int, folder: Path | None, parts: Path | None) -> tuple[list[_Work], int]:
    """Return the segments that are to be drawn, and how many frames are there already."""
    works, kept = [], 0
    for low in range(start - start % SEGMENT, stop, SEGMENT):
        first, last = max(low, start), min(low + SEGMENT, stop)
        part = parts / f"{first:08d}-{last:08d}.mp4" if parts else None
        pictures = [folder / f"{frame:06d}.png" for frame in range(first, last)] if folder else []
        if (part is None or part.exists()) and all(has_mark(path, stage.mark) for path in pictures):
            kept += last - first if part or folder else 0
        elif part or folder:
            works.append(_Work(first, last, folder, part))
    return works, kept


def check_frames(frames: tuple[int, int] | None, count: int, name: str) -> tuple[int, int]:
    """Return a range of frames that is not empty and lies within a source.

    Raises:
        TakeError: It does not.
    """
    if count < 1:
        raise TakeError(f"{name}: there is no frame to draw")
    start, stop = frames if frames is not None else (0, count)
    if not 0 <= start < stop <= count:
        raise TakeError(f"{name}: frames {start}:{stop} are not there, expected a range within 0:{count}")
    return start, stop


def _segments(parts: Path, start: int, stop: int) -> list[Path]:
    """Files of the segments of a range, in order."""
    lows = range(start - start % SEGMENT, stop, SEGMENT)
    return [parts / f"{max(low, start):08d}-{min(low + SEGMENT, stop):08d}.mp4" for low in lows]


def _draw_segment(stage: Stage, work: _Work, threads: int, preset: str, count: Callable[[int], None]) -> None:
    """Draw the frames of a segment, several at a time, and write them in order."""

    def draw(frame: int) -> Array | None:
        path = work.folder / f"{frame:06d}.png" if work.folder else None
        if path and work.part is None and has_mark(path, stage.mark):
            return None
        picture = stage.picture(frame)
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
        encode(work.part, (block for block in ordered() if block is not None), stage.size, stage.source.fps, preset)
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


def _draw_apart(source: PoseSource, settings: tuple[Any, ...], work: _Work, threads: int, preset: str) -> None:
    """Draw a segment in a process of its own."""
    size, camera, caption = settings

    def count(more: int) -> None:
        if _STOP.value:
            raise _Stopped
        with _COUNTER.get_lock():
            _COUNTER.value += more

    _draw_segment(build_stage(source, size, camera, caption), work, threads, preset, count)


def _share(
    works: list[_Work],
    source: PoseSource,
    settings: tuple[Any, ...],
    threads: int,
    jobs: int,
    preset: str,
    count: Callable[[int], None],
) -> None:
    """Draw segments in several processes; finished ones stay when another fails."""
    context = multiprocessing.get_context("spawn")
    counter, stop = context.Value("q", 0), context.Value("b", 0)
    seen = 0
    pool = ProcessPoolExecutor(jobs, context, _start_worker, (counter, stop))
    try:
        futures = {pool.submit(_draw_apart, source, settings, work, threads, preset) for work in works}
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
