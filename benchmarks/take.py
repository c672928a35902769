"""A long run that writes only its take: what does writing cost beside control, and what does a kill cost?

    python benchmarks/take.py [--json] [--quick] [--frames N] [--avatars N]

``long``: ``brawl_30`` for 150,000 control frames without outputs. ``writing_over_control`` is the time of writing the
take over that of control; ``files`` are those of the take.

``killed``: the same run ends without a word after a third of its frames, and the same command is given again.
``lost_frames`` are simulated again; ``lost_seconds`` is their share of the first run's time. ``control_seconds`` is
what control of the second run takes, and ``finish_seconds`` all of it: what is there is read and counted again.
``identical`` says whether all files of the take are.

``read``: ``short_milliseconds`` is what ten control frames of one variable take, at random places of the long take one
after the other, ``near_milliseconds`` likewise where each place is next to the one before, ``open_milliseconds`` what
it takes to open it.

``large``: ``crowd_1m`` for 8 control frames. ``writing_over_disk`` is the time of writing the take over the time of
writing what it holds to one file, uncompressed, until it is on disk; both with what is constant of each avatar.
"""

from __future__ import annotations

import json
import os
import tempfile
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from _quick import command_line, small_policies

from crowdsim.runs.checkpoint import frames_done
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.runner import run_to
from crowdsim.scenario.scenario import Scenario, load_scenario
from crowdsim.take.layout import CAST
from crowdsim.take.store import open_take
from crowdsim.take.take import VARIABLES

FRAMES, QUICK_FRAMES = 150_000, 3000
AVATARS, QUICK_AVATARS = 1_000_000, 2000
LARGE_FRAMES = 8
READS = 200
ROWS = 10


class Killed(BaseException):
    """The process is gone."""


class Kill:
    """Ends a run at a control frame as if it had been killed there; called with stage, done and total.

    Attributes:
        reached: Control frames that had been simulated.
    """

    def __init__(self, frame: int) -> None:
        self._frame, self.reached = frame, 0

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Look whether it is time."""
        if stage == "control" and done >= self._frame:
            self.reached = done
            raise Killed


def contents(take: Path) -> dict[str, bytes]:
    """Return the files of a take."""
    return {path.relative_to(take).as_posix(): path.read_bytes() for path in take.rglob("*") if path.is_file()}


def run_long(scenario: Scenario, folder: Path) -> dict[str, Any]:
    """Return what the parts of a run take."""
    run_to(folder, scenario)
    seconds, files = read_manifest(folder)["seconds"], contents(folder / "take.zarr")
    return {
        "frames": open_take(folder).frame_count,
        "control_seconds": seconds["control"],
        "writing_seconds": seconds["take"],
        "writing_over_control": seconds["take"] / seconds["control"],
        "checkpoint_share": seconds["checkpoints"] / seconds["total"],
        "total_seconds": seconds["total"],
        "files": len(files),
        "megabytes": sum(map(len, files.values())) / 1e6,
        "checkpoint_megabytes": (folder / "checkpoint.bin").stat().st_size / 1e6,
    }


def run_killed(scenario: Scenario, folder: Path, frames: int, undisturbed: Path) -> dict[str, Any]:
    """Return what a run costs that is killed after a third of its frames."""
    kill, since = Kill(frames // 3), perf_counter()
    with suppress(Killed):
        run_to(folder, scenario, progress=kill)
    first = perf_counter() - since
    done = frames_done(folder)
    report = run_to(folder, scenario)
    seconds = report.seconds
    simulated = frames - report.continued_at
    return {
        "killed_after_frames": kill.reached,
        "checkpoint_frames": done,
        "lost_frames": kill.reached - report.continued_at,
        "lost_seconds": first * (kill.reached - report.continued_at) / kill.reached,
        "control_seconds": seconds["control"],
        "control_milliseconds_per_frame": 1000 * seconds["control"] / simulated,
        "finish_seconds": seconds["total"],
        "identical": contents(folder / "take.zarr") == contents(undisturbed / "take.zarr"),
    }


def read(folder: Path) -> dict[str, float]:
    """Return what it takes to open a take and to read a little of it [ms]."""
    since = perf_counter()
    take = open_take(folder)
    opened = perf_counter() - since
    places = np.random.default_rng(1).integers(0, take.frame_count - ROWS, READS)
    near = np.arange(READS) * ROWS % (take.frame_count - ROWS)
    found = {"open_milliseconds": 1000 * opened}
    for name, firsts in (("short", places), ("near", near)):
        since = perf_counter()
        for first in firsts.tolist():
            take.x[first : first + ROWS]
        found[f"{name}_milliseconds"] = 1000 * (perf_counter() - since) / READS
    return found


def run_large(folder: Path, avatars: int) -> dict[str, float]:
    """Return what writing the take of a large crowd costs beside writing as many bytes."""
    scenario = load_scenario("crowd_1m", ["outputs={}"], frames=LARGE_FRAMES, fraction=avatars / AVATARS)
    run_to(folder, scenario, threads=os.cpu_count() or 1)
    seconds, files, take = read_manifest(folder)["seconds"], contents(folder / "take.zarr"), open_take(folder)
    rows = [np.asarray(getattr(take, name)) for name in VARIABLES]
    constant = [getattr(take.cast, name) for name in CAST.values()]
    since = perf_counter()
    with open(folder / "plain.bin", "wb") as file:
        for values in (*rows, *constant):
            file.write(np.ascontiguousarray(values).data)
        file.flush()
        os.fsync(file.fileno())
    disk = perf_counter() - since
    return {
        "avatars": take.avatar_count,
        "files": len(files),
        "megabytes": sum(map(len, files.values())) / 1e6,
        "control_seconds": seconds["control"],
        "writing_seconds": seconds["take"],
        "writing_over_control": seconds["take"] / seconds["control"],
        "writing_over_disk": seconds["take"] / disk,
        "plain_megabytes": (folder / "plain.bin").stat().st_size / 1e6,
    }


def measure(frames: int, avatars: int) -> dict[str, Any]:
    """Return all figures."""
    scenario = load_scenario("brawl_30", ["outputs={}"], frames=frames)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # Kernels are compiled and loaded, the policy trained.
        run_to(folder / "warm", load_scenario("brawl_30", ["outputs={}"], frames=100))
        report = {"long": run_long(scenario, folder / "long")}
        report["read"] = read(folder / "long")
        report["killed"] = run_killed(scenario, folder / "killed", frames, folder / "long")
        report["large"] = run_large(folder / "large", avatars)
    return report


def main() -> None:
    """Measure and print."""
    parser = command_line(__doc__, "few frames and a small policy: it runs, no more")
    parser.add_argument("--frames", type=int, default=FRAMES, help="control frames of the long run")
    parser.add_argument("--avatars", type=int, default=AVATARS, help="avatars of the large crowd")
    options = parser.parse_args()
    sizes = (QUICK_FRAMES, QUICK_AVATARS) if options.quick else (options.frames, options.avatars)
    with small_policies(wanted=options.quick):
        report = measure(*sizes)
    if options.json:
        print(json.dumps(report, indent=2))
        return
    for part, figures in report.items():
        print(part)
        for name, value in figures.items():
            print(f"  {name:<30} {value:.4g}" if isinstance(value, float) else f"  {name:<30} {value:,}")


if __name__ == "__main__":
    main()
