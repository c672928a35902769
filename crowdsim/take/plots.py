"""Pictures of a run: where strikes land, how far opponents are, which actions are used."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.crowd.record import TakeData
from crowdsim.figures import new_figure, save_figure
from crowdsim.poses.sampler import PoseSampler
from crowdsim.take.hits_plot import hit_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_take(sampler: PoseSampler, folder: Path) -> list[Path]:
    """Write the pictures of a run as PNG files and return their paths.

    Args:
        sampler: Poses of its take.
        folder: Where to write; made where it is missing.

    Raises:
        OutputError: The folder or a file cannot be written.
    """
    take = sampler.take
    figures = {
        "hits.png": hit_figure(sampler),
        "distances.png": distance_figure(take),
        "actions.png": action_figure(take),
    }
    return [save_figure(figure, folder / name) for name, figure in figures.items()]


def distance_figure(take: TakeData) -> Figure:
    """Draw the distance to the opponent over time: the median, and the middle half and nine tenths of avatars."""
    opponent = np.asarray(take.opponent[:])
    x, z = np.asarray(take.x[:], dtype=float), np.asarray(take.z[:], dtype=float)
    rows = np.arange(take.frame_count)[:, None]
    other = np.maximum(opponent, 0)
    gap = np.hypot(x - x[rows, other], z - z[rows, other])
    if take.targets.shape[1]:
        targets = np.asarray(take.targets[:], dtype=float)
        aim = np.clip(-2 - opponent, 0, targets.shape[1] - 1)
        gap = np.where(opponent < -1, np.hypot(x - targets[rows, aim, 0], z - targets[rows, aim, 2]), gap)
    gap[(opponent == -1) | (np.asarray(take.action[:]) < 0)] = np.nan
    figure = new_figure(9.0, 4.5)
    axes = figure.subplots()
    some = np.flatnonzero(np.isfinite(gap).any(axis=1))
    if len(some):
        times = some / take.control_rate
        low, quarter, middle, most, high = np.nanpercentile(gap[some], [5, 25, 50, 75, 95], axis=1)
        axes.fill_between(times, low, high, color="tab:blue", alpha=0.15, label="nine tenths")
        axes.fill_between(times, quarter, most, color="tab:blue", alpha=0.3, label="half")
        axes.plot(times, middle, color="tab:blue", label="median")
        axes.legend(loc="upper right")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("distance to the opponent [m]")
    axes.set_ylim(bottom=0.0)
    return figure


def action_figure(take: TakeData) -> Figure:
    """Draw how often actions are used, the most used first."""
    from matplotlib.ticker import LogLocator, NullFormatter

    action = np.asarray(take.action[:])
    phase = np.asarray(take.action_frame[:])
    begun = np.ones(action.shape, bool)
    begun[1:] = (action[1:] != action[:-1]) | (phase[1:] <= phase[:-1])
    figure = new_figure(9.0, 4.5)
    axes = figure.subplots()
    result = []
    for index, name in enumerate(take.cast.policy_names):
        mine = begun & (action >= 0) & (take.cast.policies == index)[None]
        if not mine.any():
            continue
        counts = np.sort(np.bincount(action[mine]))[::-1]
        counts = counts[counts > 0]
        axes.plot(np.arange(1, len(counts) + 1), counts, drawstyle="steps-post", label=name)
        half = int(np.searchsorted(np.cumsum(counts), 0.5 * counts.sum())) + 1
        result.append(f"{name}: {len(counts)} actions used, half of the time {half} of them")
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:,.0f}")
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("rank of the action, the most used first")
    axes.set_ylabel("number of times used")
    axes.set_title("\n".join(result), fontsize=10)
    if result:
        axes.legend()
    return figure
