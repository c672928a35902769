"""The command ``profile``."""

from __future__ import annotations

import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdsim.commands.common import Device, Force, Json, Mocap, Search, complete_scenario, print_json
from crowdsim.commands.progress import Bars
from crowdsim.errors import CrowdsimError

if TYPE_CHECKING:
    from crowdsim.scenario.scenario import Scenario


def profile(
    scenario: Annotated[
        str,
        typer.Argument(metavar="SCENARIO", help="A scenario file, or its name.", autocompletion=complete_scenario),
    ],
    avatars: Annotated[
        str | None, typer.Option(metavar="NUMBERS", help="Numbers of avatars, 30,1000,10k say; the scenario's own.")
    ] = None,
    threads: Annotated[str, typer.Option(metavar="NUMBERS", help="Numbers of threads, 1,2 say.")] = "1",
    frames: Annotated[
        str | None,
        typer.Option(metavar="N", help="Control frames to measure, or seconds as in 20s; the scenario's duration."),
    ] = None,
    search: Search = None,
    device: Device = "cpu",
    as_json: Json = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for profile.csv, profile.png and scaling.png.")
    ] = None,
    trace: Annotated[bool, typer.Option("--trace", help="Write trace.json for Perfetto, too; needs --out.")] = False,
    writing: Annotated[bool, typer.Option("--writing", help="Measure what writing the outputs costs, too.")] = False,
    override: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Another value.")] = None,
    mocap: Mocap = None,
    force: Force = False,
) -> None:
    """Measure what control costs a frame, by stage, for any number of avatars and threads."""
    from crowdsim.compilation import watch_compilation
    from crowdsim.crowd import profiling
    from crowdsim.crowd.cuda.device import choose_device
    from crowdsim.crowd.profile import profile_table
    from crowdsim.crowd.profile_files import draw_profile, draw_scaling, write_csv
    from crowdsim.preparation.prepare import load_policies
    from crowdsim.runs.manifest import FILES
    from crowdsim.runs.stage import Wanted, write_together
    from crowdsim.scenario.scenario import load_scenario

    counts = profiling.parse_counts(avatars, "--avatars") if avatars is not None else []
    numbers = profiling.parse_counts(threads, "--threads")
    if trace and out is None:
        raise CrowdsimError("--trace needs a folder to write into, expected --out DIR")
    loaded = load_scenario(scenario, override or (), frames=frames, search=search)
    choose_device(device, max(counts or [loaded.avatar_count]), loaded.opponents.search)
    with ExitStack() as stack:
        place = None
        if out is not None:
            names = {"profile.csv", "profile.png", "scaling.png"} | ({"trace.json"} if trace else set())
            # Another measurement is never the same, so it is never done already.
            facts = {"scenario": loaded.name, "measured": time.time_ns()}
            wanted = Wanted(FILES, {"profile": facts}, names)
            place = stack.enter_context(write_together(out, wanted, force=force)).folder
        with Bars() as bars, watch_compilation(bars.note):
            policies = load_policies(loaded, mocap, max(numbers), bars)
            profiles = profiling.profile_scenario(loaded, policies, counts, numbers, progress=bars, device=device)
        seconds = _time_writing(loaded, max(numbers), device) if writing else None
        if place is not None:
            first = profiles[0]
            write_csv(place / "profile.csv", first.timings, first.avatars)
            draw_profile(place / "profile.png", first.timings, first.avatars)
            draw_scaling(place / "scaling.png", profiles)
            if trace:
                profiling.write_trace(place / "trace.json", first)
    if as_json:
        document: dict[str, Any] = {"scenario": loaded.name, "profiles": [profiling.describe(one) for one in profiles]}
        print_json(document if seconds is None else {**document, "writing_seconds": seconds})
        return
    print("\n\n".join(profile_table(one) for one in profiles))
    if seconds is not None:
        print("\na whole run: " + ", ".join(f"{stage} {value:.2f} s" for stage, value in seconds.items()))


def _time_writing(scenario: Scenario, threads: int, device: str) -> dict[str, float]:
    """Return what a run of the scenario spends on control and on each thing that it writes [s]; nothing is kept."""
    from crowdsim.runs.runner import run_to

    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        report = run_to(Path(folder) / "run", scenario, threads, device=device)
        return {**report.seconds, "total": time.perf_counter() - started}
