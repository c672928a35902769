"""The table of README.md: the figures that matter to users."""

from __future__ import annotations

from collections.abc import Callable

from _results import Results, number, percent, scaled, whole

MILLIONS = scaled(1e-6, " M")


def figures(results: Results) -> list[str]:
    """Return the short table of figures."""
    get = results.cell
    rows = [
        ["`crowdsim run brawl_30`, BVH and point clouds included: the first run, later runs",
         f"{get(scaled(1.0, ' s'), 'first_result', 'cold', 'wall_seconds')}, "
         f"{get(scaled(1.0, ' s'), 'first_result', 'warm', 'run_seconds')}", ""],
        ["control of 30 boxers for 67 s", get(scaled(1.0, " ms"), "control", "brawl_30", "milliseconds"),
         "the paper: 9 s"],
        ["control of a million boxers (`crowd_1m`), one frame",
         get(scaled(1.0, " ms"), "control", "crowd_1m", "milliseconds"),
         "real time: 67 ms"],
        ["100,000 agents on one thread, agent-steps per second",
         get(MILLIONS, "control", "jupedsim", "ours_per_second"),
         f"JuPedSim: {get(MILLIONS, 'control', 'jupedsim', 'agent_steps_per_second')}"],
        ["video at 1280x720 of 30 / 1,000 / 10,000 boxers, frames per second",
         " / ".join(get(number, "render", "fps", count) for count in ("30", "1000", "10000")),
         f"Open3D, 30 boxers: {get(number, 'render', 'open3d', 'fps_30')}"],
        ["first picture of 10,000 / 100,000 boxers, whole command in a fresh process; nothing compiled",
         "; ".join(" / ".join(get(scaled(1.0, " s"), "render", "commands", count, row, "wall_seconds")
                              for count in ("10000", "100000")) for row in ("warm", "cold")), ""],
        ["30 boxers over 60,000 control frames to BVH at 15 frames per second, likewise",
         "; ".join(get(scaled(1.0, " s"), "export", "commands", row, "wall_seconds") for row in ("warm", "cold")), ""],
        ["BVH read / written to a file, MB/s",
         f"{get(whole, 'bvh', 'read_mb_per_s', 'crowdsim')} / "
         f"{get(whole, 'bvh', 'write_mb_per_s', 'crowdsim, to a file')}",
         f"pybvh: {get(whole, 'bvh', 'read_mb_per_s', 'pybvh')} / "
         f"{get(whole, 'bvh', 'write_mb_per_s', 'pybvh, to a file')}"],
        ["1000 PLY clouds of 15,000 labelled points", get(scaled(1.0, " s"), "export", "clouds", "ply"), ""],
        ["strikes thrown / landed per avatar per minute in `brawl_30`",
         " / ".join(get(number, "scenes", "brawl_30", "mean", f"{what}_per_minute") for what in ("thrown", "landed")),
         ""],
        ["fists further than 2 cm from what they hit",
         get(percent, "blows", "brawl_30", "fists_beyond_2_cm", "mean"), ""],
        ["slide of planted feet, median", get(scaled(1.0, " m/s"), "exported", "brawl_30", "feet", "slide", "median"),
         f"the captured motion: "
         f"{get(scaled(1.0, ' m/s'), 'exported', 'brawl_30', 'feet', 'slide_of_all_the_capture', 'median')}"],
    ]  # fmt: skip
    benchmarks = ("first_result", "control", "render", "bvh", "export", "scenes", "blows", "exported")
    return results.table(["", "crowdsim", "beside"], rows, *benchmarks)


USER_TABLES: dict[str, Callable[[Results], list[str]]] = {"figures": figures}
