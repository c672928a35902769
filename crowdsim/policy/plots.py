"""Pictures of a policy: where strikes reach, and what is worth what around the avatar."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.figures import new_figure, save_figure
from crowdsim.graph.settings import GraphSettings
from crowdsim.policy.policy import Behaviour, Policy, build_lookup_tables
from crowdsim.policy.statistics import PAPER_REACH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[Any]

HANDS = (("left", "tab:blue"), ("right", "tab:red"))


def plot_bundle(policy: Policy, folder: str | Path) -> list[Path]:
    """Draw a policy: its graph, its strikes, and for every behaviour maps of values and best actions.

    Args:
        policy: The policy.
        folder: Where the PNG go; made when it is missing.

    Returns:
        The files.

    Raises:
        OutputError: The folder or a file cannot be written.
    """
    from crowdsim.graph.plots import plot_graph

    folder = Path(folder)
    settings = GraphSettings(**policy.recipe["graph"]) if policy.recipe.get("graph") else GraphSettings()
    files = list(plot_graph(policy.database, policy.graph, settings, folder))
    figures = {"strikes": strikes_figure(policy)} if len(policy.database.strike_frames) else {}
    states = chosen_states(policy)
    for behaviour in policy.behaviours:
        figures[f"values_{behaviour.name}"] = maps_figure(policy, behaviour, states)
    return files + [save_figure(figure, folder / f"{name}.png") for name, figure in figures.items()]


def chosen_states(policy: Policy, count: int = 3) -> list[int]:
    """Return states worth looking at: those with most actions, apart from one another in the capture."""
    branching = np.diff(policy.actions.offsets)
    found: list[int] = []
    for state in np.argsort(-branching, kind="stable"):
        frame = int(policy.graph.state_frames[state])
        if all(abs(frame - int(policy.graph.state_frames[other])) > 60 for other in found):
            found.append(int(state))
        if len(found) == count:
            break
    return found


def strikes_figure(policy: Policy) -> Figure:
    """Draw the strikes from above, and their reach, height, direction and speed beside the paper's region."""
    database = policy.database
    x, y, z = np.asarray(database.strike_places, dtype=float).T
    figure = new_figure(13, 8)
    above, *others = (figure.add_subplot(2, 3, place) for place in (1, 2, 3, 5, 6))
    legend = figure.add_subplot(2, 3, 4)
    for hand, (label, colour) in enumerate(HANDS):
        own = database.strike_hands == hand
        above.scatter(x[own], z[own], s=12, color=colour, label=f"{label} ({int(own.sum())})", alpha=0.7)
    _paper_sector(above)
    above.plot(0, 0, marker="^", color="black", markersize=9)
    _ground_axes(above, "Strikes from above, paper's region shaded")
    above.legend(loc="lower right", fontsize=8)
    quantities = {
        "distance": (np.hypot(x, z), "Reach over the ground [m]"),
        "height": (y, "Height of the fist [m]"),
        "bearing": (np.arctan2(x, z), "Direction [rad], left is positive"),
        "speed": (np.asarray(database.strike_speeds, dtype=float), "Highest speed of the fist [m/s]"),
    }
    lines = ["5th to 95th percentile"]
    for axes, (name, (values, label)) in zip(others, quantities.items(), strict=True):
        parts = [values[database.strike_hands == hand] for hand in range(2)]
        axes.hist(parts, bins=24, stacked=True, color=[colour for _, colour in HANDS])
        axes.set_xlabel(label)
        axes.set_ylabel("strikes")
        low, high = np.percentile(values, [5.0, 95.0])
        lines.append(f"{name}: {low:.2f} .. {high:.2f}")
        if name in PAPER_REACH:
            axes.axvspan(*PAPER_REACH[name], color="tab:green", alpha=0.15)
            lines[-1] += f"   paper {PAPER_REACH[name][0]:.2f} .. {PAPER_REACH[name][1]:.2f}"
    legend.axis("off")
    legend.text(0.0, 0.95, "\n\n".join(lines), va="top", family="monospace", fontsize=10)
    figure.suptitle(f"{policy.name}: {len(x)} strikes, mirror images included")
    return figure


def maps_figure(policy: Policy, behaviour: Behaviour, states: list[int], points: int = 81) -> Figure:
    """Draw what the best action is worth, and which one it is, for targets all around the avatar in some states."""
    from crowdsim.policy import kernels

    tables = build_lookup_tables(policy.actions, (behaviour,), policy.body)
    ones, cells, shares = np.ones(1), np.empty(64, np.int64), np.empty(64)
    found = np.empty(int(np.diff(policy.actions.offsets).max()))
    figure = new_figure(4.6 * len(states), 8.2)
    far = next(axis.maximum for axis in behaviour.grid.axes if axis.name == "distance")
    height = _middle_height(behaviour)
    sides = np.linspace(-far, far, points)
    for column, state in enumerate(states):
        values = np.full((points, points), np.nan)
        best = np.full((points, points), np.nan)
        for row, z in enumerate(sides):
            for place, x in enumerate(sides):
                if math.hypot(x, z) <= far:
                    n = kernels.evaluate_actions(tables, ones, state, x, height, z, 0.0, 0.0, cells, shares, found)
                    values[row, place], best[row, place] = (
                        found[:n].max() * (behaviour.scale or 1.0),
                        found[:n].argmax(),
                    )
        upper = figure.add_subplot(2, len(states), column + 1)
        image = upper.pcolormesh(sides, sides, values, shading="nearest", cmap="viridis")
        figure.colorbar(image, ax=upper, label="value of the best action")
        _ground_axes(upper, f"state {state}, frame {int(policy.graph.state_frames[state])}")
        lower = figure.add_subplot(2, len(states), len(states) + column + 1)
        first = int(policy.actions.offsets[state])
        cuts = policy.graph.action_cuts[first : int(policy.actions.offsets[state + 1])]
        lower.pcolormesh(sides, sides, best % 20, shading="nearest", cmap="tab20", vmin=0, vmax=19)
        for k, end in enumerate(policy.actions.displacements[first : first + len(cuts)]):
            lower.annotate(
                str(k), (end[0], end[1]), fontsize=7, color="black", fontweight="normal" if cuts[k] else "bold"
            )
        _ground_axes(lower, "best action (numbers: where each ends, bold: capture runs on)")
        lower.title.set_fontsize(8)
        for axes in (upper, lower):
            axes.plot(0, 0, marker="^", color="white", markeredgecolor="black", markersize=8)
    where = f", head at {height:.2f} m" if any(axis.name == "height" for axis in behaviour.grid.axes) else ""
    figure.suptitle(f"{policy.name}: {behaviour.name}, target around the avatar, which looks up{where}")
    return figure


def _middle_height(behaviour: Behaviour) -> float:
    for axis in behaviour.grid.axes:
        if axis.name == "height":
            return 0.5 * (axis.minimum + axis.maximum)
    return 1.5


def _ground_axes(axes: Axes, title: str) -> None:
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("to the left [m]")
    axes.set_ylabel("ahead [m]")
    if not axes.xaxis_inverted():
        axes.invert_xaxis()  # seen from above, an avatar that looks up has its left hand on the left


def _paper_sector(axes: Axes) -> None:
    """Shade the region that the paper's strikes reach."""
    angles = np.linspace(*PAPER_REACH["bearing"], 40)
    near, far = PAPER_REACH["distance"]
    x = np.concatenate([near * np.sin(angles), far * np.sin(angles[::-1])])
    z = np.concatenate([near * np.cos(angles), far * np.cos(angles[::-1])])
    axes.fill(x, z, color="tab:green", alpha=0.15)
