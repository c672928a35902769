"""Options of ``crowdsim render``, converted to arguments of the renderer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from crowdsim.bvh.people import split_person
from crowdsim.core.types import FileName, Progress
from crowdsim.errors import CrowdsimError, OutputError
from crowdsim.render.batch import Record, Rendered, render
from crowdsim.render.look import Look
from crowdsim.render.options import RenderOptions
from crowdsim.render.source import PoseSource

__all__ = [
    "Outcome",
    "RenderOptions",
    "parse_size",
    "render_bvh",
    "render_many",
    "scenario_options",
]

SMALLEST_SIZE, LARGEST_SIZE = 16, 8192


@dataclass(frozen=True)
class Outcome:
    """What became of one file of a batch.

    Attributes:
        path: What was to be drawn.
        out: Folder of its pictures.
        rendered: What was written; None when it failed.
        error: Why it failed; None when it did not.
        notes: What a user should know: findings of a file, an unfinished run.
    """

    path: Path
    out: Path
    rendered: Rendered | None = None
    error: CrowdsimError | None = None
    notes: tuple[str, ...] = field(default=())


Open = Callable[[Path, RenderOptions], tuple[PoseSource, tuple[str, ...]]]
"""Opens one source at the rate of the options, and returns notes for the user."""


def parse_size(text: str) -> tuple[int, int]:
    """Return the width and height that '1280x720' means.

    Raises:
        CrowdsimError: It means none.
    """
    words = text.lower().replace("×", "x").split("x")
    if len(words) != 2 or not all(word.strip().isdecimal() for word in words):
        raise CrowdsimError(f"size {text!r}: expected WIDTHxHEIGHT in pixels, 1280x720 say")
    width, height = (int(word) for word in words)
    for value in (width, height):
        if not SMALLEST_SIZE <= value <= LARGEST_SIZE:
            raise CrowdsimError(f"size {text!r}: {value} is out of range, expected {SMALLEST_SIZE} to {LARGEST_SIZE}")
    return width, height


def scenario_options(output: Any, threads: int | None = None) -> RenderOptions:
    """Return how to draw what the ``outputs.render`` section of a scenario asks for."""
    return RenderOptions(
        size=tuple(output.size),
        fps=output.rate,
        frames=output.asked_frames(),
        camera=None if output.shots else output.camera,
        mp4=output.mp4,
        png=output.png,
        contact_sheet=output.contact_sheet or 0,
        look=Look.of(output),
        shots=output.shots,
        threads=threads,
    )


def render_bvh(
    path: FileName,
    out: Path,
    options: RenderOptions,
    progress: Progress | None = None,
    record: Record | None = None,
) -> tuple[Rendered, tuple[str, ...]]:
    """Draw a BVH file as a figure, by default from the front and the side; return findings about it too.

    Raises:
        BvhError: The file is no BVH or cannot be drawn.
        TakeError: Frames are asked for that it does not have.
        OutputError: A file cannot be written.
    """
    from crowdsim.render.bvh_figure import BVH_CAMERA, bvh_source

    source, findings = bvh_source(path, options.fps)
    return render(source, out, _with_camera(options, BVH_CAMERA), progress, record), findings


def _with_camera(options: RenderOptions, camera: str) -> RenderOptions:
    return options if options.camera is not None or options.shots else replace(options, camera=camera)


def render_many(
    paths: Sequence[Path],
    outs: Sequence[Path],
    options: RenderOptions,
    open_source: Open | None = None,
    progress: Progress | None = None,
    record: Record | None = None,
) -> list[Outcome]:
    """Draw several things one after the other; a failure of one hurts no other.

    Args:
        paths: BVH files, and whatever else ``open_source`` opens.
        outs: The folder of each.
        options: How to draw.
        open_source: Opens what is no BVH file, a run folder say.
        progress: Called with stage, done and total; the stage 'files' counts the things themselves.
        record: Notes the files of each, see ``crowdsim.render.batch.render``.

    Raises:
        CrowdsimError: Two of them would write into one folder, or the camera is unknown.
    """
    if len({out.resolve() for out in outs}) < len(outs):
        raise CrowdsimError("two things to draw would share an output folder, expected a folder each")
    outcomes = []
    for index, (path, out) in enumerate(zip(paths, outs, strict=True)):
        notes: tuple[str, ...] = ()
        try:
            if split_person(path)[0].suffix.lower() == ".bvh" or open_source is None:
                rendered, notes = render_bvh(path, out, options, progress, record)
            else:
                source, notes = open_source(path, options)
                rendered = render(source, out, options, progress, record)
            outcomes.append(Outcome(path, out, rendered, None, notes))
        except CrowdsimError as error:
            outcomes.append(Outcome(path, out, None, error, notes))
        except OSError as error:
            outcomes.append(
                Outcome(path, out, None, OutputError(f"{error.filename or path}: {error.strerror or error}"), notes)
            )
        if progress and len(paths) > 1:
            progress("files", index + 1, len(paths))
    return outcomes
