"""Pictures of a policy: where strikes reach, and what is worth what around the avatar."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.figures import STRIKERS, new_figure, save_figure
from crowdsim.graph.settings import GraphSettings
from crowdsim.motion.strikers import HANDS, LIMBS
from crowdsim.policy.axes.axis import AxisKind
from crowdsim.policy.environment import Axis
from crowdsim.policy.policy import Behaviour, Policy, build_lookup_tables
from crowdsim.training.motion_kinds import MotionKind, motion_kinds
from crowdsim.training.statistics import PAPER_REACH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


HEAD = 1.5
"""Height of a target's head where a behaviour does not depend on height [m]."""
NEARBY = 2.5
"""Within what distance maps show targets nearby [m]."""
KIND_COLOURS = {
    MotionKind.STAY: "#d9d9d9",
    MotionKind.STEP_FORWARD: "#2ca02c",
    MotionKind.STEP_BACK: "#8c564b",
    MotionKind.STEP_LEFT: "#17becf",
    MotionKind.STEP_RIGHT: "#e377c2",
    MotionKind.TURN_LEFT: "#9edae5",
    MotionKind.TURN_RIGHT: "#f7c6e0",
    MotionKind.STRIKE_LEFT: "#1f77b4",
    MotionKind.STRIKE_RIGHT: "#d62728",
}
"""Colour of each kind of motion; left is blue, right is red."""


def plot_bundle(policy: Policy, folder: str | Path) -> list[Path]:
    """Draw a policy: its graph, its strikes, and for every behaviour maps of values and best actions.

    Return the PNG files in the folder, which is made when it is missing.
    """
    from crowdsim.graph.plots import plot_graph

    folder = Path(folder)
    settings = GraphSettings(**policy.recipe["graph"]) if policy.recipe.get("graph") else GraphSettings()
    files = list(plot_graph(policy.database, policy.graph, settings, folder))
    figures = {"strikes": strikes_figure(policy)} if len(policy.database.strike_frames) else {}
    states = chosen_states(policy)
    for behaviour in policy.behaviours:
        figures[f"values_{behaviour.name}"] = maps_figure(policy, behaviour, states)
        for axis in behaviour.grid.layer_axes:
            if axis.name != "height" and axis.count > 1:
                figures[f"values_{behaviour.name}_by_{axis.name}"] = axis_figure(policy, behaviour, axis, states[0])
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
    x, y, z = np.asarray(database.strike_positions, dtype=float).T
    figure = new_figure(13, 8)
    above, *others = (figure.add_subplot(2, 3, place) for place in (1, 2, 3, 5, 6))
    legend = figure.add_subplot(2, 3, 4)
    limbs = [limb for limb in range(len(LIMBS)) if limb in HANDS or (database.strike_limbs == limb).any()]
    for limb in limbs:
        own, (label, colour) = database.strike_limbs == limb, STRIKERS[limb]
        above.scatter(-x[own], z[own], s=12, color=colour, label=f"{label} ({int(own.sum())})", alpha=0.7)
    _paper_sector(above)
    above.plot(0, 0, marker="^", color="black", markersize=9)
    _ground_axes(above, "Strikes from above, paper's region shaded")
    above.legend(loc="lower right", fontsize=8)
    degrees = tuple(math.degrees(angle) for angle in PAPER_REACH["bearing"])
    quantities = [
        (np.hypot(x, z), "reach over the ground", "m", PAPER_REACH["distance"]),
        (y, "height of fist or foot", "m", PAPER_REACH["height"]),
        (np.degrees(np.arctan2(x, z)), "direction, left is positive", "degrees", degrees),
        (np.asarray(database.strike_speeds, dtype=float), "highest speed of fist or foot", "m/s", None),
    ]
    lines = ["5th to 95th percentile"]
    for axes, (values, label, unit, paper) in zip(others, quantities, strict=True):
        parts = [values[database.strike_limbs == limb] for limb in limbs]
        axes.hist(parts, bins=24, stacked=True, color=[STRIKERS[limb][1] for limb in limbs])
        axes.set_xlabel(f"{label} [{unit}]")
        axes.set_ylabel("number of strikes")
        low, high = np.percentile(values, [5.0, 95.0])
        digits = 0 if unit == "degrees" else 2
        lines.append(f"{label}:\n  {low:.{digits}f} to {high:.{digits}f} {unit}")
        if paper is not None:
            axes.axvspan(*paper, color="tab:green", alpha=0.15, zorder=0)
            lines[-1] += f"; the paper: {paper[0]:.{digits}f} to {paper[1]:.{digits}f}"
    legend.axis("off")
    legend.text(0.0, 0.95, "\n\n".join(lines), va="top", family="monospace", fontsize=10)
    figure.suptitle(f"{policy.name}: {len(x)} strikes, mirror images included")
    return figure


def maps_figure(policy: Policy, behaviour: Behaviour, states: list[int], points: int = 81) -> Figure:
    """Draw what the best action is worth, and what it does, for targets all around the avatar in some states.

    Behaviours that know targets far away have a second map of what the best action does, of those nearby.
    """
    return _draw_maps(policy, behaviour, [_Column(_name_state(policy, state), state) for state in states], points)


def axis_figure(policy: Policy, behaviour: Behaviour, axis: Axis, state: int, points: int = 61) -> Figure:
    """Draw the same for targets of which an axis has some values, from its first grid point to its last one."""
    unit, columns = axis.kind.grid_units(policy.database.control_rate), []
    for value in axis.points[np.unique(np.linspace(0, axis.count - 1, 4).round().astype(int))]:
        last = axis.kind.beyond is not None and value == axis.points[-1]
        text = (
            f"{math.degrees(value):.0f} degrees" if axis.kind.unit == "rad" else f"{value / unit:.2g} {axis.kind.unit}"
        )
        title = f"{axis.name} {text}" + " or none" * int(last)
        columns.append(_Column(title, state, axis.kind, axis.kind.beyond if last else float(value)))
    return _draw_maps(policy, behaviour, columns, points)


class _Column(NamedTuple):
    """Maps of one state; with a kind of axis, of targets of which that has some value."""

    title: str
    state: int
    kind: AxisKind | None = None
    value: float | None = None


def _draw_maps(policy: Policy, behaviour: Behaviour, columns: list[_Column], points: int) -> Figure:
    """Draw maps of values and of best actions, a column for each of some."""
    far = next(axis.maximum for axis in behaviour.grid.axes if axis.name == "distance")
    extents = [far] if far <= 2.0 * NEARBY else [far, NEARBY]
    kinds = motion_kinds(policy.actions, policy.database.strike_limbs)
    look = _BestActions(policy, behaviour)
    shown: set[int] = set()
    figure = new_figure(4.6 * len(columns), 0.9 + 3.9 * (1 + len(extents)))
    rows = figure.subplots(1 + len(extents), len(columns), squeeze=False)
    for column, what in enumerate(columns):
        first = int(policy.actions.offsets[what.state])
        for row, extent in enumerate(extents, 1):
            sides, values, best = look(what, extent, points)
            axes = rows[row, column]
            shades = np.where(best < 0, np.nan, kinds[first + np.maximum(best, 0)])
            axes.pcolormesh(sides, sides, shades, shading="nearest", cmap=_kind_colours(), vmin=-0.5, vmax=8.5)
            shown.update(int(kind) for kind in np.unique(shades[np.isfinite(shades)]))
            _ground_axes(axes, f"what the best action does, targets within {extent:.3g} m")
            if row == 1:
                upper = rows[0, column]
                image = upper.pcolormesh(sides, sides, values, shading="nearest", cmap="viridis")
                figure.colorbar(image, ax=upper, label="value of the best action [reward]")
                _ground_axes(upper, what.title)
    for axes in rows.flat:
        axes.plot(0, 0, marker="^", color="white", markeredgecolor="black", markersize=8)
    _kind_legend(figure, shown)
    where = f", head at {height:.2f} m" if (height := look.head) is not None else ""
    turned = columns[0].kind is not None and columns[0].kind.name == "heading"
    where += ", targets face it" if not turned and any(one.name == "heading" for one in behaviour.grid.axes) else ""
    if columns[0].kind is not None:
        where += f", in {_name_state(policy, columns[0].state)}"
    figure.suptitle(f"{policy.name}: {behaviour.name}, by where the target is around the avatar, who looks up{where}")
    return figure


class _BestActions:
    """Finds values and numbers of best actions for targets on a square around an avatar."""

    def __init__(self, policy: Policy, behaviour: Behaviour) -> None:
        self.far = next(axis.maximum for axis in behaviour.grid.axes if axis.name == "distance")
        heights = [axis for axis in behaviour.grid.axes if axis.name == "height"]
        self.head = 0.5 * (heights[0].minimum + heights[0].maximum) if heights else None
        self._scale = behaviour.scale or 1.0
        self._tables = build_lookup_tables(policy.actions, (behaviour,), policy.body)
        self._most = int(np.diff(policy.actions.offsets).max())

    def __call__(self, column: _Column, extent: float, points: int) -> tuple[Array, Array, Array]:
        """Return places along x to the right and z ahead (P,), values and actions (P, P), numbers within the state's.

        An action is -1 beyond the extent.
        """
        from crowdsim.policy.axes.axis import Target
        from crowdsim.policy.kernels.axes import Corners
        from crowdsim.policy.kernels.values import evaluate_actions

        ones, corners = np.ones(1), Corners(np.empty(64, np.int64), np.empty(64))
        found, height = np.empty(self._most), HEAD if self.head is None else self.head
        sides = np.linspace(-extent, extent, points)
        values, best = np.full((points, points), np.nan), np.full((points, points), -1)
        for row, z in enumerate(sides):
            for place, right in enumerate(sides):
                if math.hypot(right, z) <= min(extent, self.far):
                    target = Target(-right, height, z, 0.0, 0.0, math.atan2(right, -z))
                    if column.kind is not None:
                        placed = column.kind.place(target, np.asarray(column.value))
                        target = Target(*(float(number) for number in placed))
                    n = evaluate_actions(self._tables, ones, column.state, target, corners, found)
                    values[row, place] = found[:n].max() * self._scale
                    best[row, place] = found[:n].argmax()
        return sides, values, best


def _name_state(policy: Policy, state: int) -> str:
    """Where a state is in the capture."""
    database, frame = policy.database, int(policy.graph.state_frames[state])
    clip = int(np.searchsorted(database.clip_starts, frame, side="right")) - 1
    seconds = (frame - int(database.clip_starts[clip])) / database.control_rate
    return f"state {state}: {database.clip_names[clip]} at {seconds:.1f} s"


def _kind_colours() -> Any:
    from matplotlib.colors import ListedColormap

    return ListedColormap([KIND_COLOURS[kind] for kind in MotionKind])


def _kind_legend(figure: Figure, shown: set[int]) -> None:
    """Name the kinds of motion that maps show."""
    from matplotlib.patches import Patch

    kinds = [kind for kind in MotionKind if kind in shown]
    patches = [Patch(facecolor=KIND_COLOURS[kind], label=kind.words) for kind in kinds]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), fontsize=9)


def _ground_axes(axes: Axes, title: str) -> None:
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("to the right [m]")
    axes.set_ylabel("ahead [m]")


def _paper_sector(axes: Axes) -> None:
    """Shade the region that the paper's strikes reach."""
    angles = np.linspace(*PAPER_REACH["bearing"], 40)
    near, far = PAPER_REACH["distance"]
    x = np.concatenate([near * np.sin(angles), far * np.sin(angles[::-1])])
    z = np.concatenate([near * np.cos(angles), far * np.cos(angles[::-1])])
    axes.fill(-x, z, color="tab:green", alpha=0.15)
