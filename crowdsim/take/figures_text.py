"""Figures as words: rounded numbers with units, ratings against the capture, and lines that are aligned."""

from __future__ import annotations

import math
from collections.abc import Iterable

ALIKE = 0.05
"""Share by which a figure may differ from the capture's and still be rated as the same."""

Row = tuple[str, str | None]
"""What a figure is, and the figure in words; None leaves the row out."""


def section(title: str, rows: Iterable[Row]) -> list[str]:
    """Return lines of a section, its labels in one column; nothing where no row has words.

    A row without a label continues the one above it.
    """
    kept = [(label, text) for label, text in rows if text is not None]
    width = max((len(label) for label, _ in kept), default=0)
    return [f"  {title}", *(f"    {label:{width}}  {text}" for label, text in kept)] if kept else []


def number(value: float, digits: int = 2) -> str:
    """Return a number to so many significant digits, thousands separated; whole numbers from there on."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:,.{decimals}f}"


def length(metres: float) -> str:
    """Return a length in the unit that suits it, to the millimetre."""
    return f"{metres:.2f} m" if metres >= 1.0 else f"{100.0 * metres:.1f} cm"


def speed(metres: float) -> str:
    """Return a speed, to the millimetre a second below 1 m/s."""
    return f"{metres:.3f} m/s" if metres < 1.0 else f"{metres:.1f} m/s"


def time(seconds: float) -> str:
    """Return a time in the unit that suits it."""
    if seconds < 0.1:
        return f"{number(1000.0 * seconds)} ms"
    minutes, rest = divmod(round(seconds), 60)
    return (
        f"{number(seconds)} s" if seconds < 10.0 else f"{seconds:.1f} s" if minutes == 0 else f"{minutes} min {rest} s"
    )


def percent(share: float, none: str = "none") -> str:
    """Return a share in percent, to a second decimal below 1 %; ``none`` for nothing at all."""
    return none if share == 0.0 else f"{100.0 * share:.{2 if share < 0.01 else 1}f} %"


def count(amount: float, one: str, many: str | None = None) -> str:
    """Return an amount of things, thousands separated."""
    return f"{amount:,} {one if amount == 1 else many or f'{one}s'}"


def rating(ours: float, captured: float) -> str:
    """Return how a figure compares with the capture's own."""
    if captured <= 0.0:
        return "as the capture" if ours <= 0.0 else "the capture has none"
    ratio = ours / captured
    if abs(ratio - 1.0) <= ALIKE:
        return "as the capture"
    return f"{ratio:.2f} times the capture's" if ratio < 10.0 else f"{ratio:,.0f} times the capture's"
