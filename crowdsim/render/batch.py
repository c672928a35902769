"""From a source to files: what is finished stays, and what was there already is not drawn again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crowdsim.core.types import Progress
from crowdsim.errors import OutputError, under_way
from crowdsim.files import Writing, entries, make_folder, move_plain
from crowdsim.render.contact_sheet import sheet_frames, write_sheet
from crowdsim.render.options import RenderOptions
from crowdsim.render.parts import is_parts, make_parts, mark_first, remove_parts
from crowdsim.render.segments import Work, divide, draw_segment, segment_files, share
from crowdsim.render.source import PoseSource
from crowdsim.render.stage import Stage
from crowdsim.render.video import ffmpeg, join

Record = Callable[[Path, Sequence[Path], str, Mapping[str, Any]], AbstractContextManager[Writing]]
"""Gives where pictures of a folder are drawn, by their files there, a mark of all that they depend on, and facts."""


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


def render(
    source: PoseSource,
    out: Path,
    options: RenderOptions,
    progress: Progress | None = None,
    record: Record | None = None,
) -> Rendered:
    """Draw frames of a source into ``out``: ``video.mp4``, ``frames/000000.png`` ..., ``contact_sheet.png``.

    The same source, camera and size give the same pixels for any range of frames and any number of threads and jobs.
    Frames of an interrupted rendering are kept when it starts again with the same options; no file has its final name
    before it is whole.

    Args:
        source: Where motion comes from; its rate is the rate of the video.
        out: The folder, made when missing.
        options: What to draw, and how.
        progress: Called with stage, done and total.
        record: Gives where they are drawn until all are whole; in ``out`` itself when None.

    Raises:
        TakeError: The range of frames is empty or reaches beyond the source.
        CrowdsimError: The camera, an avatar or the size is invalid.
        OutputError: A folder cannot be made.
        RunError: A file cannot be written.
    """
    options.check()
    if not options.shots:
        # A camera takes a while to plan.
        options.frame_range(source)
    stage = options.stage(source)
    start, stop = options.frame_range(stage.source)
    if options.mp4:
        ffmpeg()
    planned = picture_files(out, (start, stop), options.mp4, options.png, options.contact_sheet)
    with (record or _unrecorded)(out, planned, stage.mark, options.facts(stage.source)) as place:
        if place.done:
            return Rendered(place.done, 0, stop - start)
        work = place.folder
        parts = work / f".video-{stage.mark[:16]}" if options.mp4 else None
        _make_folders(work, options.png, parts, stage.mark)
        works, kept = divide(stage, start, stop, work / "frames" if options.png else None, parts)
        with under_way():
            _draw(stage, source, works, options, _counter(progress, kept, stop - start))
            if parts:
                join(work / "video.mp4", segment_files(parts, start, stop))
                remove_parts(parts)
            if options.contact_sheet > 0:
                moments = sheet_frames(start, stop, options.contact_sheet)
                write_sheet(work / "contact_sheet.png", stage, moments, options.thread_count, progress)
    return Rendered(tuple(planned), sum(one.stop - one.start for one in works), kept)


def draw_apart(source: PoseSource, out: Path, options: RenderOptions, progress: Progress | None = None) -> Path:
    """Draw frames of a source as ``render`` does, but leave the segments of the video as they are.

    ``render`` of more frames takes them over where they are moved into its folder (``adopt_frames``). A range that
    begins or ends between whole segments is joined with others only where it is the first or the last one.

    Args:
        source: Where motion comes from.
        out: The folder, made when missing.
        options: What to draw, and how.
        progress: Called with stage, done and total.

    Raises:
        TakeError: The range of frames is empty or reaches beyond the source.
        CrowdsimError: The camera, an avatar or the size is invalid.
        OutputError: A folder cannot be made.
        RunError: A file cannot be written.
    """
    if not options.shots:
        # A camera takes a while to plan.
        options.frame_range(source)
    stage = options.stage(source)
    start, stop = options.frame_range(stage.source)
    parts = out / f".video-{stage.mark[:16]}" if options.mp4 else None
    _make_folders(out, options.png, parts, stage.mark)
    works, kept = divide(stage, start, stop, out / "frames" if options.png else None, parts)
    with under_way():
        _draw(stage, source, works, options, _counter(progress, kept, stop - start))
    return out


def adopt_frames(out: Path, apart: Iterable[Path]) -> None:
    """Move frames and segments of a video, drawn into other folders on the same disk, into the folder of a rendering.

    What is interrupted is finished when it is done again.

    Raises:
        OutputError: One cannot be moved.
    """
    try:
        for folder in apart:
            for place in [name for name in entries(folder) if name == "frames" or name.startswith(".video-")]:
                for path in mark_first(folder / place / name for name in entries(folder, place)):
                    move_plain(folder, f"{place}/{path.name}", out)
    except OSError as error:
        raise OutputError(f"{error.filename or out}: cannot be moved: {error.strerror or error}") from error


def picture_files(out: Path, frames: tuple[int, int], mp4: bool, png: bool, contact_sheet: int) -> list[Path]:
    """Return the files that ``render`` writes of a range of frames."""
    files = [out / "frames" / f"{frame:06d}.png" for frame in range(*frames)] if png else []
    return files + [out / "video.mp4"] * mp4 + [out / "contact_sheet.png"] * (contact_sheet > 0)


@contextmanager
def _unrecorded(out: Path, planned: Sequence[Path], mark: str, facts: Mapping[str, Any]) -> Iterator[Writing]:
    """Draw where the pictures go."""
    yield Writing(out)


def _make_folders(out: Path, png: bool, parts: Path | None, mark: str) -> None:
    """Make the folders of a rendering; segments of other videos are removed."""
    make_folder(out)
    if parts:
        for other in [out / name for name in entries(out) if name.startswith(".video-")]:
            if other != parts and is_parts(other):
                remove_parts(other)
        make_parts(parts, mark)
    if png:
        make_folder(out / "frames")


def _counter(progress: Progress | None, kept: int, total: int) -> Callable[[int], None]:
    """Return what is called with the number of frames that have become ready, and reports how many are in all."""
    done = kept

    def count(more: int) -> None:
        nonlocal done
        done += more
        if progress:
            progress("frames", done, total)

    if kept:
        count(0)
    return count


def _draw(
    stage: Stage, source: PoseSource, works: list[Work], options: RenderOptions, count: Callable[[int], None]
) -> None:
    """Draw segments, in this process or in several."""
    if options.jobs > 1 and len(works) > 1:
        share(works, source, options, count)
    else:
        for work in works:
            draw_segment(stage, work, options.thread_count, count)
