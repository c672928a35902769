"""What control costs: the time of every stage of every frame, summed up, written and drawn.

A simulation that is profiled takes these times itself (``Chunk.timings``); one that is not reads no clock.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.compilation import watch_compilation
from crowdsim.crowd.chunk import STAGES
from crowdsim.crowd.kernels.limits import walk as walk_along
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.warming import warm_up
from crowdsim.errors import OutputError
from crowdsim.figures import new_figure, save_figure

if TYPE_CHECKING:
    from crowdsim.crowd.arrays import Model
    from crowdsim.crowd.crowd import Crowd
    from crowdsim.crowd.script import Script
    from crowdsim.policy.policy import Policy
    from crowdsim.scenario.outputs import ProfileOutput

Array = NDArray[Any]
Progress = Callable[[str, int, int], None]

PAPER_NANOSECONDS = 300_000.0
"""What the paper's control cost an avatar and frame: 9 s for 30 avatars and 1000 frames on a 2.4 GHz Pentium 4."""


@dataclass(frozen=True)
class Costs:
    """What one stage cost a control frame, in milliseconds, and in nanoseconds an avatar-frame."""

    stage: str
    mean: float
    p50: float
    p95: float
    p99: float
    maximum: float
    nanoseconds: float


@dataclass(frozen=True)
class Profile:
    """What a run's control cost.

    Attributes:
        avatars: Number of avatars.
        threads: Threads.
        search: How nearest opponents were found: ``direct``, ``kd_tree`` or ``scipy``; several, joined by ``, ``, where
            the number of avatars passed the limit of ``auto``.
        timings: Time of each of ``STAGES`` [ns]. Shape (frames, 6), int64.
        whole: Time of all frames together, taken around them [ns]; compiling is not part of it.
        compiling: Time of compiling kernels or loading them [ns].
        rate: Control frames a second.
        bytes_per_avatar: Memory of the simulation, an avatar, beside the policies.
    """

    avatars: int
    threads: int
    search: str
    timings: Array
    whole: int
    compiling: int
    bytes_per_avatar: float
    rate: float = 15.0

    @property
    def times_real_time(self) -> float:
        """How many seconds of the crowd's motion control decides in a second, recording left out."""
        control = float(self.timings[:, : len(STAGES) - 1].sum()) * 1e-9
        return len(self.timings) / self.rate / control if control > 0.0 else float("inf")

    @property
    def costs(self) -> tuple[Costs, ...]:
        """What each stage cost, and all together under ``control``, which leaves recording out."""
        return stage_costs(self.timings, self.avatars)


def stage_costs(timings: Array, avatars: int) -> tuple[Costs, ...]:
    """Return what each stage cost, then ``control``: all stages but recording; timings (frames, 6) [ns]."""
    columns = {stage: timings[:, k] for k, stage in enumerate(STAGES)}
    columns["control"] = timings[:, : len(STAGES) - 1].sum(axis=1)
    found = []
    for stage, spent in columns.items():
        milliseconds = np.asarray(spent, dtype=float) * 1e-6
        p50, p95, p99 = np.percentile(milliseconds, [50, 95, 99])
        mean = float(milliseconds.mean())
        found.append(
            Costs(
                stage=stage,
                mean=mean,
                p50=float(p50),
                p95=float(p95),
                p99=float(p99),
                maximum=float(milliseconds.max()),
                nanoseconds=mean * 1e6 / max(avatars, 1),
            )
        )
    return tuple(found)


def profile_crowd(
    crowd: Crowd,
    policies: Sequence[Policy],
    frames: int,
    script: Script | None = None,
    threads: int = 1,
    search: str = "auto",
    progress: Progress | None = None,
) -> Profile:
    """Run a crowd for what it costs; what it does is thrown away.

    Args:
        crowd: The crowd.
        policies: Its policies.
        frames: Control frames to measure; kernels are ready before.
        script: What is planned.
        threads: Threads for large crowds.
        search: How nearest opponents are found, one of ``opponents.SEARCHES``.
        progress: Called with ("control", frames done, frames).
    """
    with watch_compilation() as compilation:
        model = warm_up(crowd, policies, script, search, profiled=True)
        profile = _measure(crowd, policies, frames, script, threads, search, model, progress)
    return replace(profile, compiling=round(compilation.seconds * 1e9))


def _measure(
    crowd: Crowd,
    policies: Sequence[Policy],
    frames: int,
    script: Script | None,
    threads: int,
    search: str,
    model: Model,
    progress: Progress | None,
) -> Profile:
    """Run a crowd whose kernels are ready."""
    simulation = Simulation(crowd, policies, script, threads, search, profiled=True, model=model)
    size = min(max(1_000_000 // max(crowd.count, 1), 1), 256)
    parts = []
    whole = 0
    try:
        while simulation.frame < frames:
            started = perf_counter_ns()
            chunk = simulation.run(min(size, frames - simulation.frame))
            whole += perf_counter_ns() - started
            assert chunk.timings is not None
            parts.append(chunk.timings)
            if progress is not None:
                progress("control", simulation.frame, frames)
    finally:
        simulation.close()
    return Profile(
        avatars=crowd.count,
        threads=threads,
        search=", ".join(simulation.searches),
        timings=np.concatenate(parts),
        whole=whole,
        compiling=0,
        bytes_per_avatar=simulation.nbytes / max(crowd.count, 1),
        rate=simulation.rate,
    )


def profile_table(profile: Profile) -> str:
    """Return a profile as a table for people."""
    lines = [
        f"{profile.avatars} avatars, {len(profile.timings)} control frames, threads: {profile.threads}, "
        f"search: {profile.search}"
    ]
    lines.append(f"{'stage':<10}{'mean':>10}{'p50':>10}{'p95':>10}{'p99':>10}{'max':>10}  {'ns/avatar-frame':>16}")
    for cost in profile.costs:
        times = "".join(f"{value:>10.4f}" for value in (cost.mean, cost.p50, cost.p95, cost.p99, cost.maximum))
        lines.append(f"{cost.stage:<10}{times}  {cost.nanoseconds:>16.0f}")
    scopes, whole = profile.timings.sum() * 1e-6, profile.whole * 1e-6
    lines.append(f"milliseconds a frame; stages add up to {scopes:.1f} ms of {whole:.1f} ms")
    lines.append(f"compiling, or loading what was compiled: {profile.compiling * 1e-9:.2f} s, no part of the above")
    lines.append(profile_verdict(profile))
    return "\n".join(lines)


def profile_verdict(profile: Profile) -> str:
    """Return what a profile comes to: ``12,000 times real time on one thread``."""
    times = profile.times_real_time
    number = f"{float(f'{times:.2g}'):,.0f}" if times >= 10 else f"{times:.1f}"
    threads = "one thread" if profile.threads == 1 else f"{profile.threads} threads"
    return f"{number} times real time on {threads}"


def write_profile(folder: Path, timings: Array, avatars: int, wanted: ProfileOutput) -> list[Path]:
    """Write ``profile.csv``, and ``profile.png`` where plots are wanted, into a run's folder; return the files."""
    files = []
    if wanted.csv:
        files.append(folder / "profile.csv")
        write_csv(files[-1], timings, avatars)
    if wanted.plots:
        files.append(folder / "profile.png")
        draw_profile(files[-1], timings, avatars)
    return files


def write_csv(path: Path, timings: Array, avatars: int) -> None:
    """Write a row for each control frame: the time of each stage and of all but recording [us].

    Raises:
        OutputError: It cannot be written.
    """
    rows = ["frame,avatars," + ",".join(f"{stage}_us" for stage in STAGES) + ",control_us"]
    for frame, spent in enumerate(timings.tolist()):
        times = ",".join(f"{value / 1000:.3f}" for value in (*spent, sum(spent[:-1])))
        rows.append(f"{frame},{avatars},{times}")
    with _written(path) as part:
        part.write_text("\n".join(rows) + "\n", encoding="utf-8")


def draw_profile(path: Path, timings: Array, avatars: int) -> None:
    """Draw what control cost: a histogram over frames, and the stages over time."""
    microseconds = np.asarray(timings, dtype=float) * 1e-3
    control = microseconds[:, :-1].sum(axis=1)
    figure = new_figure(10, 4)
    left, right = figure.subplots(1, 2)
    left.hist(control, bins=min(60, max(10, len(control) // 10)), color="#4878a8")
    left.axvline(float(np.median(control)), color="#c8553d", label=f"median {np.median(control):.1f} µs")
    left.set(xlabel="control of a frame [µs]", ylabel="frames", title=f"{avatars} avatars")
    left.legend()
    window = max(1, len(control) // 200)
    whole = len(control) // window * window
    frames = np.arange(whole).reshape(-1, window).mean(axis=1)
    smooth = microseconds[:whole].reshape(-1, window, len(STAGES)).mean(axis=1)
    right.stackplot(frames, smooth.T, labels=STAGES)
    right.set(xlabel="control frame", ylabel="time [µs]", title="stages")
    right.legend(loc="upper right", fontsize=8)
    save_figure(figure, path)


def machine_limits() -> tuple[float, float]:
    """Return what this machine's memory takes for an avatar at least, in one thread [ns].

    Returns:
        The time of copying as many bytes as an avatar has, in pieces that no cache holds; and the time of fetching a
        value whose place depends on the one before, the least of several tries each.
    """
    bytes_moved = 4 * (11 + 1) + 8 * 14
    source = np.ones(8_000_000)
    target = np.empty_like(source)
    copying = _least(lambda: np.copyto(target, source)) / source.nbytes * bytes_moved
    # A walk along one cycle through all places, each time on from where it ended, so that nothing lies in a cache yet.
    places = np.random.default_rng(0).permutation(len(source)).astype(np.int64)
    steps = 20_000
    following = np.empty_like(places)
    following[places] = np.roll(places, -1)
    here = walk_along(following, 0, steps)

    def walk() -> None:
        nonlocal here
        here = walk_along(following, here, steps)

    return copying, _least(walk) / steps


def _least(work: Callable[[], object], times: int = 5) -> float:
    """Return the least time of some runs [ns]."""
    spent = []
    for _ in range(times):
        begun = perf_counter_ns()
        work()
        spent.append(perf_counter_ns() - begun)
    return float(min(spent))


def draw_scaling(path: Path, profiles: Sequence[Profile]) -> None:
    """Draw avatars against the cost of an avatar-frame, log-log, a line for each number of threads."""
    figure = new_figure(7, 5)
    axes = figure.subplots()
    for threads in sorted({profile.threads for profile in profiles}):
        mine = sorted((p for p in profiles if p.threads == threads), key=lambda p: p.avatars)
        costs = [profile.costs[-1].nanoseconds for profile in mine]
        label = f"{threads} thread{'s' if threads > 1 else ''}"
        axes.plot([profile.avatars for profile in mine], costs, marker="o", label=label)
    axes.axhline(PAPER_NANOSECONDS, color="#888888", linestyle="--", label="Lee and Lee 2005: 0.30 ms")
    counts = [profile.avatars for profile in profiles]
    real = np.geomspace(max(min(counts), 1), max(max(counts), 10), 50)
    axes.plot(real, 1e9 / 15 / real, color="#c8553d", linestyle=":", label="real time at 15 Hz")
    copying, fetching = machine_limits()
    axes.axhline(copying, color="#6a9f58", linestyle="--", label="limit: reading and writing an avatar once")
    axes.axhline(fetching, color="#967662", linestyle="--", label="limit: one value from anywhere in memory")
    axes.set(xscale="log", yscale="log", xlabel="avatars", ylabel="control of an avatar-frame [ns]")
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    save_figure(figure, path)


@contextmanager
def _written(path: Path) -> Iterator[Path]:
    """Give a temporary name beside a file, which becomes the file's where all goes well."""
    part = path.with_name(path.name + ".part")
    try:
        yield part
        os.replace(part, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        part.unlink(missing_ok=True)
