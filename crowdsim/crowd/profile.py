"""What control costs: the time of every stage of every frame, summed up.

A simulation that is profiled takes these times itself (``Chunk.timings``); one that is not reads no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter_ns
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.compilation import watch_compilation
from crowdsim.core.types import Array, Progress
from crowdsim.crowd.chunk import STAGES
from crowdsim.crowd.cuda.device import choose_device
from crowdsim.crowd.jit_warmup import warm_up
from crowdsim.crowd.simulation import Simulation

if TYPE_CHECKING:
    from crowdsim.crowd.arrays import Model
    from crowdsim.crowd.crowd import Crowd


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
        device: Where control ran, ``cpu`` or ``cuda``.
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
    device: str
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
    frames: int,
    threads: int = 1,
    search: str = "auto",
    progress: Progress | None = None,
    device: str = "cpu",
) -> Profile:
    """Run a crowd for what it costs; what it does is thrown away.

    Args:
        crowd: The crowd.
        frames: Control frames to measure, fewer where the run ends before; kernels are ready before.
        threads: Threads for large crowds.
        search: How nearest opponents are found, one of ``scenario.groups.SEARCHES``.
        progress: Called with ("control", frames done, frames).
        device: Where control runs, one of ``cuda.device.DEVICES``.
    """
    device = choose_device(device, crowd.count, search)
    with watch_compilation() as compilation:
        model = warm_up(crowd, search, True, device, progress)
        profile = _measure(crowd, frames, threads, search, model, progress, device)
    return replace(profile, compiling=round(compilation.seconds * 1e9))


def _measure(
    crowd: Crowd,
    frames: int,
    threads: int,
    search: str,
    model: Model,
    progress: Progress | None,
    device: str,
) -> Profile:
    """Run a crowd whose kernels are ready."""
    simulation = Simulation(crowd, threads, search, profiled=True, model=model, device=device)
    size = min(max(1_000_000 // max(crowd.count, 1), 1), 256)
    parts = []
    whole = 0
    try:
        while simulation.frame < frames and not simulation.is_over:
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
        device=device,
        search="kd_tree" if device == "cuda" else ", ".join(simulation.searches),
        timings=np.concatenate(parts),
        whole=whole,
        compiling=0,
        bytes_per_avatar=simulation.nbytes / max(crowd.count, 1),
        rate=simulation.rate,
    )


def profile_table(profile: Profile) -> str:
    """Return a profile as a table for people."""
    lines = [
        f"{profile.avatars} avatars, {len(profile.timings)} control frames, device: {profile.device}, "
        f"threads: {profile.threads}, search: {profile.search}"
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
    where = "one thread" if profile.threads == 1 else f"{profile.threads} threads"
    if profile.device == "cuda":
        where = "a GPU"
    return f"{number} times real time on {where}"
