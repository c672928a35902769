"""The command ``profile``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.common import Json, Mocap, Search, complete_scenario, print_json
from crowdsim.commands.progress import Bars
from crowdsim.errors import CrowdsimError, under_way
from crowdsim.files import make_folder


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
    as_json: Json = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for profile.csv, profile.png and scaling.png.")
    ] = None,
    trace: Annotated[bool, typer.Option("--trace", help="Write trace.json for Perfetto, too; needs --out.")] = False,
    writing: Annotated[bool, typer.Option("--writing", help="Measure what writing the outputs costs, too.")] = False,
    override: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Another value.")] = None,
    mocap: Mocap = None,
) -> None:
    """Measure what control costs a frame, by stage, for any number of avatars and threads."""
    from crowdsim.compilation import watch_compilation
    from crowdsim.crowd.profile import profile_table
    from crowdsim.crowd.profile_files import draw_profile, draw_scaling, write_csv
    from crowdsim.preparation.prepare import load_policies
    from crowdsim.runs import profiling
    from crowdsim.scenario.frame_ranges import parse_length
    from crowdsim.scenario.scenario import load_scenario

    counts = profiling.parse_counts(avatars, "--avatars") if avatars is not None else []
    numbers = profiling.parse_counts(threads, "--threads")
    if trace and out is None:
        raise CrowdsimError("--trace needs a folder to write into, expected --out DIR")
    length = None if frames is None else parse_length(frames)
    loaded = load_scenario(scenario, override or (), frames=length, search=search)
    with Bars() as bars, watch_compilation(bars.note):
        policies = load_policies(loaded, mocap, max(numbers), bars)
        profiles = profiling.profile_scenario(loaded, policies, counts, numbers, progress=bars)
    seconds = profiling.time_writing(loaded, policies, max(numbers)) if writing else None
    if out is not None:
        make_folder(out)
        first = profiles[0]
        with under_way():
            write_csv(out / "profile.csv", first.timings, first.avatars)
            draw_profile(out / "profile.png", first.timings, first.avatars)
            draw_scaling(out / "scaling.png", profiles)
            if trace:
                profiling.write_trace(out / "trace.json", first)
    if as_json:
        document: dict[str, Any] = {"scenario": loaded.name, "profiles": [profiling.describe(one) for one in profiles]}
        print_json(document if seconds is None else {**document, "writing_seconds": seconds})
        return
    print("\n\n".join(profile_table(one) for one in profiles))
    if seconds is not None:
        print("\na whole run: " + ", ".join(f"{stage} {value:.2f} s" for stage, value in seconds.items()))
