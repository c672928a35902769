"""Tables of falls and rests, and of bodies that lie, for ``docs/quality.md``."""

from __future__ import annotations

from collections.abc import Callable

from _results import NOT_MEASURED, Results, fixed, number, percent, scaled


def _pair(results: Results, kind: str, group: str, *keys: str) -> str:
    """Return a figure of shown motion and, in brackets, that of the capture behind it."""
    own, theirs = (
        results.cell(fixed, "motion_quality", "boxer", kind, "motion", group, *keys, side)
        for side in ("shown", "captured")
    )
    return own if own == theirs == NOT_MEASURED else f"{own} ({theirs})"


def fall_motion(results: Results) -> list[str]:
    """Return how smooth motion is near transitions of falls and near all others of the same fights."""
    return _motion(results, "falls", "into falls and staggers and out of them")


def rest_motion(results: Results) -> list[str]:
    """Return how smooth motion is near transitions of rests and near all others of the same fights."""
    return _motion(results, "rests", "into rests, in them and out of them")


def _motion(results: Results, kind: str, label: str) -> list[str]:

    def cells(*keys: str) -> list[str]:
        return [_pair(results, kind, group, *keys) for group in (kind, "others")]

    rows = [
        [f"{part}, {name} [per mille]", *cells(part, figure)]
        for part in ("legs", "trunk", "arms", "head")
        for figure, name in (("acceleration", "positions"), ("rotation", "rotations"), ("joint", "joints"))
    ]
    rows += [
        ["one-frame jumps of joints in a thousand transitions", *cells("jumps")],
        ["slide of feet on the floor, median [m/s]", *cells("slide_median")],
        ["the same, 95th percentile [m/s]", *cells("slide_95")],
    ]
    header = ["`boxer` (of the capture behind)", label, "other transitions"]
    return results.table(header, rows, "motion_quality")


def lying(results: Results) -> list[str]:
    """Return how bodies that are down meet the floor, feet of others, and one another."""
    centimetres = scaled(100.0, shown=number)
    rows = [
        [label, results.cell(shown, "fights", "lying", key)]
        for label, shown, key in (
            ("lowest point of a body, from the fall to standing [cm]", centimetres, "lowest"),
            ("greatest height of a body's lowest point [cm]", centimetres, "highest"),
            ("frames in which it is more than 1 cm below the floor", percent, "sunk_share"),
            ("frames in which it is more than 1 cm above the floor", percent, "floating_share"),
            ("lying frames in which the axis of a foot of another is inside the body", percent, "trodden_share"),
            ("lying frames in which a foot of another touches the body", percent, "touched_share"),
            ("lying pairs nearer than 2.4 m that are deeper than 6 cm in one another", percent, "overlap_share"),
            ("lying frames in which a body is deeper than 6 cm in another", percent, "overlap_frames_share"),
        )
    ]
    rows += [
        [label, results.cell(shown, "fights", "knock_downs", key)]
        for label, shown, key in (
            ("time from the blow that knocks an avatar down to its fall, median [s]", number, "delay_median"),
            ("the same, 95th percentile [s]", number, "delay_95"),
            ("falls that lead away from the attacker", percent, "away_share"),
        )
    ]
    return results.table(["", "`brawl_last_standing`"], rows, "fights")


def breaks(results: Results) -> list[str]:
    """Return how boxers come to rest between rounds."""
    rows = [
        [label, results.cell(shown, "fights", "breaks", key)]
        for label, shown, key in (
            ("time until a boxer drops its guard, median [s]", number, "seconds"),
            ("breaks in which it never does", percent, "never_share"),
            ("share of the time at ease or dropping the guard", percent, "ease_share"),
        )
    ]
    return results.table(["", "`bout`, breaks of 10 s"], rows, "fights")


FALL_TABLES: dict[str, Callable[[Results], list[str]]] = {
    "fall-motion": fall_motion,
    "rest-motion": rest_motion,
    "lying": lying,
    "breaks": breaks,
}
