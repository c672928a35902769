"""The command ``render``."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdsim.commands.common import Force, Frames, Threads, fps_option, note, say
from crowdsim.commands.process import opened_run
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES

if TYPE_CHECKING:
    from crowdsim.files import Writing
    from crowdsim.render.take_source import TakeSource


def render(
    things: Annotated[list[Path], typer.Argument(metavar="RUN|FILE.bvh", help="Runs, their archives, BVH files.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the pictures; with several things their parent.")
    ] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Width and height, 1280x720 say.")] = "1280x720",
    fps: Annotated[float | None, fps_option("Pictures a second; the scenario's or BVH file's own")] = None,
    frames: Frames = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="auto, fight, orbit, top, side, front, follow:AVATAR, eye:AVATAR, fight:AVATAR,AVATAR; "
            "one of the scenario's; FILE.yaml#NAME; front+side for BVH files.",
        ),
    ] = None,
    shots: Annotated[
        Path | None, typer.Option(metavar="FILE.yaml", help="Edited video of the shots of a file or scenario.")
    ] = None,
    png: Annotated[bool, typer.Option("--png", help="Write numbered PNG.")] = False,
    mp4: Annotated[bool, typer.Option("--mp4", help="Write video.mp4; so it is when nothing else is named.")] = False,
    contact_sheet: Annotated[int, typer.Option(metavar="N", min=0, max=400, help="Write one PNG of N moments.")] = 0,
    marks: Annotated[str, typer.Option(metavar="none|landed|all", help="Which strikes have marks.")] = "all",
    grid: Annotated[bool, typer.Option(help="Squares of a metre on the floor.")] = True,
    background: Annotated[
        str, typer.Option(metavar="NAME", help="day, dark, studio, white, black, green or a colour as '#rrggbb'.")
    ] = "day",
    light: Annotated[str, typer.Option(metavar="NAME", help="day, soft, evening or night.")] = "day",
    figure: Annotated[
        str, typer.Option(metavar="auto|body|capsules", help="What avatars are seen as; auto: bodies from near.")
    ] = "auto",
    transparent: Annotated[bool, typer.Option("--transparent", help="PNG of the figures alone.")] = False,
    caption: Annotated[bool, typer.Option(help="A small caption in the picture.")] = True,
    motion_blur: Annotated[
        int, typer.Option(metavar="N", min=0, max=64, help="Moments that a picture mixes, of half a frame; 0 for none.")
    ] = 0,
    threads: Threads = CORES,
    jobs: Annotated[int, typer.Option(metavar="N", min=1, max=256, help="Processes that draw.")] = 1,
    force: Force = False,
) -> None:
    """Render runs and BVH files to PNG, MP4 and contact sheets."""
    from crowdsim.bvh.people import split_person
    from crowdsim.compilation import watch_compilation
    from crowdsim.render.command import parse_size, render_many
    from crowdsim.render.look import Look
    from crowdsim.render.options import RenderOptions
    from crowdsim.runs.opening import open_run
    from crowdsim.runs.stage import record_pictures
    from crowdsim.scenario.camera_files import read_shots
    from crowdsim.scenario.frame_ranges import parse_frames

    options = RenderOptions(
        size=parse_size(size),
        fps=fps,
        frames=None if frames is None else parse_frames(frames),
        camera=camera,
        mp4=mp4 or not (png or contact_sheet),
        png=png,
        contact_sheet=contact_sheet,
        look=Look(marks, grid, background, light, transparent, caption, motion_blur, figure),
        shots=() if shots is None else read_shots(shots),
        threads=threads,
        jobs=jobs,
    )

    unpacked = ExitStack()

    def open_source(path: Path, wanted: RenderOptions) -> tuple[TakeSource, tuple[str, ...]]:
        folder = unpacked.enter_context(opened_run(path))
        run = open_run(folder)
        return run.source(wanted.fps or run.fps, threads), run.notes

    def record(folder: Path, *more: Any) -> AbstractContextManager[Writing]:
        return record_pictures(folder, *more, run=runs.get(folder), force=force, threads=threads)

    if out is not None and len(things) == 1:
        outs = [out]
    else:
        outs = [
            out / _without_suffix(thing).name
            if out is not None
            else _without_suffix(thing)
            if split_person(thing)[0].suffix.lower() == ".bvh" or thing.is_file()
            else thing
            for thing in things
        ]
    runs = {to: thing for thing, to in zip(things, outs, strict=True) if thing.is_dir()}
    with unpacked, Bars() as bars, watch_compilation(bars.note, ["pictures"], threads):
        outcomes = render_many(things, outs, options, open_source, bars, record)
    failed = [outcome for outcome in outcomes if outcome.error is not None]
    for outcome in outcomes:
        for message in outcome.notes:
            note(f"{outcome.path}: {message}")
        if outcome.rendered is not None:
            for path in outcome.rendered.files[:4]:
                say(str(path))
        else:
            print(outcome.error, file=sys.stderr)
    if failed:
        error = failed[0].error
        sys.exit(1 if len(things) > 1 or error is None else error.exit_code)


def _without_suffix(thing: Path) -> Path:
    """Return a path without its suffix: ``capture#2`` for ``capture.bvh#2``."""
    from crowdsim.bvh.people import split_person

    file, number = split_person(thing)
    return file.with_suffix("") if number is None else file.with_name(f"{file.stem}#{number}")
