"""The command ``inspect``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.common import CORES, Json, make_folder, note, print_json, print_tree
from crowdsim.commands.progress import Bars
from crowdsim.errors import CrowdsimError, under_way


def inspect(
    thing: Annotated[
        str, typer.Argument(metavar="THING", help="A BVH file, a policy bundle or its name, or a run folder.")
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
) -> None:
    """Tell what is in a BVH file, a trained policy or a run, and draw it."""
    path = Path(thing)
    if path.is_dir() and not (path / "policy.json").exists():
        _inspect_run(path, as_json, plots)
    elif path.is_file() and path.suffix not in (".yaml", ".yml"):
        _inspect_bvh(path, as_json, plots, unit, up)
    elif path.suffix.lower() == ".bvh":
        raise CrowdsimError(f"{path}: no such file")
    else:
        _inspect_bundle(thing, as_json, plots)


def _inspect_bundle(name: str, as_json: bool, plots: Path | None) -> None:
    from crowdsim import assets
    from crowdsim.policy.bundle import read_bundle, read_timings
    from crowdsim.policy.statistics import inspect_bundle

    folder = assets.find_bundle(name)
    policy = read_bundle(folder)
    told = inspect_bundle(policy, read_timings(folder))
    if plots is not None:
        from crowdsim.policy.plots import plot_bundle

        _draw(plots, lambda: plot_bundle(policy, plots))
    _tell(folder, told, as_json)


def _inspect_run(folder: Path, as_json: bool, plots: Path | None) -> None:
    from crowdsim.manifest import NAME, read_manifest
    from crowdsim.runner import open_run
    from crowdsim.take.poses import PoseSampler
    from crowdsim.take.quality import measure_take

    take, policies, notes = open_run(folder)
    for told_note in notes:
        note(told_note)
    sampler = PoseSampler(take, policies, CORES)
    with Bars() as bars:
        told = measure_take(sampler, progress=bars)
    seconds = read_manifest(folder)["seconds"] if (folder / NAME).exists() else {}
    told["control_seconds"], told["wall_seconds"] = seconds.get("control"), seconds.get("total")
    if plots is not None:
        from crowdsim.take.plots import plot_take

        _draw(plots, lambda: plot_take(sampler, plots))
    _tell(folder, told, as_json)


def _draw(folder: Path, draw: Callable[[], list[Path]]) -> None:
    """Make pictures in a folder and say where they are."""
    make_folder(folder)
    with under_way():
        pictures = draw()
    for picture in pictures:
        note(str(picture))


def _tell(thing: Path, told: dict[str, Any], as_json: bool) -> None:
    """Print what was found of a bundle or a run, as JSON or as a tree."""
    if as_json:
        print_json(told)
        return
    print(thing)
    print_tree(told, 1)


def _inspect_bvh(path: Path, as_json: bool, plots: Path | None, unit: str | None, up: str | None) -> None:
    from crowdsim.motion.capture import load_capture
    from crowdsim.motion.report import describe_capture, study_capture

    capture = load_capture(path, unit, up)
    study = study_capture(capture)
    told = describe_capture(capture, study)
    if plots is not None:
        from crowdsim.motion.plots import plot_capture

        _draw(plots, lambda: plot_capture(capture, study, plots))
    if as_json:
        print_json(told)
        return
    _print_capture(path, told)


def _print_capture(path: Path, told: dict[str, Any]) -> None:
    scale, height = told["unit_scale"], told["height_m"]
    print(f"{path}")
    print(f"  {told['joints']} joints, {told['end_sites']} end sites, {told['channels']} channels")
    print(f"  {told['frames']} frames at {told['fps']:g} a second, {told['seconds']:.2f} s")
    print(f"  unit {f'{scale:g} m' if scale else 'unknown'}, up axis {told['up_axis'] or 'unknown'}", end="")
    print(f", body {height:.2f} m tall" if height else "")
    for role, joint in told["roles"].items():
        print(f"    {role:15} {joint}")
    if told["contacts"] is not None:
        shares = " and ".join(f"{share:.0%}" for share in told["contact_share"])
        print(f"  lead-in of {told['lead_in_frames']} frames cut off; floor at {told['floor_m']:+.3f} m")
        print(f"  {told['contacts']} foot contacts, left and right foot planted {shares} of the time")
        print(f"  {told['strikes']} strikes, highest fist speed {told['highest_fist_speed']:.1f} m/s")
        for strike in told["strike_list"]:
            place = ", ".join(f"{value:+.2f}" for value in strike["place"])
            print(f"    {strike['seconds']:8.2f} s  {strike['hand']:5}  {strike['speed']:5.1f} m/s  at ({place})")
    for finding in told["findings"]:
        print(f"{path}: {finding}", file=sys.stderr)
