"""Plots of a report as inline SVG: strikes, health and distance over time. They are told apart without colour."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.layout import BLOCKED, LANDED
from crowdsim.scenario.heals import Heal, find_returns
from crowdsim.take.take import Take

_WIDE, _TALL = 1100, 210
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 150, 12, 30
"""Size of a plot, and what its axes and names take of that [px]."""
_BARS, _MOMENTS, _AVATARS, _TEAMS = 120, 160, 2000, 8
"""Most bars, moments, avatars that distances are of, and teams that have a line."""
_DASHES = ("", "7 4", "2 3", "10 3 2 3")


def plots(take: Take, health: Mapping[str, float], heals: Sequence[Heal] = ()) -> Iterator[str]:
    """Yield the plots of a run as HTML, those that it has something for.

    Args:
        take: The take.
        health: Health at the start of avatars that can be hurt, by the names of their types [points].
        heals: When health is restored beside that of those that come back.
    """
    seconds = take.frame_count / take.control_rate
    if len(take.events.frame):
        yield _strikes(take, seconds)
    full = np.array([health.get(name, 0.0) for name in take.cast.type_names])[take.cast.types]
    if (full > 0.0).any():
        yield _health(take, seconds, full, heals)
    gaps, times = opponent_distances(take)
    if np.isfinite(gaps).any():
        yield _distance(gaps, times, seconds)


def count_strikes(take: Take, edges: Array) -> Array:
    """Return strikes between times: landed, blocked, and neither. Shape (3, len(edges) - 1).

    Args:
        take: The take.
        edges: Times, ascending [s].
    """
    times, outcome = np.asarray(take.events.frame, float) / take.control_rate, np.asarray(take.events.outcome)
    kinds = outcome == LANDED, outcome == BLOCKED, (outcome != LANDED) & (outcome != BLOCKED)
    return np.array([np.histogram(times[kind], edges)[0] for kind in kinds])


def mean_health(take: Take, full: Array, heals: Sequence[Heal], times: Array) -> dict[str, Array]:
    """Return by team how much of its avatars' health is left at times, from 0 to 1; of those that can be hurt.

    Args:
        take: The take.
        full: Health of each avatar at the start, 0 of those that cannot be hurt [points]. Shape (N,).
        heals: When health is restored beside that of those that come back.
        times: Ascending [s]. Shape (n,).
    """
    at = np.asarray(take.events.frame, float) / take.control_rate
    victims, damage = np.asarray(take.events.victim, np.int64), np.asarray(take.events.damage, float)
    some = np.flatnonzero((victims >= 0) & (damage > 0.0))
    order = some[np.argsort(at[some], kind="stable")]
    heals = sorted([*heals, *find_returns(take.action, np.unique(victims[some]).tolist(), take.control_rate)])
    left, strike, heal = full.astype(float), 0, 0
    teams = np.asarray(take.cast.teams, int)
    hurt = {team: np.flatnonzero((teams == team) & (full > 0.0)) for team in np.unique(teams).tolist()}
    found: dict[str, list[float]] = {take.cast.team_names[team]: [] for team, own in hurt.items() if len(own)}
    for time in times:
        while True:
            struck = at[order[strike]] if strike < len(order) else np.inf
            healed = heals[heal].seconds if heal < len(heals) else np.inf
            if min(struck, healed) > time:
                break
            if healed < struck:
                one, heal = heals[heal], heal + 1
                left[one.first : one.stop] = full[one.first : one.stop]
            else:
                victim = victims[order[strike]]
                left[victim], strike = max(left[victim] - damage[order[strike]], 0.0), strike + 1
        for team, own in hurt.items():
            if len(own):
                found[take.cast.team_names[team]].append(float((left[own] / full[own]).mean()))
    return {name: np.array(values) for name, values in found.items()}


def opponent_distances(take: Take) -> tuple[Array, Array]:
    """Return how far opponents of some avatars are at some times [m], NaN without one; and the times [s].

    Shapes (n, m) and (n,).
    """
    rows = np.unique(np.linspace(0, take.frame_count - 1, min(_MOMENTS, take.frame_count)).astype(int))
    some = np.unique(np.linspace(0, take.avatar_count - 1, min(_AVATARS, take.avatar_count)).astype(int))
    gaps = np.full((len(rows), len(some)), np.nan)
    for k, row in enumerate(rows.tolist()):
        opponent, x, z = (np.asarray(getattr(take, name)[row]) for name in ("opponent", "x", "z"))
        own = opponent[some]
        there = own >= 0
        gaps[k, there] = np.hypot(x[some[there]] - x[own[there]], z[some[there]] - z[own[there]])
        scripted = own < -1
        if scripted.any():
            target = np.asarray(take.targets[row])[-2 - own[scripted]]
            gaps[k, scripted] = np.hypot(x[some[scripted]] - target[:, 0], z[some[scripted]] - target[:, 2])
    return gaps, rows / take.control_rate


class _Axes:
    """A plot over time: where values lie in it, and its axes."""

    def __init__(self, seconds: float, most: float, unit: str) -> None:
        self.seconds, self.most, self._unit = max(seconds, 1e-6), max(most, 1e-6), unit

    def x(self, seconds: float) -> float:
        return round(_LEFT + (_WIDE - _LEFT - _RIGHT) * seconds / self.seconds, 1)

    def y(self, value: float) -> float:
        return round(_TALL - _BOTTOM - (_TALL - _TOP - _BOTTOM) * value / self.most, 1)

    def line(self, times: Array, values: Array, kind: str, dashes: str = "") -> str:
        points = " ".join(f"{self.x(t)},{self.y(v)}" for t, v in zip(times, values, strict=True) if np.isfinite(v))
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
        return f'<polyline class="{kind}"{dashed} points="{points}"/>'

    def text(self, x: float, y: float, text: str, anchor: str = "start") -> str:
        return f'<text x="{x}" y="{y}" text-anchor="{anchor}">{html.escape(text)}</text>'

    def figure(self, title: str, said: str, inside: str) -> str:
        """Return the plot, with a title, what it shows in words, and its axes."""
        grid = []
        for share in (0.0, 0.5, 1.0):
            y, value = self.y(share * self.most), share * self.most
            grid.append(f'<line class="grid" x1="{_LEFT}" x2="{_WIDE - _RIGHT}" y1="{y}" y2="{y}"/>')
            grid.append(self.text(_LEFT - 6, y + 4, f"{value:.3g}{self._unit}", "end"))
            grid.append(self.text(self.x(share * self.seconds), _TALL - 10, f"{share * self.seconds:.3g} s", "middle"))
        named = f'viewBox="0 0 {_WIDE} {_TALL}" role="img" aria-label="{html.escape(said, quote=True)}"'
        return f'<h3>{html.escape(title)}</h3>\n<svg class="plot" {named}>{"".join(grid)}{inside}</svg>\n'


def _strikes(take: Take, seconds: float) -> str:
    bars = int(np.clip(np.ceil(seconds), 1, _BARS))
    edges = np.linspace(0.0, seconds, bars + 1)
    edges[-1] += 1.0 / take.control_rate
    counts = count_strikes(take, edges)
    axes = _Axes(seconds, float(counts.sum(axis=0).max()), "")
    parts, wide = [], axes.x(seconds / bars) - axes.x(0.0)
    for column in range(bars):
        below = 0.0
        for kind, value in zip(("landed", "blocked", "missed"), counts[:, column].tolist(), strict=True):
            if value:
                top, low = axes.y(below + value), axes.y(below)
                x = axes.x(column * seconds / bars)
                box = f'x="{x}" y="{top}" width="{max(wide - 1, 0.5):.1f}" height="{low - top:.1f}"'
                parts.append(f'<rect class="{kind}" {box}/>')
                below += value
    for row, (kind, name) in enumerate((("landed", "landed"), ("blocked", "blocked"), ("missed", "missed"))):
        y = _TOP + 18 * (2 - row)
        parts.append(f'<rect class="{kind}" x="{_WIDE - _RIGHT + 14}" y="{y}" width="12" height="12"/>')
        parts.append(axes.text(_WIDE - _RIGHT + 32, y + 11, f"{name}: {int(counts[row].sum()):,}"))
    each = seconds / bars
    title = f"Strikes in each {'second' if abs(each - 1) < 0.06 else f'{each:.2g} s'}"
    landed, blocked, others = counts.sum(axis=1).tolist()
    return axes.figure(title, f"{landed} strikes landed, {blocked} were blocked, {others} missed", "".join(parts))


def _health(take: Take, seconds: float, full: Array, heals: Sequence[Heal]) -> str:
    times = np.linspace(0.0, seconds, _MOMENTS)
    lines = list(mean_health(take, full, heals, times).items())[:_TEAMS]
    axes, parts, taken = _Axes(seconds, 100.0, " %"), [], [-99.0]
    for row, (name, values) in enumerate(sorted(lines, key=lambda one: -one[1][-1])):
        parts.append(axes.line(times, 100 * values, "line", _DASHES[row % len(_DASHES)]))
        taken.append(max(axes.y(100 * values[-1]) + 4, taken[-1] + 15))
        parts.append(axes.text(_WIDE - _RIGHT + 8, taken[-1], f"{name[:14]}: {100 * values[-1]:.0f} %"))
    said = "; ".join(f"{name} has {100 * values[-1]:.0f} % left at the end" for name, values in lines)
    return axes.figure("Health left, of all avatars of a team", said, "".join(parts))


def _distance(gaps: Array, times: Array, seconds: float) -> str:
    some = np.isfinite(gaps).any(axis=1)
    low, middle, high = np.nanpercentile(gaps[some], [25, 50, 75], axis=1)
    axes, at = _Axes(seconds, float(np.ceil(2 * high.max()) / 2), " m"), times[some]
    edge = [*zip(at, high, strict=True), *zip(at[::-1], low[::-1], strict=True)]
    points = " ".join(f"{axes.x(t)},{axes.y(v)}" for t, v in edge)
    parts = [f'<polygon class="band" points="{points}"/>', axes.line(at, middle, "line")]
    parts.append(axes.text(_WIDE - _RIGHT + 8, axes.y(middle[-1]) + 4, f"median: {middle[-1]:.2f} m"))
    parts.append(axes.text(_WIDE - _RIGHT + 8, _TOP + 12, "band: half of them"))
    said = f"The median distance is {np.median(middle):.2f} m over the run, {middle[-1]:.2f} m at the end"
    return axes.figure("Distance to the opponent", said, "".join(parts))
