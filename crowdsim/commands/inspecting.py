"""The command ``inspect``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.common import Force, Json, note, print_json
from crowdsim.commands.process import opened_run
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError


def inspect(
    thing: Annotated[
        str,
        typer.Argument(metavar="THING", help="A BVH file, a policy bundle or its name, a run or its archive."),
    ],
    as_json: Json = False,
    plots: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for pictures.")] = None,
    unit: Annotated[
        str | None,
        typer.Option(metavar="UNIT", help="Unit of a BVH file: m, cm, mm, inch, cmu or metres; found by default."),
    ] = None,
    up: Annotated[
        str | None, typer.Option(metavar="AXIS", help="Up axis of a BVH file: y, z, -y ...; found by default.")
    ] = None,
    faults: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            metavar="KIND=WHAT",
            help="What is done about a kind of fault of a BVH file: repair, keep or refuse; time_base=120 is a rate.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Describe a BVH file, a trained policy or a run in words and figures, and draw it.

    Where numbers of a BVH file are missing or wrong, or it is not to be trained on, the exit code is 2.
    """
    from crowdsim.bvh.people import split_person
    from crowdsim.runs.archive import is_archive

    path = Path(thing)
    if (path.is_dir() and not (path / "policy.json").exists()) or is_archive(path):
        with opened_run(path) as folder:
            _inspect_run(folder, as_json, plots, force)
    elif split_person(path)[0].is_file() and path.suffix not in (".yaml", ".yml"):
        _inspect_bvh(path, as_json, plots, (unit, up, _choices(faults or [])), force)
    elif path.suffix.lower() == ".bvh":
        raise CrowdsimError(f"{path}: no such file")
    else:
        _inspect_bundle(thing, as_json, plots, force)


def _inspect_bundle(name: str, as_json: bool, plots: Path | None, force: bool) -> None:
    from crowdsim.commands.policy_text import policy_lines
    from crowdsim.policy.bundle import load_policy, read_timings
    from crowdsim.training.statistics import inspect_bundle
    from crowdsim.training.train import find_bundle

    with Bars() as bars:
        folder = find_bundle(name, bars)
    policy = load_policy(folder)
    result = inspect_bundle(policy, read_timings(folder))
    result["warnings"] = _graph_warnings(result)
    if policy.falls is not None and "falls" in result:
        share = 2 if result["motion"]["mirrored"] else 1
        result["falls"] = {**result["falls"], "celebrations": len(policy.falls.cheer) // share}
    if plots is not None:
        from crowdsim.training.plots import plot_bundle

        _draw(plots, folder, lambda place: plot_bundle(policy, place), force)
    _print(folder, result, policy_lines, as_json)


def _graph_warnings(figures: dict[str, Any]) -> list[str]:
    """Return the warnings of a policy, without those of clips that are used beside its graph, as rests or falls."""
    kept = figures["motion"]["frames_kept_by_clip"]
    used = tuple(f"clip {name!r} drops out of the motion graph" for name, frames in kept.items() if frames)
    return [warning for warning in figures["warnings"] if not warning.startswith(used)]


def _inspect_run(folder: Path, as_json: bool, plots: Path | None, force: bool) -> None:
    from crowdsim.compilation import watch_compilation
    from crowdsim.poses.sampler import PoseSampler
    from crowdsim.runs.manifest import NAME, read_manifest
    from crowdsim.runs.opening import open_run
    from crowdsim.take.quality import measure_take
    from crowdsim.take.run_text import run_lines

    run = open_run(folder)
    for line in run.notes:
        note(line)
    sampler = PoseSampler(run, run.policies, CORES)
    with Bars() as bars, watch_compilation(bars.note):
        result = measure_take(sampler, bars, CORES)
    manifest = read_manifest(folder, ("seconds",)) if (folder / NAME).exists() else {"seconds": {}}
    seconds, result["outcome"] = manifest["seconds"], manifest.get("outcome")
    result["control_seconds"], result["wall_seconds"] = seconds.get("control"), seconds.get("total")
    if plots is not None:
        from crowdsim.take.plots import plot_take

        _draw(plots, folder, lambda place: plot_take(sampler, place), force)
    _print(folder, result, run_lines, as_json)


def _draw(folder: Path, thing: str | Path, draw: Callable[[Path], list[Path]], force: bool) -> None:
    """Make pictures of a thing in a folder and say where they are."""
    from crowdsim.runs.manifest import FILES
    from crowdsim.runs.stage import Wanted, write_together

    with write_together(folder, Wanted(FILES, {"plots": {"of": str(thing)}}), force=force) as writing:
        pictures = writing.done or draw(writing.folder)
    for picture in pictures:
        note(str(folder / picture.name))


def _print(
    thing: Path, figures: dict[str, Any], lines: Callable[[dict[str, Any]], Iterable[str]], as_json: bool
) -> None:
    """Print figures as one JSON document, or what they are figures of and lines of text."""
    if as_json:
        print_json(figures)
        return
    print(thing)
    for line in lines(figures):
        print(line)


def _choices(words: list[str]) -> dict[str, str | float]:
    """Return what is to be done about kinds of faults, from ``kind=what``."""
    choices: dict[str, str | float] = {}
    for word in words:
        kind, equals, what = word.partition("=")
        if not equals:
            raise CrowdsimError(f"--fault {word}: expected KIND=WHAT, such as in_place=keep")
        try:
            choices[kind] = float(what)
        except ValueError:
            choices[kind] = what
    return choices


def _inspect_bvh(
    path: Path,
    as_json: bool,
    plots: Path | None,
    given: tuple[str | None, str | None, dict[str, str | float]],
    force: bool,
) -> None:
    from crowdsim.capture.encounters import describe_encounters, find_encounters
    from crowdsim.capture.loading import load_people, with_path
    from crowdsim.capture.report import describe_capture
    from crowdsim.commands.capture_text import capture_lines, encounter_lines

    people = load_people(path, *given)
    figures = [describe_capture(capture) for capture in people]
    encounters = describe_encounters(people, find_encounters(people))
    if plots is not None:
        from crowdsim.capture.plots import plot_capture

        if len(people) > 1:
            raise CrowdsimError(f"{path}: --plots draws one person, expected {people[0].clip.source} or another number")
        _draw(plots, path, lambda place: plot_capture(people[0], place), force)
    if as_json:
        print_json(figures[0] if len(people) == 1 else {"people": figures, "encounters": encounters})
    else:
        for capture, result in zip(people, figures, strict=True):
            _print(Path(capture.clip.source), result, capture_lines, False)
            for finding in result["findings"]:
                print(with_path(finding, capture.clip.source), file=sys.stderr)
        for line in encounter_lines(encounters):
            print(line)
    if any(capture.bvh.faults or any(one.refused for one in capture.diagnoses) for capture in people):
        sys.exit(2)
