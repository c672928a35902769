"""Pictures of a motion graph: the distance matrix with its transitions, actions of states, lengths of actions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.figures import new_figure, save_figure
from crowdsim.graph.features import frame_features
from crowdsim.graph.settings import GraphSettings
from crowdsim.graph.states import MotionGraph
from crowdsim.motion.database import MotionDatabase

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_PIXELS = 1400
"""Most rows and columns that a distance matrix is drawn with."""


def plot_graph(database: MotionDatabase, graph: MotionGraph, settings: GraphSettings, folder: Path) -> list[Path]:
    """Write all pictures of a graph, falls left out, as PNG files in a folder and return their paths."""
    graph = graph.without_falls
    figures = {
        "distances.png": distance_figure(database, graph, settings),
        "degrees.png": degree_figure(graph),
        "action_lengths.png": length_figure(graph, database.control_rate),
    }
    return [save_figure(figure, folder / name) for name, figure in figures.items()]


def distance_figure(database: MotionDatabase, graph: MotionGraph, settings: GraphSettings) -> Figure:
    """Draw the cost between all frames, dark where they are alike, with the transitions of the graph as dots.

    A dot at column i and row j - 1 is the transition after frame i to frame j.
    """
    frames = database.frame_count
    step = max(1, -(-frames // _PIXELS))
    features = frame_features(database, settings)[::step].astype(np.float64)
    lengths = (features**2).sum(axis=1)
    squares = lengths[:, None] + lengths[None, :] - 2.0 * features @ features.T
    costs = np.sqrt(np.maximum(squares, 0.0))
    figure = new_figure(11.0, 11.3, layout=None)
    axes = figure.add_axes((0.17, 0.155, 0.81, 0.81 * 11.0 / 11.3))
    image = axes.imshow(
        costs,
        cmap="gray",
        vmin=0.0,
        vmax=max(float(np.percentile(costs, 75)), 1e-6),
        extent=(-0.5, frames - 0.5, frames - 0.5, -0.5),
        interpolation="nearest",
    )
    _scale(figure, 0.17, image, "cost between two frames [m]")
    dots = axes.scatter(
        graph.transition_from,
        graph.transition_to - 1,
        c=graph.transition_costs,
        s=float(np.clip(30000.0 / max(len(graph.transition_from), 1), 1.5, 20.0)),
        cmap="rainbow",
        linewidths=0,
    )
    _scale(figure, 0.595, dots, "cost of a transition [m]")
    for start in database.clip_starts[1:-1]:
        axes.axhline(start - 0.5, color="tab:blue", linewidth=0.4)
        axes.axvline(start - 0.5, color="tab:blue", linewidth=0.4)
    middles = (database.clip_starts[:-1] + database.clip_starts[1:]) / 2
    axes.set_yticks(middles, database.clip_names, fontsize=6)
    axes.set_xlabel("control frame i [frames]")
    axes.set_ylabel("control frame j [frames, by clip]")
    count = f"{len(graph.transition_from):,} transitions of a cost up to {graph.threshold:.3f} m"
    axes.set_title(f"{count}; a dot at i and j: frame j + 1 may follow frame i")
    return figure


def degree_figure(graph: MotionGraph) -> Figure:
    """Draw how many states have how many actions, and from how many states each one can be reached at once."""
    figure = new_figure(10.0, 4.0)
    ways_out = np.diff(graph.action_offsets)
    ways_in = np.bincount(graph.action_next, minlength=graph.state_count)
    for place, (counts, label) in enumerate([(ways_out, "actions of a state"), (ways_in, "actions into a state")], 1):
        axes = figure.add_subplot(1, 2, place)
        _bars(axes, counts)
        axes.set_xlabel(f"number of {label}")
        axes.set_ylabel("number of states")
        axes.set_title(f"{graph.state_count} states, mean {counts.mean():.1f}, most {counts.max()}", fontsize=10)
    return figure


def length_figure(graph: MotionGraph, control_rate: float) -> Figure:
    """Draw how many actions last how long."""
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(6.0, 4.0)
    axes = figure.add_subplot()
    _bars(axes, graph.action_lengths)
    seconds = axes.secondary_xaxis(
        "top", functions=(lambda x: np.divide(x, control_rate), lambda x: np.multiply(x, control_rate))
    )
    seconds.set_xlabel("length of an action [s]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    mean = graph.action_lengths.mean()
    axes.set_xlabel(f"length of an action [control frames, {control_rate:g} per second]")
    axes.set_ylabel("number of actions")
    axes.set_title(f"{graph.action_count} actions, mean {mean:.1f} frames = {mean / control_rate:.2f} s", fontsize=10)
    return figure


def _scale(figure: Figure, left: float, colours: Any, label: str) -> None:
    """Put a scale of colours under the axes."""
    figure.colorbar(colours, cax=figure.add_axes((left, 0.06, 0.385, 0.012)), label=label, orientation="horizontal")


def _bars(axes: Any, counts: Array) -> None:
    """Draw a histogram of whole numbers, several to a bar where there are many."""
    most = int(counts.max())
    width = max(1, -(-most // 60))
    axes.hist(counts, bins=np.arange(0, most + 2 * width, width) - 0.5, color="tab:blue")
