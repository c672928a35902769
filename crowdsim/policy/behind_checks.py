"""What the arrays of falls, rests and walks must be: actions behind those of states, all arrays of a kind or none."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from crowdsim.array_checks import ArrayFault, Relation
from crowdsim.core.types import Array
from crowdsim.policy.falls import numbers_of

FALLS = ("falls_fall", "falls_lie", "falls_rise", "falls_stagger")
CHEERS = ("falls_cheer",)
OF_FALLS = (*FALLS, "falls_direction", "falls_stagger_direction")
"""Names of the arrays of ``policy.falls.Falls``, all of which are there or none: numbers of actions, and all."""

OF_CHEERS = (*CHEERS, "falls_cheer_stop")
"""Likewise of celebrations; only where there are falls, and not in older bundles."""

OF_STOPS = ("falls_stop", "falls_stagger_stop")
"""Likewise where falls and staggers are over; only where there are falls, and not in older bundles."""

RESTS = ("rests_enter", "rests_hold", "rests_leave")
OF_RESTS = (*RESTS, "rests_frames", "rests_state", "rests_row", "rests_next")
"""Likewise of ``policy.rests.Rests``."""

WALKS = ("walks_take", "walks_hold")
OF_WALKS = (*WALKS, "walks_spans", "walks_piece", "walks_row", "walks_next")
"""Likewise of ``policy.walks.Walks``; only where there are rests."""


GROUPS = (OF_FALLS, OF_CHEERS, OF_STOPS, OF_RESTS, OF_WALKS)
"""Names of arrays all of which are there or none."""

BEHIND = tuple(name for group in GROUPS for name in group)
"""Names of all of these arrays."""


def relations_behind(arrays: Mapping[str, Array]) -> tuple[Relation, ...]:
    """Return what must be true of the arrays of falls, rests and walks that are there.

    Raises:
        ArrayFault: One of them is there without the others.
    """
    relations: tuple[Relation, ...] = ()
    for what, own, needed, more in (
        ("falls", OF_FALLS, (), _FALLS),
        ("celebrations", OF_CHEERS, OF_FALLS, _CHEERS),
        ("stops of falls", OF_STOPS, OF_FALLS, _STOPS),
        ("rests", OF_RESTS, (), _RESTS),
        ("walks", OF_WALKS, OF_RESTS, _WALKS),
    ):
        some = [name for name in own if name in arrays]
        if some and any(name not in arrays for name in (*own, *needed)):
            raise ArrayFault(some[0], f"is there without the other arrays of {what}, expected all of them or none")
        relations += more if some else ()
    return relations


def count_behind(arrays: Mapping[str, Array]) -> int:
    """Return how many actions of falls, rests and walks there are by these arrays, which need not be right."""
    return sum(arrays[name].size for name in (*FALLS, *CHEERS, *RESTS, *WALKS) if name in arrays)


def frames_of(arrays: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return the control frame on which each action is laid, and its last one. Shapes (A,), int64."""
    first = arrays["graph_action_first"].astype(np.int64)
    return first - 1, first + arrays["graph_action_lengths"] - 1


def _numbered_behind(arrays: Mapping[str, Array]) -> bool:
    fall, lie, rise, stagger = (arrays[name] for name in FALLS)
    numbers = numbers_of(fall, lie, rise, stagger, arrays.get(CHEERS[0], stagger[:0]))
    count = sum(len(arrays[name]) for name in (*RESTS, *WALKS) if name in arrays)
    last = len(arrays["graph_action_next"]) - count
    return np.array_equal(numbers, np.arange(arrays["graph_action_offsets"][-1], last))


def _rest_behind(arrays: Mapping[str, Array]) -> bool:
    numbers = np.concatenate([arrays[name] for name in (*RESTS, *WALKS) if name in arrays])
    last = len(arrays["graph_action_next"])
    return np.array_equal(numbers, np.arange(last - len(numbers), last))


def _rest_in_order(arrays: Mapping[str, Array]) -> Array:
    result: Array = np.all(np.diff(arrays["rests_frames"], axis=1) >= 0, axis=1)
    return result


def _lie_between(arrays: Mapping[str, Array]) -> Array:
    before, last = frames_of(arrays)
    fall, lie, rise = (arrays[f"falls_{name}"] for name in ("fall", "lie", "rise"))
    result: Array = (before[lie] == last[fall]) & (last[lie] <= before[rise])
    return result


_FALLS = (
    Relation("falls_fall", "falls, each with its lie and rise, behind the actions of states", _numbered_behind),
    Relation("falls_lie", "lying between a fall and a rise", _lie_between),
)


def _stands_again(arrays: Mapping[str, Array]) -> Array:
    return _within(arrays, "falls_rise", "falls_stop")


def _has_caught_itself(arrays: Mapping[str, Array]) -> Array:
    return _within(arrays, "falls_stagger", "falls_stagger_stop")


def _within(arrays: Mapping[str, Array], actions: str, stop: str) -> Array:
    before, last = frames_of(arrays)
    result: Array = (before[arrays[actions]] < arrays[stop]) & (arrays[stop] <= last[arrays[actions]])
    return result


def _ends_cheering(arrays: Mapping[str, Array]) -> Array:
    return _within(arrays, "falls_cheer", "falls_cheer_stop")


_CHEERS = (Relation("falls_cheer_stop", "frames of celebrations", _ends_cheering),)

_STOPS = (
    Relation("falls_stop", "frames of rises", _stands_again),
    Relation("falls_stagger_stop", "frames of staggers", _has_caught_itself),
)

_RESTS = (
    Relation("rests_enter", "rests behind the actions of states and falls", _rest_behind),
    Relation("rests_frames", "frames that ascend", _rest_in_order),
)


def _walks_in_order(arrays: Mapping[str, Array]) -> Array:
    spans, frames = arrays["walks_spans"], arrays["rests_frames"]
    result: Array = np.all(np.diff(np.column_stack([spans, frames[:, 2]]), axis=1) >= 0, axis=1)
    return result


def _begin_at_ease(arrays: Mapping[str, Array]) -> Array:
    result: Array = (arrays["walks_piece"] >= 0) & (arrays["walks_piece"] < len(arrays["rests_hold"]))
    return result


def _lead_somewhere(arrays: Mapping[str, Array]) -> Array:
    last = len(arrays["rests_hold"]) + len(arrays["walks_hold"])
    result: Array = (arrays["walks_row"] >= 0) & (arrays["walks_row"] < last)
    return result


def _come_to_an_end(arrays: Mapping[str, Array]) -> Array:
    pieces, following = len(arrays["rests_hold"]), arrays["walks_next"]
    own = pieces + np.arange(len(following))
    result: Array = (following >= 0) & (following < pieces + len(following))
    result &= (following < pieces) | (following > own)
    return result


_WALKS = (
    Relation("walks_spans", "frames that ascend to the one at ease behind them", _walks_in_order),
    Relation("walks_piece", "pieces of rests", _begin_at_ease),
    Relation("walks_row", "parts of walks, or pieces of rests", _lead_somewhere),
    Relation("walks_next", "parts that come later, or pieces of rests", _come_to_an_end),
)
