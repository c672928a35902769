"""What control costs, written and drawn, beside what the machine can do at best."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter_ns
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.chunk import STAGES
from crowdsim.crowd.kernels.limits import walk
from crowdsim.errors import OutputError
from crowdsim.figures import new_figure, save_figure

if TYPE_CHECKING:
    from crowdsim.crowd.profile import Profile

PAPER_NANOSECONDS = 300_000.0
"""What the paper's control cost an avatar and frame: 9 s for 30 avatars and 1000 frames on a 2.4 GHz Pentium 4."""


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
    here = walk(following, 0, steps)

    def fetch() -> None:
        nonlocal here
        here = walk(following, here, steps)

    return copying, _least(fetch) / steps


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
    """Give a temporary name beside a file, which is renamed to the file on success."""
    part = path.with_name(path.name + ".part")
    try:
        yield part
        os.replace(part, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        part.unlink(missing_ok=True)
