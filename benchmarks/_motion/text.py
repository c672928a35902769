"""The figures of ``motion_quality`` as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from _motion.decisions import KINDS
from _motion.shown_motion import PARTS

_METHODS = ("ours", "crossfade", "hard", "motions alone")


def lines_of_policy(name: str, outcome: Mapping[str, Any]) -> Iterator[str]:
    """Yield the figures of a policy, a line each."""
    each = ", ".join(f"{area:.3f}" for area in outcome["made_in_each"])
    rate = outcome["transitions_per_second"]
    yield f"{name}: {rate:.2f} transitions per avatar per second; AUC of ours in each brawl: {each}"
    for group in ("made", "apart", "every", "falls", "rests"):
        if outcome[group] is not None:
            yield from _methods(group, outcome[group])
    yield from _decisions(outcome["decisions"])
    smooth = outcome["smoothness"]
    yield from _excesses("", smooth, ("near_transitions", "near_strikes", "elsewhere"))
    for figure in ("jumps_per_minute", "pelvis_drops_per_minute"):
        yield f"    {figure}: {_shown_and_captured(smooth[figure])}"
    for kind in ("falls", "rests"):
        if outcome[kind] is None:
            continue
        motion = outcome[kind]["motion"]
        yield from _excesses(f" near transitions into and out of {kind}, and others", motion, tuple(motion))
        for group, figures in motion.items():
            cells = [f"{name} {_shown_and_captured(figures[name])}" for name in ("jumps", "slide_median", "slide_95")]
            yield f"    {group:17} {figures['transitions']:.0f} transitions  {'  '.join(cells)}"


def _methods(group: str, rows: Mapping[str, Any]) -> Iterator[str]:
    yield f"  {group} ({rows['transitions']:.0f} transitions, {rows['of_them_different']:.0f} different)"
    yield f"    {'':24} {'AUC':>7} {'logistic':>8} {'trees':>6}"
    for kind in _METHODS:
        row = rows[kind]
        yield f"    {kind:24} {row['auc']:7.3f} {row['logistic']:8.3f} {row['trees']:6.3f}"


def _shown_and_captured(pair: Mapping[str, Any]) -> str:
    """Return two figures side by side, the second in brackets."""
    own, theirs = (pair[name]["auc"] if isinstance(pair[name], dict) else pair[name] for name in ("shown", "captured"))
    return "      -      " if own is None or theirs is None else f"{own:6.3f} ({theirs:5.3f})"


def _decisions(outcome: Mapping[str, Any]) -> Iterator[str]:
    yield "  AUC of transitions against other decisions, and (of the capture behind them)"
    for length, entry in outcome.items():
        best = _shown_and_captured(entry)
        each = ", ".join(
            f"{name} {_shown_and_captured({side: entry[side][name] for side in ('shown', 'captured')})}"
            for name in entry["shown"]
            if name != "auc"
        )
        yield f"    {length}, {entry['transitions']} and {entry['others']}: {best}; {each}"
        yield f"      of any transitions and decisions, not matched: {_shown_and_captured(entry['unmatched'])}"
        for part, kinds in entry["parts"].items():
            yield f"      {part:8} " + "  ".join(f"{kind} {_shown_and_captured(kinds[kind])}" for kind in KINDS)


def _excesses(where: str, outcome: Mapping[str, Any], groups: tuple[str, ...]) -> Iterator[str]:
    yield f"  frames above the 99.9th percentile of the capture{where} [per mille], and (of the capture behind them)"
    for group in groups:
        for part in PARTS:
            kinds = outcome[group][part]
            cells = "  ".join(f"{kind} {_shown_and_captured(pair)}" for kind, pair in kinds.items())
            yield f"    {group:17} {part:6} {cells}"
