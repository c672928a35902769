"""Curves of a figure against a swept key, as SVG: the mean, and the spread over seeds as a band."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

COLOURS = ("#3b6fc4", "#c8641e", "#3f8f4f", "#a0458f", "#8a6d1a", "#4a8f9c")
"""Colours of the curves of one picture, in order; no more are drawn."""
WIDTH, HEIGHT = 420, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 14, 30, 42


class Curve(NamedTuple):
    """Mean, least and greatest of a figure at ascending values of a key; a label tells it from other curves."""

    label: str
    colour: str
    x: Sequence[float]
    middle: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]


def curve_of(label: str, colour: str, x: Sequence[float], y: Sequence[float]) -> Curve:
    """Return the curve of values ``y`` at ``x``, several of which may be equal."""
    values = np.asarray(y, float)
    at = np.asarray(x, float)
    known = np.isfinite(values)
    places = sorted(set(at[known].tolist()))
    groups = [values[known & (at == place)] for place in places]
    middle, low, high = ([float(get(group)) for group in groups] for get in (np.mean, np.min, np.max))
    return Curve(label, colour, places, middle, low, high)


def draw_curves(curves: Sequence[Curve], title: str, key: str) -> str:
    """Return a picture of curves as SVG: what ``title`` says, with its unit, against the swept key."""
    from matplotlib.ticker import MaxNLocator

    xs = [value for curve in curves for value in curve.x]
    ys = [value for curve in curves for band in (curve.low, curve.high) for value in band]
    x_ticks = sorted(set(xs)) if len(set(xs)) <= 7 else list(MaxNLocator(5).tick_values(min(xs), max(xs)))
    y_ticks = list(MaxNLocator(4).tick_values(min(ys), max(ys) if max(ys) > min(ys) else min(ys) + 1))
    x_range = _widened(min(xs), max(xs))
    place_x = _scale(*x_range, _LEFT, WIDTH - _RIGHT)
    place_y = _scale(y_ticks[0], y_ticks[-1], HEIGHT - _BOTTOM, _TOP)
    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)} against {escape(key)}">']
    parts.append(f'<text class="title" x="{_LEFT}" y="17">{escape(title)}</text>')
    for tick in y_ticks:
        y = place_y(tick)
        parts.append(f'<line class="grid" x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="tick" x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:.4g}</text>')
    for tick in x_ticks:
        if x_range[0] <= tick <= x_range[1]:
            x = place_x(tick)
            parts.append(f'<text class="tick" x="{x:.1f}" y="{HEIGHT - 24}" text-anchor="middle">{tick:.6g}</text>')
    middle = (WIDTH + _LEFT - _RIGHT) / 2
    parts.append(f'<text class="tick" x="{middle}" y="{HEIGHT - 6}" text-anchor="middle">{escape(key)}</text>')
    for curve in curves:
        parts += _draw_curve(curve, place_x, place_y)
    return "\n".join([*parts, "</svg>"])


def _draw_curve(curve: Curve, place_x: Any, place_y: Any) -> list[str]:
    colour = curve.colour
    x = [place_x(value) for value in curve.x]

    def points(values: Sequence[float], at: Sequence[float]) -> str:
        return " ".join(f"{a:.1f},{place_y(value):.1f}" for a, value in zip(at, values, strict=True))

    band = f"{points(curve.high, x)} {points(curve.low[::-1], x[::-1])}"
    found = [f'<polygon points="{band}" fill="{colour}" opacity="0.18"/>']
    found.append(f'<polyline points="{points(curve.middle, x)}" fill="none" stroke="{colour}" stroke-width="2"/>')
    for at, value, low, high in zip(x, curve.middle, curve.low, curve.high, strict=True):
        note = escape(f"{curve.label + ': ' if curve.label else ''}{value:.4g}, from {low:.4g} to {high:.4g}")
        dot = f'<circle cx="{at:.1f}" cy="{place_y(value):.1f}" r="3.2" fill="{colour}">'
        found.append(f"{dot}<title>{note}</title></circle>")
    return found


def _widened(low: float, high: float) -> tuple[float, float]:
    room = 0.04 * (high - low) or 0.5
    return low - room, high + room


def _scale(low: float, high: float, first: float, last: float) -> Any:
    return lambda value: first + (value - low) / (high - low) * (last - first)
