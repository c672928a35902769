"""Figures of ``benchmarks/results.json`` as cells of Markdown tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

NOT_MEASURED = "not measured"
MISSING: Any = object()
"""What is returned for a figure that the document does not have; None is a figure that could not be measured."""

Format = Callable[[Any], str]


class Results:
    """The full results of a document; quick ones count as not measured.

    Attributes:
        entries: Entries of the document by benchmark.
        asked: Benchmark and keys of every figure that was asked for, in order.
    """

    def __init__(self, document: dict[str, Any]) -> None:
        found = document.get("benchmarks", {})
        self.entries: dict[str, dict[str, Any]] = {name: one for name, one in found.items() if not one["quick"]}
        self.asked: dict[tuple[str, ...], None] = {}

    def get(self, benchmark: str, *keys: str) -> Any:
        """Return a figure, or ``MISSING``; keys of lists are numbers."""
        figure = (benchmark, *keys)
        self.asked[figure] = None
        return self._find(benchmark, keys)

    def has(self, benchmark: str, *keys: str) -> bool:
        """Return whether the document has a figure or a group of figures; it does not count as asked for."""
        return self._find(benchmark, keys) is not MISSING

    def _find(self, benchmark: str, keys: tuple[str, ...]) -> Any:
        found: Any = self.entries.get(benchmark, {}).get("results", MISSING)
        for key in keys:
            if isinstance(found, list):
                found = dict(enumerate(found)).get(int(key), MISSING)
            else:
                found = found.get(key, MISSING) if isinstance(found, dict) else MISSING
        return found

    def cell(self, shown: Format, benchmark: str, *keys: str) -> str:
        """Return a figure as text."""
        return cell(shown, self.get(benchmark, *keys))

    def table(self, header: Sequence[str], rows: Sequence[Sequence[str]], *benchmarks: str) -> list[str]:
        """Return the lines of a table, and below it when and where its benchmarks were measured."""
        return [*table(header, rows), "", self.provenance(*benchmarks)]

    def provenance(self, *benchmarks: str) -> str:
        """Return a line that states when, at which commit and on what machine benchmarks were measured."""
        groups: dict[str, list[str]] = {}
        for name in benchmarks:
            entry = self.entries.get(name)
            if entry is None:
                groups.setdefault("Not measured", []).append(f"`{name}`")
                continue
            commit = entry["commit"] or "of no checkout"
            commit = f"`{commit[:7]}`{' with local changes' if commit.endswith('-dirty') else ''}"
            words = f"Measured on {entry['date'][:10]} at commit {commit} ({entry['machine']})"
            groups.setdefault(words, []).append(f"`{name}`")
        return "\n".join(f"{words}: {', '.join(names)}." for words, names in groups.items())


def cell(shown: Format, value: Any) -> str:
    """Return a figure as text: ``not measured`` where there is none, ``none`` where it could not be measured."""
    if value is MISSING:
        return NOT_MEASURED
    return "none" if value is None else shown(value)


def number(value: float, digits: int = 3) -> str:
    """Return a number of three significant digits, of four decimals at most; whole numbers keep all of theirs."""
    if isinstance(value, int) or abs(value) < 5e-5:
        return f"{value:,.0f}"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{value:,.{min(max(0, decimals), 4)}f}"


def short(value: float) -> str:
    """Return a number of two significant digits."""
    return number(value, 2)


def fixed(value: float) -> str:
    """Return a number of two decimals."""
    return f"{value:.2f}"


def whole(value: float) -> str:
    """Return a whole number."""
    return f"{value:,.0f}"


def percent(value: float) -> str:
    """Return a share in per cent, of two decimals at most."""
    if 0.0 < value < 5e-5:
        return "< 0.01 %"
    return f"{f'{100 * value:.{1 if value >= 0.1 else 2}f}'.rstrip('0').rstrip('.')} %"


def scaled(factor: float, unit: str = "", shown: Format = number) -> Format:
    """Return a format of figures in another unit."""
    return lambda value: f"{shown(factor * value)}{unit}"


def at_most(most: float | None) -> Format:
    """Return a format of figures that stand out, with the goal, where they are greater than that."""
    return lambda value: number(value) if most is None or value <= most else f"**{number(value)}** (at most {most:g})"


def at_least(least: float) -> Format:
    """Return a format of figures that stand out, with the goal, where they are smaller than that."""
    return lambda value: number(value) if value >= least else f"**{number(value)}** (at least {least:g})"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table."""
    head, *body = [f"| {' | '.join(row)} |" for row in [header, *rows]]
    return [head, f"|{'---|' * len(header)}", *body]
