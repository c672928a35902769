"""The command ``export``, with an option for each output that is written from poses, and for each of their keys."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.common import Force, Frames, Threads, add_options, fps_option, note, say, size_text
from crowdsim.commands.process import opened_run
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES


def export(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder, or its archive.")],
    avatars: Annotated[
        str | None,
        typer.Option(metavar="AVATARS", help="Numbers or names of avatars: 0-9 or 0,3,red_1; all by default."),
    ] = None,
    frames: Frames = None,
    fps: Annotated[float | None, fps_option("Output frames a second; the scenario's")] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of bvh/, ply/ and the like; the run's, or one beside an archive."),
    ] = None,
    threads: Threads = CORES,
    force: Force = False,
    **options: Any,
) -> None:
    """Export a run's take in other formats, without simulating again; in the run's folder it replaces them."""
    from crowdsim.compilation import watch_compilation
    from crowdsim.export.posed import AVATARS
    from crowdsim.runs.exports import EXPORTS, choose_outputs
    from crowdsim.runs.opening import open_run

    kinds = [kind for kind in EXPORTS if options.pop(kind)]
    target = out or (folder.with_suffix("") if folder.is_file() else folder)
    with opened_run(folder) as unpacked:
        run = open_run(unpacked)
        for line in run.notes:
            note(line)
        outputs = choose_outputs(run, kinds, fps or run.fps, frames, avatars, **options)
        uses = list(dict.fromkeys(output.kernels for output in outputs))
        with Bars() as bars, watch_compilation(bars.note, uses, threads):
            written = run.write(outputs, target, threads, bars, force)
    for kind, files in written.items():
        size = sum(path.stat().st_size for path in files)
        count = sum(path.name != AVATARS for path in files)
        what = f"{count:,} file{'s' if count > 1 else ''} and {AVATARS}, {size_text(size)}"
        empty = f"{AVATARS} only: none of these avatars is present in these frames"
        say(f"{target / kind}: {what if count else empty}")


def with_outputs(command: Callable[..., None]) -> Callable[..., None]:
    """Return ``export`` with an option for each output, and for each of the keys that only some have.

    What outputs there are is looked up where this command is called, since others start faster without.
    """
    from crowdsim.export.posed import PosedOutput
    from crowdsim.runs.exports import EXPORTS

    options: dict[str, tuple[Any, Any]] = {}
    keys: dict[str, list[str]] = {}
    for name, output in EXPORTS.items():
        options[name] = Annotated[bool, typer.Option(f"--{name}", help=output.about)], False
        for key in output.model_fields:
            if key not in PosedOutput.model_fields:
                keys.setdefault(key, []).append(name)
    for key, kinds in keys.items():
        field = EXPORTS[kinds[0]].model_fields[key]
        if field.annotation is bool:
            about = f"{(field.description or '').replace('`', '')} For {', '.join(kinds)}."
            options[key] = Annotated[bool | None, typer.Option(help=about)], None
            continue
        kind = next((one for one in (int, float) if field.annotation in (one, one | None)), str)
        low, high = (
            next((getattr(one, word) for one in field.metadata if kind is not str and hasattr(one, word)), None)
            for word in ("ge", "le")
        )
        default = "" if field.default is None else f" {field.default} by default."
        about = f"{(field.description or '').replace('`', '')}{default} For {', '.join(kinds)}."
        metavar = "N" if kind is not str else "NAMES" if "tuple" in str(field.annotation) else "NAME"
        options[key] = Annotated[kind | None, typer.Option(metavar=metavar, min=low, max=high, help=about)], None
    return add_options(functools.partial(command), command, options, at=1)
